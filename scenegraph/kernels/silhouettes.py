"""Silhouettes of convex polyhedra and the planes through them and the eye, many polyhedra at once.

Papaioannou, Gaitatzes & Christopoulos, "Efficient occlusion culling using solid occluders", WSCG 2006, equations (1)
and (2). What differs from the print: a silhouette edge separates a face that is *surely* front-facing from one that
is not, so that faces seen edge-on cannot break the outline; and the cap lies at the largest depth, not at the largest
distance.

Coordinates are relative to the eye (in a parallel view: to any point, and `direction` is the line of sight).
Polyhedra are the last axis, because there are more of them than of anything else; all are padded to the largest one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .slices import slice_entries

#: Rounding of a cross product and of its normalization, in units of float64 epsilon.
ROUNDING = 16.0

#: Offset of a row that holds for every box.
UNUSED = 1e30

_EPS = float(np.finfo(np.float64).eps)


def cone_warp(
    points: NDArray[np.float64], normals: NDArray[np.float64], loops: NDArray[np.integer], /
) -> NDArray[np.float64]:
    """How far the vertices of each face lie from the plane through its first one.

    Parameters
    ----------
    points : (3, v, m) float64
    normals : (3, f, m) float64
    loops : (l, f, m or 1) int
        Vertices of each face.

    Returns
    -------
    (f, m) float64
    """
    m = points.shape[2]
    corner = points.reshape(3, -1)[:, loops * m + np.arange(m)]
    return np.asarray(np.abs(((corner - corner[:, :1]) * normals[:, None]).sum(axis=0)).max(axis=0))


def cone_outline(front: NDArray[np.bool_], edge_faces: NDArray[np.integer], /) -> NDArray[np.bool_]:
    """Which edges separate a front-facing face from another one: equation (1).

    Whatever `front` says, the edges form closed loops.

    Parameters
    ----------
    front : (f, m) bool
        Faces that surely look at the eye.
    edge_faces : (2, e, m or 1) int
        The two faces at each edge; f where there is none (the border of a polygon). Twice the same for padding.

    Returns
    -------
    (e, m) bool
    """
    f, m = front.shape
    lit = np.zeros((f + 1, m), bool)
    lit[:f] = front
    sides = slice_entries(lit, edge_faces)
    return np.asarray(sides[0] != sides[1])


def cone_side_planes(
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    center: NDArray[np.float64],
    /,
    *,
    reach: NDArray[np.float64],
    error: NDArray[np.float64],
    direction: NDArray[np.float64] | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Planes through the eye and edges, facing the polyhedron: v_i × v_(i+1), offset exactly 0.

    Parameters
    ----------
    start, end : (3, e) float64
        Ends of the edges.
    center : (3, e) float64
        A point well inside the polyhedron of each.
    reach, error : (e,) float64
        No end is farther away; absolute uncertainty of the coordinates.
    direction : (3,) float64, optional
        Line of sight of a parallel view.

    Returns
    -------
    normal : (3, e) float64
        Unit vectors; inside is n·x + offset > 0.
    offset : (e,) float64
        0 for a perspective view; for a parallel one already reduced by its own uncertainty.
    slack : (e,) float64
        Angle by which the plane may be off: n·x + offset is uncertain by slack·|x|. Infinite or not a number where the
        edge points at the eye.
    turn : (e,) float64
        Distance of `center` from the plane, positive where the edge runs counterclockwise about it, seen from behind.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        a, b = start, end
        if direction is None:
            doubt = ((ROUNDING * _EPS) * reach + 4.0 * error) * reach
        else:
            a, b = end - start, np.broadcast_to(direction[:, None], start.shape)
            doubt = (4.0 * ROUNDING * _EPS) * reach + 4.0 * error
        normal = np.empty(start.shape)
        (ax, ay, az), (bx, by, bz), (x, y, z) = a, b, normal
        np.subtract(ay * bz, az * by, out=x)
        np.subtract(az * bx, ax * bz, out=y)
        np.subtract(ax * by, ay * bx, out=z)
        size = np.sqrt(np.add.reduce(normal * normal, axis=0))
        slack = doubt / size
        slack += ROUNDING * _EPS
        normal /= size
        turn = np.add.reduce(normal * center, axis=0)
        offset = np.zeros(len(turn))
        if direction is not None:
            offset -= (normal * start).sum(axis=0)
            turn += offset
        sign = np.copysign(1.0, turn)
        normal *= sign
        if direction is not None:
            offset *= sign
            offset -= (slack + ROUNDING * _EPS) * reach + error
    return normal, offset, slack, turn


def cone_turns_are_even(
    first: NDArray[np.integer], last: NDArray[np.integer], turn: NDArray[np.float64], /, *, vertices: int
) -> NDArray[np.bool_]:
    """At which vertices as many silhouette edges arrive as leave, when all run counterclockwise about their center.

    Where this holds for all vertices of a polyhedron, its silhouette is made of closed curves that go round the center,
    and what is on the inner side of all planes through them is inside the polyhedron's cone, however its faces were
    classified.

    Parameters
    ----------
    first, last : (e,) int
        Vertices of each edge.
    turn : (e,) float64
        See `cone_side_planes`.
    vertices : int
        Number of vertices.

    Returns
    -------
    (vertices,) bool
    """
    forward = turn > 0.0
    leaving = np.bincount(np.where(forward, first, last), minlength=vertices)
    arriving = np.bincount(np.where(forward, last, first), minlength=vertices)
    return np.equal(leaving, arriving)


def cone_depth_caps(
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    which: NDArray[np.integer],
    /,
    *,
    reach: NDArray[np.float64],
    error: NDArray[np.float64],
    direction: NDArray[np.float64] | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The caps of equation (2), at the largest depth of the silhouette along them.

    A point x of the cone is a sum of λ_i S_i over silhouette points with λ_i ≥ 0. If it is deeper than every S_i, the
    λ_i sum to more than 1, and x lies behind a point of the polyhedron. This holds along any direction in which some
    S_i is in front of the eye, so the direction itself needs no tolerance.

    Parameters
    ----------
    start, end : (3, e) float64
        Ends of the silhouette edges.
    which : (e,) int
        The polyhedron of each.
    reach, error : (m,) float64
        No point is farther away; absolute uncertainty of the coordinates.
    direction : (3,) float64, optional
        Line of sight of a parallel view: then the caps are perpendicular to it.

    Returns
    -------
    normal : (3, m) float64
        Away from the eye; behind the cap is n·x + offset > 0.
    offset : (m,) float64
        Reduced by its own uncertainty; minus infinity where nothing lies in front of the eye.
    """
    m = len(error)
    if direction is None:
        # each silhouette point ends two edges, so this is twice the sum of equation (2)
        total = np.array([np.bincount(which, a, minlength=m) for a in start + end])
        with np.errstate(divide="ignore", invalid="ignore"):
            normal = total / np.sqrt((total * total).sum(axis=0))
    else:
        normal = np.broadcast_to(direction[:, None], (3, m))
    toward = normal.take(which, axis=1)
    deepest = np.full(m, -np.inf)
    with np.errstate(invalid="ignore"):
        np.maximum.at(deepest, which, np.maximum((toward * start).sum(axis=0), (toward * end).sum(axis=0)))
    offset = -(deepest + error + (ROUNDING * _EPS) * reach)
    return normal, offset if direction is not None else np.where(deepest > 0.0, offset, -np.inf)


