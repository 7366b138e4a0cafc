"""Convex solids inside the shells of a mesh, with the proof that they are.

**Claim.** An occluder made here lies in a region K that a shell of the mesh walls in: every way from a point of the
occluder to the outside crosses one of the shell's triangles. So for an eye outside K, whatever lies behind the
occluder is behind the shell, too, and cannot be seen. Things in a cavity of a closed mesh are behind its shell as
well, so occluders may (and do) span cavities of *other* shells inside; within one shell, the cavity is not counted as
inside.

**Proof.** (1) A shell is *closed* if each edge is passed as often in one direction as in the other, after merging
vertices of exactly equal coordinates (`topology`): then its triangles are a cycle, the winding number is defined
everywhere off the triangles, is constant along every path that does not touch a triangle, and is 0 far away. A point
of winding number other than 0 is therefore walled in. Nothing else is asked of the mesh: it may intersect itself,
share edges among four faces, be turned inside out, or have other triangles besides. It is *not* enough that cells of a
grid which the surface touches lie around a point: through a slit thinner than a cell one could look in. Here no such
conclusion is drawn; the cells serve to find large free boxes, the winding number says whether one is inside.
(2) A cell that no triangle touches (separating axes, with a margin; `cells`) has one winding number, and so have all
such cells that hang together by sides; it is computed once for each such group, at the middle of a cell, which keeps
half a cell's distance from all triangles (`winding`).
(3) A box of such cells of winding number other than 0 is inside. Pushing its sides, or the planes of a polytope around
its middle, outward while no triangle is touched cannot change the winding number (`grown`, `inflated`).
(4) Rounding: everything happens in coordinates scaled to the mesh's size, in which the margin (`CLEARANCE`, or more
for a mesh far from its origin) is thousands of times the error of any step, moving back included.

**Openings** (only on request). An open shell, with flat covers over its openings, is closed. A line through a point p
of its inside leaves at both ends; it can miss the triangles only where it crosses covers, so it can miss them at both
ends only if p lies between a point of one cover and a point of another (or the same), that is, in the convex hull of
the two. Solids that keep away from all these hulls block each line at least at one side of p. What is behind such a
solid is hidden for eyes outside K, provided that it is itself outside K: one can look into K through the opening, but
not through K. Whether somebody goes in, the mesh cannot tell; but rooms, pits and valleys are turned toward those
inside, things toward those outside. So by default only what faces outward is covered.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .cells import Simplices, cells_touched
from .cuboids import maximal_boxes
from .inflate import HalfSpaces, inflated
from .topology import Shell
from .winding import winding_numbers

F64 = NDArray[np.float64]
#: Which open shells count as closed: see `scenegraph.meshes.fit_occluders`.
Openings = Literal["none", "outward", "any"]

#: Distance of every occluder from the surface, relative to the largest extent of the mesh.
CLEARANCE = 1e-6
#: Groups of free cells that are asked for their winding number, at most; and their least number of cells.
_GROUPS, _LEAST = 32, 8
#: With more openings than this, solids keep away from the hull of all of them together.
_OPENINGS = 8


@dataclass(frozen=True)
class Region:
    """Slab by slab bounds of something: low <= n·x <= high for each direction n; contains its convex hull."""

    directions: F64
    low: F64
    high: F64

    @classmethod
    def around(cls, points: F64, directions: F64) -> Region:
        """Of points (k, 3)."""
        along = points @ directions.T
        return cls(directions, along.min(axis=0), along.max(axis=0))

    def joined(self, other: Region) -> Region:
        """Of both."""
        return Region(self.directions, np.minimum(self.low, other.low), np.maximum(self.high, other.high))

    def apart(self, low: F64, high: F64) -> bool:
        """Whether the box [low, high] surely keeps clear."""
        middle, reach = self.directions @ (0.5 * (low + high)), np.abs(self.directions) @ (0.5 * (high - low))
        return bool(((self.low > middle + reach) | (self.high < middle - reach)).any())


@dataclass(frozen=True)
class Interior:
    """The cells of a grid that a shell encloses.

    Attributes
    ----------
    axes : (3, 3) float64
        Rows are the directions of the grid.
    origin, cell : (3,) float64
        Grid coordinates g of a point x: (axes @ x - origin) / cell. Cell i is [i, i + 1].
    triangles : (m, 3, 3) float64
        The shell with its covers, in grid coordinates.
    margin : (3,) float64
        The clearance in cells.
    enclosed : (x, y, z) bool
        Cells that the shell does not touch but walls in.
    outside : (x, y, z) bool
        Cells that it neither touches nor walls in.
    mask : (x, y, z) bool
        Those of the enclosed that may be part of a solid.
    regions : list of Region
        What solids must keep away from besides the triangles; in grid coordinates.
    """

    axes: F64
    origin: F64
    cell: F64
    triangles: F64
    margin: F64
    enclosed: NDArray[np.bool_]
    outside: NDArray[np.bool_]
    mask: NDArray[np.bool_]
    regions: list[Region]

    def points(self, grid: F64) -> F64:
        """From grid coordinates (k, 3) to those of the shell."""
        return np.asarray((grid * self.cell + self.origin) @ self.axes)

    def holds(self, triangles: F64) -> tuple[bool, bool]:
        """Whether triangles (m, 3, 3) in the shell's coordinates reach inside, and whether they are wholly inside."""
        placed = (triangles @ self.axes.T - self.origin) / self.cell
        end = np.array(self.enclosed.shape)
        near = ((placed.max(axis=1) >= 0) & (placed.min(axis=1) <= end)).all(axis=1)
        touched = cells_touched(placed[near], self.enclosed.shape, self.margin)
        reached = bool((touched & self.enclosed).any())
        return reached, reached and bool(near.all()) and not (touched & self.outside).any()


