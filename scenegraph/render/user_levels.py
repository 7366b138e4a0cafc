"""Coarser levels of a user's actors: drawn in their places for the time of a frame, and dressed as they are.

A level shares its actor's property, so that light, shading and edits of the color are the same. Colors that are mapped
from scalars are taken over once, with the levels. An actor that is colored otherwise since is drawn as it is, as are
those whose picture is more than their surface: edges, points, clipping planes, shaders of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .actors import Surface, actor_of, matrix_of
from .bake import Part, centered, ready_parts, without_lost_corners
from .layout import I64, Mask
from .user_looks import is_surface

if TYPE_CHECKING:
    from ..frame import Frame
    from ..mesh import Mesh
    from ..snapshot import Snapshot


class UserLevels:
    """The coarser levels of some actors.

    Parameters
    ----------
    actors : sequence of vtkActor
    row_of_actor : (a,) int64
        The row that each actor is; -1 for those that are several, or must not be exchanged.

    Attributes
    ----------
    row : (a,) int64
        As given.
    """

    def __init__(self, actors: Sequence[Any], row_of_actor: I64) -> None:
        self._actors, self.row = actors, row_of_actor
        self._refused: Mask = row_of_actor < 0
        self._coloring: dict[int, tuple[Any, ...]] = {}
        self._made = np.full((len(actors), 0), None, object)
        self._surfaces: dict[int, tuple[Mesh, Part, Surface]] = {}

    def leave(self, index: int) -> None:
        """An actor was edited: if its levels have other colors now, draw it as it is from now on."""
        if index in self._coloring and coloring_of(self._actors[index]) != self._coloring[index]:
            self._refused[index] = True

    def coarse(self, frame: Frame) -> tuple[I64, list[Any]]:
        """Actors of which a coarser level is drawn, and what is drawn instead of each."""
        level = frame.level
        if not level.any():
            return np.zeros(0, np.int64), []
        level = np.where(self._refused, 0, level[self.row])
        index = np.flatnonzero(level)
        if self._made.shape[1] < frame.snapshot.level_meshes.shape[1]:
            self._made = np.full((len(self._actors), frame.snapshot.level_meshes.shape[1]), None, object)
        found = self._made[index, level[index]]
        for at in np.flatnonzero(found == None).tolist():  # noqa: E711 - of each
            found[at] = self._make(int(index[at]), int(level[index[at]]), frame.snapshot)
        kept = ~self._refused[index]
        return index[kept], found[kept].tolist()

    def _make(self, index: int, level: int, snapshot: Snapshot) -> Any:
        actor, row = self._actors[index], int(self.row[index])
        number = int(snapshot.level_meshes[row, level])
        coloring = coloring_of(actor)
        if number < 0 or coloring is None:
            self._refused[index] = True
            return None
        self._coloring.setdefault(index, coloring)
        mesh, part, surface = self._surface(snapshot.meshes[number])
        if (actor.GetTexture() is not None) != (part.uv is not None) or part.translucent:
            self._refused[index] = True
            return None
        center = mesh.bounds.mean(axis=0)
        place = centered(snapshot.transforms[snapshot.transform_index[row]][None], center)[0]
        made = actor_of(surface, matrix_of(place))
        made.SetProperty(actor.GetProperty())
        made.SetBackfaceProperty(actor.GetBackfaceProperty())
        made.SetTexture(actor.GetTexture())
        made.ForceOpaqueOn()
        made.PickableOff()
        self._made[index, level] = made
        return made

    def _surface(self, mesh: Mesh) -> tuple[Mesh, Part, Surface]:
        """What actors with the same level share."""
        if id(mesh) not in self._surfaces:
            (part,), _ = ready_parts([mesh])
            vertices, faces = without_lost_corners(part.vertices - mesh.bounds.mean(axis=0), part.faces)
            surface = Surface(
                vertices,
                np.ascontiguousarray(faces).reshape(-1),
                normals=part.normals,
                uv=part.uv,
                colors=part.colors,
            )
            # holds the mesh, so that its number names no other
            self._surfaces[id(mesh)] = mesh, part, surface
        return self._surfaces[id(mesh)]

    def release(self, window: Any) -> None:
        """Give back what is loaded into the GPU."""
        if window is not None:
            for actor in self._made[self._made != None].tolist():  # noqa: E711 - of each
                actor.ReleaseGraphicsResources(window)


def coloring_of(actor: Any) -> tuple[Any, ...] | None:
    """What decides the colors of an actor beside its property; None if it is more than a surface with colors."""
    if not is_surface(actor):
        return None
    mapper = actor.GetMapper()
    data = mapper.GetInputDataObject(0, 0)
    if data.IsA("vtkPolyData") and (data.GetNumberOfVerts() or data.GetNumberOfLines()):
        return None
    if not mapper.GetScalarVisibility():
        return ()
    table = mapper.GetLookupTable()
    return (
        mapper.GetScalarMode(),
        mapper.GetColorMode(),
        mapper.GetArrayName(),
        mapper.GetScalarRange(),
        None if table is None else (table.GetAddressAsString(""), table.GetMTime()),
    )
