"""Meshes of the nodes of an HLOD tree: cut out of the scene at leaves, simplified from the children's above."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .collapsing import collapse
from .deviation import Surface, is_among, surface_deviation
from .soup import Soup

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

#: By how much the bound of an error may lie above what was found; a tighter one costs more than it saves.
TOLERANCE = 0.25
#: Triangles that are tried for each point.
_TRIED = 8


class NodeMesh(NamedTuple):
    """Arrays of one mesh.

    Attributes
    ----------
    vertices : (v, 3) float64
        Relative to the origin of the scene.
    normals : (v, 3) float32
        Zero where it is shaded flat.
    colors : (v, 4) uint8
    faces : (t, 3) int64
    """

    vertices: F64
    normals: NDArray[np.float32]
    colors: NDArray[np.uint8]
    faces: I64

    @property
    def corners(self) -> F64:
        """(t, 3, 3) corners of the triangles."""
        return np.asarray(self.vertices[self.faces])


class Step(NamedTuple):
    """What one simplification did.

    Attributes
    ----------
    error : float
        Distance between the meshes before and after, see `_distance`.
    border_edges, broken_edges : int
        Edges of the border before, and those of them that are lost.
    """

    error: float
    border_edges: int
    broken_edges: int


def leaf_mesh(soup: Soup, triangles: I64) -> NodeMesh:
    """The original triangles."""
    faces = soup.faces[triangles]
    used, faces = np.unique(faces, return_inverse=True)
    mesh = NodeMesh(soup.vertices[used], soup.normals[used], soup.colors[used], faces.reshape(-1, 3).astype(np.int64))
    return _shaded(mesh)


def joined(parts: Sequence[NodeMesh | None]) -> NodeMesh:
    """Meshes side by side."""
    given = [p for p in parts if p is not None]
    starts = np.cumsum([0, *(len(p.vertices) for p in given[:-1])])
    return NodeMesh(
        np.concatenate([p.vertices for p in given]),
        np.concatenate([p.normals for p in given]),
        np.concatenate([p.colors for p in given]),
        np.concatenate([p.faces + s for p, s in zip(given, starts, strict=True)]),
    )


def simplified(mesh: NodeMesh, most: int) -> tuple[NodeMesh, Step]:
    """A mesh of at most so many triangles, unless its border has more; the border stays as it is.

    Vertices at the same place are one: the seams between children are no border any more.
    """
    from scipy.spatial import cKDTree

    points, faces = _welded(mesh.vertices, mesh.faces)
    border = _border(points, faces)
    error = 0.0
    if len(faces) > most:
        before = points[faces]
        points, faces = _collapsed(points, faces, most)
        error = _distance(before, points, faces)
    broken = len(border - _border(points, faces))
    _, nearest = cKDTree(mesh.vertices).query(points)
    nearest = np.asarray(nearest, np.int64)
    made = NodeMesh(points, mesh.normals[nearest], mesh.colors[nearest], faces)
    return _shaded(made), Step(error, len(border), broken)


def _collapsed(points: F64, faces: I64, most: int) -> tuple[F64, I64]:
    """Edges collapsed by the quadric error metric (Garland & Heckbert 1997), except at the border.

    Not by way of `simplification.simplify`: that scales to unit size and back, after which the borders of neighbors
    differ in their last bits, and it measures both ways, which takes nine tenths of the time of a tree.
    """
    # a power of two: dividing by it and multiplying by it changes no bit
    scale = 2.0 ** np.ceil(np.log2(float(np.abs(points).max()) or 1.0))
    points, faces = np.ascontiguousarray(points / scale), np.ascontiguousarray(faces, np.int32)
    out, kept = collapse(points, faces, target_count=most, preserve_border=True)
    used, kept = np.unique(np.asarray(kept, np.int64), return_inverse=True)
    return np.asarray(out, np.float64)[used] * scale, kept.reshape(-1, 3).astype(np.int64)


def _distance(before: F64, points: F64, faces: I64) -> float:
    """Bound of how far triangles (m, 3, 3) lie from what they were simplified to, and a measurement of the way back.

    Bounding the way back, too, takes ten times as long: large triangles have to be cut down to the size of small ones.
    Its corners and middles are measured; bulges between them are not.
    """
    if not len(faces):
        # nothing is left: everything is as far away as it is large
        return float(np.linalg.norm(np.ptp(before.reshape(-1, 3), axis=0)))
    after = points[faces]
    there = surface_deviation(before, Surface(after), tolerance=TOLERANCE).bound
    corners = points[~is_among(points[:, None], before.reshape(-1, 1, 3))]
    middles = after[~is_among(after, before)].mean(axis=1)
    return _farthest(np.concatenate([corners, middles]), before, there)


def _farthest(points: F64, triangles: F64, least: float) -> float:
    """Distance of the farthest of points (k, 3) from triangles (m, 3, 3), or `least` if that is more.

    Nearly all points are nearer than `least`, as a rule, and any triangle that is shows it: one of those with the
    nearest middles, which are found soonest. Only for points without such a one more is done.
    """
    for spread in (False, True):
        if not len(points):
            return least
        surface = Surface(triangles, spread=spread)
        for tried in (1, _TRIED):
            away = surface.distances(points.T[:, None], surface.near(points, tried).T).min(axis=0)
            points, away = points[away > least], away[away > least]
            if not len(points):
                return least
    return float(away.max())


def _welded(vertices: F64, faces: I64) -> tuple[F64, I64]:
    """Vertices of exactly equal coordinates merged; triangles that have become lines dropped."""
    # 0.0 and -0.0 are the same place
    points = vertices + 0.0
    # a tenth of the time of `np.unique` of rows
    order = np.lexsort(points.T[::-1])
    points = points[order]
    fresh = np.ones(len(points), bool)
    fresh[1:] = (points[1:] != points[:-1]).any(axis=1)
    index = np.empty(len(points), np.int64)
    index[order] = np.cumsum(fresh) - 1
    points, faces = points[fresh], index[faces]
    flat: NDArray[np.bool_] = (faces[:, 0] == faces[:, 1]) | (faces[:, 1] == faces[:, 2]) | (faces[:, 2] == faces[:, 0])
    return points, faces[~flat]


def _border(points: F64, faces: I64) -> set[bytes]:
    """Edges of a single triangle, by the coordinates of their ends."""
    a, b = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    edges, times = np.unique(np.minimum(a, b) * len(points) + np.maximum(a, b), return_counts=True)
    ends = points[np.stack(np.divmod(edges[times == 1], len(points)), axis=1)] + 0.0
    swap = _after(ends[:, 0], ends[:, 1])
    ends[swap] = ends[swap][:, ::-1]
    data = np.ascontiguousarray(ends.reshape(-1, 6)).view(np.dtype((np.void, 48))).reshape(-1)
    return {d.tobytes() for d in data}


def _after(a: F64, b: F64) -> NDArray[np.bool_]:
    """Whether points a come after points b in the order of their coordinates."""
    after, same = (a > b).T, (a == b).T
    return np.asarray(after[0] | (same[0] & (after[1] | (same[1] & after[2]))))


def _shaded(mesh: NodeMesh) -> NodeMesh:
    """Where some vertices are smooth and some flat, flat faces get corners of their own, with the face's normal."""
    flat = np.logical_not(mesh.normals.any(axis=1))
    if flat.all() or not flat.any():
        return mesh
    face_flat = flat[mesh.faces].any(axis=1)
    alone = mesh.faces[face_flat]
    a, b, c = mesh.corners[face_flat].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.where(length > 0, normal / np.where(length > 0, length, 1.0), [0.0, 0.0, 1.0])
    count = len(mesh.vertices)
    faces = mesh.faces.copy()
    faces[face_flat] = count + np.arange(3 * len(alone)).reshape(-1, 3)
    vertices = np.concatenate([mesh.vertices, mesh.vertices[alone].reshape(-1, 3)])
    normals = np.concatenate([mesh.normals, np.repeat(normal, 3, axis=0).astype(np.float32)])
    colors = np.concatenate([mesh.colors, mesh.colors[alone].reshape(-1, 4)])
    used, faces = np.unique(faces, return_inverse=True)
    return NodeMesh(vertices[used], normals[used], colors[used], faces.reshape(-1, 3).astype(np.int64))
