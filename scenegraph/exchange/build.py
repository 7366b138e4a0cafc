"""From raw arrays to meshes and geodes: validated, welded where nothing is shared, and near their own origin.

Coordinates stay in float64. A mesh whose coordinates are far from its own origin (a georeferenced city) is moved to it
and put below a `Transform` that moves it back: whoever makes float32 of local vertices then loses nothing that can be
seen. The offset is a multiple of a power of two, and only coordinates that are at least a mesh size away from 0 are
moved, so that subtracting it and adding it back are exact, bit for bit.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..mesh import Mesh
from ..nodes import Geode, Group, Node, Transform
from . import problems as kinds
from .materials import Look
from .problems import Problems

#: A flat file (nothing but meshes in world coordinates) gets one common offset beyond this many half sizes.
FLAT_FAR = 64.0
#: A single mesh gets an offset of its own beyond this many half sizes (14 of the 24 bits of a float32).
MESH_FAR = 16384.0
_IDENTITY = np.eye(4).tolist()
#: From here on neighboring float64 values are 0.125 apart.
HUGE = 1e15


def bounds_of(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(2, 3) lowest and highest corner of the finite points; NaN if there are none."""
    if len(points):
        lo, hi = np.minimum.reduce(points, axis=0), np.maximum.reduce(points, axis=0)
        if not np.isfinite([lo, hi]).all():
            points = points[np.isfinite(points).all(axis=1)]
            if len(points):
                lo, hi = points.min(axis=0), points.max(axis=0)
        if len(points):
            return np.array([lo, hi])
    return np.full((2, 3), np.nan)


def far_offset(bounds: ArrayLike, limit: float, least: float = 0.0) -> NDArray[np.float64] | None:
    """Where to put the origin of coordinates that lie far from it, or None if they do not.

    Parameters
    ----------
    bounds : (2, 3) float
        Lowest and highest corner; NaN gives None.
    limit : float
        How many half sizes are far.
    least : float
        Half sizes below this one (and below a billionth of the distance) count as this.

    Returns
    -------
    (3,) float64 or None
        Components that are not far stay 0.
    """
    lo, hi = np.asarray(bounds, np.float64)
    values = [*lo.tolist(), *hi.tolist()]
    reach = max(map(abs, values))
    half = max(max(b - a for a, b in zip(values[:3], values[3:], strict=True)) / 2, reach * 2.0**-30, least)
    # an eighth of the smallest numbers there are is 0
    if not (math.isfinite(sum(values)) and reach > limit * half and half / 8 > 0.0):
        return None
    center = (lo + hi) / 2
    step = 2.0 ** math.floor(math.log2(half / 8))
    offset = np.where(np.abs(center) >= 4 * half, np.round(center / step) * step, 0.0)
    return offset if offset.any() else None


