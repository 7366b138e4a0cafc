"""Outlines of triangle meshes as seen from an eye.

Every face covers the screen with its loop, turned so that it runs counterclockwise there. In the sum of these chains
the edges between two faces that face the same way cancel; what is left is the outline of their union, and its winding
number counts the layers. That needs no special case for open, folded, non-manifold or inconsistently oriented meshes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Sine of the angle between line of sight and face below which the face counts as edge-on and covers nothing.
EDGE_ON = 1e-7


def mesh_edges(faces: NDArray[np.integer], /) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int8]]:
    """Undirected edges of triangles, and how each face runs along them.

    Parameters
    ----------
    faces : (f, 3) int
        Vertex indices.

    Returns
    -------
    edges : (e, 2) int64
        Lower and higher vertex; sorted.
    face_edges : (f, 3) int64
        Edge from corner i to corner i + 1.
    face_signs : (f, 3) int8
        +1 where the face runs from the lower vertex to the higher, -1 against it.
    """
    a = faces.astype(np.int64)
    b = np.roll(a, -1, axis=1)
    span = int(a.max(initial=0)) + 1
    key, inverse = np.unique(np.minimum(a, b) * span + np.maximum(a, b), return_inverse=True)
    edges = np.column_stack([key // span, key % span])
    return edges, inverse.reshape(a.shape), np.where(a < b, 1, -1).astype(np.int8)


def face_turns(
    points: NDArray[np.float64], faces: NDArray[np.int64], /, *, parallel: bool
) -> tuple[NDArray[np.int8], NDArray[np.float64], NDArray[np.float64]]:
    """How faces turn on the screen.

    Parameters
    ----------
    points : (3, v) float64
        Eye space: x right, y up, looking along -z from the origin.
    faces : (f, 3) int
    parallel : bool
        Lines of sight are parallel to z instead of meeting in the origin.

    Returns
    -------
    turn : (f,) int8
        +1 counterclockwise on the screen, -1 clockwise, 0 edge-on.
    normal : (3, f) float64
        Not normalized, by the order of the corners.
    offset : (f,) float64
        n·p on the plane of the face.
    """
    p = points[:, faces[:, 0]]
    u, v = points[:, faces[:, 1]] - p, points[:, faces[:, 2]] - p
    normal = np.stack([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]])
    offset = (normal * p).sum(axis=0)
    length = np.sqrt((normal * normal).sum(axis=0))
    if parallel:
        side, scale = normal[2], length
    else:
        side, scale = -offset, length * np.sqrt((p * p).sum(axis=0))
    turn = np.where(np.abs(side) > EDGE_ON * scale, np.sign(side), 0.0).astype(np.int8)
    return turn, normal, offset


def mesh_outline(
    depth: NDArray[np.float64],
    edges: NDArray[np.int64],
    faces: NDArray[np.int64],
    face_edges: NDArray[np.int64],
    face_signs: NDArray[np.int8],
    turn: NDArray[np.int8],
    /,
    *,
    near: float,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """The outline of the faces that turn, cut off at the near plane.

    Parameters
    ----------
    depth : (v,) float64
        Distance of each vertex along the line of sight.
    edges, faces, face_edges, face_signs
        As from `mesh_edges`.
    turn : (f,) int8
        As from `face_turns`; faces with 0 are left out.
    near : float

    Returns
    -------
    start, end : (k,) int64
        Ends of the outline's edges: a vertex, or v + i for the point where edge `cuts[i]` meets the near plane.
    weight : (k,) int64
        How often the edge is traversed; never 0.
    cuts : (c,) int64
    """
    ahead = depth >= near
    count = ahead[faces].sum(axis=1)
    turn = np.where(count > 0, turn, np.int8(0))
    net = np.bincount(face_edges.ravel(), (face_signs * turn[:, None]).ravel(), minlength=len(edges)).astype(np.int64)
    of_outline = np.flatnonzero(net)
    start, end, weight = edges[of_outline, 0], edges[of_outline, 1], net[of_outline]
    cut_faces = np.flatnonzero((turn != 0) & (count < 3))
    if not len(cut_faces) and ahead[start].all() and ahead[end].all():
        return start, end, weight, np.zeros(0, np.int64)
    here = ahead[faces[cut_faces]]
    there = np.roll(here, -1, axis=1)
    of_cut = face_edges[cut_faces]
    leaves, enters = of_cut[here & ~there], of_cut[~here & there]
    crossing = ahead[start] != ahead[end]
    cuts, number = np.unique(np.concatenate([leaves, enters, of_outline[crossing]]), return_inverse=True)
    number += len(depth)
    k = len(cut_faces)
    # the part of an edge of the outline that is ahead
    behind_start, behind_end = crossing & ~ahead[start], crossing & ~ahead[end]
    place = np.zeros(len(start), np.int64)
    place[crossing] = number[2 * k :]
    kept = ahead[start] | ahead[end]
    start, end = np.where(behind_start, place, start)[kept], np.where(behind_end, place, end)[kept]
    # along the near plane each cut face is closed from where its loop leaves to where it enters again
    return (
        np.concatenate([start, number[:k]]),
        np.concatenate([end, number[k : 2 * k]]),
        np.concatenate([weight[kept], turn[cut_faces].astype(np.int64)]),
        cuts,
    )
