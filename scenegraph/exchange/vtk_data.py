"""VTK data sets as triangle arrays. Works on the VTK interface alone, so any version of pyvista will do."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .materials import Look, as_rgba, plain_if_equal, rgba8

#: Name under which colors travel through VTK's filters.
_COLORS = "scenegraph colors"


@cache
def vtk_module(name: str) -> Any:
    """A module of VTK, imported when it is needed: that is slow, and most scenes come from files."""
    return import_module(f"vtkmodules.{name}")


def to_numpy(array: Any) -> NDArray[np.generic]:
    """A VTK array as numpy, without copying."""
    return np.asarray(vtk_module("util.numpy_support").vtk_to_numpy(array))


@dataclass(frozen=True)
class Surface:
    """Triangles of a data set."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    normals: NDArray[np.generic] | None
    look: Look


def surface_of(
    data: Any,
    *,
    colors: NDArray[np.uint8] | None = None,
    cell_colors: bool = False,
    normals: bool = True,
) -> Surface:
    """The triangles of a `vtkDataSet`: its own, or those of its outer surface if it is a volume or grid.

    Parameters
    ----------
    data : vtkDataSet
    colors : (n, 4) uint8, optional
        One per point or cell of `data`.
    cell_colors : bool
        Whether `colors` are per cell.
    normals : bool
        Whether to take the point normals, if there are any.
    """
    carried = colors is not None and not _is_triangles(data)
    if colors is not None and carried:
        # the filters take them along
        copy = data.NewInstance()
        copy.ShallowCopy(data)
        array = vtk_module("util.numpy_support").numpy_to_vtk(np.ascontiguousarray(colors), deep=True)
        array.SetName(_COLORS)
        (copy.GetCellData() if cell_colors else copy.GetPointData()).AddArray(array)
        data = copy
    if not data.IsA("vtkPolyData"):
        data = _filtered(vtk_module("vtkFiltersGeometry").vtkDataSetSurfaceFilter(), data)
    polys, before = data.GetPolys(), data.GetVerts().GetNumberOfCells() + data.GetLines().GetNumberOfCells()
    if not _is_triangles(data):
        triangulate = vtk_module("vtkFiltersCore").vtkTriangleFilter()
        triangulate.PassVertsOff()
        triangulate.PassLinesOff()
        data = _filtered(triangulate, data)
        polys, before = data.GetPolys(), 0
    faces = to_numpy(polys.GetConnectivityArray()).reshape(-1, 3).astype(np.int64)
    points = data.GetPoints()
    vertices = np.zeros((0, 3)) if points is None else to_numpy(points.GetData()).astype(np.float64)
    point_data, cell_data = data.GetPointData(), data.GetCellData()
    found = point_data.GetNormals() if normals else None
    uv = point_data.GetTCoords()
    look = Look(uv=None if uv is None or uv.GetNumberOfComponents() < 2 else to_numpy(uv)[:, :2].astype(np.float32))
    if colors is not None:
        mapped = to_numpy((cell_data if cell_colors else point_data).GetArray(_COLORS)) if carried else colors
        if cell_colors:
            look = replace(look, face_colors=rgba8(mapped[before : before + len(faces)]))
        else:
            look = replace(look, vertex_colors=rgba8(mapped))
        plain = plain_if_equal(look)
        look = replace(plain, uv=look.uv)
    return Surface(vertices, faces, None if found is None else to_numpy(found), look)


def _is_triangles(data: Any) -> bool:
    """Whether a data set's polygons are triangles already, and need no filter."""
    if not data.IsA("vtkPolyData") or data.GetStrips().GetNumberOfCells():
        return False
    return data.GetPolys().IsHomogeneous() in (0, 3)


def _filtered(algorithm: Any, data: Any) -> Any:
    algorithm.SetInputData(data)
    algorithm.Update()
    return algorithm.GetOutput()


def own_colors(data: Any) -> tuple[NDArray[np.uint8] | None, bool]:
    """Colors that a data set carries itself (8-bit scalars of 3 or 4 components), and whether they are per cell."""
    for per_cell, attributes in ((False, data.GetPointData()), (True, data.GetCellData())):
        array = attributes.GetScalars()
        if array is not None and array.IsA("vtkUnsignedCharArray") and array.GetNumberOfComponents() in (3, 4):
            return rgba8(to_numpy(array)), per_cell
    return None, False


def field_color(data: Any) -> tuple[float, float, float, float] | None:
    """The base color that `to_multiblock` stores in the field data."""
    array = data.GetFieldData().GetArray("color")
    if array is None or array.GetNumberOfValues() not in (3, 4):
        return None
    return as_rgba(to_numpy(array).reshape(-1))


def mapped_colors(mapper: Any, data: Any) -> tuple[NDArray[np.uint8] | None, bool]:
    """What a mapper's lookup table makes of the scalars of `data`, and whether that is per cell."""
    if not mapper.GetScalarVisibility():
        return None, False
    core = vtk_module("vtkCommonCore")
    flag = core.reference(0)
    array = mapper.GetScalars(
        data, mapper.GetScalarMode(), mapper.GetArrayAccessMode(), mapper.GetArrayId(), mapper.GetArrayName(), flag
    )
    if array is None or int(flag) not in (0, 1):
        return None, False
    table = mapper.GetLookupTable()
    table.Build()
    if not mapper.GetUseLookupTableScalarRange():  # as the mapper itself does when it draws, but on a copy
        copy = table.NewInstance()
        copy.DeepCopy(table)
        copy.SetRange(mapper.GetScalarRange())
        if hasattr(copy, "BuildSpecialColors"):  # those beyond the range are not copied
            copy.BuildSpecialColors()
        table = copy
    colors = table.MapScalars(array, mapper.GetColorMode(), mapper.GetArrayComponent())
    return (None if colors is None else rgba8(to_numpy(colors))), bool(int(flag))


def texture_of(actor: Any) -> NDArray[np.uint8] | None:
    """(h, w, 3 or 4) uint8 image of an actor's texture, top row first."""
    texture = actor.GetTexture()
    if texture is None:
        return None
    if (source := texture.GetInputAlgorithm()) is not None:
        source.Update()
    image = texture.GetInput()
    scalars = None if image is None else image.GetPointData().GetScalars()
    if scalars is None or not scalars.IsA("vtkUnsignedCharArray"):
        return None
    width, height, _ = image.GetDimensions()
    array = to_numpy(scalars).reshape(height, width, -1)[::-1]
    if array.shape[2] < 3:
        array = np.repeat(array[:, :, :1], 3, axis=2)
    return np.ascontiguousarray(array[:, :, :4])


def children_of(blocks: Any) -> list[tuple[str, Any]]:
    """Names and members of a composite data set; members that are not set are left out."""
    model = vtk_module("vtkCommonDataModel")
    if not blocks.IsA("vtkMultiBlockDataSet"):
        blocks = _filtered(vtk_module("vtkFiltersCore").vtkConvertToMultiBlockDataSet(), blocks)
    out = []
    for index in range(blocks.GetNumberOfBlocks()):
        block = blocks.GetBlock(index)
        if block is None:
            continue
        key = model.vtkCompositeDataSet.NAME()
        known = blocks.HasMetaData(index) and blocks.GetMetaData(index).Has(key)
        out.append((blocks.GetMetaData(index).Get(key) if known else f"block {index}", block))
    return out
