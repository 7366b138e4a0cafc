"""Large boxes of full cells in a grid: grown from many seeds at once.

A box can be pushed outward on one side as long as all cells in it are full; that is monotone, so the farthest is found
by bisection, and a table of sums (one number per corner) tells how many cells of a box are full. The order in which
the sides are pushed decides which of the boxes that cannot be pushed any further is reached; all orders of the axes
are tried from cubes of several sizes about many cells.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]
I64 = NDArray[np.int64]

#: The search ends when less than this share of the cells is left.
_LEAST = 0.05


class Sums:
    """Counts of full cells in boxes, from sums over all boxes at the origin."""

    def __init__(self, mask: Mask) -> None:
        self.shape = mask.shape
        table = np.zeros(np.array(mask.shape) + 1, np.int32)
        table[1:, 1:, 1:] = mask.cumsum(0, dtype=np.int32).cumsum(1, dtype=np.int32).cumsum(2, dtype=np.int32)
        self.table = table.reshape(-1)
        self.strides = (table.shape[1] * table.shape[2], table.shape[2], 1)

    def count(self, low: I64, high: I64) -> I64:
        """(k,) how many cells of the boxes [low, high) are full; both (k, 3)."""
        below = self._column(low, high, 0)
        return np.asarray(below(high[:, 0]) - below(low[:, 0]), np.int64)

    def _column(self, low: I64, high: I64, axis: int) -> Callable[[I64], NDArray[np.int32]]:
        """How many cells are full in a box with these sides across the axis, from 0 up to some place along it."""
        b, c = (k for k in range(3) if k != axis)
        lb, hb, lc, hc = (self.strides[k] * side[:, k] for k, side in ((b, low), (b, high), (c, low), (c, high)))
        corners, stride, table = (hb + hc, lb + lc, lb + hc, hb + lc), self.strides[axis], self.table

        def below(at: I64) -> NDArray[np.int32]:
            p, q, r, s = (table[corner + stride * at] for corner in corners)
            return np.asarray(p + q - r - s)

        return below

    def push(self, low: I64, high: I64, axis: int) -> None:
        """Push full boxes outward along an axis, on both sides, as far as they stay full; in place."""
        b, c = (k for k in range(3) if k != axis)
        across = (high[:, b] - low[:, b]) * (high[:, c] - low[:, c])
        below, end = self._column(low, high, axis), self.shape[axis]
        start, stop = low[:, axis].copy(), high[:, axis].copy()
        for side, way, room in ((stop, 1, end - stop), (start, -1, start.copy())):
            base, reached = side.copy(), below(side)
            moved = np.zeros_like(side)
            step = 1 << end.bit_length()
            while step := step >> 1:
                further = np.minimum(moved + step, room)
                full = (below(base + way * further) - reached) * way == across * further
                moved = np.where(full, further, moved)
            side += way * moved
        low[:, axis], high[:, axis] = start, stop


def maximal_boxes(mask: Mask, *, cell: NDArray[np.float64], limit: int = 256, seeds: int = 400, rounds: int = 6) -> I64:
    """Boxes of full cells that cannot be pushed outward on any side, those of the largest surface first.

    A convex body's mean shadow over all directions is a quarter of its surface (Cauchy): the surface is what an
    occluder is good for. The search is repeated from cells that the largest boxes so far do not hold, so that the
    boxes are spread over the whole shape.

    Parameters
    ----------
    mask : (x, y, z) bool
    cell : (3,) float
        Size of a cell.
    limit : int
        How many are returned at most.
    seeds : int
        From how many cells they are grown, each time.
    rounds : int
        How often the search starts again, unless hardly a cell is left.

    Returns
    -------
    (k, 2, 3) int
        Lowest cell, and the one after the highest.
    """
    left = mask.copy()
    sums = Sums(mask)
    found: list[I64] = []

    def best(boxes: I64) -> I64:
        boxes = np.unique(boxes, axis=0)
        new = Sums(left).count(boxes[:, 0], boxes[:, 1]) / (boxes[:, 1] - boxes[:, 0]).prod(axis=1)
        return boxes[np.argsort(-new * _surfaces(boxes, cell), kind="stable")][: limit // rounds]

    for _ in range(rounds):
        if left.sum() <= _LEAST * mask.sum():
            break
        boxes = best(_grown(sums, _starts(mask, left, seeds)))
        for _ in range(2):
            # give up some cells at one side, and see whether the others gain more than is lost
            better = best(np.concatenate([boxes, _grown(sums, _cut(boxes[:8]))]))
            if np.array_equal(better, boxes):
                break
            boxes = better
        found.append(boxes)
        for low, high in spread_out(boxes, 3):
            left[low[0] : high[0], low[1] : high[1], low[2] : high[2]] = False
    boxes = np.unique(np.concatenate([np.zeros((0, 2, 3), np.int64), *found]), axis=0)
    return boxes[np.argsort(-_surfaces(boxes, cell), kind="stable")]


def _surfaces(boxes: I64, cell: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y, z = ((boxes[:, 1] - boxes[:, 0]) * cell).T
    return np.asarray(2 * (x * y + y * z + z * x))


def spread_out(boxes: I64, limit: int) -> I64:
    """Of boxes (k, 2, 3) in order of size, those of which less than half lies in one that is kept already."""
    kept: list[I64] = []
    for box in boxes:
        overlaps = [np.clip(np.minimum(box[1], k[1]) - np.maximum(box[0], k[0]), 0, None).prod() for k in kept]
        if max(overlaps, default=0) < 0.5 * (box[1] - box[0]).prod():
            kept.append(box)
        if len(kept) == limit:
            break
    return np.array(kept, np.int64).reshape(-1, 2, 3)


def _starts(mask: Mask, left: Mask, count: int) -> I64:
    """Cubes about cells: half of them where there is most room, half spread evenly; each in three sizes."""
    from scipy.ndimage import distance_transform_cdt, maximum_filter

    # outside is empty; an axis of one cell is no axis
    around = [(1, 1) if n > 1 else (0, 0) for n in mask.shape]
    within = tuple(slice(a, a + n) for (a, _), n in zip(around, mask.shape, strict=True))
    depth = distance_transform_cdt(np.pad(mask, around), "chessboard")[within].astype(np.int64)
    free = np.where(left, depth, 0)
    peaks = np.argwhere((free == maximum_filter(free, 3)) & left)
    peaks = peaks[np.argsort(-depth[tuple(peaks.T)], kind="stable")]
    seed = np.concatenate([_some(peaks[: 4 * count], count // 2), _some(np.argwhere(left), count // 2)])
    room = depth[tuple(seed.T)][:, None] - 1
    reach = [r * (np.array(mask.shape) > 1) for r in (room, room // 2, np.zeros_like(room))]
    return np.unique(np.concatenate([np.stack([seed - r, seed + r + 1], axis=1) for r in reach]), axis=0)


def _some(cells: I64, count: int) -> I64:
    return cells[np.unique(np.linspace(0, len(cells) - 1, min(count, len(cells))).astype(np.int64))]


def _grown(sums: Sums, boxes: I64) -> I64:
    out = []
    for order in itertools.permutations(k for k in range(3) if sums.shape[k] > 1):
        low, high = boxes[:, 0].copy(), boxes[:, 1].copy()
        for axis in order:
            sums.push(low, high, axis)
        out.append(np.stack([low, high], axis=1))
    return np.unique(np.concatenate(out), axis=0)


def _cut(boxes: I64) -> I64:
    out = []
    for axis, side, share in itertools.product(range(3), range(2), (0.1, 0.25, 0.5)):
        new = boxes.copy()
        size = boxes[:, 1, axis] - boxes[:, 0, axis]
        lost = np.minimum(np.maximum((size * share).astype(np.int64), 1), size - 1)
        new[:, side, axis] += lost if side == 0 else -lost
        out.append(new)
    return np.unique(np.concatenate(out), axis=0)
