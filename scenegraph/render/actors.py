"""VTK objects made from arrays: the only place that knows how VTK wants them.

VTK's arrays borrow the memory of NumPy's; each object here holds what it lends.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .layout import F64, I32, I64, U8, Batch, Instances, Mask, Material


class Materials:
    """Properties and textures that actors share; ambient light keeps what the lamp does not reach from being black."""

    def __init__(self, textures: Sequence[U8]) -> None:
        self._textures = [texture_of(image) for image in textures]
        self._properties: dict[tuple[int, ...], Any] = {}

    def dress(self, actor: Any, material: Material, color: Sequence[int] = (255, 255, 255, 255)) -> None:
        """Give an actor its property, texture and pass."""
        key = tuple(int(c) for c in color)
        if key not in self._properties:
            self._properties[key] = property_of(key)
        actor.SetProperty(self._properties[key])
        actor.SetTexture(self._textures[material.texture] if material.texture >= 0 else None)
        # the pass is known; left alone, VTK reads all vertex colors to find it out
        actor.SetForceTranslucent(material.translucent)
        actor.SetForceOpaque(not material.translucent)


def borrowed(array: NDArray[np.generic], *, copy: bool = False) -> Any:
    """A VTK array over the memory of a NumPy array, which must outlive it unless `copy`."""
    from vtkmodules.util import numpy_support

    convert: Any = numpy_support.numpy_to_vtk
    return convert(array, deep=copy)


def property_of(color: Sequence[int]) -> Any:
    """A `vtkProperty` of one color (bytes, RGBA)."""
    from vtkmodules.vtkRenderingCore import vtkProperty

    made = vtkProperty()
    made.SetColor(*(c / 255 for c in color[:3]))
    made.SetOpacity(color[3] / 255)
    made.SetAmbient(0.4)
    made.SetDiffuse(0.7)
    return made


def texture_of(image: U8) -> Any:
    """A `vtkTexture` of an image whose row 0 is the top."""
    from vtkmodules.vtkCommonDataModel import vtkImageData
    from vtkmodules.vtkRenderingCore import vtkTexture

    height, width, channels = image.shape
    data = vtkImageData()
    data.SetDimensions(width, height, 1)
    data.GetPointData().SetScalars(borrowed(image[::-1].reshape(-1, channels), copy=True))
    made = vtkTexture()
    made.SetInputData(data)
    made.InterpolateOn()
    made.MipmapOn()
    made.RepeatOn()
    return made


def matrix_of(matrix: F64) -> Any:
    """A `vtkMatrix4x4`."""
    from vtkmodules.vtkCommonMath import vtkMatrix4x4

    made = vtkMatrix4x4()
    made.DeepCopy(matrix.ravel().tolist())
    return made


def translation_of(origin: F64) -> Any:
    """A `vtkMatrix4x4` that moves by `origin`, in float64 as all of VTK's matrices."""
    matrix = np.eye(4)
    matrix[:3, 3] = origin
    return matrix_of(matrix)


class Surface:
    """A `vtkPolyData` over borrowed arrays, with its mapper.

    Parameters
    ----------
    vertices, normals, uv, colors
        As in `Batch`; None where there is none.
    indices : (3 t,) int32
    """

    def __init__(
        self,
        vertices: NDArray[np.float32],
        indices: I32,
        *,
        normals: NDArray[np.float32] | None = None,
        uv: NDArray[np.float32] | None = None,
        colors: U8 | None = None,
    ) -> None:
        from vtkmodules.vtkCommonCore import vtkPoints
        from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
        from vtkmodules.vtkRenderingCore import vtkPolyDataMapper

        self._lent: list[Any] = [vertices, normals, uv, colors]
        self._points = vtkPoints()
        self._points.SetData(borrowed(vertices))
        self._cells = vtkCellArray()
        self.data: Any = vtkPolyData()
        self.data.SetPoints(self._points)
        self.data.SetPolys(self._cells)
        point_data = self.data.GetPointData()
        if normals is not None:
            point_data.SetNormals(borrowed(normals))
        if uv is not None:
            point_data.SetTCoords(borrowed(uv))
        if colors is not None:
            point_data.SetScalars(borrowed(colors))
        self.mapper: Any = vtkPolyDataMapper()
        self.mapper.SetInputData(self.data)
        self.mapper.SetScalarVisibility(colors is not None)
        self.mapper.SetColorModeToDirectScalars()
        # vertices are near their own origin already, and the same bits must be drawn whatever they are grouped with
        self.mapper.SetVBOShiftScaleMethod(0)
        self.set_indices(indices)

    def set_indices(self, indices: I32) -> None:
        """Exchange the triangles; nothing but the index buffer is uploaded again."""
        array = borrowed(indices)
        self._cells.SetData(3, array)
        self._cells.Modified()
        self._lent_indices = indices, array

    def vertices_changed(self) -> None:
        """Vertices, normals or colors were rewritten in place."""
        self._points.GetData().Modified()
        self._points.Modified()
        point_data = self.data.GetPointData()
        for array in (point_data.GetNormals(), point_data.GetScalars()):
            if array is not None:
                array.Modified()
        self.data.Modified()


