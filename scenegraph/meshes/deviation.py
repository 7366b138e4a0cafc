"""How far two surfaces lie apart, as a bound that holds for all of their points and not only for sampled ones.

The distance from a triangle *t* is a convex function of the point. So no point of a triangle *T* is farther from *t*
than *T*'s farthest corner is, and no point of *T* is farther from a surface than

    min over some triangles t of the surface, of the max over the corners p of T, of distance(p, t),

whichever triangles are tried. Trying those nearest to *T* gives a bound for *T*; where it lies well above the farthest
point found so far, *T* is cut in four and each part has its own. The largest is the one-sided distance. A search tree
over points of the surface only proposes triangles: a poor proposal makes the bound larger, never wrong.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..kernels.triangles import point_triangle_distance, point_triangle_weights

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

#: Triangles tried per part: few, and more where few do not do.
_TRIED = (2, 8, 24)
#: Parts that are looked at closely to find a far point.
_CLOSELY = 256
#: Parts worked on together, cuts in four, and parts after which the bound is taken as it is.
_CHUNK, _CUTS, _PARTS = 1 << 14, 8, 300_000
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
        Cutting stops when the bound lies by no more than this share above what was found, or by no more than 2e-4 of
        the size of the other surface.

    Returns
    -------
    Deviation
    """
    size = float(np.ptp(other.triangles.reshape(-1, 3), axis=0).max(initial=0.0))
    bound = found = 0.0
    parts = surface
    for cut in range(_CUTS + 1):
        for tried in _TRIED:
            reach, middle = _reaches(parts, other, tried)
            if len(parts):
                # with few tried, a middle may seem farther than it is: the farthest are looked at closely
                top = np.argsort(-middle, kind="stable")[:_CLOSELY]
                found = max(found, float(_reaches(parts[top], other, _TRIED[-1])[1].max()))
            coarse = reach > max((1 + tolerance) * found, found + 1e-3 * size)
            if tried == _TRIED[-1] and (cut == _CUTS or 4 * int(coarse.sum()) > _PARTS):
                coarse[:] = False
            bound = max(bound, float(reach[~coarse].max(initial=0.0)))
            parts = parts[coarse]
        if not len(parts):
            break
        parts = _quartered(parts)
    return Deviation(bound, found)


def _reaches(parts: F64, other: Surface, count: int) -> tuple[F64, F64]:
    """(m,) bound of each triangle, and (m,) distance of its middle."""
    reach, middle = np.empty(len(parts)), np.empty(len(parts))
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
        reach[start : start + k] = away[:3].max(axis=0).min(axis=0)
        middle[start : start + k] = away[3].min(axis=0)
    return reach, middle


def _quartered(triangles: F64) -> F64:
    a, b, c = (triangles[:, i] for i in range(3))
    ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    quarters = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
    return np.concatenate([np.stack(q, axis=1) for q in quarters])


def _spread(triangles: F64, enough: int) -> tuple[F64, I64]:
    """Points all over the triangles, about evenly, and the triangle of each; every triangle has one."""
    sides = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
    # the longest side is the base: a sliver gets a row of points, not a heap
    base = sides.argmax(axis=1)
    turned = triangles[np.arange(len(triangles))[:, None], (base[:, None] + np.arange(3)) % 3]
    longest = sides.max(axis=1)
    normal = np.cross(turned[:, 1] - turned[:, 0], turned[:, 2] - turned[:, 0])
    double = np.linalg.norm(normal, axis=1)
    spacing = np.sqrt(double.sum() / enough)
    cuts = np.ones((2, len(triangles)), np.int64)
    if spacing > 0:
        height = double / np.where(longest > 0, longest, np.inf)
        cuts = np.clip(np.ceil(np.stack([longest, height]) / spacing), 1, 256).astype(np.int64)
    points, of = [], []
    for m, n in np.unique(cuts, axis=1).T.tolist():
        which = np.flatnonzero((cuts[0] == m) & (cuts[1] == n))
        i, j = (x.ravel() for x in np.meshgrid(np.arange(m), np.arange(n), indexing="ij"))
        # the two halves of each cell of a grid over the parallelogram; those beyond the diagonal fall away
        v = np.concatenate([(i + 1 / 3) / m, (i + 2 / 3) / m])
        w = np.concatenate([(j + 1 / 3) / n, (j + 2 / 3) / n])
        v, w = v[v + w < 1], w[v + w < 1]
        weights = np.stack([1 - v - w, v, w])
        points.append(np.einsum("sk,msc->mkc", weights, turned[which]).reshape(-1, 3))
        of.append(np.repeat(which, len(v)))
    return np.concatenate(points), np.concatenate(of)
