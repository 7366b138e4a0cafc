"""Nodes and rows under one kind of number, and what lies below them: for traversals with a priority queue."""

from __future__ import annotations

import numpy as np

from scenegraph.kernels.boxes import box_distance
from scenegraph.kernels.slices import slice_expand

from .asking import F64, Asking
from .history import I64, Mask

Entry = tuple[float, int]


class Opening:
    """Numbers 0 ... m - 1 are nodes of the hierarchy, m + r is row r.

    Parameters
    ----------
    asking : Asking
    """

    def __init__(self, asking: Asking) -> None:
        self.asking = asking
        self.tree = tree = asking.tree
        self.nodes = m = len(tree)
        leaf = tree.is_leaf
        # what is below a node has consecutive numbers
        self._first = np.where(leaf, m + tree.first, tree.child_first)
        self._end = np.where(leaf, m + tree.end, tree.child_end)
        self._kept: Mask = np.concatenate([~asking.frame.dead_nodes_now(), asking.candidates])
        self._eye = np.asarray(asking.view.eye)

    def start(self) -> list[Entry]:
        """A heap with the root."""
        return [(0.0, 0)] if self._kept[: min(self.nodes, 1)].any() else []

    def is_row(self, numbers: I64) -> Mask:
        """(k,) which of these are rows."""
        return np.asarray(numbers >= self.nodes)

    def boxes(self, numbers: I64) -> F64:
        """(6, k) world boxes."""
        rows = self.is_row(numbers)
        if rows.all():
            return self.asking.snapshot.boxes[:, numbers - self.nodes]
        if not rows.any():
            return self.tree.boxes[:, numbers]
        out = np.empty((6, len(numbers)))
        out[:, rows] = self.asking.snapshot.boxes[:, numbers[rows] - self.nodes]
        out[:, ~rows] = self.tree.boxes[:, numbers[~rows]]
        return out

    def open(self, numbers: I64) -> list[Entry]:
        """Draw rows; give what is below nodes, with its distance from the eye."""
        if not len(numbers):
            return []
        rows = self.is_row(numbers)
        if rows.any():
            self.asking.draw(numbers[rows] - self.nodes)
            numbers = numbers[~rows]
            if not len(numbers):
                return []
        return self.entries(self.below(numbers))

    def entries(self, numbers: I64) -> list[Entry]:
        """For a heap."""
        return list(zip(self.distance(numbers).tolist(), numbers.tolist(), strict=True))

    def distance(self, numbers: I64) -> F64:
        """(k,) from the eye."""
        return box_distance(self.boxes(numbers), self._eye)

    def below(self, nodes: I64, *, but: Mask | None = None) -> I64:
        """Children of nodes, rows of leaves, without those that were hidden before the first question, nor `but`."""
        found, _ = self.below_each(nodes)
        return found if but is None else found[~but[found]]

    def below_each(self, nodes: I64) -> tuple[I64, I64]:
        """The same, and the position in `nodes` of the node that each is below."""
        first, end = self._first[nodes], self._end[nodes]
        found = slice_expand(first, end)
        kept = self._kept[found]
        return found[kept], np.repeat(np.arange(len(nodes)), end - first)[kept]

    def mark_asked(self, numbers: I64) -> None:
        """Rows among these have been asked about."""
        self.asking.asked[numbers[self.is_row(numbers)] - self.nodes] = True

    def hide(self, numbers: I64) -> None:
        """Nothing of these is seen."""
        rows = self.is_row(numbers)
        self.asking.hide_rows(numbers[rows] - self.nodes)
        self.asking.hide_nodes(numbers[~rows])
