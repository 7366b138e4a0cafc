"""Which cells of a regular grid simplices touch: segments in the plane, triangles in space.

A simplex and a box, both convex, are apart if and only if one of finitely many axes separates their shadows (the
separating axis theorem): the axes of the grid, the normals of the simplex, and in space the cross products of its edges
with the axes of the grid. Any axis that separates is a proof, even one that is not computed exactly, as long as the
shadows on it are; the boxes are therefore grown by a margin that is far larger than the rounding of the shadows, and
"apart" is sure, while "touches" may be a near miss.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

#: Pairs of simplex and cell looked at in one go: bounds the memory to some 40 MB.
CHUNK = 1 << 16


class Simplices:
    """Segments (m, 2, 2) or triangles (m, 3, 3), prepared for overlap tests with boxes.

    Attributes
    ----------
    corners : (m, k, d) float64
    low, high : (m, d) float64
        Bounds of each.
    axes : (m, a, d) float64
        Possible separating axes besides those of the grid; the first is the normal.
    shadow : (2, m, a) float64
        Lowest and highest position of each simplex along its axes.
    """

    def __init__(self, corners: F64) -> None:
        self.corners = corners
        self.low, self.high = corners.min(axis=1), corners.max(axis=1)
        edge = np.roll(corners, -1, axis=1) - corners
        if corners.shape[2] == 2:
            self.axes = np.stack([-edge[:, :1, 1], edge[:, :1, 0]], axis=2)
        else:
            normal = np.cross(edge[:, 0], edge[:, 1])[:, None]
            zero = np.zeros(edge.shape[:2])
            x, y, z = np.moveaxis(edge, 2, 0)
            across = [np.stack(v, axis=2) for v in ((zero, z, -y), (-z, zero, x), (y, -x, zero))]
            self.axes = np.concatenate([normal, *across], axis=1)
        along = np.einsum("mad,mkd->mak", self.axes, corners)
        self.shadow = np.stack([along.min(axis=2), along.max(axis=2)])

    def __len__(self) -> int:
        return len(self.corners)

    def take(self, rows: NDArray[np.generic]) -> Simplices:
        """Some of them, by mask or index."""
        new = Simplices.__new__(Simplices)
        new.corners, new.low, new.high = self.corners[rows], self.low[rows], self.high[rows]
        new.axes, new.shadow = self.axes[rows], self.shadow[:, rows]
        return new

    def touch(self, rows: I64, center: F64, half: F64) -> NDArray[np.bool_]:
        """Whether simplex `rows[i]` touches box i.

        Parameters
        ----------
        rows : (p,) int
        center : (p, d) float64
        half : (d,) float64
            Half extent of all boxes.

        Returns
        -------
        (p,) bool
        """
        low, high = self.low[rows], self.high[rows]
        out = np.flatnonzero(((low <= center + half) & (high >= center - half)).all(axis=1))
        # the normal first: it tells most pairs apart
        for part in (slice(0, 1), slice(1, None)):
            axes = self.axes[rows[out], part]
            at = np.einsum("pad,pd->pa", axes, center[out])
            reach = np.abs(axes) @ half
            shadow = self.shadow[:, rows[out], part]
            out = out[((shadow[0] <= at + reach) & (shadow[1] >= at - reach)).all(axis=1)]
        touching = np.zeros(len(rows), bool)
        touching[out] = True
        return touching


def cells_touched(corners: F64, shape: tuple[int, ...], margin: F64) -> NDArray[np.bool_]:
    """Mark the unit cells [i, i + 1] that simplices come nearer to than a margin.

    Parameters
    ----------
    corners : (m, k, d) float64
        Segments or triangles in units of cells, within the grid.
    shape : d ints
        Cells along each axis.
    margin : (d,) float
        By which each cell is grown, in cells; at least 1e-9 of the longest side, to outweigh rounding.

    Returns
    -------
    (shape) bool
    """
    touched = np.zeros(shape, bool)
    limit = np.array(shape) - 1
    for start in range(0, len(corners), CHUNK):
        part = corners[start : start + CHUNK]
        first = np.clip(np.floor(part.min(axis=1) - margin), 0, limit).astype(np.int64)
        last = np.clip(np.floor(part.max(axis=1) + margin), 0, limit).astype(np.int64)
        span = (last - first).max(axis=1) + 1
        touched[tuple(first[span == 1].T)] = True
        wide = np.flatnonzero(span > 1)
        _Descent(Simplices(part[wide]), first[wide], last[wide], margin, touched).run(span[wide])
    return touched


class _Descent:
    """From blocks of cells that simplices touch to the cells, halving the blocks; few pairs at a time."""

    def __init__(self, simplices: Simplices, first: I64, last: I64, margin: F64, touched: NDArray[np.bool_]) -> None:
        self.simplices, self.first, self.last, self.margin, self.touched = simplices, first, last, margin, touched
        self.corner = np.array(list(itertools.product((0, 1), repeat=touched.ndim)), np.int64)

    def run(self, span: I64) -> None:
        # a span of 2**level cells lies in at most two such blocks along each axis
        level = np.ceil(np.log2(span)).astype(np.int64)
        for top in np.unique(level):
            rows = np.flatnonzero(level == top)
            self.descend(rows, self.first[rows] >> top, int(top))

    def visit(self, rows: I64, block: I64, level: int) -> None:
        size = 1 << level
        center = np.multiply(block + 0.5, size, dtype=np.float64)
        hit = self.simplices.touch(rows, center, 0.5 * size + self.margin)
        rows, block = rows[hit], block[hit]
        if level == 0:
            self.touched[tuple(block.T)] = True
        elif len(rows):
            self.descend(rows, 2 * block, level - 1)

    def descend(self, rows: I64, base: I64, level: int) -> None:
        children = len(self.corner)
        for start in range(0, len(rows), CHUNK // children):
            part = slice(start, start + CHUNK // children)
            r, block = np.repeat(rows[part], children), (base[part, None] + self.corner).reshape(-1, base.shape[1])
            inside = ((block >= self.first[r] >> level) & (block <= self.last[r] >> level)).all(axis=1)
            self.visit(r[inside], block[inside], level)