def interior(shell: Shell, axes: F64, openings: Openings, *, cells: int, clearance: float) -> Interior | None:
    """Find the cells that a shell encloses.

    Parameters
    ----------
    shell : Shell
        Of a mesh whose largest extent is 1.
    axes : (3, 3) float64
    openings : "none", "outward" or "any"
        With "outward", only what an open shell encloses with outward faces counts.
    cells : int
        Along each axis, whatever the extents.
    clearance : float

    Returns
    -------
    Interior, or None for a shell that is too thin to have an inside.
    """
    placed = np.concatenate([shell.triangles, shell.covers]) @ axes.T
    low, high = placed.min(axis=(0, 1)), placed.max(axis=(0, 1))
    # three cells at least, each far larger than the clearance
    count = np.minimum((high - low) / (8 * clearance), cells).astype(np.int64)
    if count.min() < 3:
        return None
    cell = (high - low) / count
    origin = low - cell  # a layer of cells all around is outside for sure
    triangles, margin = (placed - origin) / cell, clearance / cell
    free = ~cells_touched(triangles, tuple(int(c) + 2 for c in count), margin)
    regions = _between_openings([(o.reshape(-1, 3) @ axes.T - origin) / cell for o in shell.openings], margin)
    enclosed = _enclosed(free, triangles, outward=openings == "outward" and not shell.is_closed)
    mask = enclosed.copy()
    for region in regions:
        mask &= ~_cells_near(region, mask.shape)
    return Interior(axes, origin, cell, triangles, margin, enclosed, free & ~enclosed, mask, regions)


def _enclosed(free: NDArray[np.bool_], triangles: F64, *, outward: bool) -> NDArray[np.bool_]:
    from scipy.ndimage import label

    groups, _ = label(free)
    sizes = np.bincount(groups.reshape(-1))
    sizes[[0, groups[0, 0, 0]]] = 0
    asked = np.argsort(-sizes, kind="stable")[:_GROUPS]
    asked = asked[sizes[asked] >= _LEAST]
    where = np.array([np.unravel_index(np.argmax(groups == g), groups.shape) for g in asked]).reshape(-1, 3)
    inside = np.zeros(len(sizes), bool)
    number = winding_numbers(where + 0.5, triangles)
    inside[asked] = number > 0 if outward else number != 0
    return np.asarray(inside[groups])


_DIRECTIONS = np.array([d for d in itertools.product((-1, 0, 1), repeat=3) if d > (0, 0, 0)], float)


