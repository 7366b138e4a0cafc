"""A snapshot in a VTK renderer: all rows are loaded once, and every frame says which of them are drawn.

Merged batches are the fast way: a new visible set costs a copy of its triangle indices. `SetBlockVisibility` of VTK's
composite mapper rebuilds its batch and is never used. The choice was measured by `tests/bench/bench_drawing.py`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from .actors import BatchActor, InstanceActors, ItemActors, Materials
from .geometry import HEAVY_TRIANGLES, Geometry
from .layout import U8, Batch, Instances, Mask
from .standins import TableActors, TableGeometry

if TYPE_CHECKING:
    from ..frame import Frame, StandIn
    from ..snapshot import Snapshot

Mode = Literal["auto", "batches", "actors"]
#: Tables of stand-ins of earlier frames that are kept loaded.
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
        self._standins: dict[int, TableActors] = {}
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
        wanted: dict[int, list[StandIn]] = {}
        for standin in standins:
            wanted.setdefault(id(standin.table), []).append(standin)
        for key, group in wanted.items():
            # taken out and put back: the order of the dict is the order of last use
            loaded = self._standins.pop(key, None) or TableActors(TableGeometry.shared(group[0].table), self.renderer)
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
        return sum(len(group.actors) for group in [*self._batches, *self._instances]) + sum(
            s.actor_count for s in self._standins.values()
        )

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
