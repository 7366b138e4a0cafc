"""What the stages of this plugin share: levels on demand, a memory against popping, and errors as they are seen.

A level that is right by a hair becomes wrong with the next step of the camera, and the drawable flickers between two
shapes. So a drawable that was seen in the frame before keeps its level as long as a rule that is a little stricter and
the rule itself do not both ask for another one. The stricter rule is the finer one: whatever a stage promises of errors
holds with the memory, too.
"""

from __future__ import annotations

import weakref
from abc import abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenegraph import Frame, Guarantee, Snapshot, Stage
from scenegraph.progress import Progress

F32 = NDArray[np.float32]
I64 = NDArray[np.int64]

#: Stands for "not seen in the frame before".
UNSEEN = -1
_NOTHING = np.zeros(0, np.int64), np.zeros(0, np.int16), lambda: None


class Memory:
    """The level at which each drawable was drawn in the frame before, by view and by key.

    Rows may come, go and change their order; a replay that begins with `start` gives the same answers.
    """

    def __init__(self) -> None:
        self._seen: dict[str, tuple[NDArray[np.int64], NDArray[np.int16], weakref.ref[Frame]]] = {}
        self._snapshot: weakref.ref[Snapshot] | None = None
        self._structure = -1

    def start(self, snapshot: Snapshot) -> bool:
        """Begin with a snapshot; what was seen is kept if it is the same one and only its rows have changed."""
        same = self._snapshot is not None and self._snapshot() is snapshot
        kept = same and self._structure != snapshot.structure_version
        self._snapshot, self._structure = weakref.ref(snapshot), snapshot.structure_version
        if not kept:
            self._seen.clear()
        return kept

    def recall(self, frame: Frame, rows: I64) -> NDArray[np.int16]:
        """(k,) level of each row in the frame before of this view; `UNSEEN` if it was not visible."""
        keys, levels, of = self._seen.get(frame.view_name, _NOTHING)
        # between two frames of a view the stage may have been skipped; only after an edit has a frame no previous one
        if not len(keys) or (frame.previous is not None and of() is not frame.previous):
            return np.full(len(rows), UNSEEN, np.int16)
        if keys is frame.snapshot.keys:
            return levels[rows]
        order = np.argsort(keys, kind="stable")
        wanted = frame.snapshot.keys[rows]
        at = order[np.minimum(np.searchsorted(keys, wanted, sorter=order), len(keys) - 1)]
        return np.where(keys[at] == wanted, levels[at], np.int16(UNSEEN))

    def keep(self, frame: Frame) -> None:
        """Remember what this frame shows."""
        levels = np.where(frame.visible, frame.level, np.int16(UNSEEN)).astype(np.int16)
        self._seen[frame.view_name] = frame.snapshot.keys, levels, weakref.ref(frame)


class LevelStage(Stage):
    """A stage that picks a level for every drawable that is still visible; it hides nothing.

    Subclasses write `choose`.
    """

    writes = ("level",)
    needs = ("levels",)

    def __init__(self, **values: Any) -> None:
        super().__init__(**values)
        self._memory = Memory()
        self._errors: tuple[int, F32] | None = None

    @property
    def guarantee(self) -> Guarantee:
        """Conservative: no drawable is hidden. How far its image may change, the stages' pages say."""
        return Guarantee.CONSERVATIVE

    def open(self, snapshot: Snapshot, progress: Progress) -> None:
        """Forget what was seen, unless only rows came or went."""
        self._errors = None
        self.started(fresh=not self._memory.start(snapshot))

    def started(self, *, fresh: bool) -> None:
        """Forget what a subclass remembers, if `fresh`."""

    def skip(self, frame: Frame) -> str | None:
        """Nothing to choose from."""
        return None if len(frame.snapshot.triangles) > 1 else "no drawable has levels"

    def run(self, frame: Frame) -> None:
        """Choose, and count what popped."""
        rows = frame.candidates()
        before = self._memory.recall(frame, rows)
        frame.coarsen(rows, self.choose(frame, rows, before))
        now = frame.level[rows]
        pops = int(np.count_nonzero((before != UNSEEN) & (before != now)))
        frame.count(tested=len(rows), pops=pops)
        self._memory.keep(frame)

    @abstractmethod
    def choose(self, frame: Frame, rows: I64, before: NDArray[np.int16]) -> I64:
        """Choose levels.

        Parameters
        ----------
        frame : Frame
        rows : (k,) int64
        before : (k,) int16
            Level of each row in the frame before; `UNSEEN` if it was not visible.

        Returns
        -------
        (k,) int64
            Levels that do not exist count as the coarsest.
        """

    # -- measuring --------------------------------------------------------------------------------------------------

    def seen_errors(self, frame: Frame, rows: I64) -> F32:
        """(L, k) model error of each level of rows, in pixels as large as it can be seen; +∞ for levels they lack.

        The depth is that of the nearest point of the drawable's box, and at least the near plane. Where the error is
        unknown, it is the diagonal of the box: no point of a level is farther from any point of another.
        """
        snapshot, view = frame.snapshot, frame.view
        if self._errors is None or self._errors[0] != snapshot.version:
            self._errors = snapshot.version, known_errors(snapshot)
        errors = self._errors[1]
        whole = len(rows) == snapshot.n
        boxes = snapshot.boxes if whole else snapshot.boxes[:, rows]
        with np.errstate(over="ignore", invalid="ignore"):
            scale = view.pixels_per_unit(view.box_depth(boxes)).astype(np.float32)
            seen = (errors if whole else errors[:, rows]) * scale
        return np.asarray(seen)


def known_errors(snapshot: Snapshot) -> F32:
    """(L, n) model errors in world units without gaps: never falling, the box's diagonal where unknown, +∞ beyond."""
    with np.errstate(over="ignore", invalid="ignore"):
        diagonal = 2 * np.sqrt((snapshot.boxes[3:] ** 2).sum(axis=0))
        diagonal = np.where(np.isnan(diagonal), np.inf, diagonal).astype(np.float32)
    errors = np.where(np.isnan(snapshot.errors), diagonal, snapshot.errors)
    errors[0] = 0.0
    np.maximum.accumulate(errors, axis=0, out=errors)
    errors[np.arange(len(errors))[:, None] >= snapshot.level_count] = np.inf
    return np.asarray(errors, np.float32)


def held(before: NDArray[np.int16], finest: I64, coarsest: I64) -> I64:
    """(k,) the level before where it lies between two others, else the nearer of them; the coarsest where unseen."""
    return np.where(before == UNSEEN, coarsest, np.clip(before, finest, coarsest))