def _between_openings(openings: list[F64], margin: F64) -> list[Region]:
    """What lines through two openings can pass: the hull of each two, also of each with itself."""
    if not openings:
        return []
    normals = [np.linalg.svd(p - p.mean(axis=0))[2][2] for p in [*openings, np.concatenate(openings)]]
    directions = np.concatenate([_DIRECTIONS, normals])
    parts = [Region.around(p, directions) for p in openings]
    if len(parts) > _OPENINGS:
        parts = [Region.around(np.concatenate(openings), directions)]
    reach = np.abs(directions) @ margin
    pairs = (a.joined(b) for a, b in itertools.combinations_with_replacement(parts, 2))
    return [Region(directions, r.low - reach, r.high + reach) for r in pairs]


def _cells_near(region: Region, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    near = np.ones(shape, bool)
    middles = [np.arange(n) + 0.5 for n in shape]
    for direction, low, high in zip(region.directions, region.low, region.high, strict=True):
        x, y, z = (d * m for d, m in zip(direction, middles, strict=True))
        at = x[:, None, None] + y[:, None] + z
        reach = 0.5 * np.abs(direction).sum()
        near &= (at + reach >= low) & (at - reach <= high)
    return near


def boxes_inside(inside: Interior, *, limit: int) -> list[tuple[F64, F64]]:
    """Large boxes of enclosed cells, in grid coordinates: pairs of low and high corner (3,)."""
    found = maximal_boxes(inside.mask, cell=inside.cell, limit=limit)
    return [(box[0].astype(float), box[1].astype(float)) for box in found]


def grown(low: F64, high: F64, obstacles: F64, margin: F64, regions: list[Region]) -> tuple[F64, F64]:
    """Push the sides of a free box outward, up to one cell, until just before something is touched.

    First all sides together, then one by one.

    Parameters
    ----------
    low, high : (d,) float64
    obstacles : (m, k, d) float64
        Segments or triangles.
    margin : (d,) float64
    regions : list of Region
    """
    close = ((obstacles.min(axis=1) <= high + 1 + margin) & (obstacles.max(axis=1) >= low - 1 - margin)).all(axis=1)
    simplices = Simplices(obstacles[close])

    def free(near: Simplices, low: F64, high: F64) -> bool:
        center = np.broadcast_to(0.5 * (low + high), near.low.shape)
        hit = near.touch(np.arange(len(near)), center, 0.5 * (high - low) + margin)
        return not hit.any() and all(r.apart(low, high) for r in regions)

    step = _farthest(lambda t: free(simplices, low - t, high + t))
    low, high = low - step, high + step
    for axis, side in itertools.product(range(len(low)), (0, 1)):
        unit = np.eye(len(low))[axis]

        def slab(t: float, low: F64 = low, high: F64 = high, unit: F64 = unit, side: int = side) -> tuple[F64, F64]:
            return (low, high + t * unit) if side else (low - t * unit, high)

        a, b = slab(1.0)
        near = simplices.take(((simplices.low <= b + margin) & (simplices.high >= a - margin)).all(axis=1))
        low, high = slab(_farthest(lambda t, near=near, slab=slab: free(near, *slab(t))))  # type: ignore[misc]
    return low, high


def _farthest(allowed: Callable[[float], bool]) -> float:
    if allowed(1.0):
        return 1.0
    good, bad = 0.0, 1.0
    for _ in range(12):
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if allowed(middle) else (good, middle)
    return good


def box_corners(low: F64, high: F64) -> F64:
    """(8, 3) corners of a box, in the order of `scenegraph.mesh.Mesh.box`."""
    upper = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)], bool)
    return np.where(upper, high, low)


def polytope(inside: Interior, low: F64, high: F64, *, planes: int) -> F64 | None:
    """(v, 3) corners of a convex polytope about the middle of a box, in grid coordinates; None if there is none."""
    end = np.array(inside.mask.shape) - 1.0
    normals, offsets = [*np.eye(3), *-np.eye(3)], [*end, *-np.ones(3)]
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    for region in inside.regions:
        # the slab that is farthest from the box is where to keep away
        at, reach = region.directions @ middle, np.abs(region.directions) @ half
        gaps = np.stack([region.low - at - reach, at - reach - region.high]) / np.linalg.norm(region.directions, axis=1)
        side, k = np.unravel_index(int(gaps.argmax()), gaps.shape)
        normals.append(region.directions[k] if side == 0 else -region.directions[k])
        offsets.append(region.low[k] if side == 0 else -region.high[k])
    within = HalfSpaces(np.array(normals), np.array(offsets))
    return inflated(inside.triangles, low, high, inside.margin, planes=planes, within=within)
