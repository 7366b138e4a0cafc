"""The hierarchical walk that stages share: level by level, in array operations, with three-way verdicts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .kernels.boxes import box_inside, box_outside, box_outside_exact
from .kernels.slices import slice_expand

if TYPE_CHECKING:
    from .frame import Frame
    from .snapshot import Snapshot

#: Verdicts on a box, Performer's PFIS_FALSE / MAYBE / ALL_IN. Of the first two, a mask of what is kept is made by
#: viewing it as int8.
OUT, PARTIAL, IN = 0, 1, 2

#: Up to so many rows one product over all of them beats a walk down the tree (tests/bench/bench_frustum.py).
FLAT_LIMIT = 60_000


class Batch:
    """Boxes to be judged together: nodes of one level of the hierarchy, or rows.

    Attributes
    ----------
    index : (k,) int64
        Node or row numbers; rows ascend.
    is_rows : bool
        Rows: the verdict IN means no more than PARTIAL here, so it need not be told apart.
    carry : (k, ...) array or None
        What each box inherits from its parent; change it in place to hand it down.
    origin : (3,) float64
        `packed` is relative to it.
    radius : float
        Bound of |center - origin| + |half extent|.
    """

    def __init__(
        self,
        snapshot: Snapshot,
        index: NDArray[np.int64] | None,
        *,
        is_rows: bool,
        carry: NDArray[np.generic] | None,
    ) -> None:
        self._source = snapshot if is_rows else snapshot.tree
        self._index = index
        self.is_rows = is_rows
        self.carry = carry
        self.origin = snapshot.origin
        self.radius = snapshot.radius
        self._boxes: NDArray[np.float64] | None = None
        self._packed: NDArray[np.float32] | None = None

    def __len__(self) -> int:
        return len(self._source.packed) if self._index is None else len(self._index)

    @property
    def index(self) -> NDArray[np.int64]:
        """(k,) node or row numbers."""
        return np.arange(len(self)) if self._index is None else self._index

    @property
    def boxes(self) -> NDArray[np.float64]:
        """(6, k) world boxes, components first."""
        if self._boxes is None:
            self._boxes = self.boxes_at(None)
        return self._boxes

    def boxes_at(self, subset: NDArray[np.integer] | None) -> NDArray[np.float64]:
        """(6, j) world boxes of some of the batch, by position in it."""
        which = self._index if subset is None else subset if self._index is None else self._index[subset]
        return self._source.boxes if which is None else self._source.boxes[:, which]

    @property
    def packed(self) -> NDArray[np.float32]:
        """(k, 8) boxes in single precision relative to `origin`, see `kernels.boxes.box_packed`."""
        if self._packed is None:
            # take along whole 32-byte rows: one cache line per box instead of seven
            source = self._source.packed
            self._packed = source if self._index is None else np.take(source, self._index, axis=0)
        return self._packed

    def outside(self, planes: NDArray[np.float64], subset: NDArray[np.integer] | None = None) -> NDArray[np.bool_]:
        """Which boxes lie wholly outside one of the planes.

        Single precision first; float64, with a tolerance relative to the coordinates, where that cannot tell.

        Parameters
        ----------
        planes : (p, 4) float64
            Inward unit normals and offsets relative to `origin`: inside is n·x + d ≥ 0.
        subset : (j,) int, optional
            Look at these positions of the batch only.

        Returns
        -------
        (k,) or (j,) bool
            False for boxes with NaN.
        """
        packed = self.packed if subset is None else np.take(self.packed, subset, axis=0)
        outside, unsure = box_outside(packed, planes, radius=self.radius)
        if len(unsure):
            which = unsure if subset is None else subset[unsure]
            outside[unsure] = box_outside_exact(self.boxes_at(which), planes, origin=self.origin)
        return outside

    def inside(self, planes: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(k,) which boxes lie surely and wholly inside all planes; see `outside`."""
        return box_inside(self.packed, planes, radius=self.radius)


@dataclass
class Walked:
    """What a walk found: the new visible rows, nodes with nothing visible below, boxes tested."""

    visible: NDArray[np.bool_] | None
    dead: NDArray[np.bool_] | None
    tested: int


def walk(
    frame: Frame,
    classify: Callable[[Batch], NDArray[np.integer]],
    *,
    carry: ArrayLike | None = None,
    flat: bool | None = None,
) -> Walked:
    """See `Frame.traverse`."""
    snapshot = frame.snapshot
    root_carry = None if carry is None else np.asarray(carry)
    if snapshot.n == 0 or frame.visible_count == 0:
        return Walked(None, frame.dead_nodes, 0)
    if flat is None:
        flat = frame.visible_count <= FLAT_LIMIT
    return _flat(frame, classify, root_carry) if flat else _hierarchical(frame, classify, root_carry)