def common_offset(boxes: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Where to put the common origin of meshes in world coordinates, or None if they are not far from it.

    Parameters
    ----------
    boxes : (n, 2, 3) float64
        Of the meshes. Strays (a marker left at the origin of a map) and NaN boxes have no say.
    """
    boxes = boxes[np.isfinite(boxes).all(axis=(1, 2))]
    if not len(boxes):
        return None
    centers = (boxes[:, 0] + boxes[:, 1]) / 2
    away = np.abs(centers - np.median(centers, axis=0)).max(axis=1)
    usual = boxes[away <= 8 * np.percentile(away, 75)]
    return far_offset([usual[:, 0].min(axis=0), usual[:, 1].max(axis=0)], FLAT_FAR)


def weld(vertices: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices without exact repetitions, and for every old vertex the index of its new one.

    Equal means equal bits (but -0 equals 0): no tolerance, which would collapse small models.
    """
    bits = (vertices + 0.0).view(np.uint64)
    with np.errstate(over="ignore"):
        mixed = np.zeros(len(bits), np.uint64)
        for column in range(3):
            mixed = (mixed ^ bits[:, column]) * np.uint64(0x9E3779B97F4A7C15)
            mixed ^= mixed >> np.uint64(29)
    _, first, inverse = np.unique(mixed, return_index=True, return_inverse=True)
    if not np.array_equal(bits[first[inverse]], bits):  # two different vertices share a hash
        _, first, inverse = np.unique(bits, axis=0, return_index=True, return_inverse=True)
    # in the order of first use, as the file has them
    order = np.argsort(first)
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    return vertices[first[order]], rank[inverse.reshape(-1)]


@dataclass(frozen=True)
class Part:
    """A mesh that is ready to be placed, and where its origin lies in the coordinates of the file."""

    mesh: Mesh
    offset: NDArray[np.float64] | None = None

    def place(self, name: str, *, color: Sequence[float] | None = None, source: object = None) -> Geode | Transform:
        """A new geode of this mesh, below a transform if it was moved to its origin."""
        geode = Geode(self.mesh, name=name, color=color, source=source)
        return geode if self.offset is None else Transform(geode, translation=self.offset, name=name)


class Builder:
    """Makes meshes of what a file holds and writes down what is wrong with them.

    Parameters
    ----------
    problems : Problems
    shift : (3,) float, optional
        Subtracted from all vertices: the common offset of a flat file.
    """

    def __init__(self, problems: Problems, shift: NDArray[np.float64] | None = None) -> None:
        self.problems = problems
        self.shift = shift

    def part(
        self,
        vertices: ArrayLike,
        faces: ArrayLike,
        *,
        name: str,
        look: Look | None = None,
        normals: ArrayLike | None = None,
    ) -> Part | None:
        """A validated mesh, or None (and a remark) if there is no triangle that can be drawn.

        Parameters
        ----------
        vertices : (v, 3) float
        faces : (f, 3) int
            Faces that name vertices that do not exist are dropped and counted.
        name : str
        look : Look, optional
            Colors and texture.
        normals : (v, 3) float, optional
            Dropped if there is not one per vertex.
        """
        look = look or Look()
        v = np.asarray(vertices, np.float64).reshape(-1, 3)
        f = np.asarray(faces, np.int64).reshape(-1, 3)
        face_colors = look.face_colors if look.face_colors is not None and len(look.face_colors) == len(f) else None
        wrong = ((f < 0) | (f >= len(v))).any(axis=1)
        if wrong.any():
            self.problems.note(kinds.MISSING_VERTICES, name, f"{int(wrong.sum())} of {len(f)}")
            f = f[~wrong]
            face_colors = None if face_colors is None else face_colors[~wrong]
        if not len(f):
            self.problems.note(kinds.NO_FACES, name)
            return None
        n = _per_vertex(normals, len(v))
        uv, colors = _per_vertex(look.uv, len(v)), _per_vertex(look.vertex_colors, len(v))
        if face_colors is not None:
            v, n, uv, colors = v[f.ravel()], _take(n, f), _take(uv, f), np.repeat(face_colors, 3, axis=0)
            f = np.arange(3 * len(f)).reshape(-1, 3)
        elif n is None and uv is None and colors is None and len(v) == 3 * len(f):
            v, index = weld(v)
            f = index[f]
        if look.texture is not None and uv is None:
            self.problems.note(kinds.NO_UV, name)
        v, offset = self._near_origin(v, name)
        mesh = Mesh(
            v, f, name=name, color=look.color, normals=n, uv=uv, vertex_colors=colors,
            texture=None if uv is None else look.texture,
        )  # fmt: skip
        if not mesh.is_finite:
            bad = int((~np.isfinite(v)).any(axis=1).sum())
            self.problems.note(kinds.NOT_FINITE, name, f"{bad} of {len(v)}")
        return Part(mesh, offset)

    def _near_origin(self, v: NDArray[np.float64], name: str) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
        bounds = bounds_of(v)
        if (reach := float(np.abs(bounds).max())) > HUGE:
            self.problems.note(kinds.HUGE, name, f"{reach:.3g}")
        least = 0.0
        if self.shift is not None:
            v, bounds, least = v - self.shift, bounds - self.shift, reach * 2.0**-30
        offset = far_offset(bounds, MESH_FAR, least)
        return (v, None) if offset is None else (v - offset, offset)

    def check(self, root: Group) -> None:
        """Write down the transforms below `root` that are singular, not finite or huge."""
        nodes = [node for node in root.walk() if isinstance(node, Transform)]
        if not nodes:
            return
        matrices = np.array([node.matrix for node in nodes])
        with np.errstate(all="ignore"):
            linear = matrices[:, :3, :3]
            volume = np.abs(np.linalg.det(linear / np.linalg.norm(linear, axis=1, keepdims=True)))
            reach = np.abs(matrices).max(axis=(1, 2))
        for index in np.flatnonzero(~((volume > 1e-9) & (reach <= HUGE))):
            if nodes[index].is_singular:
                self.problems.note(kinds.SINGULAR, nodes[index].path())
            elif reach[index] > HUGE:
                self.problems.note(kinds.HUGE, nodes[index].path(), f"{reach[index]:.3g}")


def node_of(matrix: NDArray[np.float64] | None, children: Iterable[Node], name: str) -> Group:
    """A `Transform`, or a plain `Group` where the matrix is the identity or None."""
    if matrix is None or matrix.tolist() == _IDENTITY:
        return Group(*children, name=name)
    return Transform(*children, matrix=matrix, name=name)


def world_bounds(root: Group) -> NDArray[np.float64]:
    """(2, 3) world box of all finite geodes below `root`; NaN if there are none."""
    boxes: list[NDArray[np.float64]] = []
    worlds: list[NDArray[np.float64]] = []
    stack: list[tuple[Node, NDArray[np.float64]]] = [(root, np.eye(4))]
    with np.errstate(over="ignore", invalid="ignore"):
        while stack:
            node, world = stack.pop()
            if isinstance(node, Transform):
                world = world @ node.matrix
            if isinstance(node, Group):
                stack.extend((child, world) for child in node)
            elif isinstance(node, Geode):
                boxes.append(node.mesh.bounds)
                worlds.append(world)
        if not boxes:
            return np.full((2, 3), np.nan)
        pick = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)])
        corners, m = np.array(boxes)[:, pick, (0, 1, 2)], np.array(worlds)
        return bounds_of((corners @ m[:, :3, :3].transpose(0, 2, 1) + m[:, None, :3, 3]).reshape(-1, 3))


def _per_vertex(value: ArrayLike | None, count: int) -> NDArray[np.generic] | None:
    if value is None:
        return None
    array = np.asarray(value)
    return array if array.ndim == 2 and len(array) == count else None


def _take(value: NDArray[np.generic] | None, faces: NDArray[np.int64]) -> NDArray[np.generic] | None:
    return None if value is None else value[faces.ravel()]
