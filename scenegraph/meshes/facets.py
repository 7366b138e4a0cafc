"""Large flat parts of a mesh, and convex polygons inside them.

**Claim.** A polygon made here is backed by real triangles: a ray through it that meets its plane at an angle whose
tangent is at least `SLOPE` crosses a triangle of the mesh before it is farther from the plane than the facet is thick.
This holds for open meshes too.

**Proof.** The triangles of a facet lie within the roughness of its plane. Turned so that each is counterclockwise seen
along the normal, they are a chain; edges passed once in each direction cancel, the others are its border. Off the
border's shadow in the plane, the winding number of the border is the number of triangles above the place, and constant
on everything that hangs together. A cell of the facet's grid that the border does not touch, and whose group has a
winding number other than 0, is covered; so is a polygon grown from such cells without touching the border (`solids`
argues alike in space). A way that stays over the polygon and leads from one side of the rough layer to the other
crosses the chain. A ray through a point of the polygon that is steep enough stays over the facet until it is through
the layer, as the polygon keeps the thickness / SLOPE away from the border.

An occluder must not stand in front of the triangles that back it: a one-sided polygon lies behind all of them. A rough
facet that is seen from both sides gets two such polygons, one for each side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .cells import cells_touched
from .cuboids import maximal_boxes, spread_out
from .inflate import HalfSpaces, inflated
from .solids import grown
from .topology import triangle_areas
from .winding import winding_numbers

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

#: Vertices at most this far from the plane (relative to the mesh) are in the facet: map data has 3 decimals.
FLATNESS = 5e-5
#: Tangent of the least angle between ray and plane for which a facet's polygons are proved.
SLOPE = 0.01
_CELLS = 48
#: How many planes are looked for among triangles of nearly the same plane.
_SHEETS = 4


@dataclass(frozen=True)
class Facet:
    """Coplanar triangles.

    Attributes
    ----------
    frame : (3, 3) float64
        Rows: two directions in the plane, the normal.
    height : float
        The plane is normal · x = height.
    triangles : (m, 3, 2) float64
        Counterclockwise, in the plane's coordinates.
    border : (k, 2, 2) float64
        Directed edges that do not cancel.
    roughness : float
        Distance of the farthest vertex from the plane.
    """

    frame: F64
    height: float
    triangles: F64
    border: F64
    roughness: float

    def depth(self, clearance: float) -> float:
        """From a polygon behind the triangles to the foremost of them."""
        return 2 * self.roughness + clearance

    def points(self, flat: F64, offset: float) -> F64:
        """(k, 3) of points (k, 2) in the plane, moved along the normal."""
        heights = np.full((len(flat), 1), self.height + offset)
        return np.asarray(np.concatenate([flat, heights], axis=1) @ self.frame)


def facets(points: F64, faces: I64, *, one_sided: bool, least_area: float, limit: int = 32) -> list[Facet]:
    """Groups of coplanar triangles, the largest first.

    Parameters
    ----------
    points : (p, 3) float64
        Of a mesh whose largest extent is 1.
    faces : (f, 3) int
    one_sided : bool
        Whether triangles that face opposite ways belong to different facets.
    least_area : float
        Smaller groups are left out.
    limit : int
        How many are returned at most.
    """
    corners = points[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = triangle_areas(corners)
    with np.errstate(invalid="ignore", divide="ignore"):
        normal = cross / (2 * area)[:, None]
    left = area > 1e-12
    if not one_sided:
        largest = np.take_along_axis(normal, np.abs(normal).argmax(axis=1)[:, None], axis=1)
        normal = np.where(largest < 0, -normal, normal)
    bins = _bins(normal, corners[:, 0], left)
    sums = np.bincount(bins[left], area[left], minlength=1)
    out: list[Facet] = []
    for number in np.argsort(-sums, kind="stable")[: 4 * limit]:
        # a plane on the border between two bins has its triangles in both
        if sums[number] <= 0.25 * least_area or len(out) == limit:
            break
        # a bin is much thicker than a facet: sheets that lie close together are in one bin
        for _ in range(_SHEETS):
            seed = left & (bins == number)
            if area[seed].sum() <= 0.25 * least_area or len(out) == limit:
                break
            rows, direction = _plane_group(corners, normal, area, left, seed)
            left[rows] = False
            if area[rows].sum() >= least_area:
                out.append(_facet(points, faces[rows], direction))
    return out


def _bins(normal: F64, position: F64, good: NDArray[np.bool_]) -> I64:
    """(f,) which triangles lie in roughly the same plane."""
    height = np.einsum("ij,ij->i", normal, position)
    key = np.column_stack([normal * 32, height * 256])
    key[~good] = 0
    return np.unique(np.round(key).astype(np.int64), axis=0, return_inverse=True)[1].reshape(-1)


def _plane_group(
    corners: F64, normal: F64, area: F64, left: NDArray[np.bool_], seed: NDArray[np.bool_]
) -> tuple[I64, F64]:
    """Triangles in the plane of the largest one of the seed, and that one: their rows, and the plane's normal."""
    first = int(np.flatnonzero(seed)[area[seed].argmax()])
    best, best_direction = np.array([first]), normal[first]
    # a small triangle's plane, drawn on, leaves a rough wall soon: the second way begins with a thicker layer
    for layers in ((1, 1), (8, 3, 1, 1)):
        direction, height = normal[first], float(normal[first] @ corners[first, 0])
        rows = np.zeros(0, np.int64)
        for layer in layers:
            off = np.abs(corners @ direction - height).max(axis=1)
            rows = np.flatnonzero(left & (off <= layer * FLATNESS) & (normal @ direction > 0.9))
            if not len(rows):
                break
            direction, height = _fitted_plane(corners[rows], area[rows], direction)
        if area[rows].sum() > 1.01 * area[best].sum():
            best, best_direction = rows, direction
    return best, best_direction


