"""Shapes to fit occluders into, and an independent proof that what was fitted is hidden by the mesh: rays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from scenegraph import Mesh
from scenegraph.meshes import FittedOccluder, FittedOccluders

F64 = NDArray[np.float64]

#: A polygon may be so far, in sizes of the mesh and along the normal, from the triangles that back it.
THICKNESS = 1.1e-4
#: Least tangent of the angle between ray and plane for which a polygon is promised to hold.
SLOPE = 0.01


def hull(points: F64) -> Mesh:
    """The convex hull of points, counterclockwise from outside."""
    found = ConvexHull(points)
    faces = found.simplices.copy()
    p = points[faces]
    normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    wrong = np.einsum("ij,ij->i", normal, found.equations[:, :3]) < 0
    faces[wrong] = faces[wrong][:, ::-1]
    return Mesh(points, faces)


def prism(outline: F64, height: float) -> Mesh:
    """An outline (k, 2), star-shaped about the origin and counterclockwise, extruded along z."""
    k = len(outline)
    ring = np.arange(k)
    following = (ring + 1) % k
    flat = np.column_stack([outline, np.zeros(k)])
    vertices = np.concatenate([flat, flat + (0, 0, height), [[0, 0, 0], [0, 0, height]]])
    faces = [
        np.column_stack([ring, following, following + k]),
        np.column_stack([ring, following + k, ring + k]),
        np.column_stack([following, ring, np.full(k, 2 * k)]),
        np.column_stack([ring + k, following + k, np.full(k, 2 * k + 1)]),
    ]
    return Mesh(vertices, np.concatenate(faces))


def torus(radius: float, tube: float, around: int = 24, across: int = 12) -> Mesh:
    """A ring about the z axis."""
    a, b = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    u, v = 2 * np.pi * a / around, 2 * np.pi * b / across
    r = radius + tube * np.cos(v)
    vertices = np.stack([r * np.cos(u), r * np.sin(u), tube * np.sin(v)], axis=2).reshape(-1, 3)
    here, right = a * across + b, (a + 1) % around * across + b
    up, both = a * across + (b + 1) % across, (a + 1) % around * across + (b + 1) % across
    quads = np.stack([here, right, both, up], axis=2).reshape(-1, 4)
    return Mesh(vertices, quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3))


def without(mesh: Mesh, normal: tuple[float, float, float]) -> Mesh:
    """A mesh without the faces that look in a direction."""
    p = mesh.vertices[mesh.faces]
    n = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    n /= np.linalg.norm(n, axis=1)[:, None]
    return Mesh(mesh.vertices, mesh.faces[n @ normal < 0.99])


def turned(mesh: Mesh, matrix: F64, shift: F64 | tuple[float, ...] = (0.0, 0.0, 0.0)) -> Mesh:
    """A mesh after an affine map."""
    return Mesh(mesh.vertices @ matrix.T + np.asarray(shift), mesh.faces)


def rotation(rng: np.random.Generator) -> F64:
    """A random rotation matrix."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return np.asarray(q if np.linalg.det(q) > 0 else -q)


def first_hit(origins: F64, directions: F64, triangles: F64) -> F64:
    """(r,) distance along each ray to the first triangle (Möller and Trumbore 1997); inf for none."""
    a = triangles[:, 0]
    u, v = triangles[:, 1] - a, triangles[:, 2] - a
    out = np.full(len(origins), np.inf)
    step = max(1, 2_000_000 // max(1, len(triangles)))
    for start in range(0, len(origins), step):
        o, d = origins[start : start + step, None], directions[start : start + step, None]
        across = np.cross(d, v)
        det = (across * u).sum(axis=2)
        with np.errstate(all="ignore"):
            s = ((o - a) * across).sum(axis=2) / det
            q = np.cross(o - a, u)
            t = (d * q).sum(axis=2) / det
            at = (v * q).sum(axis=2) / det
            hit = (s >= -1e-9) & (t >= -1e-9) & (s + t <= 1 + 1e-9) & (at > 0)
        out[start : start + step] = np.where(hit, at, np.inf).min(axis=1, initial=np.inf)
    return out


def points_on(occluder: FittedOccluder, rng: np.random.Generator, count: int) -> F64:
    """Corners, and points on the surface (of a polygon: in it), many of them near edges."""
    p = occluder.points
    if not occluder.is_solid:
        return np.concatenate([rng.dirichlet(np.full(len(p), 0.5), count) @ p, p])
    middle, size = p.mean(axis=0), np.ptp(p, axis=0).max()
    faces = p[ConvexHull((p - middle) / size).simplices]
    weights = rng.dirichlet((0.4, 0.4, 0.4), count)
    on = np.einsum("nk,nkd->nd", weights, faces[rng.integers(len(faces), size=count)])
    within = middle + (on - middle) * rng.random((count, 1))
    return np.concatenate([on, within[: count // 3], p])


def assert_hidden(mesh: Mesh, fitted: FittedOccluders, rng: np.random.Generator, count: int = 40) -> None:
    """Every line through an occluder meets the mesh where it is promised to.

    Through a solid: on both sides, or on one of them if openings were covered. Through a polygon: at the polygon.
    """
    if not fitted.occluders:
        return
    low, high = mesh.bounds
    middle, size = 0.5 * low + 0.5 * high, float((high - low).max())
    triangles = (mesh.vertices[mesh.faces] - middle) / size
    for occluder in fitted.occluders:
        p = (points_on(occluder, rng, count) - middle) / size
        way = rng.normal(size=p.shape)
        way /= np.linalg.norm(way, axis=1)[:, None]
        if occluder.is_solid:
            ahead, behind = (np.isfinite(first_hit(p, w, triangles)) for w in (way, -way))
            assert ((ahead | behind) if fitted.is_covered else (ahead & behind)).all()
            continue
        q = (occluder.points - middle) / size
        normal = np.cross(q - q[0], np.roll(q - q[0], -1, axis=0)).sum(axis=0)
        normal /= np.linalg.norm(normal)
        way = np.where(np.abs(way @ normal)[:, None] < SLOPE, way + 2 * SLOPE * normal, way)
        way /= np.linalg.norm(way, axis=1)[:, None]
        reach = THICKNESS / np.abs(way @ normal)
        assert (first_hit(p - reach[:, None] * way, way, triangles) <= 2 * reach).all()


def assert_within_convex(mesh: Mesh, fitted: FittedOccluders) -> None:
    """All corners of all occluders lie inside all planes of a convex mesh."""
    low, high = mesh.bounds
    middle, size = 0.5 * low + 0.5 * high, float((high - low).max())
    planes = ConvexHull((mesh.vertices - middle) / size).equations
    for occluder in fitted.occluders:
        depth = (occluder.points - middle) / size @ planes[:, :3].T + planes[:, 3]
        # a polygon lies in a face, and the faces of a hull are not quite flat
        assert depth.max() <= (0 if occluder.is_solid else 1e-9)
