"""What is drawn by one call: merged rows (`Batch`), or one mesh at many places (`Instances`).

An *item* is one level of one row. The items of a batch stand in row order, and so do the triangles picked from it:
a tie of depth is then won by the same row however many others are hidden.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
I64 = NDArray[np.int64]
U8 = NDArray[np.uint8]
Mask = NDArray[np.bool_]

#: One triangle as one element, which NumPy copies several times faster than three integers (measured: 9 to 1.3 ms).
_TRIANGLE = np.dtype("V12")
#: Below this share of all triangles a gather is cheaper than a mask over all of them.
_FEW = 1 / 16


@dataclass(frozen=True)
class Material:
    """What rows must share to be drawn by one call.

    Attributes
    ----------
    texture : int
        Index into `Geometry.textures`, or -1.
    smooth : bool
        Vertex normals are used; flat shading without.
    translucent : bool
    """

    texture: int
    smooth: bool
    translucent: bool


@dataclass
class Batch:
    """Merged items of one material in one cell.

    Attributes
    ----------
    origin : (3,) float64
        World position of the coordinate (0, 0, 0).
    rows, levels, meshes : (k,) int32, uint8, int32
        Of each item.
    first_vertex, first_triangle : (k + 1,) int64
        Where the vertices and triangles of each item start.
    vertices : (v, 3) float32
        Relative to `origin`.
    colors : (v, 4) uint8
    normals : (v, 3) float32 or None
    uv : (v, 2) float32 or None
    faces : (t, 3) int32
    changed_at : (k,) int64
        Generation of the geometry in which each item was written last.
    """

    material: Material
    origin: F64
    rows: I32
    levels: U8
    meshes: I32
    first_vertex: I64
    first_triangle: I64
    vertices: F32
    colors: U8
    normals: F32 | None
    uv: F32 | None
    faces: I32
    changed_at: I64

    @property
    def nbytes(self) -> int:
        """Bytes held by the arrays."""
        tables = (self.rows, self.levels, self.meshes, self.changed_at, self.first_vertex, self.first_triangle)
        arrays = (self.vertices, self.colors, self.normals, self.uv, self.faces, *tables)
        return sum(a.nbytes for a in arrays if a is not None)

    def chosen(self, visible: Mask, level: U8) -> Mask:
        """(k,) which items are drawn when rows are `visible` at a `level`."""
        return np.asarray(visible[self.rows] & (level[self.rows] == self.levels))

    def indices(self, chosen: Mask) -> I32:
        """(3 t,) vertex indices of the chosen items. May be a view of `faces`."""
        return picked(self.faces, self.first_triangle, chosen)


@dataclass
class Instances:
    """One mesh, drawn once per item with a matrix of its own.

    Attributes
    ----------
    rows, levels : (k,) int32, uint8
        Of each item.
    vertices : (v, 3) float32
        Relative to `center`.
    vertex_colors : (v, 4) uint8 or None
        With the items' color multiplied in; the items of such a mesh all have the same.
    center : (3,) float64
        Middle of the mesh in its own coordinates.
    matrices : (k, 4, 4) float64
        From coordinates relative to `center` to the world.
    colors : (k, 4) uint8
    changed_at : (k,) int64
        Generation of the geometry in which each item was written last.
    """

    material: Material
    rows: I32
    levels: U8
    vertices: F32
    faces: I32
    normals: F32 | None
    uv: F32 | None
    vertex_colors: U8 | None
    center: F64
    matrices: F64
    colors: U8
    changed_at: I64

    @property
    def nbytes(self) -> int:
        """Bytes held by the arrays."""
        tables = (self.rows, self.levels, self.matrices, self.colors)
        arrays = (self.vertices, self.faces, self.normals, self.uv, self.vertex_colors, *tables)
        return sum(a.nbytes for a in arrays if a is not None)

    def chosen(self, visible: Mask, level: U8) -> Mask:
        """(k,) which items are drawn when rows are `visible` at a `level`."""
        return np.asarray(visible[self.rows] & (level[self.rows] == self.levels))


def picked(faces: I32, first_triangle: I64, chosen: Mask) -> I32:
    """(3 t,) vertex indices of the triangles of the chosen items. May be a view of `faces`.

    Parameters
    ----------
    faces : (t, 3) int32
    first_triangle : (k + 1,) int64
        Where the triangles of each item start.
    chosen : (k,) bool
    """
    if chosen.all():
        return faces.reshape(-1)
    counts = np.diff(first_triangle)
    some = counts[chosen]
    if int(some.sum()) < _FEW * len(faces):
        return np.take(faces, spread(first_triangle[:-1][chosen], some), axis=0).reshape(-1)
    triangles = faces.view(_TRIANGLE).reshape(-1)
    return triangles[np.repeat(chosen, counts)].view(np.int32)


def spread(first: I64, counts: I64) -> I64:
    """Positions first[i] ... first[i] + counts[i] - 1 for all i, one after another."""
    ends = np.cumsum(counts)
    return np.asarray(np.repeat(first - (ends - counts), counts) + np.arange(int(ends[-1]) if len(ends) else 0))
