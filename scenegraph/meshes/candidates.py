"""Occluders that a mesh could have, each of them proved; which are taken is decided elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..mesh import Mesh
from ..progress import Progress
from .facets import facets, polygons
from .fitted import Kind
from .frames import main_axes
from .prepared import PreparedMesh
from .silhouette import Silhouette, Tally
from .solids import Interior, Openings, box_corners, boxes_inside, grown, interior, polytope
from .topology import Shell

F64 = NDArray[np.float64]

#: Facets smaller than this share of the area of the box around the mesh.
_SMALL_FACET = 0.01
#: Volume, or area, of a shape relative to that of a cube, or square, on its diagonal: less is no solid, no polygon.
_THIN = 1e-8
_BOX_FACES = Mesh.box((0, 0, 0), (1, 1, 1)).faces.astype(np.int64)


@dataclass(frozen=True)
class Candidate:
    """A proved occluder, in the coordinates of the prepared mesh.

    Attributes
    ----------
    kind : "box", "polytope" or "polygon"
    points : (k, 3) float64
    triangles : (m, 3, 3) float64
    front : (3,) float64
        The side that a one-sided polygon hides for; 0 for all others.
    worth : float
        Factor for its gain when it is compared with others: simple ones are preferred.
    """

    kind: Kind
    points: F64
    triangles: F64
    front: F64
    worth: float

    @property
    def two_sided(self) -> bool:
        """Whether it hides for eyes on any side."""
        return not self.front.any()


def tally(silhouette: Silhouette, pool: Sequence[Candidate]) -> Tally:
    """What candidates cover."""
    fronts = np.array([c.front for c in pool]).reshape(-1, 3)
    return Tally(silhouette, silhouette.covered([c.triangles for c in pool]), fronts)


def insides_of(
    shells: Sequence[Shell], openings: Openings, clearance: float, *, cells: int, progress: Progress
) -> list[Interior]:
    """Interiors of those shells that have room for a solid; smaller shells get fewer cells."""
    out = []
    for i, shell in enumerate(shells):
        progress("looking inside", i / len(shells))
        extent = float(np.ptp(shell.triangles.reshape(-1, 3), axis=0).max())
        count = int(np.clip(cells * np.sqrt(extent), min(16, cells), cells))
        inside = interior(shell, main_axes(shell.triangles), openings, cells=count, clearance=clearance)
        if inside is not None and inside.mask.any():
            out.append(inside)
    return out


def solid_candidates(
    insides: Sequence[Interior],
    silhouette: Silhouette,
    *,
    count: int,
    least_gain: float,
    planes: int | None,
    progress: Progress,
) -> list[Candidate]:
    """Boxes inside shells, grown until they touch the surface, and polytopes about them.

    Parameters
    ----------
    insides : sequence of Interior
    silhouette : Silhouette
    count : int
        How many boxes are chosen, at most, of all that are found.
    least_gain : float
    planes : int or None
        How many sides polytopes may have; None for boxes only.
    progress : Progress
    """
    boxes: list[tuple[Interior, F64, F64]] = []
    limit = max(24, 192 // max(1, len(insides)))
    for i, inside in enumerate(insides):
        progress("finding boxes", 0.4 * i / len(insides))
        boxes += [(inside, low, high) for low, high in boxes_inside(inside, limit=limit)]
    rough = [_box(*box) for box in boxes]
    taken = tally(silhouette, rough).choose(count, least_gain, np.ones(len(rough)))
    out: list[Candidate] = []
    for done, (i, _) in enumerate(taken):
        progress("growing solids", 0.4 + 0.6 * done / len(taken))
        inside, low, high = boxes[i]
        low, high = grown(low, high, inside.triangles, inside.margin, inside.regions)
        out.append(_box(inside, low, high))
        corners = None if planes is None else polytope(inside, low, high, planes=planes)
        if corners is not None:
            out.append(_polytope(inside.points(corners)))
    return [c for c in out if _volume(c.points) > _THIN]


def _box(inside: Interior, low: F64, high: F64) -> Candidate:
    points = inside.points(box_corners(low, high))
    return Candidate("box", points, points[_BOX_FACES], np.zeros(3), 1.0)


def _polytope(points: F64) -> Candidate:
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points)
    # a box is simpler to work with where it covers nearly as much
    return Candidate("polytope", points[hull.vertices], points[hull.simplices], np.zeros(3), 0.95)


def _volume(points: F64) -> float:
    """Of a convex hull, relative to the cube of its diagonal."""
    from scipy.spatial import ConvexHull, QhullError

    diagonal = float(np.linalg.norm(np.ptp(points, axis=0)))
    try:
        return float(ConvexHull((points - points.mean(axis=0)) / diagonal).volume)
    except QhullError:
        return 0.0


def flat_candidates(
    prepared: PreparedMesh, silhouette: Silhouette, others: Tally, *, least_gain: float, corners: int
) -> list[Candidate]:
    """Polygons in the large flat parts of a mesh; one-sided if the mesh is closed.

    Parameters
    ----------
    prepared : PreparedMesh
    silhouette : Silhouette
    others : Tally
        What else has been chosen. Flat parts that would add less than `least_gain` to it are left alone.
    least_gain : float
    corners : int
        How many a polygon has at most.
    """
    extent = np.ptp(prepared.points, axis=0)
    least = _SMALL_FACET * float(extent @ np.roll(extent, 1))
    one_sided, clearance = prepared.is_closed, prepared.clearance
    out: list[Candidate] = []
    found = facets(prepared.points, prepared.faces, one_sided=one_sided, least_area=least)
    whole = [f.points(f.triangles.reshape(-1, 2), 0.0).reshape(-1, 3, 3) for f in found]
    fronts = np.array([f.frame[2] if one_sided else np.zeros(3) for f in found]).reshape(-1, 3)
    gains = Tally(silhouette, silhouette.covered(whole), fronts, after=others).gains(np.arange(len(found)))
    for facet, gain in zip(found, gains, strict=True):
        if gain < least_gain:
            continue
        normal = facet.frame[2]
        # behind all triangles that back it; a facet without roughness needs no second polygon for its back
        back = facet.roughness + clearance
        for flat in polygons(facet, clearance=clearance, corners=corners, limit=4):
            if one_sided or facet.roughness > clearance:
                out.append(_polygon(facet.points(flat, -back), normal))
                if not one_sided:
                    out.append(_polygon(facet.points(flat, back)[::-1], -normal))
            else:
                out.append(_polygon(facet.points(flat, 0.0), np.zeros(3)))
    return [c for c in out if _area(c.points) > _THIN]


def _polygon(points: F64, front: F64) -> Candidate:
    fan = np.stack([np.repeat(points[:1], len(points) - 2, axis=0), points[1:-1], points[2:]], axis=1)
    return Candidate("polygon", points, fan, front, 0.9)


def _area(points: F64) -> float:
    """Of a polygon, relative to the square of its diagonal."""
    p = points - points[0]
    normal = 0.5 * np.cross(p, np.roll(p, -1, axis=0)).sum(axis=0)
    return float(np.linalg.norm(normal) / (np.ptp(p, axis=0) ** 2).sum())


def volume_share(insides: Sequence[Interior], solids: Sequence[Candidate]) -> float:
    """How many of the enclosed cells have their middle in a solid, each weighed by its size; NaN without cells."""
    from scipy.spatial import ConvexHull

    if not insides:
        return float("nan")
    sides = [ConvexHull(s.points).equations for s in solids]
    filled = total = 0.0
    for inside in insides:
        middles = inside.points(np.argwhere(inside.mask).astype(np.float64) + 0.5)
        within = np.zeros(len(middles), bool)
        for planes in sides:
            within |= (middles @ planes[:, :3].T + planes[:, 3] <= 0).all(axis=1)
        size = float(inside.cell.prod())
        filled += size * float(within.sum())
        total += size * len(middles)
    return filled / total
