"""Triangles by the array: the pieces from which the built-in scenes are put together.

Coordinates are meters, z up. Faces are counterclockwise seen from outside.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..mesh import Mesh
from ..occluder import Occluder, newell_normal

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Surface = tuple[Floats, Ints]

#: Corner k of a box has x from bit 0, y from bit 1, z from bit 2.
SIDES = {
    "-x": (0, 4, 6, 2),
    "+x": (1, 3, 7, 5),
    "-y": (0, 1, 5, 4),
    "+y": (2, 6, 7, 3),
    "-z": (0, 2, 3, 1),
    "+z": (4, 5, 7, 6),
}
ALL_SIDES = tuple(SIDES)
NO_BOTTOM = ("-x", "+x", "-y", "+y", "+z")


def box_corners(lo: ArrayLike, hi: ArrayLike) -> Floats:
    """(k, 8, 3) corners of boxes given by (k, 3) low and high corners."""
    low, high = np.atleast_2d(np.asarray(lo, np.float64)), np.atleast_2d(np.asarray(hi, np.float64))
    bits = (np.arange(8)[:, None] >> np.arange(3)) & 1
    return np.where(bits[None].astype(bool), high[:, None], low[:, None])


class Shape:
    """Pieces of surface, collected and then turned into one `Mesh`; every piece may have its own color."""

    def __init__(self) -> None:
        self._points: list[Floats] = []
        self._faces: list[Ints] = []
        self._colors: list[tuple[float, ...] | None] = []
        self._count = 0

    def surface(self, points: ArrayLike, faces: ArrayLike, color: Sequence[float] | None = None) -> Shape:
        """Add vertices (v, 3) and triangles (f, 3)."""
        p = np.asarray(points, np.float64).reshape(-1, 3)
        self._points.append(p)
        self._faces.append(np.asarray(faces, np.int64).reshape(-1, 3) + self._count)
        self._colors.append(None if color is None else tuple(color))
        self._count += len(p)
        return self

    def polygons(
        self, corners: ArrayLike, color: Sequence[float] | None = None, *, away_from: ArrayLike | None = None
    ) -> Shape:
        """Add convex polygons (k, m, 3), each as a fan of m - 2 triangles.

        With `away_from` (3,), polygons whose corners run the wrong way round are turned to face away from that point.
        """
        p = np.asarray(corners, np.float64)
        p = p.reshape(-1, *p.shape[-2:])
        k, m = p.shape[:2]
        if away_from is not None:
            normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 1])
            inward = ((p.mean(axis=1) - np.asarray(away_from)) * normal).sum(axis=1) < 0
            p = np.where(inward[:, None, None], p[:, ::-1], p)
        fan = np.column_stack([np.zeros(m - 2, int), np.arange(1, m - 1), np.arange(2, m)])
        return self.surface(p.reshape(-1, 3), fan[None] + m * np.arange(k)[:, None, None], color)

    def prism(self, first: ArrayLike, second: ArrayLike, color: Sequence[float] | None = None) -> Shape:
        """Add the convex solid between two polygons (m, 3) with corresponding corners."""
        a, b = np.asarray(first, np.float64), np.asarray(second, np.float64)
        center = (a.mean(axis=0) + b.mean(axis=0)) / 2
        after = np.roll(np.arange(len(a)), -1)
        self.polygons(np.stack([a, b]), color, away_from=center)
        return self.polygons(np.stack([a, a[after], b[after], b], axis=1), color, away_from=center)

    def boxes(
        self,
        lo: ArrayLike,
        hi: ArrayLike,
        sides: Sequence[str] = ALL_SIDES,
        color: Sequence[float] | None = None,
    ) -> Shape:
        """Add axis-aligned boxes between (k, 3) corners; `sides` names the faces that are wanted."""
        corners = box_corners(lo, hi)
        return self.polygons(corners[:, [SIDES[s] for s in sides]].reshape(-1, 4, 3), color)

    def add(self, other: Shape, color: Sequence[float] | None = None, matrix: ArrayLike | None = None) -> Shape:
        """Add the pieces of another shape, recolored if a color is given, moved if a (4, 4) matrix is given."""
        m = np.eye(4) if matrix is None else np.asarray(matrix, np.float64)
        start = 0
        for points, faces, own in zip(other._points, other._faces, other._colors, strict=True):
            self.surface(points @ m[:3, :3].T + m[:3, 3], faces - start, own if color is None else color)
            start += len(points)
        return self

    def mesh(self, *, name: str = "", color: Sequence[float] | None = None, smooth: bool = False) -> Mesh:
        """One mesh of everything; vertex colors if a piece has its own color, white where one has none."""
        points, faces = np.concatenate(self._points), np.concatenate(self._faces)
        tints = None
        if any(c is not None for c in self._colors):
            tints = np.repeat(
                [rgba8(c or (1.0, 1.0, 1.0)) for c in self._colors], [len(p) for p in self._points], axis=0
            )
        normals = vertex_normals(points, faces) if smooth else None
        return Mesh(points, faces, name=name, color=color, normals=normals, vertex_colors=tints)


def rgba8(color: Sequence[float]) -> NDArray[np.uint8]:
    """(4,) RGBA of 0..255 from 3 or 4 floats of 0..1."""
    return np.round(255 * np.array([*color, 1.0][:4])).astype(np.uint8)


def vertex_normals(points: Floats, faces: Ints) -> Floats:
    """(v, 3) unit normals, each the area-weighted mean of the faces around the vertex; up where there are none."""
    a, b, c = (points[faces[:, i]] for i in range(3))
    area = np.cross(b - a, c - a)
    total = np.stack([np.bincount(faces.ravel(), np.repeat(area[:, k], 3), len(points)) for k in range(3)], axis=1)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.where(length > 0, total / np.where(length > 0, length, 1.0), (0.0, 0.0, 1.0))


def lathe(profile: ArrayLike, sides: int, *, flute: float = 0.0, turn: float = 0.0) -> Surface:
    """Surface of revolution about z.

    Parameters
    ----------
    profile : (m, 2) float
        Radius and height, from the bottom to the top; a radius of 0 closes the surface.
    sides : int
    flute : float
        Every second vertex is drawn in by this share of the radius: `sides / 2` flutes.
    turn : float
        Angle of the first vertex in radians.
    """
    r, z = np.asarray(profile, np.float64).T
    angle = turn + 2 * np.pi * np.arange(sides) / sides
    depth = np.where(np.arange(sides) % 2, 1.0 - flute, 1.0)
    ring = np.stack([np.cos(angle) * depth, np.sin(angle) * depth], axis=1)
    points = np.concatenate([ring[None] * r[:, None, None], np.broadcast_to(z[:, None, None], (len(z), sides, 1))], 2)
    i, j = np.meshgrid(np.arange(len(z) - 1), np.arange(sides), indexing="ij")
    a, b = i * sides + j, i * sides + (j + 1) % sides
    lower = np.stack([a, b, b + sides], axis=2)[r[:-1] > 0]
    upper = np.stack([a, b + sides, a + sides], axis=2)[r[1:] > 0]
    return points.reshape(-1, 3), np.concatenate([lower.reshape(-1, 3), upper.reshape(-1, 3)])


def icosphere(levels: int = 1) -> Surface:
    """Unit sphere of 20·4^levels triangles."""
    g = (1 + 5**0.5) / 2
    p = np.array(
        [[-1, g, 0], [1, g, 0], [-1, -g, 0], [1, -g, 0], [0, -1, g], [0, 1, g]]
        + [[0, -1, -g], [0, 1, -g], [g, 0, -1], [g, 0, 1], [-g, 0, -1], [-g, 0, 1]],
        np.float64,
    )
    f = np.array(
        [[0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4], [11, 10, 2], [10, 7, 6]]
        + [[7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9], [4, 9, 5], [2, 4, 11], [6, 2, 10]]
        + [[8, 6, 7], [9, 8, 1]]
    )
    for _ in range(levels):
        edges = np.sort(f[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        ends, index = np.unique(edges, axis=0, return_inverse=True)
        middle = index.reshape(-1, 3) + len(p)
        p = np.concatenate([p, p[ends].mean(axis=1)])
        a, b, c = f.T
        ab, bc, ca = middle.T
        f = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])
    return p / np.linalg.norm(p, axis=1, keepdims=True), f


def bumps(directions: Floats, rng: np.random.Generator, waves: int = 12, roughness: float = 2.5) -> Floats:
    """(v,) smooth noise in about -1..1 on unit vectors (v, 3): a sum of random plane waves."""
    k = rng.normal(size=(waves, 3)) * roughness
    phase = rng.uniform(0, 2 * np.pi, waves)
    return np.asarray(np.sin(directions @ k.T + phase).sum(axis=1) / np.sqrt(2.0 * waves))


def shrunk(polygon: ArrayLike, by: float) -> Floats:
    """(m, 2) convex counterclockwise polygon with every edge moved inward by a distance."""
    p = np.asarray(polygon, np.float64)
    edge = np.roll(p, -1, axis=0) - p
    inward = np.column_stack([-edge[:, 1], edge[:, 0]]) / np.linalg.norm(edge, axis=1, keepdims=True)
    offset = (inward * p).sum(axis=1) + by
    # each corner is where its two moved edges meet
    return np.array([np.linalg.solve(inward[[i - 1, i]], offset[[i - 1, i]]) for i in range(len(p))])


def face_occluders(solid: Occluder, *, name: str = "facade") -> list[Occluder]:
    """Walls and slopes of a solid occluder as one-sided planar ones that look outward; not its floor or flat top."""
    faces: list[Occluder] = []
    for face in solid.faces:
        corners = solid.vertices[list(face)]
        area = newell_normal(corners)
        if -0.5 < area[2] / np.linalg.norm(area) < 0.98:
            faces.append(Occluder.planar(corners, two_sided=False, name=f"{name} {len(faces)}"))
    return faces


def occluder_copy(pattern: Occluder) -> Occluder:
    """A node of its own with the shape of another occluder, whose arrays it shares: no second check, no copy."""
    return Occluder(
        pattern.kind,
        pattern.vertices,
        pattern.faces,
        two_sided=pattern.two_sided,
        holes=pattern.holes,
        name=pattern.name,
    )


def placements(where: ArrayLike, *, angle: ArrayLike = 0.0, scale: ArrayLike = 1.0) -> Floats:
    """(k, 4, 4) matrices that scale, turn about z and then move.

    Parameters
    ----------
    where : (k, 3) float
    angle : (k,) float
        Degrees.
    scale : float, broadcast to (k, 3)
    """
    at = np.atleast_2d(np.asarray(where, np.float64))
    turn = np.radians(np.broadcast_to(np.asarray(angle, np.float64), len(at)))
    size = np.broadcast_to(np.asarray(scale, np.float64), at.shape)
    c, s = np.cos(turn), np.sin(turn)
    m = np.zeros((len(at), 4, 4))
    m[:, 0, 0], m[:, 0, 1] = c * size[:, 0], -s * size[:, 1]
    m[:, 1, 0], m[:, 1, 1] = s * size[:, 0], c * size[:, 1]
    m[:, 2, 2], m[:, 3, 3] = size[:, 2], 1.0
    m[:, :3, 3] = at
    return m