def _flat(frame: Frame, classify: Callable[[Batch], NDArray[np.integer]], root: NDArray[np.generic] | None) -> Walked:
    snapshot = frame.snapshot
    whole = frame.visible_count == snapshot.n
    rows = None if whole else frame.candidates()
    k = snapshot.n if rows is None else len(rows)
    carry = None if root is None else np.repeat(root[None], k, axis=0)
    verdict = np.asarray(classify(Batch(snapshot, rows, is_rows=True, carry=carry)))
    if rows is None:
        visible = verdict != OUT
        if snapshot.any_protected:
            visible |= snapshot.protected
    else:
        visible = np.zeros(snapshot.n, bool)
        visible[rows[verdict != OUT]] = True
        if snapshot.any_protected:
            visible[rows[snapshot.protected[rows]]] = True
    return Walked(visible, None, k)


def _hierarchical(
    frame: Frame, classify: Callable[[Batch], NDArray[np.integer]], root: NDArray[np.generic] | None
) -> Walked:
    snapshot, tree = frame.snapshot, frame.snapshot.tree
    before = frame.visible
    whole = frame.visible_count == snapshot.n
    dead = np.zeros(len(tree), bool) if whole else frame.dead_nodes_now()
    nodes = np.flatnonzero(~dead[:1])
    carry = None if root is None else np.repeat(root[None], len(nodes), axis=0)
    accepted: list[NDArray[np.int64]] = []
    leaves: list[NDArray[np.int64]] = []
    leaf_carry: list[NDArray[np.generic]] = []
    tested = 0
    while len(nodes):
        batch = Batch(snapshot, nodes, is_rows=False, carry=carry)
        verdict = np.asarray(classify(batch))
        tested += len(nodes)
        dead[nodes[verdict == OUT]] = True
        accepted.append(nodes[verdict == IN])
        partial = verdict == PARTIAL
        nodes = nodes[partial]
        carry = None if carry is None else carry[partial]
        count = tree.child_end[nodes] - tree.child_first[nodes]
        leaf = count == 0
        if leaf.any():
            leaves.append(nodes[leaf])
            if carry is not None:
                leaf_carry.append(carry[leaf])
        children = slice_expand(tree.child_first[nodes], tree.child_end[nodes])
        carry = None if carry is None else np.repeat(carry, count, axis=0)
        alive = ~dead[children]
        nodes = children[alive]
        carry = None if carry is None else carry[alive]

    visible = np.zeros(snapshot.n, bool)
    inside = np.concatenate(accepted) if accepted else np.zeros(0, np.int64)
    _fill(visible, tree.first[inside], tree.end[inside])
    if leaves:
        ids = np.concatenate(leaves)
        # leaves of one level after those of another: rows are to ascend
        order = np.argsort(tree.first[ids], kind="stable")
        ids = ids[order]
        rows = slice_expand(tree.first[ids], tree.end[ids])
        size = (tree.end[ids] - tree.first[ids]).astype(np.int64)
        row_carry = np.repeat(np.concatenate(leaf_carry)[order], size, axis=0) if leaf_carry else None
        of_leaf = np.repeat(np.arange(len(ids)), size)
        if not whole:
            left = before[rows]
            rows, of_leaf = rows[left], of_leaf[left]
            row_carry = None if row_carry is None else row_carry[left]
        if len(rows):
            kept = np.asarray(classify(Batch(snapshot, rows, is_rows=True, carry=row_carry))) != OUT
            tested += len(rows)
            visible[rows[kept]] = True
            emptied = np.ones(len(ids), bool)
            emptied[of_leaf[kept]] = False
            dead[ids[emptied]] = True
    if not whole:
        visible &= before
    if snapshot.any_protected:
        visible |= snapshot.protected & before
    return Walked(visible, dead, tested)


def _fill(mask: NDArray[np.bool_], first: NDArray[np.integer], end: NDArray[np.integer]) -> None:
    """Set slices of a mask; few long ones by index, many by one running sum."""
    total = int((end - first).sum())
    if total * 4 < len(mask):
        mask[slice_expand(first, end)] = True
    else:
        step = np.zeros(len(mask) + 1, np.int8)
        step[first] += 1
        # slices are disjoint, so a boundary is at most one end and one start
        step[end] -= 1
        np.cumsum(step[:-1], dtype=np.int8, out=mask.view(np.int8))
