"""Bounding hierarchies over the rows of a snapshot.

The tree follows the graph's groups where they are fine enough, and divides flat groups in space (`spatialize`), so that
every node has a bounded number of children and every subtree is a slice of rows. Nodes are stored level by level: the
children of a node are neighbors, and a level is refitted or classified by one array operation.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .kernels.boxes import box_from_bounds, box_packed, box_to_bounds
from .kernels.slices import slice_expand, slice_morton_order, slice_reduce_min_max


@dataclass
class Hierarchy:
    """A tree of boxes over rows, nodes in level order.

    Attributes
    ----------
    parent, first, end, child_first, child_end : (m,) int32
        Rows [first, end) lie below a node; its children are the nodes [child_first, child_end), none for a leaf.
    level_start : (levels + 1,) int64
        Nodes of level i are [level_start[i], level_start[i + 1]).
    boxes : (6, m) float64
        World boxes; NaN only where nothing below has a known box.
    packed : (m, 8) float32
        The same relative to the snapshot's origin, see `scenegraph.kernels.boxes.box_packed`.
    """

    parent: NDArray[np.int32]
    first: NDArray[np.int32]
    end: NDArray[np.int32]
    child_first: NDArray[np.int32]
    child_end: NDArray[np.int32]
    level_start: NDArray[np.int64]
    boxes: NDArray[np.float64] = field(default_factory=lambda: np.zeros((6, 0)))
    packed: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 8), np.float32))

    def __len__(self) -> int:
        return len(self.parent)

    @property
    def levels(self) -> int:
        """Depth of the tree; 0 if it is empty."""
        return len(self.level_start) - 1

    @property
    def boxes32(self) -> NDArray[np.float32]:
        """(8, m) float32 components-first view of `packed`."""
        return self.packed.T

    @property
    def is_leaf(self) -> NDArray[np.bool_]:
        """(m,) whether a node has rows only."""
        return np.equal(self.child_first, self.child_end)

    @property
    def nbytes(self) -> int:
        """Bytes held by the arrays."""
        names = ("parent", "first", "end", "child_first", "child_end", "level_start", "boxes", "packed")
        return sum(getattr(self, name).nbytes for name in names)

    def refit(
        self, row_boxes: NDArray[np.float64], origin: NDArray[np.float64], rows: NDArray[np.int64] | None = None
    ) -> None:
        """Recompute node boxes from the rows' boxes, for all nodes or only above the given (sorted) rows."""
        m = len(self)
        if self.boxes.shape[1] != m:
            self.boxes, self.packed, rows = np.full((6, m), np.nan), np.zeros((m, 8), np.float32), None
        if m == 0:
            return
        if rows is None:
            dirty = np.ones(m, bool)
        else:
            touched = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=row_boxes.shape[1]))])
            dirty = touched[self.end] > touched[self.first]
        row_bounds = box_to_bounds(row_boxes)
        bounds = box_to_bounds(self.boxes)
        for level in range(self.levels - 1, -1, -1):
            a, b = self.level_start[level], self.level_start[level + 1]
            nodes = a + np.flatnonzero(dirty[a:b])
            leaf = self.is_leaf[nodes]
            for ids, source, lo, hi in (
                (nodes[leaf], row_bounds, self.first, self.end),
                (nodes[~leaf], bounds, self.child_first, self.child_end),
            ):
                if len(ids):
                    low, high = slice_reduce_min_max(source, lo[ids], hi[ids])
                    bounds[:3, ids], bounds[3:, ids] = low, high
        index = np.flatnonzero(dirty)
        self.boxes[:, index] = box_from_bounds(bounds[:3, index], bounds[3:, index])
        self.packed[index] = box_packed(self.boxes[:, index], origin)


