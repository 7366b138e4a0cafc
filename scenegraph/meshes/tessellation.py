"""Finer levels of a mesh: Phong tessellation (Boubekeur & Alexa 2008), as in Kristmann 2022 up to level 20.

The mesh stays in one piece wherever it was:

* Points on an edge are made once per edge, from its two ends, and used by all faces around it.
* Files repeat vertices where normals have a crease. With different normals, the two copies of an edge would bend
  apart. So the surface is bent by one normal per position, the mean of all that stand there; the vertices keep their
  own normals for shading, and edges with the same ends are one edge, whatever vertices name them.
* Where the normals of a position cancel, it stays flat.

Level 1 is the mesh itself. Level t cuts each triangle into 3t²/2 (rounded down), as OpenGL's tessellator does: 600 at
level 20.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..errors import SceneError
from ..kernels.contours import mesh_edges
from ..kernels.tessellation import (
    edge_phong_points,
    face_phong_error,
    face_phong_points,
    face_tessellation,
    face_tessellation_count,
)
from ..mesh import Mesh

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

#: As the paper has it: a compromise between flat and bulging.
SHAPE = 0.75
#: The finest level of the thesis, and the finest of any.
FINEST, LIMIT = 20, 64


def tessellate(mesh: Mesh, level: int, *, shape: float = SHAPE) -> Mesh:
    """Cut each triangle and bend the parts.

    Parameters
    ----------
    mesh : Mesh
        With vertex normals; without, the mean of the faces around each position is taken.
    level : int
        Parts of each edge, 1 to 64.
    shape : float
        0 keeps the mesh's surface; 3/4 is the paper's.

    Returns
    -------
    Mesh
        With normals; colors and texture coordinates are interpolated. Level 1 is the mesh itself.

    Raises
    ------
    SceneError
        The mesh is not finite, or the level out of bounds.
    """
    if not 1 <= level <= LIMIT:
        raise SceneError(f"tessellation: level={level!r} is not between 1 and {LIMIT}")
    if mesh.problems:
        raise SceneError(f"tessellation: {mesh!r}: {mesh.problems[0]}")
    if level == 1 or not mesh.triangles:
        return mesh
    corner, bend = _welded(mesh)
    faces = mesh.faces.astype(np.int64)
    weights, pattern = face_tessellation(level)
    edges, face_edges, signs = mesh_edges(faces)
    points = len(mesh.vertices) + len(edges) * (level - 1)
    number = _numbers(faces, face_edges, signs, level, len(weights), len(mesh.vertices), points)
    share = np.arange(1, level) / level
    inner = weights[3 * level :]

    shared = np.unique(np.sort(corner[edges], axis=1), axis=0)
    which, turned = _shared_edge(corner[edges], shared, len(bend))
    place = np.empty((len(bend), 3))
    place[corner] = mesh.vertices
    between = edge_phong_points(place[shared], bend[shared], share, shape=shape)[which]
    between[turned] = between[turned, ::-1]
    inside = face_phong_points(place[corner[faces]], bend[corner[faces]], inner, shape=shape)
    vertices = np.concatenate([mesh.vertices, between.reshape(-1, 3), inside.reshape(-1, 3)])

    def spread(values: NDArray[np.generic]) -> F64:
        """Mix what the vertices have along edges and inside faces."""
        v = values.astype(np.float64)
        on_edges = (1 - share)[None, :, None] * v[edges[:, 0], None] + share[None, :, None] * v[edges[:, 1], None]
        in_faces = sum(inner[None, :, k, None] * v[faces[:, k], None] for k in range(3))
        tail = v.shape[1]
        return np.concatenate([v, on_edges.reshape(-1, tail), np.asarray(in_faces).reshape(-1, tail)])

    normals = spread(bend[corner] if mesh.normals is None else mesh.normals)
    length = np.sqrt((normals**2).sum(axis=1, keepdims=True))
    colors = mesh.vertex_colors
    return Mesh(
        vertices,
        number[:, pattern].reshape(-1, 3),
        name=mesh.name,
        color=mesh.color,
        normals=normals / np.where(length > 0, length, 1.0),
        uv=None if mesh.uv is None else spread(mesh.uv),
        vertex_colors=None if colors is None else np.rint(spread(colors)).astype(np.uint8),
        texture=mesh.texture,
    )


def tessellation_chain(mesh: Mesh, finest: int = FINEST, *, shape: float = SHAPE) -> list[tuple[Mesh, float]]:
    """All levels from `finest` down to the mesh itself, as `scenegraph.Lod` takes them.

    Parameters
    ----------
    mesh : Mesh
    finest : int
        Tessellation level of the finest one.
    shape : float
        See `tessellate`.

    Returns
    -------
    list of (Mesh, float)
        `finest` levels, finest first, each with a bound on the distance of its surface from the finest one's, in the
        mesh's units: both are bounded against the bent surface itself.
    """
    corner, bend = _welded(mesh)
    place = np.empty((len(bend), 3))
    place[corner] = mesh.vertices
    at = corner[mesh.faces]
    away = [float(face_phong_error(place[at], bend[at], n, shape=shape).max(initial=0.0)) for n in range(1, finest + 1)]
    chain = [(tessellate(mesh, finest, shape=shape), 0.0)]
    error = 0.0
    for level in range(finest - 1, 0, -1):
        error = max(error, away[level - 1] + away[finest - 1])
        chain.append((tessellate(mesh, level, shape=shape), error))
    return chain


def tessellated_triangles(mesh: Mesh, level: int) -> int:
    """How many triangles a level has, without making it."""
    return mesh.triangles * face_tessellation_count(level)


def _welded(mesh: Mesh) -> tuple[I64, F64]:
    """Number of each vertex's position, and the normal of each position: 0 where it has none."""
    # adding 0 makes a negative zero a positive one
    _, corner = np.unique(mesh.vertices + 0.0, axis=0, return_inverse=True)
    corner = corner.reshape(-1)
    bend = np.zeros((int(corner.max(initial=-1)) + 1, 3))
    if mesh.normals is not None:
        known = np.where(np.isfinite(mesh.normals).all(axis=1, keepdims=True), mesh.normals, 0).astype(np.float64)
        length = np.sqrt((known**2).sum(axis=1, keepdims=True))
        known /= np.where(length > 0, length, 1.0)
        # each direction counts once, however many faces repeat it
        both = np.unique(np.column_stack([corner, np.round(known, 6)]), axis=0)
        np.add.at(bend, both[:, 0].astype(np.int64), both[:, 1:])
    elif len(bend):
        size = float(np.ptp(mesh.bounds, axis=0).max()) or 1.0
        p = mesh.vertices[mesh.faces] / size
        facing = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
        np.add.at(bend, corner[mesh.faces].reshape(-1), np.repeat(facing, 3, axis=0))
    length = np.sqrt((bend**2).sum(axis=1, keepdims=True))
    none = length <= 1e-6 * length.max(initial=0.0)
    return corner, np.where(none, 0.0, bend / np.where(none, 1.0, length))


def _shared_edge(ends: I64, shared: I64, count: int) -> tuple[I64, NDArray[np.bool_]]:
    """Which shared edge has these ends, and whether the other way round."""
    turned = ends[:, 0] > ends[:, 1]
    low, high = np.sort(ends, axis=1).T
    return np.searchsorted(shared[:, 0] * count + shared[:, 1], low * count + high), turned


def _numbers(
    faces: I64, face_edges: I64, signs: NDArray[np.int8], level: int, count: int, vertices: int, points: int
) -> I64:
    """(f, p) vertex of each point of the pattern in each face: corners, points of edges, inner ones."""
    out = np.empty((len(faces), count), np.int64)
    out[:, :3] = faces
    step = np.arange(level - 1)
    for side in range(3):
        forward = vertices + face_edges[:, side, None] * (level - 1) + step
        start = 3 + side * (level - 1)
        out[:, start : start + level - 1] = np.where(signs[:, side, None] > 0, forward, forward[:, ::-1])
    inside = count - 3 * level
    out[:, 3 * level :] = points + np.arange(len(faces))[:, None] * inside + np.arange(inside)
    return out
