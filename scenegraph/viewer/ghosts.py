"""What the viewer draws beside the scene: recolored rows, wire frames of hidden rows, lines and faces of overlays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..overlay import Color, Faces, Lines
from ..render.actors import Surface, actor_of, matrix_of, translation_of
from ..render.geometry import Geometry
from ..snapshot import Snapshot

#: Opacity of wires: where many cross, they are still told apart.
_WIRE = 0.3

Mask = NDArray[np.bool_]


class Painting:
    """The rows of a snapshot in colors of its own, as surfaces or as wire frame; made when it is first shown.

    Parameters
    ----------
    snapshot : Snapshot
    renderer : vtkRenderer
    wire : bool
    """

    def __init__(self, snapshot: Snapshot, renderer: Any, *, wire: bool = False) -> None:
        self._snapshot, self._renderer, self._wire = snapshot, renderer, wire
        self._geometry: Geometry | None = None
        self._batches: list[tuple[Any, NDArray[np.uint8], Surface, Any]] = []
        self._instances: list[tuple[Any, Surface, list[Any]]] = []

    def _load(self) -> None:
        self.remove()
        self._geometry = Geometry.shared(self._snapshot)
        for batch in self._geometry.batches:
            colors = np.zeros((len(batch.vertices), 4), np.uint8)
            surface = Surface(batch.vertices, batch.faces.reshape(-1), normals=batch.normals, colors=colors)
            self._batches.append((batch, colors, surface, self._add(surface, translation_of(batch.origin))))
        for entry in self._geometry.instances:
            surface = Surface(entry.vertices, entry.faces.reshape(-1), normals=entry.normals)
            actors = [self._add(surface, matrix_of(matrix)) for matrix in entry.matrices]
            self._instances.append((entry, surface, actors))

    def _add(self, surface: Surface, matrix: Any) -> Any:
        actor = actor_of(surface, matrix)
        style = actor.GetProperty()
        style.SetAmbient(0.45)
        style.SetDiffuse(0.65)
        actor.SetForceOpaque(not self._wire)
        actor.SetForceTranslucent(self._wire)
        if self._wire:
            style.SetRepresentationToWireframe()
            style.SetLighting(False)
            style.SetOpacity(_WIRE)
        actor.SetPickable(False)
        # the camera keeps its distance from the scene, and not from what is drawn to explain it
        actor.SetUseBounds(False)
        self._renderer.AddActor(actor)
        return actor

    def show(self, colors: NDArray[np.floating], visible: Mask, level: NDArray[np.uint8]) -> None:
        """Draw rows at their levels.

        Parameters
        ----------
        colors : (n, 4) float
            In 0..1; opacity is ignored but for 0, which hides.
        visible : (n,) bool
        level : (n,) uint8
        """
        if self._geometry is None or Geometry.shared(self._snapshot) is not self._geometry:
            self._load()
        paint = np.rint(np.clip(colors, 0, 1) * 255).astype(np.uint8)
        visible = visible & (paint[:, 3] > 0)
        paint[:, 3] = 255
        for batch, own, surface, actor in self._batches:
            chosen = batch.chosen(visible, level)
            actor.SetVisibility(bool(chosen.any()))
            own[:] = np.repeat(paint[batch.rows], np.diff(batch.first_vertex), axis=0)
            surface.vertices_changed()
            surface.set_indices(batch.indices(chosen))
        for entry, _, actors in self._instances:
            chosen = entry.chosen(visible, level)
            for actor, wanted, color in zip(actors, chosen.tolist(), paint[entry.rows].tolist(), strict=True):
                actor.SetVisibility(wanted)
                if wanted:
                    actor.GetProperty().SetColor(*(c / 255 for c in color[:3]))

    def hide(self) -> None:
        """Draw nothing."""
        for actor in self._all():
            actor.SetVisibility(False)

    def _all(self) -> list[Any]:
        return [a for *_, a in self._batches] + [a for *_, actors in self._instances for a in actors]

    def remove(self) -> None:
        """Take everything out of the renderer."""
        for actor in self._all():
            self._renderer.RemoveActor(actor)
        self._batches, self._instances = [], []
        self._geometry = None


class Gizmos:
    """Lines and faces of overlays in a renderer."""

    def __init__(self, renderer: Any) -> None:
        self._renderer = renderer
        self._actors: list[Any] = []

    def show(self, lines: Sequence[Lines], faces: Sequence[Faces]) -> None:
        """Draw these instead of what was drawn before."""
        self.clear()
        for line in lines:
            if len(line.ends):
                count = len(line.ends)
                self._add(line.ends.reshape(-1, 3), np.arange(2 * count), 2, line.color, line.width, 1.0)
        for face in faces:
            if len(face.triangles):
                self._add(face.points, np.asarray(face.triangles).reshape(-1), 3, face.color, 1.0, face.opacity)

    def _add(
        self, points: NDArray[np.float64], index: Any, corners: int, color: Color, width: float, opacity: float
    ) -> None:
        from vtkmodules.util.numpy_support import numpy_to_vtk
        from vtkmodules.vtkCommonCore import vtkPoints
        from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
        from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper

        origin = np.asarray(points.mean(axis=0), np.float64)
        convert: Any = numpy_to_vtk
        place, cells, data = vtkPoints(), vtkCellArray(), vtkPolyData()
        place.SetData(convert(np.ascontiguousarray(points - origin, np.float32), deep=True))
        cells.SetData(corners, convert(np.ascontiguousarray(index, np.int32), deep=True))
        data.SetPoints(place)
        (data.SetLines if corners == 2 else data.SetPolys)(cells)
        mapper, actor = vtkPolyDataMapper(), vtkActor()
        mapper.SetInputData(data)
        actor.SetMapper(mapper)
        actor.SetUserMatrix(translation_of(origin))
        style = actor.GetProperty()
        style.SetColor(*color)
        style.SetLineWidth(width)
        style.SetOpacity(opacity)
        style.SetLighting(False)
        actor.SetPickable(False)
        actor.SetUseBounds(False)
        self._renderer.AddActor(actor)
        self._actors.append(actor)

    def clear(self) -> None:
        """Draw nothing."""
        for actor in self._actors:
            self._renderer.RemoveActor(actor)
        self._actors = []
