"""All drawables of a snapshot as one surface in world coordinates: what a tree over a whole scene is built from."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .prepared import is_translucent

if TYPE_CHECKING:
    from ..mesh import Mesh
    from ..snapshot import Snapshot

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


#: What is merged is not farther from the center of the scene, in any coordinate.
LARGEST = 1e50


@dataclass(frozen=True)
class Soup:
    """Triangles with the row each came from.

    Attributes
    ----------
    vertices : (v, 3) float64
        World coordinates relative to `origin`.
    normals : (v, 3) float32
        Zero where the mesh is shaded flat.
    colors : (v, 4) uint8
        Of the row, times that of the vertex.
    faces : (t, 3) int64
        Turned so that front faces stay front faces.
    rows : (t,) int32
    origin : (3,) float64
    """

    vertices: F64
    normals: NDArray[np.float32]
    colors: NDArray[np.uint8]
    faces: I64
    rows: NDArray[np.int32]
    origin: F64

    @property
    def is_painted(self) -> bool:
        """Whether it has more than one color."""
        return bool((self.colors != self.colors[:1]).any())


def rows_for_soup(snapshot: Snapshot) -> NDArray[np.bool_]:
    """(n,) rows whose meshes can be merged with others: opaque, untextured, in a known place, and free to be culled."""
    good_mesh = np.array([_is_plain(m) for m in snapshot.meshes] + [False], bool)
    linear = snapshot.transforms[:, :3, :3]
    with np.errstate(all="ignore"):
        placed = np.isfinite(snapshot.transforms).all(axis=(1, 2)) & (np.abs(np.linalg.det(linear)) > 0)
    good = good_mesh[snapshot.mesh_index] & placed[snapshot.transform_index] & (snapshot.colors[:, 3] >= 1)
    with np.errstate(over="ignore", invalid="ignore"):
        reach = np.abs(snapshot.boxes[:3] - snapshot.origin[:, None]) + snapshot.boxes[3:]
    # of what is larger, distances overflow
    good &= (reach < LARGEST).all(axis=0)
    return np.asarray(good & ~snapshot.protected)


def _is_plain(mesh: Mesh) -> bool:
    return bool(mesh.triangles) and mesh.is_finite and mesh.texture is None and not is_translucent(mesh)


def soup_of(snapshot: Snapshot, covered: NDArray[np.bool_]) -> Soup:
    """Merge the finest meshes of rows.

    Parameters
    ----------
    snapshot : Snapshot
    covered : (n,) bool
        Some of `rows_for_soup`.
    """
    origin = np.asarray(snapshot.origin, np.float64)
    vertices, normals, colors, faces, rows = [], [], [], [], []
    start = 0
    base = np.rint(np.clip(snapshot.colors, 0, 1) * 255).astype(np.uint16)
    for row in np.flatnonzero(covered).tolist():
        mesh = snapshot.meshes[int(snapshot.mesh_index[row])]
        world = snapshot.transforms[int(snapshot.transform_index[row])]
        linear = world[:3, :3]
        mirrored = np.linalg.det(linear) < 0
        vertices.append(mesh.vertices @ linear.T + (world[:3, 3] - origin))
        normals.append(_turned(mesh.normals, linear, len(mesh.vertices)))
        paint = np.broadcast_to(base[row], (len(mesh.vertices), 4))
        if mesh.vertex_colors is not None:
            paint = (paint * mesh.vertex_colors + 127) // 255
        colors.append(paint.astype(np.uint8))
        faces.append((mesh.faces[:, ::-1] if mirrored else mesh.faces).astype(np.int64) + start)
        rows.append(np.full(mesh.triangles, row, np.int32))
        start += len(mesh.vertices)
    if not vertices:
        none = np.zeros((0, 3))
        empty = np.zeros((0, 4), np.uint8)
        return Soup(none, none.astype(np.float32), empty, none.astype(np.int64), np.zeros(0, np.int32), origin)
    return Soup(
        np.concatenate(vertices),
        np.concatenate(normals),
        np.concatenate(colors),
        np.concatenate(faces),
        np.concatenate(rows),
        origin,
    )


def _turned(normals: NDArray[np.float32] | None, linear: F64, count: int) -> NDArray[np.float32]:
    if normals is None:
        return np.zeros((count, 3), np.float32)
    a, b, c = linear
    # the cofactors: parallel to the inverse transpose
    cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)]) * (
        -1.0 if np.linalg.det(linear) < 0 else 1.0
    )
    turned = normals @ cofactors.T
    length = np.linalg.norm(turned, axis=1, keepdims=True)
    return np.asarray(turned / np.where(length > 0, length, 1.0), np.float32)


def soup_key(snapshot: Snapshot, covered: NDArray[np.bool_]) -> str:
    """Content hash (hex) of what `soup_of` would merge, without merging it."""
    digest = hashlib.sha256()
    rows = np.flatnonzero(covered)
    used, number = np.unique(snapshot.mesh_index[rows], return_inverse=True)
    for index in used.tolist():
        mesh = snapshot.meshes[index]
        digest.update(mesh.key.encode())
        for extra in (mesh.normals, mesh.vertex_colors):
            digest.update(b"-" if extra is None else extra.tobytes())
    for array in (number, snapshot.transforms[snapshot.transform_index[rows]], snapshot.colors[rows], rows):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:32]
