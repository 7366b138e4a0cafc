"""From a box that is free of obstacles to a convex polytope that is, too, and larger.

After the inflation of Deits and Tedrake (2015, IRIS), without its semidefinite program: around the box's middle, in
coordinates in which the box is a cube, the nearest obstacle is cut off by a plane at right angles to the way there; so
is all that lies beyond that plane; and so on until nothing is left. Changed: to get by with few planes, each is drawn
in by some share of the distance, so that it cuts off more, and afterwards all are turned and pushed out again as what
they have to cut off allows, in turns with handing obstacles from plane to plane.

What makes the result safe is not how the planes were found but that each obstacle lies wholly beyond one of them: that
is looked at last, by the assignment that sets the final positions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

#: How many obstacles are looked at first; the others join where they are hit.
_SAMPLE = 2048
#: How often obstacles are handed to other planes, and planes turned, at most.
_TURNS = 8
#: How often planes are fitted anew because of obstacles that were not looked at.
_FITS = 3
#: In cells: far less than any margin, far more than rounding.
_ROUNDING = 1e-9
#: By how much planes are drawn in, tried in turn until there are few enough.
_DRAWN_IN = (0.0, 0.03, 0.06, 0.09, 0.12, 0.15, 0.18, 0.21, 0.25, 0.3, 0.35, 0.4, 0.5)


def nearest_points(simplices: F64) -> F64:
    """(m, d) the point of each segment (m, 2, 2) or triangle (m, 3, 3) that is nearest to the origin."""
    corners = np.moveaxis(simplices, 1, 0)
    best = _on_segment(corners[0], corners[1])
    if len(corners) == 2:
        return best
    for a, b in ((corners[1], corners[2]), (corners[2], corners[0])):
        other = _on_segment(a, b)
        closer = np.einsum("ij,ij->i", other, other) < np.einsum("ij,ij->i", best, best)
        best = np.where(closer[:, None], other, best)
    a, b, c = corners
    normal = np.cross(b - a, c - a)
    size = np.einsum("ij,ij->i", normal, normal)
    with np.errstate(divide="ignore", invalid="ignore"):
        foot = normal * (np.einsum("ij,ij->i", normal, a) / size)[:, None]
        inside = size > 0
        for p, q in ((a, b), (b, c), (c, a)):
            inside &= np.einsum("ij,ij->i", np.cross(q - p, foot - p), normal) >= 0
    return np.where(inside[:, None], foot, best)


def _on_segment(a: F64, b: F64) -> F64:
    way = b - a
    length = np.einsum("ij,ij->i", way, way)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(length > 0, -np.einsum("ij,ij->i", a, way) / length, 0.0)
    return np.asarray(a + np.clip(share, 0.0, 1.0)[:, None] * way)


@dataclass(frozen=True)
class HalfSpaces:
    """Points x with normals @ x <= offsets; normals (k, d), not of unit length, and offsets (k,)."""

    normals: F64
    offsets: F64

    def and_those(self, other: HalfSpaces) -> HalfSpaces:
        """Both together."""
        return HalfSpaces(np.concatenate([self.normals, other.normals]), np.concatenate([self.offsets, other.offsets]))


def inflated(
    simplices: F64, low: F64, high: F64, margin: F64, *, planes: int, within: HalfSpaces, rounds: int = 3
) -> F64 | None:
    """Corners of a convex polytope about the middle of a box that keeps clear of segments or triangles.

    Parameters
    ----------
    simplices : (m, d, d) float64
        Obstacles.
    low, high : (d,) float64
        A box with no obstacle in it.
    margin : (d,) float
        Half extent of the box that has to fit between polytope and obstacles everywhere.
    planes : int
        How many sides the polytope has at most, besides those it shares with `within`.
    within : HalfSpaces
        To stay in; bounded.
    rounds : int
        How often the inflation starts again from the shape that it has reached.

    Returns
    -------
    (v, d) float64, or None if it takes more planes, or rounding spoils the corners.
    """
    middle, shape = 0.5 * (low + high), np.diag(0.5 * (high - low))
    by_corner = np.ascontiguousarray(np.moveaxis(simplices, 1, 0))
    best: F64 | None = None
    most = 0.0
    for _ in range(rounds):
        found = _separating(by_corner, middle, shape, planes)
        if found is None:
            break
        sides = HalfSpaces(found.normals, found.offsets - np.abs(found.normals) @ margin)
        around = HalfSpaces(within.normals, within.offsets - np.abs(within.normals) @ margin)
        corners = corners_of(sides.and_those(around), middle)
        if corners is None:
            break
        volume, middle, shape = _moments(corners)
        if volume <= 1.02 * most:
            break
        best, most = corners, volume
    return best


def corners_of(sides: HalfSpaces, inner: F64) -> F64 | None:
    """(k, 3) corners of what half spaces enclose around an inner point; None if there is no room or no answer."""
    from scipy.spatial import HalfspaceIntersection, QhullError

    depth = sides.offsets - sides.normals @ inner
    size = np.linalg.norm(sides.normals, axis=1)
    if (depth <= 1e-9 * size).any():
        return None
    try:
        table = np.column_stack([sides.normals, sides.normals @ inner - sides.offsets]) / size[:, None]
        corners = HalfspaceIntersection(table, np.zeros(len(inner))).intersections + inner
    except (QhullError, ValueError):
        return None
    # the margin absorbs what rounding moves; more than that is a failure
    over = (sides.normals @ corners.T - sides.offsets[:, None]) / size[:, None]
    if not np.isfinite(corners).all() or over.max() > _ROUNDING:
        return None
    return np.asarray(np.unique(corners, axis=0))


def _moments(corners: F64) -> tuple[float, F64, F64]:
    """Volume and middle of a convex hull, and the half axes (columns) of the ellipsoid that lies in mass like it."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(corners)
    apex = corners.mean(axis=0)
    parts = corners[hull.simplices] - apex
    d = len(apex)
    volumes = np.abs(np.linalg.det(parts))
    total = volumes.sum()
    sums = parts.sum(axis=1)
    middle = (volumes @ sums) / (total * (d + 1))
    # of a simplex with one corner at the origin, up to a factor: sum of squares of the corners plus square of their sum
    second = np.einsum("i,ikp,ikq->pq", volumes, parts, parts) + np.einsum("i,ip,iq->pq", volumes, sums, sums)
    spread = second / (total * (d + 1) * (d + 2)) - np.outer(middle, middle)
    values, vectors = np.linalg.eigh(spread)
    half_axes = vectors * np.sqrt(np.maximum(values, 1e-12 * values.max()) * (d + 2))
    return float(hull.volume), apex + middle, half_axes


