"""Mesh: an immutable triangle mesh that any number of geodes share."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import SceneError

Color = tuple[float, float, float, float]


def as_color(value: Sequence[float] | None) -> Color | None:
    """RGB or RGBA in 0..1 → RGBA, or `SceneError`."""
    if value is None:
        return None
    rgba = tuple(float(c) for c in value)
    if len(rgba) == 3:
        rgba = (*rgba, 1.0)
    if len(rgba) != 4 or not all(0.0 <= c <= 1.0 for c in rgba):
        raise SceneError(f"color {value!r} is not three or four numbers between 0 and 1; divide 8-bit values by 255")
    return rgba


def _frozen(array: NDArray[np.generic]) -> None:
    array.flags.writeable = False


class Mesh:
    """Triangles in local coordinates; never changes after it is made, so that it can be shared and cached.

    Parameters
    ----------
    vertices : (v, 3) float
        Local coordinates, kept in float64. Values that are not finite are kept and named in `problems`;
        a drawable with such a mesh has an unknown box and is always drawn.
    faces : (f, 3) int
        Vertex indices, counterclockwise seen from outside.
    name : str, optional
    color : 3 or 4 floats in 0..1, optional
        Base color.
    normals : (v, 3) float, optional
        For smooth shading; flat shading without.
    uv : (v, 2) float, optional
    vertex_colors : (v, 4) uint8, optional
    texture : (h, w, 3 or 4) uint8, optional
        Row 0 is the top of the image.

    Raises
    ------
    SceneError
        Wrong shapes, or face indices beyond the vertices.
    """

    def __init__(
        self,
        vertices: ArrayLike,
        faces: ArrayLike,
        *,
        name: str = "",
        color: Sequence[float] | None = None,
        normals: ArrayLike | None = None,
        uv: ArrayLike | None = None,
        vertex_colors: ArrayLike | None = None,
        texture: ArrayLike | None = None,
    ) -> None:
        label = f"mesh {name!r}" if name else "mesh"
        self.name = name
        self.vertices: NDArray[np.float64] = np.array(vertices, np.float64, ndmin=2)
        self.faces: NDArray[np.int32] = np.array(faces, np.int64, ndmin=2).astype(np.int32)
        if self.vertices.size == 0:
            self.vertices = self.vertices.reshape(0, 3)
        if self.faces.size == 0:
            self.faces = self.faces.reshape(0, 3)
        count = len(self.vertices)
        if self.vertices.shape != (count, 3):
            raise SceneError(f"{label}: vertices have shape {self.vertices.shape}, expected (v, 3)")
        if self.faces.ndim != 2 or self.faces.shape[1] != 3:
            raise SceneError(f"{label}: faces have shape {self.faces.shape}, expected (f, 3); triangulate first")
        if len(self.faces) and (self.faces.min() < 0 or self.faces.max() >= count):
            raise SceneError(
                f"{label}: a face names vertex {int(self.faces.max())} (lowest {int(self.faces.min())}) "
                f"but there are {count} vertices"
            )
        self.color = as_color(color)
        self.normals = self._attribute(normals, np.float32, (3,), "normals")
        self.uv = self._attribute(uv, np.float32, (2,), "uv")
        self.vertex_colors = self._attribute(vertex_colors, np.uint8, (4,), "vertex_colors")
        self.texture: NDArray[np.uint8] | None = None
        if texture is not None:
            image = np.asarray(texture)
            # a read-only image is shared: meshes with the same texture then hold the same array
            shared = image.dtype == np.uint8 and not image.flags.writeable
            self.texture = image if shared else np.array(image, np.uint8)
            if self.texture.ndim != 3 or self.texture.shape[2] not in (3, 4):
                raise SceneError(f"{label}: texture has shape {self.texture.shape}, expected (h, w, 3 or 4)")
            _frozen(self.texture)
        _frozen(self.vertices)
        _frozen(self.faces)
        bad = count - int(np.isfinite(self.vertices).all(axis=1).sum())
        self.problems: tuple[str, ...] = (f"{bad} of {count} vertices are not finite",) if bad else ()

    def _attribute(self, value: ArrayLike | None, dtype: type, tail: tuple[int, ...], what: str) -> NDArray | None:  # type: ignore[type-arg]
        if value is None:
            return None
        array: NDArray[np.generic] = np.array(value, dtype)
        if array.shape != (len(self.vertices), *tail):
            raise SceneError(
                f"mesh {self.name!r}: {what} have shape {array.shape}, expected {(len(self.vertices), *tail)}"
            )
        _frozen(array)
        return array

    def __repr__(self) -> str:
        return f"<Mesh {self.name!r} {len(self.vertices)} vertices, {len(self.faces)} triangles>"

    @property
    def triangles(self) -> int:
        """Number of triangles."""
        return len(self.faces)

    @property
    def is_finite(self) -> bool:
        """Whether every vertex is a finite number."""
        return not self.problems

    @cached_property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) lowest and highest corner of the vertices that faces use; NaN where one of them is not finite."""
        if not len(self.faces):
            return np.full((2, 3), np.nan)
        is_used = np.zeros(len(self.vertices), bool)
        is_used[self.faces] = True
        used = self.vertices[is_used]
        if not np.isfinite(used).all():
            return np.full((2, 3), np.nan)
        return np.array([np.minimum.reduce(used, axis=0), np.maximum.reduce(used, axis=0)])

    @cached_property
    def key(self) -> str:
        """Content hash (hex) of vertices and faces: the name under which derived data is cached on disk."""
        digest = hashlib.sha256(self.vertices.tobytes())
        digest.update(self.faces.tobytes())
        return digest.hexdigest()[:32]

    @cached_property
    def alone(self) -> MeshTable:
        """The table that has only this mesh; the same one at every call, so that what is loaded of it is reused."""
        return MeshTable([self])

    @property
    def nbytes(self) -> int:
        """Bytes held by the arrays."""
        arrays = (self.vertices, self.faces, self.normals, self.uv, self.vertex_colors, self.texture)
        return sum(a.nbytes for a in arrays if a is not None)

    @classmethod
    def box(cls, lo: ArrayLike, hi: ArrayLike, *, name: str = "", color: Sequence[float] | None = None) -> Mesh:
        """Axis-aligned box of 12 triangles between the corners `lo` and `hi`."""
        corner = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)], bool)
        quads = np.array([[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]])
        faces = quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
        return cls(np.where(corner, np.asarray(hi, float), np.asarray(lo, float)), faces, name=name, color=color)

    @classmethod
    def merge(cls, meshes: Iterable[Mesh], *, name: str = "", color: Sequence[float] | None = None) -> Mesh:
        """One mesh of all triangles; normals, colors and textures of the parts are dropped."""
        parts = list(meshes)
        if not parts:
            raise SceneError("Mesh.merge got no meshes")
        starts = np.cumsum([0] + [len(m.vertices) for m in parts[:-1]])
        return cls(
            np.concatenate([m.vertices for m in parts]),
            np.concatenate([m.faces.astype(np.int64) + s for m, s in zip(parts, starts, strict=True)]),
            name=name,
            color=color,
        )


class MeshTable:
    """Meshes that stages draw instead of rows: declared once, loaded once, chosen anew in every frame.

    Parameters
    ----------
    meshes : sequence of Mesh
        All in the same coordinates: those of the world, or local ones of stand-ins that have a matrix.

    Attributes
    ----------
    meshes : tuple of Mesh
    triangles : (m,) int64
    """

    def __init__(self, meshes: Sequence[Mesh]) -> None:
        self.meshes = tuple(meshes)
        self.triangles = np.array([m.triangles for m in self.meshes], np.int64)
        _frozen(self.triangles)

    def __len__(self) -> int:
        return len(self.meshes)

    def __repr__(self) -> str:
        return f"<MeshTable of {len(self)} meshes, {int(self.triangles.sum())} triangles>"
