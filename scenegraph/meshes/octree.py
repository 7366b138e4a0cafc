"""An octree over points, as ranges of their Morton order: built top-down, split only by how many points a node has."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

#: Splits at most: a Morton code of three times so many bits fits into 64.
DEPTH = 20


@dataclass(frozen=True)
class Octree:
    """Nodes in depth-first order, parents first.

    Attributes
    ----------
    order : (p,) int64
        Points in the order in which nodes hold them.
    first, last : (m,) int64
        A node holds ``order[first:last]``.
    parent : (m,) int64
        -1 for the root.
    end : (m,) int64
        One behind the last node below; ``end == index + 1`` for leaves.
    """

    order: I64
    first: I64
    last: I64
    parent: I64
    end: I64

    def __len__(self) -> int:
        return len(self.parent)


def octree(points: F64, most: int) -> Octree:
    """Split a cube around points until no node holds more than `most`, or `DEPTH` is reached.

    Parameters
    ----------
    points : (p, 3) float64
        Finite. Without any, there is one empty node.
    most : int
        At least 1.
    """
    codes = morton_codes(points)
    order = np.argsort(codes, kind="stable")
    codes = codes[order]
    first: list[int] = []
    last: list[int] = []
    parent: list[int] = []
    # a stack of ranges: an octree of p points has some p / most nodes, so this loop is short
    stack = [(0, len(codes), -1, 0)]
    while stack:
        a, b, above, depth = stack.pop()
        number = len(first)
        first.append(a)
        last.append(b)
        parent.append(above)
        if b - a <= most or depth == DEPTH:
            continue
        shift = np.uint64(3 * (DEPTH - 1 - depth))
        eighth = (codes[a:b] >> shift) & np.uint64(7)
        cuts = a + np.searchsorted(eighth, np.arange(9, dtype=np.uint64))
        below = [(int(c), int(d), number, depth + 1) for c, d in pairwise(cuts) if d > c]
        stack.extend(reversed(below))
    above_of = np.array(parent, np.int64)
    end = np.arange(1, len(first) + 1)
    for node in range(len(first) - 1, 0, -1):
        end[above_of[node]] = max(end[above_of[node]], end[node])
    return Octree(order, np.array(first, np.int64), np.array(last, np.int64), above_of, end)


def morton_codes(points: F64) -> NDArray[np.uint64]:
    """(p,) positions along a Z-order curve through the cube around points."""
    if not len(points):
        return np.zeros(0, np.uint64)
    low, high = points.min(axis=0), points.max(axis=0)
    edge = float((high - low).max())
    # in halves: the cube of the largest numbers has an edge that is none
    scaled = (points / 2 - low / 2) / (edge / 2) if edge > 0 else np.zeros_like(points)
    cell = np.minimum(scaled * 2.0**DEPTH, 2.0**DEPTH - 1).astype(np.uint64)
    code = np.zeros(len(points), np.uint64)
    for bit in range(DEPTH):
        for axis in range(3):
            code |= ((cell[:, axis] >> np.uint64(bit)) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return code
