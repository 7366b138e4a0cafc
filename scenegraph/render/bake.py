"""Arrays of meshes turned into what is drawn: world matrices applied, normals turned, colors multiplied."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..mesh import Mesh
from .layout import F32, F64, I32, I64, U8, Mask


@dataclass(frozen=True)
class Part:
    """A mesh made ready for drawing: triangles with a corner that is not finite are left out.

    Attributes
    ----------
    texture : int
        Index into the list of textures, or -1.
    translucent : bool
        Its own colors or texture let light through.
    """

    vertices: F64
    faces: I32
    normals: F32 | None
    uv: F32 | None
    colors: U8 | None
    texture: int
    translucent: bool


def ready_parts(meshes: Sequence[Mesh]) -> tuple[list[Part], list[U8]]:
    """A `Part` of each mesh, and the distinct textures they use."""
    known: dict[int, int] = {}
    textures: list[U8] = []
    parts = []
    for mesh in meshes:
        vertices, faces = mesh.vertices, mesh.faces
        if mesh.problems:
            finite = np.asarray(np.isfinite(vertices).all(axis=1))
            faces = faces[finite[faces].all(axis=1)]
            vertices = np.where(finite[:, None], vertices, vertices[finite][:1].sum(axis=0))
        texture = -1
        clear = mesh.vertex_colors is not None and bool((mesh.vertex_colors[:, 3] < 255).any())
        if mesh.texture is not None and mesh.uv is not None:
            texture = known.setdefault(id(mesh.texture), len(textures))
            if texture == len(textures):
                textures.append(mesh.texture)
            clear |= mesh.texture.shape[2] == 4 and bool((mesh.texture[..., 3] < 255).any())
        uv = mesh.uv if texture >= 0 else None
        parts.append(Part(vertices, faces, mesh.normals, uv, mesh.vertex_colors, texture, clear))
    return parts, textures


def transformed(matrices: F64, points: NDArray[np.floating], counts: I64) -> F64:
    """(v, 3) each point times the 3x3 matrix of its item; `counts` points per item."""
    wide = np.repeat(matrices.reshape(-1, 9), counts, axis=0).reshape(-1, 3, 3)
    return np.asarray(np.einsum("vij,vj->vi", wide, points))


def determinants(matrices: F64) -> F64:
    """(k,) of 3x3 matrices; NaN, without a warning, where they are not finite."""
    with np.errstate(invalid="ignore", over="ignore"):
        return np.asarray(np.einsum("ki,ki->k", matrices[:, 0], np.cross(matrices[:, 1], matrices[:, 2])))


def normal_matrices(matrices: F64) -> F64:
    """(k, 3, 3) for turning normals: cofactors times the sign of the determinant.

    Parallel to the inverse transpose, but defined for singular matrices too.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        a, b, c = matrices[:, 0], matrices[:, 1], matrices[:, 2]
        cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    sign = np.where(determinants(matrices) < 0, -1.0, 1.0)
    return np.asarray(cofactors * sign[:, None, None])


def unit(vectors: F64) -> F64:
    """Vectors of length 1; what has no direction stays as it is."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.where(length > 0, length, 1.0))


def quantized(colors: NDArray[np.floating]) -> U8:
    """Colors in 0..1 as the nearest bytes."""
    return np.asarray(np.rint(np.clip(colors, 0, 1) * 255).astype(np.uint8))


def tinted(item_colors: NDArray[np.float32], own: Sequence[U8 | None], counts: I64) -> U8:
    """(v, 4) color of each item, times the vertex colors of the meshes that have any."""
    colors = np.repeat(quantized(item_colors), counts, axis=0)
    if any(c is not None for c in own):
        ends = np.cumsum(counts)
        for start, end, part in zip(ends - counts, ends, own, strict=True):
            if part is not None:
                colors[start:end] = (colors[start:end].astype(np.uint16) * part + 127) // 255
    return colors


def centered(world: F64, center: F64) -> F64:
    """(k, 4, 4) world matrices for coordinates relative to `center`."""
    matrices = world.copy()
    matrices[:, :3, 3] += world[:, :3, :3] @ center
    return matrices


def without_lost_corners(vertices: F64, faces: I32) -> tuple[F32, I32]:
    """Vertices as float32; triangles with a corner that is not finite then are shrunk to a point."""
    with np.errstate(over="ignore", invalid="ignore"):
        small = vertices.astype(np.float32)
    lost: Mask = np.logical_not(np.isfinite(small).all(axis=1))
    if lost.any():
        small[lost] = 0
        touched = np.asarray(np.take(lost, faces).any(axis=1))
        faces = np.where(touched[:, None], faces[:, :1], faces)
    return small, faces
