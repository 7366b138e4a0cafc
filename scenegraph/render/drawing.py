"""A snapshot in a VTK renderer: all rows are loaded once, and every frame says which of them are drawn.

Merged batches are the fast way: a new visible set costs a copy of its triangle indices. `SetBlockVisibility` of VTK's
composite mapper rebuilds its batch and is never used. The choice was measured by `tests/bench/bench_drawing.py`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from .actors import BatchActor, InstanceActors, ItemActors, Materials, Surface, actor_of, matrix_of
from .bake import centered, quantized
from .geometry import HEAVY_TRIANGLES, Geometry
from .layout import F64, U8, Batch, Instances, Mask, Material

if TYPE_CHECKING:
    from ..frame import Frame, StandIn
    from ..mesh import Mesh
    from ..snapshot import Snapshot

Mode = Literal["auto", "batches", "actors"]
#: Stand-ins of earlier frames that are kept loaded.
_STANDINS_KEPT = 256


class Drawing:
    """The rows of a snapshot in a renderer.

    Parameters
    ----------
    snapshot : Snapshot
    renderer : vtkRenderer
    mode : "auto", "batches" or "actors"
        One actor per batch of merged rows, or one per row, as a program without this package has it. "auto" is
        "batches": they were faster at every number of rows measured, from 1.3 times at 100 to 20 times at 10 000. The
        pictures are the same, pixel by pixel.
    heavy : int
        Meshes with at least so many triangles get an actor per row in either mode.

    Attributes
    ----------
    mode : "batches" or "actors"
    """

    def __init__(self, snapshot: Snapshot, renderer: Any, *, mode: Mode = "auto", heavy: int = HEAVY_TRIANGLES) -> None:
        self.snapshot = snapshot
        self.renderer = renderer
        self._heavy = heavy
        self.mode: Literal["batches", "actors"] = "actors" if mode == "actors" else "batches"
        self._load()

    def _load(self) -> None:
        self.geometry = Geometry.shared(self.snapshot, heavy=self._heavy)
        self._generation = self.geometry.generation
        self._n = self.snapshot.n
        materials = Materials(self.geometry.textures)
        kind = ItemActors if self.mode == "actors" else BatchActor
        self._batches: list[ItemActors | BatchActor] = [kind(batch, materials) for batch in self.geometry.batches]
        self._instances = [InstanceActors(entry, materials) for entry in self.geometry.instances]
        self._standins: dict[int, _StandInActor] = {}
        for group in [*self._batches, *self._instances]:
            for actor in group.actors:
                self.renderer.AddActor(actor)
        self.restore()

    def apply(self, frame: Frame) -> None:
        """Draw what a frame leaves: its visible rows at their levels, and its stand-ins."""
        self.show(frame.visible, frame.level, frame.standins)

    def restore(self) -> None:
        """Show all rows at their finest level, so that bounds and pickers know nothing of what was hidden."""
        self.show(np.ones(self._n, bool))

    def show(self, visible: Mask, level: U8 | None = None, standins: Iterable[StandIn] = ()) -> None:
        """Draw these rows.

        Parameters
        ----------
        visible : (n,) bool
        level : (n,) uint8, optional
            Level of each row; the finest by default.
        standins : iterable of StandIn
        """
        if len(visible) != self._n:
            raise ValueError(f"show: a mask of {len(visible)} for {self._n} rows; call sync() after edits")
        levels = np.zeros(self._n, np.uint8) if level is None else level
        for batch, group in zip(self.geometry.batches, self._batches, strict=True):
            group.show(batch.chosen(visible, levels))
        for entry, actors in zip(self.geometry.instances, self._instances, strict=True):
            actors.show(entry.chosen(visible, levels))
        self._show_standins(list(standins))

    def _show_standins(self, standins: list[StandIn]) -> None:
        wanted: dict[int, list[F64]] = {}
        meshes: dict[int, Mesh] = {}
        for standin in standins:
            wanted.setdefault(id(standin.mesh), []).append(standin.matrix)
            meshes[id(standin.mesh)] = standin.mesh
        for key, mesh in meshes.items():
            # taken out and put back: the order of the dict is the order of last use
            loaded = self._standins.pop(key, None) or _StandInActor(mesh, self.renderer)
            self._standins[key] = loaded
        for key, loaded in self._standins.items():
            loaded.show(wanted.get(key, []))
        for key in list(self._standins)[: max(0, len(self._standins) - max(_STANDINS_KEPT, len(wanted)))]:
            self._standins.pop(key).remove()

    def sync(self) -> None:
        """Follow the snapshot after its own `sync()`; what moved is rewritten in place, everything is shown again."""
        if Geometry.shared(self.snapshot, heavy=self._heavy) is not self.geometry:
            self.remove()
            self._load()
            return
        groups: list[BatchActor | ItemActors | InstanceActors] = [*self._batches, *self._instances]
        sources: list[Batch | Instances] = [*self.geometry.batches, *self.geometry.instances]
        for source, group in zip(sources, groups, strict=True):
            items = np.flatnonzero(source.changed_at > self._generation)
            if len(items):
                group.changed(items)
        self._generation = self.geometry.generation

    def drawn_by_vtk(self) -> Mask:
        """(n,) rows that VTK's own culler let through in the last frame; needs the mode "actors".

        Raises
        ------
        ValueError
            In the mode "batches" VTK sees no rows.
        """
        if self.mode != "actors":
            raise ValueError("VTK's culler decides about actors; make the Drawing with mode='actors'")
        drawn = np.zeros(self.snapshot.n, bool)
        for group in [*self._batches, *self._instances]:
            rows = (group.entry if isinstance(group, InstanceActors) else group.batch).rows
            kept = [a.GetVisibility() and a.GetRenderTimeMultiplier() > 0 for a in group.actors]
            drawn[rows[np.array(kept, bool)]] = True
        return drawn

    @property
    def actor_count(self) -> int:
        """Number of actors in the renderer."""
        return sum(len(group.actors) for group in [*self._batches, *self._instances]) + len(self._standins)

    @property
    def memory(self) -> int:
        """Bytes of the arrays that are drawn from; VTK uploads a copy to the GPU."""
        return self.geometry.nbytes

    def remove(self) -> None:
        """Take everything out of the renderer."""
        for group in [*self._batches, *self._instances]:
            for actor in group.actors:
                self.renderer.RemoveActor(actor)
        for standin in self._standins.values():
            standin.remove()
        self._standins.clear()
        self._batches, self._instances = [], []


class _StandInActor:
    """One stand-in mesh, at any number of places."""

    def __init__(self, mesh: Mesh, renderer: Any) -> None:
        from .bake import ready_parts

        # held, because the mesh is known by its identity
        self.mesh = mesh
        self._renderer = renderer
        (part,), textures = ready_parts([mesh])
        self._center = part.vertices.min(axis=0) / 2 + part.vertices.max(axis=0) / 2
        self._surface = Surface(
            (part.vertices - self._center).astype(np.float32),
            part.faces.reshape(-1),
            normals=part.normals,
            uv=part.uv,
            colors=part.colors,
        )
        color = quantized(np.array(mesh.color if mesh.color is not None else (1.0, 1.0, 1.0, 1.0)))
        clear = part.translucent or color[3] < 255
        self._material = Material(part.texture, part.normals is not None, bool(clear))
        self._materials = Materials(textures)
        self._color = color.tolist()
        self._actors: list[Any] = []

    def show(self, matrices: list[F64]) -> None:
        while len(self._actors) < len(matrices):
            actor = actor_of(self._surface, matrix_of(np.eye(4)))
            self._materials.dress(actor, self._material, self._color)
            self._renderer.AddActor(actor)
            self._actors.append(actor)
        for index, actor in enumerate(self._actors):
            actor.SetVisibility(index < len(matrices))
            if index < len(matrices):
                actor.SetUserMatrix(matrix_of(centered(matrices[index][None], self._center)[0]))

    def remove(self) -> None:
        for actor in self._actors:
            self._renderer.RemoveActor(actor)
        self._actors = []
