"""What one frame of a view hands to the next: which drawables were visible, and how old that knowledge is."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from scenegraph import Frame

I64 = NDArray[np.int64]
Mask = NDArray[np.bool_]

#: `asked_at` of what has never been asked about.
NEVER = -1


@dataclass
class QueryHistory:
    """What queries have found, by row. A row keeps its number as long as no row comes or goes.

    History decides what is asked first, and what is drawn before it is asked. Nothing is hidden because of it.

    Attributes
    ----------
    index : int
        The frame.
    visible : (n,) bool
        Rows found or assumed to be visible. False outside the view frustum: nothing is known about these.
    hidden_for : (n,) int32
        Frames in a row, this one included, in which a row was inside the frustum, was asked about and was hidden.
    asked_at : (n,) int32
        Frame in which a row, or a node above it, was last asked about; `NEVER` outside the frustum.
    asked_boxes : (6, q) float64
        The boxes asked about in this frame, of nodes and of rows, in the order of asking.
    seen : (q,) bool
        What the answers were.
    """

    index: int
    visible: Mask
    hidden_for: NDArray[np.int32]
    asked_at: NDArray[np.int32]
    asked_boxes: NDArray[np.float64] = field(default_factory=lambda: np.zeros((6, 0)))
    seen: Mask = field(default_factory=lambda: np.zeros(0, bool))

    @classmethod
    def before(cls, frame: Frame) -> QueryHistory:
        """That of the frame before of the same view, or one that knows nothing."""
        previous = frame.previous
        found = previous.find(cls) if previous is not None and previous.snapshot is frame.snapshot else None
        if found is not None and len(found.visible) == frame.snapshot.n:
            return found
        n = frame.snapshot.n
        return cls(frame.index - 1, np.zeros(n, bool), np.zeros(n, np.int32), np.full(n, NEVER, np.int32))

    def ages(self) -> NDArray[np.int32]:
        """(n,) frames since each visible row was asked about; -1 for those that are not visible or never were."""
        return np.where(self.visible & (self.asked_at != NEVER), np.int32(self.index) - self.asked_at, np.int32(-1))


def row_phases(n: int, period: int) -> I64:
    """(n,) in which frame out of `period` each row is due: pseudo-random, and the same in every run (splitmix64)."""
    with np.errstate(over="ignore"):
        z = np.arange(1, n + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        return ((z ^ (z >> np.uint64(31))) % np.uint64(period)).astype(np.int64)