def _separating(simplices: F64, middle: F64, shape: F64, limit: int) -> HalfSpaces | None:
    """Half spaces about the middle, each obstacle wholly outside one of them; None if it takes too many.

    Simplices by corner, (c, m, d). Few of them are looked at first; the others are asked against the planes that are
    found, first some of them, at last all, and join if they are not beyond one.
    """
    back = np.linalg.inv(shape)
    count = simplices.shape[1]
    stride = max(1, count // _SAMPLE)
    active = np.arange(0, count, stride)
    level = fits = 0
    for _ in range(24):
        around = (simplices[:, active] - middle) @ back.T
        normals, offsets, level = _cutting_planes(around, limit, level)
        if not len(normals):
            return None
        if stride == 1:
            normals, offsets = _fitted_planes(around, normals, offsets)
            fits += 1
        normals = normals @ back
        offsets = offsets + normals @ middle
        least = (offsets - _ROUNDING * np.linalg.norm(normals, axis=1))[:, None]
        while True:
            reach = _nearest_along(simplices[:, ::stride], normals)
            missed = stride * np.flatnonzero((reach < least).all(axis=0))
            if stride == 1 and (fits == _FITS or (fits and not len(missed))):
                # what is missed now pulls the plane in that suits it best
                return _pushed_out(normals, offsets, reach)
            if len(missed):
                active = np.union1d(active, missed[:: max(1, len(missed) // _SAMPLE)])
                break
            if stride == 1:
                break
            stride = max(1, stride // 8)
    return None


def _nearest_along(corners: F64, normals: list[F64] | F64) -> F64:
    """(k, m) where along each normal a simplex begins; simplices by corner, (c, m, d)."""
    table = np.asarray(normals)
    out = table @ corners[0].T
    for others in corners[1:]:
        np.minimum(out, table @ others.T, out=out)
    return np.asarray(out)


def _cutting_planes(corners: F64, limit: int, level: int) -> tuple[F64, F64, int]:
    """Normals and positions of planes about the origin, each simplex beyond one; empty if it takes too many.

    `level` says how far planes are drawn in at first; the one that was enough comes back.
    """
    near = nearest_points(np.moveaxis(corners, 0, 1))
    distance = np.sqrt(np.einsum("ij,ij->i", near, near))
    order = np.argsort(distance, kind="stable")
    corners, near, distance = corners[:, order], near[order], distance[order]
    none = np.zeros((0, corners.shape[2])), np.zeros(0), level
    if not len(distance) or distance[0] == 0:
        return none
    for more, drawn_in in enumerate(_DRAWN_IN[level:]):
        normals: list[F64] = []
        offsets: list[float] = []
        rest, numbers = corners, np.arange(len(distance))
        while len(numbers) and len(normals) < limit:
            first = numbers[0]
            normals.append(near[first] / distance[first])
            offsets.append((1 - drawn_in) * float(distance[first]) * (1 - 1e-12))
            beyond = _nearest_along(rest, normals[-1:])[0] >= offsets[-1]
            beyond[0] = True  # by construction; rounding must not make it come back forever
            rest, numbers = rest[:, ~beyond], numbers[~beyond]
        if not len(numbers):
            return np.array(normals), np.array(offsets), level + more
    return none


def _fitted_planes(corners: F64, normals: F64, offsets: F64) -> tuple[F64, F64]:
    """Planes turned and pushed away from the origin, in turns with the choice of which simplices each has to cut off.

    Each simplex goes to the plane that it is farthest beyond; each plane goes where it is farthest from the origin but
    has all of its own beyond it. No plane ever comes nearer.
    """
    for _ in range(_TURNS):
        suits = _most_beyond(_nearest_along(corners, normals), offsets)
        kept_normals, kept_offsets = [], []
        for k, (normal, offset) in enumerate(zip(normals, offsets, strict=True)):
            mine = suits == k
            if mine.any():
                better, farther = _farthest_plane(corners[:, mine].reshape(-1, corners.shape[2]), normal)
                kept_normals.append(better if farther > offset else normal)
                kept_offsets.append(max(farther, offset))
        gain = sum(kept_offsets) / max(offsets.sum(), 1e-300)
        done = len(kept_offsets) == len(offsets) and gain < 1.002
        normals, offsets = np.array(kept_normals), np.array(kept_offsets)
        if done:
            break
    return normals, offsets


def _farthest_plane(points: F64, normal: F64) -> tuple[F64, float]:
    """The plane farthest from the origin with all points beyond it; through their hull's nearest point (Gilbert)."""
    along = points @ normal
    x = points[along.argmin()]
    best, farthest = normal, float(along.min())
    for _ in range(24):
        size = float(np.sqrt(x @ x))
        if size == 0:
            break
        along = points @ (x / size)
        least = int(along.argmin())
        if along[least] > farthest:
            best, farthest = x / size, float(along[least])
        if size - along[least] < 1e-3 * size:
            break
        way = points[least] - x
        x = x + way * min(max(-float(x @ way) / float(way @ way), 0.0), 1.0)
    return np.asarray(best), farthest


def _most_beyond(reach: F64, offsets: F64) -> NDArray[np.int64]:
    """(m,) which plane each simplex is farthest beyond; `reach` (k, m) is where along each normal it begins."""
    suits, most = np.zeros(reach.shape[1], np.int64), np.full(reach.shape[1], -np.inf)
    for k, along in enumerate(reach):
        room = along - offsets[k]
        suits[room > most] = k
        np.maximum(most, room, out=most)
    return suits


def _pushed_out(normals: F64, offsets: F64, reach: F64) -> HalfSpaces:
    """Planes pushed out as far as each obstacle stays wholly beyond the plane that suits it best.

    `reach` (k, m) is how far along each normal an obstacle begins.
    """
    for _ in range(4):
        suits = _most_beyond(reach, offsets)
        new = np.full(len(normals), np.inf)
        np.minimum.at(new, suits, reach[suits, np.arange(len(suits))])
        # a plane that cuts nothing off is not needed
        used = np.isfinite(new)
        normals, offsets, reach = normals[used], new[used], reach[used]
    return HalfSpaces(normals, offsets)
