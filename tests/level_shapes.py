"""Shapes to make levels of."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenegraph import Mesh

F64 = NDArray[np.float64]


def sheet(cells: int, height: float = 0.0, **options: Any) -> Mesh:
    """A square of cells² x 2 triangles in z = 0, with waves of a height."""
    i, j = (x.ravel() for x in np.meshgrid(np.arange(cells + 1), np.arange(cells + 1), indexing="ij"))
    x, y = i / cells, j / cells
    points = np.column_stack([x, y, height * np.sin(7 * x) * np.cos(5 * y)])
    corner = (i * (cells + 1) + j)[(i < cells) & (j < cells)]
    faces = [
        np.column_stack([corner, corner + cells + 1, corner + cells + 2]),
        np.column_stack([corner, corner + cells + 2, corner + 1]),
    ]
    return Mesh(points, np.concatenate(faces), **options)


def ball(cells: int, bumps: float = 0.0, *, smooth: bool = False, **options: Any) -> Mesh:
    """A closed ball of six bent sheets, 12 x cells² triangles, welded; with normals if it is smooth."""
    flat = sheet(cells)
    local = 2 * flat.vertices[:, :2] - 1
    points, faces = [], []
    for axis in range(3):
        for sign in (1.0, -1.0):
            side = np.empty((len(local), 3))
            side[:, axis] = sign
            side[:, (axis + 1) % 3] = local[:, 0] * sign
            side[:, (axis + 2) % 3] = local[:, 1]
            faces.append(flat.faces + len(points) * len(local))
            points.append(side)
    corners, number = np.unique(np.round(np.concatenate(points), 12), axis=0, return_inverse=True)
    around = corners / np.linalg.norm(corners, axis=1, keepdims=True)
    radius = 1 + bumps * np.sin(9 * around[:, 0]) * np.sin(7 * around[:, 1] + 1) * np.sin(8 * around[:, 2] + 2)
    mesh = Mesh(around * radius[:, None], number.reshape(-1)[np.concatenate(faces)], **options)
    return Mesh(mesh.vertices, mesh.faces, normals=vertex_normals(mesh), **options) if smooth else mesh


def vertex_normals(mesh: Mesh) -> F64:
    """Unit normals, by the area of the faces around."""
    p = mesh.vertices[mesh.faces]
    face = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    out = np.zeros_like(mesh.vertices)
    np.add.at(out, mesh.faces.reshape(-1), np.repeat(face, 3, axis=0))
    return out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-300)


def unwelded(mesh: Mesh, **options: Any) -> Mesh:
    """The same triangles, none sharing a vertex, with the normals of the faces: as files without smoothing are."""
    points = mesh.vertices[mesh.faces].reshape(-1, 3)
    faces = np.arange(len(points)).reshape(-1, 3)
    normal = np.cross(points[1::3] - points[::3], points[2::3] - points[::3])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return Mesh(points, faces, normals=np.repeat(normal, 3, axis=0), **options)


def random_points(mesh: Mesh, count: int, rng: np.random.Generator) -> F64:
    """Points all over a surface, by area."""
    p = mesh.vertices[mesh.faces]
    area = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
    which = rng.choice(len(p), count, p=area / area.sum())
    u, v = rng.random((2, count))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    return p[which, 0] + u[:, None] * (p[which, 1] - p[which, 0]) + v[:, None] * (p[which, 2] - p[which, 0])


def brute_distance(points: F64, mesh: Mesh) -> F64:
    """Distance of each point from a surface: by VTK, which knows nothing of ours."""
    import pyvista as pv

    surface = pv.PolyData.from_regular_faces(mesh.vertices, mesh.faces)
    return np.abs(np.asarray(pv.PolyData(points).compute_implicit_distance(surface)["implicit_distance"]))