def cone_shadow_rows(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    areas: NDArray[np.float64],
    warp: NDArray[np.float64],
    corners: NDArray[np.integer],
    ends: NDArray[np.integer],
    edge_faces: NDArray[np.integer],
    /,
    *,
    reach: NDArray[np.float64],
    world: float,
    guard: float = 0.0,
    two_sided: NDArray[np.bool_] | None = None,
    beyond: NDArray[np.bool_] | None = None,
    unneeded: NDArray[np.bool_] | None = None,
    direction: NDArray[np.float64] | None = None,
    most_faces: int = 0,
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], NDArray[np.bool_]]:
    """Planes of the shadow frusta of convex polyhedra and polygons, as rows for `box_depth_in_frusta`.

    Parameters
    ----------
    points : (3, v, m) float64
        Vertices; padding repeats some.
    normals : (3, f, m) float64
        Outward unit normals; the front of a polygon.
    areas : (f, m) float64
        0 for faces that are padding.
    warp : (f, m) float64
        From `cone_warp`.
    corners : (f, m or 1) int
        First vertex of each face; 1 if they are the same for all.
    ends : (2, e, m or 1) int
        Vertices at the ends of each edge.
    edge_faces : (2, e, m or 1) int
        See `cone_outline`; a polygon has one face.
    reach : (m,) float64
        No vertex is farther away.
    world : float
        Largest world coordinate of the eye: vertices were rounded at such a distance from the world's origin.
    guard : float
        Radius of a ball around the eye that must lie before one and the same face: what is drawn of a polyhedron that
        reaches into it is unknown. Not for a parallel view.
    two_sided : (m,) bool, optional
        Polygons that hide from behind as well.
    beyond : (m,) bool, optional
        Polyhedra known to lie where everything is drawn. In a parallel view no others are clear.
    unneeded : (e, m) bool, optional
        Edges whose sides do not matter.
    direction : (3,) float64, optional
        Line of sight of a parallel view.
    most_faces : int
        Polyhedra with at most so many front faces end at these faces rather than at the cap of equation (2), which lies
        behind them all. Polygons always end at themselves.

    Returns
    -------
    rows : (m, p, 8) float64
        Inward normal, minus its absolute values, offset, minus the angle by which the plane may be off; unused rows
        hold for every box.
    lit, clear, sound : (m,) bool
        Some face looks at the eye; nothing of the polyhedron can reach into `guard`; its planes are well-conditioned. A
        shadow counts only where all three hold.
    """
    _, v, m = points.shape
    f = len(areas)
    number = np.arange(m)
    flat = points.reshape(3, -1)
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        center = np.add.reduce(points, axis=1)
        center /= v
        error = (4.0 * _EPS) * (reach + 2.0 * world)
        round_off = error + (ROUNDING * _EPS) * reach

        height = np.add.reduce(normals * slice_entries(points, corners), axis=0)
        # a normal is as uncertain as its face is small
        doubt = (ROUNDING * error * reach * reach) / areas
        doubt += round_off
        doubt += warp
        if direction is None:
            front, back = height < -doubt, height > doubt
        else:
            along = np.tensordot(direction, normals, 1)
            angle = (ROUNDING * error * reach) / areas + ROUNDING * _EPS
            front, back = along < -angle, along > angle
        padding = areas == 0.0
        if two_sided is not None:
            behind = back & two_sided & ~padding
            normals = np.where(behind, -normals, normals)
            height = np.where(behind, -height, height)
            front, back = front | behind, back & ~behind
        back |= padding
        if direction is not None:
            clear = np.zeros(m, bool)
        else:
            clear = np.logical_or.reduce(front & (height + doubt < -guard), axis=0)
        if beyond is not None:
            clear |= beyond

        outline = cone_outline(front, edge_faces)
        edge = outline.reshape(-1).nonzero()[0]
        which = edge % m
        if ends.shape[2] == 1:
            both_ends = ends[..., 0].take(edge // m, axis=1)
            both_ends *= m
            both_ends += which
        else:
            both_ends = (ends * m + number).reshape(2, -1).take(edge, axis=1)
        first, last = both_ends
        start, end = flat.take(first, axis=1), flat.take(last, axis=1)
        far = reach.take(which)
        side, offset, slack, turn = cone_side_planes(
            start, end, center.take(which, axis=1), reach=far, error=error.take(which), direction=direction
        )
        even = cone_turns_are_even(first, last, turn, vertices=v * m)
        sound = np.logical_and.reduce(even.reshape(v, m), axis=0)
        # not a number, too
        shaky = ~(np.abs(turn) > 4.0 * slack * far)
    sound[which[shaky]] = False

    faces = ~back
    at_faces = np.add.reduce(faces, axis=0, dtype=np.intp) <= most_faces
    # a polygon: its first edge has nothing on the other side
    at_faces |= edge_faces[1, 0] == f
    keep = np.empty((len(outline) + f + 1, m), bool)
    sides, ends_at, last_one = keep[: len(outline)], keep[len(outline) : -1], keep[-1]
    np.logical_and(outline, True if unneeded is None else ~unneeded, out=sides)
    np.logical_and(faces, at_faces, out=ends_at)
    np.logical_not(at_faces, out=last_one)
    kept, cap, rest = sides.reshape(-1).take(edge).nonzero()[0], ends_at.reshape(-1).nonzero()[0], last_one.nonzero()[0]
    # one after the other within each polyhedron
    place = np.add.accumulate(keep, axis=0, dtype=np.intp)
    most = max(int(place[-1].max(initial=0)), 1)
    place += number * most - 1
    slot = place.reshape(-1).take(keep.reshape(-1).nonzero()[0])
    # components first while they are found, then whole rows at once
    plane = np.empty((8, len(slot)))
    a, b = len(kept), len(kept) + len(cap)
    plane[:3, :a], plane[6, :a] = side.take(kept, axis=1), offset.take(kept)
    np.negative(normals.reshape(3, -1).take(cap, axis=1), out=plane[:3, a:b])
    plane[6, a:b] = (height - warp - round_off).reshape(-1).take(cap)
    if len(rest):
        deep, depth = cone_depth_caps(start, end, which, reach=reach, error=error, direction=direction)
        plane[:3, b:], plane[6, b:] = deep.take(rest, axis=1), depth.take(rest)
    np.negative(slack.take(kept), out=plane[7, :a])
    plane[7, a:] = -ROUNDING * _EPS
    np.abs(plane[:3], out=plane[3:6])
    np.negative(plane[3:6], out=plane[3:6])
    rows = np.zeros((m * most, 8))
    rows[:, 6] = UNUSED
    rows[slot] = plane.T
    return rows.reshape(m, most, 8), np.logical_or.reduce(front, axis=0), clear, sound
