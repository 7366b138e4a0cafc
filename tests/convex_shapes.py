"""Convex occluders as the arrays that the shadow kernels take, and the truth about what they hide, without rounding."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenegraph import Occluder, OccluderTable
from scenegraph.kernels.silhouettes import cone_shadow_rows, cone_warp
from scenegraph.kernels.slices import slice_padded

Point = Sequence[Fraction]


def table_of(*occluders: Occluder) -> OccluderTable:
    """A table of occluders that are nobody's, in world coordinates."""
    zero = np.zeros(len(occluders), np.int64)
    table = OccluderTable.build(list(occluders), zero, np.zeros((len(occluders), 2), np.int64))
    table.place(np.eye(4)[None])
    return table


def shadow_arrays(table: OccluderTable, eye: Any) -> dict[str, NDArray[Any]]:
    """Arguments of `cone_shadow_rows` for all occluders of a table, and the eye as `eye`."""
    eye = np.asarray(eye, float)
    vertex = slice_padded(table.vertex_first[:-1], table.vertex_first[1:]).T
    face = slice_padded(table.face_first[:-1], table.face_first[1:]).T
    edge = slice_padded(table.edge_first[:-1], table.edge_first[1:]).T
    real = np.arange(len(face))[:, None] < np.diff(table.face_first)
    points = np.ascontiguousarray((table.vertices[vertex] - eye).transpose(2, 0, 1))
    corner = slice_padded(table.loop_first[face], table.loop_first[face + 1])
    loops = (table.loop[corner] - table.vertex_first[:-1][:, None]).transpose(2, 0, 1)
    normals = np.ascontiguousarray(table.normals[face].transpose(2, 0, 1))
    sides = table.edge_faces[edge]
    sides = np.where(sides < 0, len(face), sides - table.face_first[:-1][:, None])
    sides[1:][edge[1:] == edge[:-1]] = 0
    return {
        "eye": eye,
        "points": points,
        "normals": normals,
        "areas": table.areas[face] * real,
        "warp": cone_warp(points, normals, loops),
        "corners": loops[0],
        "ends": (table.edges[edge] - table.vertex_first[:-1][:, None]).transpose(2, 0, 1),
        "edge_faces": sides.transpose(2, 0, 1),
    }


def shadow_rows(table: OccluderTable, eye: Any, **options: Any) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Rows (m, p, 8), and which of them (m,) count."""
    arrays = shadow_arrays(table, eye)
    options = {"most_faces": 99, "two_sided": table.two_sided & ~table.solid} | options
    rows, lit, clear, sound = cone_shadow_rows(
        *(arrays[k] for k in ("points", "normals", "areas", "warp", "corners", "ends", "edge_faces")),
        reach=2.0 * np.abs(arrays["points"]).max(axis=(0, 1)),
        world=float(np.abs(arrays["eye"]).max()),
        **options,
    )
    return rows, lit & clear & sound


# -- exact ---------------------------------------------------------------------------------------------------------


def exact(values: Any) -> list[Fraction]:
    """The numbers as they are stored."""
    return [Fraction(float(v)) for v in values]


def minus(a: Point, b: Point) -> list[Fraction]:
    return [x - y for x, y in zip(a, b, strict=True)]


def dot(a: Point, b: Point) -> Fraction:
    return sum((x * y for x, y in zip(a, b, strict=True)), Fraction(0))


def cross(a: Point, b: Point) -> list[Fraction]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def corners_of(box: Any, grow: Fraction = Fraction(0)) -> list[list[Fraction]]:
    """The eight corners of a box (6,), grown by a share of its half extents."""
    center, half = exact(box[:3]), [h * (1 + grow) for h in exact(box[3:])]
    return [
        [c + s * h for c, s, h in zip(center, signs, half, strict=True)]
        for signs in itertools.product((-1, 1), repeat=3)
    ]


def half_spaces(vertices: Any, faces: Sequence[Sequence[int]]) -> list[tuple[list[Fraction], Fraction]]:
    """Outward normals and offsets of a convex solid; inside is n·p ≤ d."""
    points = [exact(v) for v in vertices]
    middle = [sum(c) / len(points) for c in zip(*points, strict=True)]
    found = []
    for face in faces:
        a, b, c = (points[i] for i in face[:3])
        normal = cross(minus(b, a), minus(c, a))
        offset = dot(normal, a)
        if dot(normal, middle) > offset:
            normal, offset = [-n for n in normal], -offset
        found.append((normal, offset))
    return found


def solid_hides(planes: list[tuple[list[Fraction], Fraction]], eye: Point, point: Point) -> bool:
    """Whether the segment from the eye meets the solid, and a part of it is left behind there."""
    enter, leave = Fraction(0), Fraction(1)
    way = minus(point, eye)
    for normal, offset in planes:
        along, room = dot(normal, way), offset - dot(normal, eye)
        if along == 0:
            if room < 0:
                return False
        elif along < 0:
            enter = max(enter, room / along)
        else:
            leave = min(leave, room / along)
    return enter <= leave and enter < 1


def polygon_hides(corners: list[Point], eye: Point, point: Point) -> bool:
    """Whether the segment from the eye passes through a convex polygon before its end."""
    normal = cross(minus(corners[1], corners[0]), minus(corners[2], corners[0]))
    a, b = dot(normal, minus(eye, corners[0])), dot(normal, minus(point, corners[0]))
    if a == 0 or (a > 0) == (b > 0) or b == 0:
        return False
    t = a / (a - b)
    met = [e + t * w for e, w in zip(eye, minus(point, eye), strict=True)]
    turns = [
        dot(normal, cross(minus(q, p), minus(met, p))) for p, q in zip(corners, [*corners[1:], corners[0]], strict=True)
    ]
    return all(t >= 0 for t in turns) or all(t <= 0 for t in turns)