class _Builder:
    """Collects tree nodes as they are found, children before parents, and numbers them level by level at the end."""

    def __init__(self, fanout: int) -> None:
        self.fanout = fanout
        self.children: list[list[int]] = []
        self.rows: list[NDArray[np.int64]] = []
        self.center: list[NDArray[np.float64]] = []

    def leaf(self, rows: NDArray[np.int64], center: NDArray[np.float64]) -> int:
        self.children.append([])
        self.rows.append(rows)
        self.center.append(center)
        return len(self.children) - 1

    def join(self, nodes: list[int]) -> int:
        """One node above these, with intermediate levels where they are too many."""
        while len(nodes) > self.fanout:
            order = slice_morton_order(np.array([self.center[i] for i in nodes]).T)
            ordered = [nodes[int(i)] for i in order]
            nodes = [self._node(ordered[i : i + self.fanout]) for i in range(0, len(ordered), self.fanout)]
        return nodes[0] if len(nodes) == 1 else self._node(nodes)

    def _node(self, nodes: list[int]) -> int:
        if len(nodes) == 1:
            return nodes[0]
        self.children.append(nodes)
        self.rows.append(np.zeros(0, np.int64))
        self.center.append(np.nanmean([self.center[i] for i in nodes], axis=0))
        return len(self.children) - 1

    def leaves(
        self, rows: NDArray[np.int64], first: NDArray[np.int64], end: NDArray[np.int64], centers: NDArray[np.float64]
    ) -> list[int]:
        """Leaves over items (slices of `rows` that stay together), divided in space where they are too many."""
        count = end - first
        if count.sum() > self.fanout:
            order = slice_morton_order(centers)
            first, end, centers, count = first[order], end[order], centers[:, order], count[order]
        part = (np.cumsum(count) - count) // self.fanout
        starts = np.flatnonzero(np.diff(part, prepend=-1))
        ordered = rows[slice_expand(first, end)]
        row_starts = np.concatenate([(np.cumsum(count) - count)[starts], [len(ordered)]])
        known = np.isfinite(centers).all(axis=0)
        total = np.add.reduceat(np.where(known, centers, 0.0), starts, axis=1)
        mean = total / np.maximum(np.add.reduceat(known, starts), 1)
        return [self.leaf(ordered[row_starts[i] : row_starts[i + 1]], mean[:, i]) for i in range(len(starts))]

    def finish(self, root: int | None) -> tuple[NDArray[np.int64], Hierarchy]:
        if root is None:
            empty = np.zeros(0, np.int32)
            return np.zeros(0, np.int64), Hierarchy(empty, empty, empty, empty, empty, np.zeros(1, np.int64))
        # depth-first, for the order of rows
        size = np.zeros(len(self.children), np.int64)
        first = np.zeros(len(self.children), np.int64)
        order: list[NDArray[np.int64]] = []
        placed = 0
        stack = [(root, False)]
        while stack:
            node, done = stack.pop()
            if done:
                size[node] = placed - first[node]
                continue
            first[node] = placed
            stack.append((node, True))
            if len(self.rows[node]):
                order.append(self.rows[node])
                placed += len(self.rows[node])
            stack.extend((c, False) for c in reversed(self.children[node]))
        # level by level, for the order of nodes
        sequence: list[int] = []
        parents: list[int] = []
        starts, level = [0], [root]
        level_parents = [-1]
        child_first = np.zeros(len(self.children), np.int32)
        child_end = np.zeros(len(self.children), np.int32)
        while level:
            base = len(sequence)
            sequence.extend(level)
            parents.extend(level_parents)
            starts.append(len(sequence))
            below: list[int] = []
            level_parents = []
            for i, node in enumerate(level):
                child_first[base + i] = starts[-1] + len(below)
                below.extend(self.children[node])
                child_end[base + i] = starts[-1] + len(below)
                level_parents.extend([base + i] * len(self.children[node]))
            level = below
        ids = np.array(sequence)
        tree = Hierarchy(
            parent=np.array(parents, np.int32),
            first=first[ids].astype(np.int32),
            end=(first + size)[ids].astype(np.int32),
            child_first=child_first[: len(ids)],
            child_end=child_end[: len(ids)],
            level_start=np.array(starts, np.int64),
        )
        return np.concatenate(order) if order else np.zeros(0, np.int64), tree


def spatialize(
    boxes: NDArray[np.float64],
    row_group: NDArray[np.int64],
    group_parent: NDArray[np.int64],
    *,
    fanout: int = 16,
) -> tuple[NDArray[np.int64], Hierarchy]:
    """A hierarchy over rows that keeps every group a slice and divides what is flat.

    Parameters
    ----------
    boxes : (6, n) float64
        World boxes of the rows, in depth-first order of the graph.
    row_group : (n,) int
        The group that holds each row.
    group_parent : (g,) int
        Parent of each group in depth-first order; -1 for the root, group 0.
    fanout : int
        Most children of a node and rows of a leaf. Groups of at most half as many rows get no node of their own: they
        stay together inside a leaf.

    Returns
    -------
    order : (n,) int64
        The order in which the hierarchy wants the rows.
    tree : Hierarchy
        Without boxes; call `refit`.
    """
    builder = _Builder(fanout)
    n, groups = len(row_group), len(group_parent)
    if n == 0:
        return builder.finish(None)
    size = np.bincount(row_group, minlength=groups)
    for g in range(groups - 1, 0, -1):
        size[group_parent[g]] += size[g]
    dissolved = size <= fanout // 2
    dissolved[0] = False
    top = np.full(groups, -1)
    for g in range(1, groups):
        if dissolved[g]:
            above = top[group_parent[g]]
            top[g] = above if above >= 0 else g
    # items: rows, or dissolved groups as runs of rows
    item_of = np.where(top[row_group] >= 0, top[row_group], groups + np.arange(n))
    first = np.flatnonzero(np.diff(item_of, prepend=-1))
    end = np.append(first[1:], n)
    owner = np.where(top[row_group[first]] >= 0, group_parent[top[row_group[first]]], row_group[first])
    if len(first) == n:
        centers = boxes[:3]
    else:
        known = np.isfinite(boxes[:3]).all(axis=0)
        total = np.add.reduceat(np.where(known, boxes[:3], 0.0), first, axis=1)
        centers = total / np.maximum(np.add.reduceat(known, first), 1)
    by_owner = np.argsort(owner, kind="stable")
    starts = np.searchsorted(owner[by_owner], np.arange(groups + 1))
    rows = np.arange(n)
    inner: list[list[int]] = [[] for _ in range(groups)]
    for g in range(groups - 1, -1, -1):
        if dissolved[g]:
            continue
        items = by_owner[starts[g] : starts[g + 1]]
        nodes = inner[g]
        nodes.reverse()
        if len(items):
            nodes = builder.leaves(rows, first[items], end[items], centers[:, items]) + nodes
        if not nodes:
            continue
        node = builder.join(nodes)
        if g == 0:
            return builder.finish(node)
        inner[group_parent[g]].append(node)
    return builder.finish(None)