def actor_of(surface: Surface, matrix: Any) -> Any:
    """A `vtkActor` at a place."""
    from vtkmodules.vtkRenderingCore import vtkActor

    made = vtkActor()
    made.SetMapper(surface.mapper)
    made.SetUserMatrix(matrix)
    return made


class BatchActor:
    """One actor for all items of a batch; the visible ones are chosen by exchanging its indices."""

    def __init__(self, batch: Batch, materials: Materials) -> None:
        self.batch = batch
        self._chosen: Mask = np.ones(len(batch.rows), bool)
        self._last: tuple[Mask, I32] | None = None
        self.surface = Surface(
            batch.vertices, batch.faces.reshape(-1), normals=batch.normals, uv=batch.uv, colors=batch.colors
        )
        self.actors = [actor_of(self.surface, translation_of(batch.origin))]
        materials.dress(self.actors[0], batch.material)

    def show(self, chosen: Mask) -> None:
        """Draw these items and no others."""
        if np.array_equal(chosen, self._chosen):
            return
        self._chosen = chosen
        any_chosen = bool(chosen.any())
        if any_chosen:
            self.surface.set_indices(self._indices(chosen))
        self.actors[0].SetVisibility(any_chosen)

    def _indices(self, chosen: Mask) -> I32:
        if chosen.all():
            return self.batch.indices(chosen)
        # in a live window all rows are put back after each frame, and most frames choose what the one before chose
        if self._last is None or not np.array_equal(self._last[0], chosen):
            self._last = chosen, self.batch.indices(chosen)
        return self._last[1]

    def changed(self, items: I64) -> None:
        """The batch was rewritten in place."""
        self.surface.vertices_changed()
        # a mirrored item has its corners in another order
        self._last = None
        if self._chosen.any():
            self.surface.set_indices(self._indices(self._chosen))


class ItemActors:
    """One actor and mapper per item of a batch: what a program without this package has."""

    def __init__(self, batch: Batch, materials: Materials) -> None:
        self.batch = batch
        self._chosen: Mask = np.ones(len(batch.rows), bool)
        self._materials = materials
        self._place = translation_of(batch.origin)
        self._surfaces = [self._surface(i) for i in range(len(batch.rows))]
        self.actors = [actor_of(surface, self._place) for surface in self._surfaces]
        for actor in self.actors:
            materials.dress(actor, batch.material)

    def _surface(self, item: int) -> Surface:
        batch = self.batch
        v = slice(int(batch.first_vertex[item]), int(batch.first_vertex[item + 1]))
        normals = None if batch.normals is None else batch.normals[v]
        uv = None if batch.uv is None else batch.uv[v]
        return Surface(batch.vertices[v], self._indices(item), normals=normals, uv=uv, colors=batch.colors[v])

    def _indices(self, item: int) -> I32:
        batch = self.batch
        faces = batch.faces[int(batch.first_triangle[item]) : int(batch.first_triangle[item + 1])]
        return faces.reshape(-1) - np.int32(batch.first_vertex[item])

    def show(self, chosen: Mask) -> None:
        """Draw these items and no others."""
        self._chosen = show_actors(self.actors, self._chosen, chosen)

    def changed(self, items: I64) -> None:
        """These items were rewritten in place."""
        for item in items.tolist():
            self._surfaces[item].vertices_changed()
            self._surfaces[item].set_indices(self._indices(item))


class InstanceActors:
    """One actor per item of a heavy mesh, all with one mapper."""

    def __init__(self, entry: Instances, materials: Materials) -> None:
        self.entry = entry
        self._materials = materials
        self._chosen: Mask = np.ones(len(entry.rows), bool)
        faces = entry.faces.reshape(-1)
        self.surface = Surface(entry.vertices, faces, normals=entry.normals, uv=entry.uv, colors=entry.vertex_colors)
        self.actors = [actor_of(self.surface, matrix_of(m)) for m in entry.matrices]
        for actor, color in zip(self.actors, entry.colors.tolist(), strict=True):
            materials.dress(actor, entry.material, color)

    def show(self, chosen: Mask) -> None:
        """Draw these items and no others."""
        self._chosen = show_actors(self.actors, self._chosen, chosen)

    def changed(self, items: I64) -> None:
        """These items have new matrices or colors."""
        for item in items.tolist():
            self.actors[item].SetUserMatrix(matrix_of(self.entry.matrices[item]))
            self._materials.dress(self.actors[item], self.entry.material, self.entry.colors[item].tolist())


def show_actors(actors: Sequence[Any], before: Mask, now: Mask) -> Mask:
    """Switch the actors whose state differs, and return `now`."""
    for index in np.flatnonzero(before != now).tolist():
        actors[index].SetVisibility(bool(now[index]))
    return now