def _fitted_plane(corners: F64, area: F64, toward: F64) -> tuple[F64, float]:
    """Least squares plane of triangles, weighed by their areas: normal, and its product with points of the plane."""
    weight = np.repeat(area, 3)[:, None]
    p = corners.reshape(-1, 3)
    middle = (p * weight).sum(axis=0) / weight.sum()
    fitted = np.linalg.svd((p - middle) * np.sqrt(weight), full_matrices=False)[2][2]
    direction = np.asarray(fitted if fitted @ toward > 0 else -fitted)
    return direction, float(direction @ middle)


def _facet(points: F64, faces: I64, direction: F64) -> Facet:
    used, local = np.unique(faces, return_inverse=True)
    local = local.reshape(-1, 3)
    p = points[used]
    helper = np.eye(3)[np.abs(direction).argmin()]
    x = np.cross(helper, direction)
    x /= np.linalg.norm(x)
    y = np.cross(direction, x)
    flat = p @ np.stack([x, y], axis=1)
    u, v = flat[local[:, 1]] - flat[local[:, 0]], flat[local[:, 2]] - flat[local[:, 0]]
    backward = u[:, 0] * v[:, 1] < u[:, 1] * v[:, 0]
    local = np.where(backward[:, None], local[:, ::-1], local)
    half = np.concatenate([local[:, [0, 1]], local[:, [1, 2]], local[:, [2, 0]]])
    low, high = half.min(axis=1), half.max(axis=1)
    _, first, edge = np.unique(low * len(used) + high, return_index=True, return_inverse=True)
    net = np.bincount(edge.reshape(-1), np.where(half[:, 0] < half[:, 1], 1, -1)).astype(np.int64)
    ids = np.repeat(np.arange(len(net)), np.abs(net))
    ends = np.column_stack([low[first[ids]], high[first[ids]]])
    ends = np.where((net[ids] > 0)[:, None], ends, ends[:, ::-1])
    # the grid follows the longest straight part of the border
    border = flat[ends]
    way = border[:, 1] - border[:, 0]
    angle = _main_angle(way)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    frame = np.concatenate([turn @ np.stack([x, y]), direction[None]])
    flat = p @ frame[:2].T
    heights = p @ direction
    height = float(0.5 * (heights.min() + heights.max()))
    return Facet(frame, height, flat[local], flat[ends], float(np.abs(heights - height).max()))


def _main_angle(way: F64) -> float:
    """Angle, modulo a quarter turn, that most of the border's length has."""
    length = np.hypot(way[:, 0], way[:, 1])
    angle = np.arctan2(way[:, 1], way[:, 0]) % (np.pi / 2)
    step = (angle / (np.pi / 2) * 180).astype(np.int64) % 180
    best = np.bincount(step, length, minlength=180).argmax()
    chosen = step == best
    return float(angle[chosen][length[chosen].argmax()]) if chosen.any() else 0.0


def polygons(facet: Facet, *, clearance: float, corners: int, limit: int) -> list[F64]:
    """Convex polygons inside a facet, in the plane's coordinates (k, 2), counterclockwise: rectangles, and larger ones.

    Parameters
    ----------
    facet : Facet
    clearance : float
        Distance from the foremost triangles, besides the roughness.
    corners : int
        How many a polygon has at most; with 4 there are rectangles only.
    limit : int
        How many rectangles are returned at most.
    """
    inset = facet.depth(clearance) / SLOPE
    low, high = facet.triangles.min(axis=(0, 1)), facet.triangles.max(axis=(0, 1))
    count = np.minimum((high - low) / (4 * inset), _CELLS).astype(np.int64)
    if count.min() < 3 or not len(facet.border):
        return []
    cell = (high - low) / count
    origin = low - cell
    border, margin = (facet.border - origin) / cell, inset / cell
    free = ~cells_touched(border, (int(count[0]) + 2, int(count[1]) + 2), margin)
    inside = _covered(free, border)
    whole = HalfSpaces(np.concatenate([np.eye(2), -np.eye(2)]), np.concatenate([count + 1.0, -np.ones(2)]))
    out: list[F64] = []
    for box in spread_out(
        maximal_boxes(inside[:, :, None], cell=np.array([*cell, 0.0]), limit=48, seeds=64, rounds=3), limit
    ):
        a, b = grown(box[0, :2].astype(float), box[1, :2].astype(float), border, margin, [])
        out.append(np.array([[a[0], a[1]], [b[0], a[1]], [b[0], b[1]], [a[0], b[1]]]))
        if corners > 4:
            found = inflated(border, a, b, margin, planes=corners, within=whole)
            if found is not None and len(found) > 2:
                out.append(_around(found))
    return [p * cell + origin for p in out]


def _covered(free: NDArray[np.bool_], border: F64) -> NDArray[np.bool_]:
    from scipy.ndimage import label

    groups, count = label(free)
    where = np.zeros((count + 1, 2))
    # the last cell that writes is as good as any
    where[groups.reshape(-1)] = np.argwhere(np.ones_like(free)) + 0.5
    inside = np.zeros(count + 1, bool)
    inside[1:] = winding_numbers(where[1:], border) != 0
    return np.asarray(inside[groups])


def _around(points: F64) -> F64:
    """Corners of a convex polygon in counterclockwise order."""
    middle = points.mean(axis=0)
    order = np.argsort(np.arctan2(*(points - middle).T[::-1]), kind="stable")
    return np.asarray(points[order])
