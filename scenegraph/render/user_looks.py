"""What actors of a user must share to be drawn by one call, and their triangles as VTK's mapper uploads them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..exchange.vtk_data import mapped_colors
from .layout import F32, F64, I32, I64, U8, spread

#: Actors with more triangles are drawn on their own: a copy of their vertices costs more than a call.
_HEAVY = 2000
_FLAT, _SURFACE, _BYTES = 0, 2, 3
_MAPPERS = ("vtkDataSetMapper", "vtkOpenGLPolyDataMapper", "vtkPolyDataMapper")


@dataclass(frozen=True)
class Shape:
    """A data set as VTK's mapper uploads it.

    Attributes
    ----------
    vertices : (v, 3) float32
    faces : (t, 3) int32
    normals : (v, 3) float32 or None
    colors : (v, 4) uint8 or None
    to_model : (4, 4) float64
        Undoes the shift and the scale; transposed, as VTK keeps its matrices.
    low, high : (3,) float64
    """

    vertices: F32
    faces: I32
    normals: F32 | None
    colors: U8 | None
    to_model: F64
    low: F64
    high: F64


def is_surface(actor: Any) -> bool:
    """Whether an actor is an opaque surface and no more: no edges, no clipping planes, no shaders of its own."""
    style, mapper, keys = actor.GetProperty(), actor.GetMapper(), actor.GetPropertyKeys()
    return not (
        style.GetRepresentation() != _SURFACE
        or style.GetOpacity() < 1
        or style.GetEdgeVisibility()
        or style.GetVertexVisibility()
        or style.GetNumberOfTextures()
        or actor.GetForceTranslucent()
        or (keys is not None and keys.GetNumberOfKeys())
        or actor.GetCoordinateSystem()
        or actor.GetShaderProperty().GetNumberOfShaderReplacements()
        or mapper.GetClassName() not in _MAPPERS
        or mapper.GetClippingPlanes() is not None
        or mapper.GetResolveCoincidentTopology()
    )


def look_of(actor: Any) -> tuple[Any, ...] | None:
    """What actors must share to be drawn by one call, their color excepted; None for one that is drawn on its own."""
    style, mapper = actor.GetProperty(), actor.GetMapper()
    if (
        not is_surface(actor)
        or style.GetInterpolation() > 2
        or style.GetAmbientColor() != style.GetDiffuseColor()
        or actor.GetTexture() is not None
        or actor.GetBackfaceProperty() is not None
    ):
        return None
    data = mapper.GetInputDataObject(0, 0)
    if data is None or not data.IsA("vtkPolyData"):
        return None
    cells = data.GetCellData()
    if cells.GetNormals() is not None or data.HasAnyGhostCells() or not _is_plain(mapper, data):
        return None
    interpolation, specular = style.GetInterpolation(), style.GetSpecular()
    if specular and (style.GetSpecularColor() != style.GetDiffuseColor() or mapper.GetScalarVisibility()):
        return None
    return (
        interpolation,
        interpolation != _FLAT and data.GetPointData().GetNormals() is not None,
        style.GetAmbient(),
        style.GetDiffuse(),
        specular,
        style.GetSpecularPower(),
        style.GetLighting(),
        style.GetBackfaceCulling(),
        style.GetFrontfaceCulling(),
    )


def _is_plain(mapper: Any, data: Any) -> bool:
    """Whether a mapper takes the color of the property, or opaque colors that the points have."""
    if not mapper.GetScalarVisibility():
        return True
    points, mode = data.GetPointData(), mapper.GetScalarMode()
    if mode == 0 and points.GetScalars() is None and data.GetCellData().GetScalars() is None:
        return True
    array = (
        points.GetScalars() if mode in (0, 1) else points.GetArray(mapper.GetArrayName() or "") if mode == 3 else None
    )
    if array is None or array.GetDataType() != _BYTES or array.GetNumberOfComponents() not in (3, 4):
        return False
    return array.GetNumberOfComponents() == 3 or bool((_numpy(array)[:, 3] == 255).all())


def colors_of(mapper: Any, data: Any) -> U8 | None:
    """(v, 4) colors of the points; None where the property gives the color."""
    colors, _ = mapped_colors(mapper, data) if mapper.GetScalarVisibility() else (None, False)
    return colors


def array_name(mapper: Any) -> str | None:
    """Name of what gives colors, as different actors may show different arrays of the same data."""
    return f"{mapper.GetScalarMode()} {mapper.GetArrayName()}" if mapper.GetScalarVisibility() else None


def shape_of(data: Any, with_normals: bool, colors: U8 | None) -> Shape | None:
    """The triangles of a `vtkPolyData`; None if it is heavy, empty, or has lines or points to draw."""
    polygons = data.GetPolys()
    if data.GetNumberOfVerts() or data.GetNumberOfLines() or data.GetNumberOfStrips() or data.GetPoints() is None:
        return None
    corners = polygons.GetNumberOfConnectivityIds()
    if not 0 < corners - 2 * polygons.GetNumberOfCells() <= _HEAVY:
        return None
    points = _numpy(data.GetPoints().GetData())
    if points.dtype.kind != "f" or not np.isfinite(points).all():
        return None
    normals = _numpy(data.GetPointData().GetNormals()).astype(np.float32) if with_normals else None
    low, high = points.min(axis=0).astype(np.float64), points.max(axis=0).astype(np.float64)
    to_model = np.eye(4)
    size, middle = high - low, 0.5 * (high + low)
    extent, away = float((size * size).sum()), float((middle * middle).sum())
    if (extent > 0 and (away / extent > 1e6 or abs(np.log10(extent)) > 3)) or (extent == 0 and away > 1e6):
        scale = 1 / np.where(size > 0, size, 1.0)
        points = (points - middle) * scale
        to_model = np.diag([*(1 / scale), 1.0])
        to_model[3, :3] = middle
    faces = _fans(_numpy(polygons.GetOffsetsArray()), _numpy(polygons.GetConnectivityArray()))
    return Shape(points.astype(np.float32), faces, normals, colors, to_model, low, high)


def _fans(offsets: I64, connectivity: I64) -> I32:
    """(t, 3) polygons divided as VTK divides them: into a fan from their first corner."""
    sizes = np.diff(offsets)
    if (sizes == 3).all():
        return connectivity.reshape(-1, 3).astype(np.int32)
    counts = np.maximum(sizes - 2, 0)
    first = np.repeat(offsets[:-1], counts)
    second = spread(offsets[:-1] + 1, counts)
    return np.stack([connectivity[first], connectivity[second], connectivity[second + 1]], axis=1).astype(np.int32)


def _numpy(array: Any) -> NDArray[Any]:
    from vtkmodules.util import numpy_support

    convert: Any = numpy_support.vtk_to_numpy
    return np.asarray(convert(array))
