"""Normals, colors and texture coordinates for a coarser level, looked up on the surface that it was made from.

Where the original has a seam (a crease between normals, the edge of a patch of the texture) its faces share no
vertices. Each face of the level belongs to the patch under its middle, and its corners are looked up within that
patch; corners of one vertex that belong to different patches become different vertices.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..mesh import Mesh
from .deviation import Surface

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

#: Faces of the original that are looked at for each corner.
_TRIED = 16


class Carried(NamedTuple):
    """Attributes of the vertices of a level; None where the original has none."""

    normals: NDArray[np.float32] | None = None
    uv: NDArray[np.float32] | None = None
    vertex_colors: NDArray[np.uint8] | None = None


def carried(mesh: Mesh, source: I64, original: Surface, vertices: F64, faces: I64) -> tuple[I64, I64, Carried]:
    """Attributes of a level.

    Parameters
    ----------
    mesh : Mesh
        What the level was made from.
    source : (m,) int64
        The mesh's face of each triangle of `original`.
    original : Surface
        The mesh in a frame in which its longest side is 1.
    vertices : (v, 3) float64
        Of the level, in that frame.
    faces : (f, 3) int64

    Returns
    -------
    (w,) int64
        The vertex that each new vertex repeats.
    (f, 3) int64
        Faces of new vertices.
    Carried
        Attributes of the new vertices.
    """
    if mesh.normals is None and mesh.uv is None and mesh.vertex_colors is None:
        return np.arange(len(vertices)), faces, Carried()
    patch = _patches(mesh, source)
    turned = _normals(original.triangles)
    corners = vertices[faces]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    under = _best(original, turned, patch, corners.mean(axis=1), facing, None)
    key = faces * (int(patch.max()) + 1) + patch[under][:, None]
    keys, first, new = np.unique(key, return_index=True, return_inverse=True)
    new = new.reshape(-1, 3)
    repeated = faces.reshape(-1)[first]
    sense = np.zeros((len(keys), 3))
    np.add.at(sense, new.reshape(-1), np.repeat(facing, 3, axis=0))
    best = _best(original, turned, patch, vertices[repeated], sense, patch[under][first // 3])
    strayed = patch[best] != patch[under][first // 3]
    best[strayed] = under[first[strayed] // 3]
    weights = original.weights(np.ascontiguousarray(vertices[repeated].T), best)
    corner = mesh.faces[source[best]]

    def mixed(values: NDArray[np.generic]) -> F64:
        return np.asarray(np.einsum("ck,kcd->kd", weights, values[corner].astype(np.float64)))

    normals = uv = colors = None
    if mesh.normals is not None:
        sum_ = mixed(mesh.normals)
        length = np.linalg.norm(sum_, axis=1, keepdims=True)
        normals = (sum_ / np.where(length > 0, length, 1)).astype(np.float32)
    if mesh.uv is not None:
        uv = mixed(mesh.uv).astype(np.float32)
    if mesh.vertex_colors is not None:
        colors = np.rint(mixed(mesh.vertex_colors)).astype(np.uint8)
    return repeated, new, Carried(normals, uv, colors)


def _patches(mesh: Mesh, source: I64) -> I64:
    """(m,) number of the patch of each triangle: faces that share vertices."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    ends = np.concatenate([mesh.faces[:, :2], mesh.faces[:, 1:]]).T
    links = coo_matrix((np.ones(ends.shape[1], np.int8), (ends[0], ends[1])), shape=(len(mesh.vertices),) * 2)
    of_vertex = connected_components(links, directed=False)[1]
    return np.asarray(of_vertex[mesh.faces[source, 0]], np.int64)


def _normals(triangles: F64) -> F64:
    return np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])


def _best(surface: Surface, turned: F64, patch: I64, points: F64, facing: F64, wanted: I64 | None) -> I64:
    """(k,) triangle for each point: if possible of the wanted patch, then facing the same way, then the nearest."""
    tried = surface.near(points, _TRIED)
    k, c = tried.shape
    repeated = np.broadcast_to(np.ascontiguousarray(points.T)[:, None], (3, c, k)).reshape(3, -1)
    cost = surface.distances(repeated, tried.T.reshape(-1)).reshape(c, k).T
    # the frame's longest side is 1: no distance outweighs these
    cost = cost + 10.0 * (np.einsum("kcd,kd->kc", turned[tried], facing) < 0)
    if wanted is not None:
        cost += 100.0 * (patch[tried] != wanted[:, None])
    return np.asarray(tried[np.arange(k), cost.argmin(axis=1)])
