"""How far two surfaces lie apart, as a bound that holds for all of their points and not only for sampled ones.

The distance from a triangle *t* is a convex function of the point. So no point of a triangle *T* is farther from *t*
than *T*'s farthest corner is, and no point of *T* is farther from a surface than

    min over some triangles t of the surface, of the max over the corners p of T, of distance(p, t),

whichever triangles are tried. Trying those nearest to *T* gives a bound for *T*; where it lies well above the farthest
point found so far, *T* is cut and each part has its own: along a side of the best *t*, if *T* reaches over it, so that
surfaces that lie in each other come out at 0 after as many cuts as they have crossing edges; else in four. The largest
is the one-sided distance. A search tree over points of the surface only proposes triangles: a poor proposal makes the
bound larger, never wrong.

Most of *T* are done with cheaply: triangles that both surfaces have are no distance apart, and for most others the
nearest *t* alone gives a bound below the farthest point found. Only for the rest more are tried.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..kernels.triangles import point_triangle_distance, point_triangle_weights

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

#: Triangles tried per part that the nearest one has not done for: few, and more where few have not done for so many
#: rounds of cutting.
_TRIED, _LATER = (4, 8, 24), 3
#: Share of the size of a surface below which it is not worth telling distances apart.
FLOOR = 2e-4
#: Parts that are looked at closely to find a far point: so many at once, and in all.
_AT_ONCE, _CLOSELY = 32, 256
#: Pairs of a part and a triangle worked on together: their arrays stay in the cache of the processor.
_CHUNK = 1 << 12
#: Rounds of cutting, and parts after which the bound is taken as it is.
_CUTS, _PARTS = 20, 300_000
#: Points of the search tree: at least two per triangle; of few triangles as many as this, or 64 of each.
_POINTS = 20_000


class Deviation(NamedTuple):
    """How far a surface goes from another one.

    Attributes
    ----------
    bound : float
        No point of the first surface is farther from the second one.
    found : float
        The farthest of the points that were looked at, as far as the proposed triangles tell; what the bound is worth.
    """

    bound: float
    found: float


class Surface:
    """Triangles that points and other triangles are held against.

    Parameters
    ----------
    triangles : (m, 3, 3) float64
        Corners; finite. At least one.
    spread : bool
        Whether triangles are searched by points all over them; else by their middles, which is done sooner and good
        enough for small ones.
    """

    def __init__(self, triangles: F64, *, spread: bool = True) -> None:
        # a quarter of a second that listing the stages does not need
        from scipy.spatial import cKDTree

        self.triangles = triangles
        self._corners = np.ascontiguousarray(triangles.transpose(1, 2, 0))
        if spread:
            points, self._of = _spread(triangles, max(min(_POINTS, 64 * len(triangles)), 2 * len(triangles)))
        else:
            points, self._of = triangles.mean(axis=1), np.arange(len(triangles))
        # halves of the box instead of medians: made in half the time, and asked as fast
        self._tree = cKDTree(points, balanced_tree=False)

    def near(self, points: F64, count: int) -> I64:
        """(k, c) triangles near (k, 3) points, c ≤ `count`; some may be named twice."""
        count = min(count, len(self._of))
        _, found = self._tree.query(points, k=count)
        return np.asarray(self._of[np.asarray(found).reshape(len(points), count)])

    def distances(self, points: F64, which: I64) -> F64:
        """Distances of (3, ...) points from the triangles `which` (...), broadcast: as many axes, less the first."""
        a, b, c = self._corners[:, :, which]
        return point_triangle_distance(points, a, b, c)

    def weights(self, points: F64, which: I64) -> F64:
        """(3, k) weights of the nearest point of the triangles `which` (k,), for (3, k) points."""
        a, b, c = self._corners
        return point_triangle_weights(points, a[:, which], b[:, which], c[:, which])


def surface_deviation(surface: F64, other: Surface, *, tolerance: float = 0.1) -> Deviation:
    """How far a surface goes from another one, one way.

    Parameters
    ----------
    surface : (m, 3, 3) float64
    other : Surface
    tolerance : float
        Cutting stops when the bound lies by no more than this share above what was found, or by no more than `FLOOR` of
        the size of the other surface.

    Returns
    -------
    Deviation
    """
    size = float(np.ptp(other.triangles.reshape(-1, 3), axis=0).max(initial=0.0))
    bound = found = 0.0
    parts = surface[~is_among(surface, other.triangles)]
    for cut in range(_CUTS + 1):
        if not len(parts):
            break
        reach, middle, best = _nearest(parts, other)
        found = max(found, _farthest(parts, middle, other, found))
        enough = max((1 + tolerance) * found, found + FLOOR * size)
        # more are tried for all that the bound may come from, and for all that would be cut
        few = np.flatnonzero(reach > found)
        now, one = _reaches(parts[few], other, _TRIED[min(cut // _LATER, 2)])
        better = now < reach[few]
        reach[few[better]], best[few[better]] = now[better], one[better]
        is_coarse = reach > enough
        if cut == _CUTS or 3 * int(is_coarse.sum()) > _PARTS:
            is_coarse[:] = False
        bound = max(bound, float(reach[~is_coarse].max(initial=0.0)))
        parts = _cut(parts[is_coarse], other.triangles[best[is_coarse]], 1e-9 * size)
    return Deviation(bound, found)


def _nearest(parts: F64, other: Surface) -> tuple[F64, F64, I64]:
    """By the triangle nearest to each part: (m,) its bound, (m,) the distance of its middle, and (m,) the triangle."""
    reach, middle, best = np.empty(len(parts)), np.empty(len(parts)), np.empty(len(parts), np.int64)
    for now in _chunks(len(parts), 1):
        some = parts[now]
        center = _middles(some)
        points = np.empty((3, 4, len(some)))
        points[:, :3], points[:, 3] = some.transpose(2, 1, 0), center.T
        best[now] = other.near(center, 1)[:, 0]
        away = other.distances(points, best[now][None])
        reach[now], middle[now] = away[:3].max(axis=0), away[3]
    return reach, middle, best


def _reaches(parts: F64, other: Surface, count: int) -> tuple[F64, I64]:
    """(m,) bound of each part, of so many triangles near it, less the nearest; and (m,) the triangle that gave it."""
    reach, best = np.empty(len(parts)), np.empty(len(parts), np.int64)
    for now in _chunks(len(parts), count):
        some = parts[now]
        tried = other.near(_middles(some), count)
        tried = tried[:, min(1, tried.shape[1] - 1) :]
        # (3 corners, c, k)
        away = other.distances(np.ascontiguousarray(some.transpose(2, 1, 0))[:, :, None], tried.T[None])
        far = away.max(axis=0)
        chosen = far.argmin(axis=0)
        each = np.arange(len(some))
        reach[now], best[now] = far[chosen, each], tried[each, chosen]
    return reach, best


def _middles(triangles: F64) -> F64:
    # `mean` takes longer over so short an axis
    return np.asarray((triangles[:, 0] + triangles[:, 1] + triangles[:, 2]) / 3)


def _chunks(count: int, tried: int) -> list[slice]:
    step = max(_CHUNK // tried, 1)
    return [slice(start, start + step) for start in range(0, count, step)]


def _farthest(parts: F64, middle: F64, other: Surface, found: float) -> float:
    """Distance of the farthest middle, if it is more than what was found, of those that seem to be.

    With few triangles tried, a middle may seem farther than it is: those that seem farthest are looked at closely.
    """
    top = np.argsort(-middle, kind="stable")[:_CLOSELY]
    for start in range(0, len(top), _AT_ONCE):
        some = top[start : start + _AT_ONCE]
        if middle[some[0]] <= found:
            break
        center = _middles(parts[some])
        away = other.distances(np.ascontiguousarray(center.T)[:, None], other.near(center, _TRIED[-1]).T)
        found = max(found, float(away.min(axis=0).max()))
    return found


def _cut(parts: F64, against: F64, least: float) -> F64:
    """Cut each triangle along the side of its triangle of `against` that it reaches over most; the others in four."""
    side = np.roll(against, -1, axis=1) - against
    normal = np.cross(side[:, 0], side[:, 1])
    inward = np.cross(normal[:, None], side)
    length = np.linalg.norm(inward, axis=2, keepdims=True)
    inward /= np.where(length > 0, length, np.inf)
    # (m, corner, side) how far a corner lies within a side
    within = np.einsum("mpsc,msc->mps", parts[:, :, None] - against[:, None], inward)
    over = within.min(axis=1).argmin(axis=1)
    sign = within[np.arange(len(parts)), :, over]
    crossing = (sign.min(axis=1) < -least) & (sign.max(axis=1) > least)
    four = parts[~crossing]
    parts, sign = parts[crossing], sign[crossing]
    # the corner that is alone on its side comes first
    outside = sign < 0
    alone = np.where(outside.sum(axis=1) == 1, outside.argmax(axis=1), (~outside).argmax(axis=1))
    turn = (alone[:, None] + np.arange(3)) % 3
    row = np.arange(len(parts))[:, None]
    parts, sign = parts[row, turn], sign[row, turn]
    a, b, c = (parts[:, i] for i in range(3))
    x = a + (b - a) * (sign[:, 0] / (sign[:, 0] - sign[:, 1]))[:, None]
    y = a + (c - a) * (sign[:, 0] / (sign[:, 0] - sign[:, 2]))[:, None]
    pieces = ((a, x, y), (x, b, c), (x, c, y))
    return np.concatenate([_quartered(four), *(np.stack(piece, axis=1) for piece in pieces)])


def _quartered(triangles: F64) -> F64:
    a, b, c = (triangles[:, i] for i in range(3))
    ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    quarters = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
    return np.concatenate([np.stack(q, axis=1) for q in quarters])


def _spread(triangles: F64, enough: int) -> tuple[F64, I64]:
    """Points all over the triangles, about evenly, and the triangle of each; every triangle has one."""
    sides = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
    # columns over the longest side, each with a point at least: slivers and sharp corners get theirs, too
    start = sides.argmax(axis=1)
    turned = triangles[np.arange(len(triangles))[:, None], (start[:, None] + np.arange(3)) % 3]
    longest = sides.max(axis=1)
    base, leg = turned[:, 1] - turned[:, 0], turned[:, 2] - turned[:, 0]
    double = np.linalg.norm(np.cross(base, leg), axis=1)
    spacing = np.sqrt(double.sum() / enough)
    longest = np.where(longest > 0, longest, np.inf)
    foot = np.clip((leg * base).sum(axis=1) / longest**2, 0.0, 1.0)
    cuts = np.ones((2, len(triangles)), np.int64)
    if spacing > 0:
        cuts = np.clip(np.ceil(np.stack([sides.max(axis=1), double / longest]) / spacing), 1, 256).astype(np.int64)
    m, n = cuts
    of = np.repeat(np.arange(len(triangles)), m * n)
    cell = np.arange(len(of)) - np.repeat(np.cumsum(m * n) - m * n, m * n)
    column, row = np.divmod(cell, n[of])
    x, y = (column + 0.5) / m[of], (row + 0.5) / n[of]
    q = foot[of]
    with np.errstate(divide="ignore"):
        top = np.minimum(x / q, (1 - x) / (1 - q))
    kept = (y < top) | (row == 0)
    of, x, q, y = of[kept], x[kept], q[kept], np.minimum(y, np.where(row == 0, 0.5 * top, np.inf))[kept]
    a, b, c = turned[of].transpose(1, 0, 2)
    points = (1 - x - (1 - q) * y)[:, None] * a + (x - q * y)[:, None] * b + y[:, None] * c
    return points, of


def is_among(sets: F64, others: F64) -> NDArray[np.bool_]:
    """Whether sets of points, such as corners of triangles, are among other sets, exactly and in any order.

    Parameters
    ----------
    sets : (k, c, 3) float64
    others : (m, c, 3) float64
        At least one.

    Returns
    -------
    (k,) bool
        False for some that are, if two others have the same mark by chance.
    """
    marks, known = _marks(sets), _marks(others)
    order = np.argsort(known)
    at = order[np.minimum(np.searchsorted(known, marks, sorter=order), len(known) - 1)]
    found: NDArray[np.bool_] = known[at] == marks
    # marks may be shared by chance, points are not
    same = (sets[found][:, :, None] == others[at[found]][:, None]).all(axis=3)
    found[found] = same.any(axis=2).all(axis=1)
    return found


def _marks(sets: F64) -> NDArray[np.uint64]:
    """(k,) a number for each set of points that does not depend on their order."""
    # 0.0 and -0.0 are the same place
    bits = np.ascontiguousarray(sets + 0.0).view(np.uint64)
    mixed = bits[:, :, 0] * np.uint64(0x9E3779B97F4A7C15)
    for axis in (1, 2):
        mixed = (mixed ^ (mixed >> np.uint64(29)) ^ bits[:, :, axis]) * np.uint64(0xBF58476D1CE4E5B9)
    return np.asarray((mixed ^ (mixed >> np.uint64(32))).sum(axis=1, dtype=np.uint64))
