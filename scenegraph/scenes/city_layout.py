"""Where things are in the city: blocks, lots, and the walk through its streets."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from .paths import Moment
from .shapes import Floats

#: Half the edge of a block between its building lines; sidewalk; half the road. In meters.
BLOCK, SIDEWALK, ROAD = 44.0, 3.5, 7.5
PITCH = 2 * (BLOCK + SIDEWALK + ROAD)
#: Depth of a row of lots, and how far fronts stand behind the building line: cornices overhang it.
ROW, SETBACK = 16.0, 0.6
LOTS = 16

ROUTE = ((-1, 0), (0, 0), (0, 1), (1, 1), (1, 0), (2, 0))


@dataclass(frozen=True)
class Layout:
    """The lots of a city, as arrays over its n buildings, and its grid of blocks.

    Attributes
    ----------
    blocks : 2 ints
        Number of blocks along x and y.
    block : (n,) int
        Block of each building, x * blocks[1] + y.
    center : (n, 2) float64
        Middle of each lot relative to the middle of its block.
    size : (n, 2) float64
        Of the lot: along the street, and depth.
    angle : (n,) float64
        Degrees by which a front that faces -y is turned.
    corner : (n,) int
        -1 or 1 where the building's -x or +x side, seen with its front towards -y, faces a second street; else 0.
    density : (n,) float64
        1 in the middle of the city, falling to 0 at its edge.
    """

    blocks: tuple[int, int]
    block: NDArray[np.intp]
    center: Floats
    size: Floats
    angle: Floats
    corner: NDArray[np.intp]
    density: Floats

    @property
    def extent(self) -> Floats:
        """(2,) size of the city between the middles of its outermost streets."""
        return PITCH * np.array(self.blocks, np.float64)

    def block_center(self, block: NDArray[np.intp] | int) -> Floats:
        """(..., 2) middles of blocks in world coordinates; the city is centered on the origin."""
        xy = np.stack(np.divmod(block, self.blocks[1]), axis=-1)
        return np.asarray((xy + 0.5) * PITCH - self.extent / 2)

    def crossing(self, i: int, j: int) -> Floats:
        """(2,) world position where the i-th street along y and the j-th along x cross, or the nearest that do."""
        return np.asarray(np.clip((i, j), 0, self.blocks) * PITCH - self.extent / 2)


def lay_out(count: int, rng: np.random.Generator) -> Layout:
    """Choose `count` lots, nearest to the middle first; a few lots and blocks are left open."""
    total = -(-count // (LOTS - 2)) + 1
    across = max(round(total**0.5), 1)
    blocks = (-(-total // across), across)
    k = blocks[0] * blocks[1]
    width = rng.uniform(0.75, 1.3, (k, 2, 5))
    width *= 2 * BLOCK / width.sum(axis=2, keepdims=True)
    length = rng.uniform(0.8, 1.25, (k, 2, 3))
    length *= 2 * (BLOCK - ROW) / length.sum(axis=2, keepdims=True)
    # rows to the south and north run the whole width, those to the west and east fill in between
    along_x = (np.cumsum(width, axis=2) - width / 2 - BLOCK).reshape(k, 10)
    along_y = (np.cumsum(length, axis=2) - length / 2 - (BLOCK - ROW)).reshape(k, 6)
    side = np.array([-1.0, 1.0]) * (BLOCK - ROW / 2)
    x = np.hstack([along_x, np.tile(np.repeat(side, 3), (k, 1))])
    y = np.hstack([np.tile(np.repeat(side, 5), (k, 1)), along_y])
    size = np.hstack([width.reshape(k, 10), length.reshape(k, 6)]).ravel()
    angle = np.repeat([0.0, 180.0, -90.0, 90.0], [5, 5, 3, 3])
    corner = np.zeros(LOTS, np.intp)
    corner[[0, 4, 5, 9]] = (-1, 1, 1, -1)

    block = np.repeat(np.arange(k), LOTS)
    distance = np.hypot(*(np.stack(np.divmod(block, blocks[1])) + 0.5 - np.array(blocks)[:, None] / 2))
    open_lot = (rng.random((k, LOTS)) < 0.05) & (corner == 0)
    park = (rng.random(k) < 0.04)[block] & (distance > 2.5)
    # open lots and parks come last: they are built on only when there is no other room
    order = np.argsort(distance + 1e5 * open_lot.ravel() + 1e6 * park, kind="stable")
    chosen = np.sort(order[:count])
    density = np.exp(-((distance / (0.42 * max(blocks) / 2)) ** 2)) if max(blocks) > 2 else np.full(len(block), 0.5)
    return Layout(
        blocks,
        block[chosen],
        np.column_stack([x.ravel(), y.ravel()])[chosen],
        np.column_stack([size, np.full(len(size), ROW)])[chosen],
        np.tile(angle, k)[chosen],
        np.tile(corner, k)[chosen],
        density[chosen],
    )


def street_walk(layout: Layout) -> tuple[Floats, list[Moment]]:
    """Footsteps (k, 3) along the streets in the middle of the city, and three moments close to buildings.

    A faces a facade from the sidewalk; B and C stand before the corner of a block, where two facades show.
    """
    middle = np.array(layout.blocks) // 2
    stops = np.array([layout.crossing(*(middle + step)) for step in ROUTE])
    stops = stops[np.concatenate([[True], np.any(np.diff(stops, axis=0), axis=1)])]
    line = SIDEWALK + ROAD
    steps: list[Floats] = []
    moments: list[Moment] = []
    for k, (start, end) in enumerate(pairwise(stops)):
        ahead = (end - start) / PITCH
        left = np.array([-ahead[1], ahead[0]])
        if (np.abs(start + PITCH * (ahead + left) / 2) > layout.extent / 2).any():
            left = -left
        if k == 0:
            door = start + 0.55 * PITCH * ahead
            at, target = door + (line - 2.2) * left, door + (line + SETBACK) * left + 1.5 * ahead
            steps += [start + 0.2 * PITCH * ahead, door - 14 * ahead, at - 2 * ahead, at + 2 * ahead, door + 14 * ahead]
        else:
            steps.append(start)
        if k in (1, 3):
            at, target = start + 6.5 * ahead + 5.5 * left, start + (line + 1) * (ahead + left)
            steps += [at, at + 9 * ahead - left]
        if k in (0, 1, 3):
            moments.append(Moment("ABC"[len(moments)], (*at, 1.7), (*target, 3.2), 9.0))
    steps.append(stops[-2] + 0.8 * (stops[-1] - stops[-2]))
    return np.insert(np.array(steps), 2, 0.0, axis=1), moments
