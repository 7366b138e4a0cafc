"""How far two surfaces lie apart, as a bound that holds for all of their points and not only for sampled ones.

The distance from a triangle *t* is a convex function of the point. So no point of a triangle *T* is farther from *t*
than *T*'s farthest corner is, and no point of *T* is farther from a surface than

    min over some triangles t of the surface, of the max over the corners p of T, of distance(p, t),

whichever triangles are tried. Trying those nearest to *T* gives a bound for *T*; where it lies well above the farthest
point found so far, *T* is cut and each part has its own: along a side of the best *t*, if *T* reaches over it, so that
surfaces that lie in each other come out at 0 after as many cuts as they have crossing edges; else in four. The largest
is the one-sided distance. A search tree over points of the surface only proposes triangles: a poor proposal makes the
bound larger, never wrong.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..kernels.triangles import point_triangle_distance, point_triangle_weights

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

#: Triangles tried per part: few, and more where few have not done for so many rounds of cutting.
_TRIED, _LATER = (4, 8, 24), 3
#: Share of the size of a surface below which it is not worth telling distances apart.
FLOOR = 2e-4
#: Parts that are looked at closely to find a far point.
_CLOSELY = 256
#: Parts worked on together, rounds of cutting, and parts after which the bound is taken as it is.
_CHUNK, _CUTS, _PARTS = 1 << 14, 20, 300_000
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
    """

    def __init__(self, triangles: F64) -> None:
        # a quarter of a second that listing the stages does not need
        from scipy.spatial import cKDTree

        self.triangles = triangles
        self._corners = np.ascontiguousarray(triangles.transpose(1, 2, 0))
        points, self._of = _spread(triangles, max(min(_POINTS, 64 * len(triangles)), 2 * len(triangles)))
        self._tree = cKDTree(points)

    def near(self, points: F64, count: int) -> I64:
        """(k, c) triangles near (k, 3) points, c ≤ `count`; some may be named twice."""
        count = min(count, len(self._of))
        _, found = self._tree.query(points, k=count)
        return np.asarray(self._of[np.asarray(found).reshape(len(points), count)])

    def distances(self, points: F64, which: I64) -> F64:
        """(k,) distances of (3, k) points from the triangles `which` (k,)."""
        a, b, c = self._corners
        return point_triangle_distance(points, a[:, which], b[:, which], c[:, which])

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
    parts = surface
    for cut in range(_CUTS + 1):
        reach, middle, best = _reaches(parts, other, _TRIED[min(cut // _LATER, 2)])
        # with few tried, a middle may seem farther than it is: the farthest are looked at closely
        top = np.argsort(-middle, kind="stable")[:_CLOSELY]
        found = max(found, float(_reaches(parts[top], other, _TRIED[-1])[1].max()))
        coarse = reach > max((1 + tolerance) * found, found + FLOOR * size)
        if cut == _CUTS or 3 * int(coarse.sum()) > _PARTS:
            coarse[:] = False
        bound = max(bound, float(reach[~coarse].max(initial=0.0)))
        if not coarse.any():
            break
        parts = _cut(parts[coarse], other.triangles[best[coarse]], 1e-9 * size)
    return Deviation(bound, found)


def _reaches(parts: F64, other: Surface, count: int) -> tuple[F64, F64, I64]:
    """(m,) bound of each triangle, (m,) distance of its middle, and (m,) the triangle that gave the bound."""
    reach, middle, best = np.empty(len(parts)), np.empty(len(parts)), np.empty(len(parts), np.int64)
    for start in range(0, len(parts), _CHUNK):
        some = parts[start : start + _CHUNK]
        center = some.mean(axis=1)
        tried = other.near(center, count)
        k, c = tried.shape
        points = np.concatenate([some, center[:, None]], axis=1)
        points = np.ascontiguousarray(points.transpose(2, 1, 0)).reshape(3, 4, 1, k)
        points = np.broadcast_to(points, (3, 4, c, k)).reshape(3, -1)
        which = np.broadcast_to(tried.T, (4, c, k)).reshape(-1)
        away = other.distances(points, which).reshape(4, c, k)
        far = away[:3].max(axis=0)
        chosen = far.argmin(axis=0)
        now = slice(start, start + k)
        reach[now], middle[now] = far[chosen, np.arange(k)], away[3].min(axis=0)
        best[now] = tried[np.arange(k), chosen]
    return reach, middle, best


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
    points, of = [], []
    for m, n in np.unique(cuts, axis=1).T.tolist():
        which = np.flatnonzero((cuts[0] == m) & (cuts[1] == n))
        x, y = (t.ravel()[None] for t in np.meshgrid((np.arange(m) + 0.5) / m, (np.arange(n) + 0.5) / n))
        q = foot[which, None]
        with np.errstate(divide="ignore"):
            top = np.minimum(x / q, (1 - x) / (1 - q))
        kept = (y < top) | (y < 1 / n)
        y = np.minimum(y, np.where(y < 1 / n, 0.5 * top, np.inf))
        weights = np.stack([1 - x - (1 - q) * y, x - q * y, y + 0 * q])[:, kept]
        row = np.broadcast_to(which[:, None], kept.shape)[kept]
        points.append(np.einsum("kc,ckx->kx", weights.T, turned[row].transpose(1, 0, 2)))
        of.append(row)
    return np.concatenate(points), np.concatenate(of)
