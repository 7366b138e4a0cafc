"""A bunny of 98 triangles: the Stanford bunny by edge collapse where its file is given, a stand-in otherwise.

Kristmann (2022, section 4.2.1) reduced the bunny to 98 triangles by hand and lets Phong tessellation round it off.
The y axis points up, as in the Stanford files.
"""

from __future__ import annotations

import numpy as np

from ..errors import SceneError
from ..mesh import Mesh
from ..meshes.collapsing import collapse
from ..scene import Scene
from .scatter import one_mesh
from .shapes import Floats, Ints, icosphere, vertex_normals

#: Triangles of the thesis' bunny; its finest tessellation makes 600 of each.
TRIANGLES = 98
COLOR = (0.80, 0.72, 0.62)

#: Lobes of the stand-in: direction, how far it reaches beyond the trunk, how narrow it is.
_LOBES = (
    ((-0.85, 0.55, 0.00), 0.50, 5.0),  # head
    ((-0.42, 0.85, 0.36), 0.85, 60.0),  # ears
    ((-0.42, 0.85, -0.36), 0.85, 60.0),
    ((0.95, -0.25, 0.00), 0.30, 2.5),  # rump
    ((-0.70, -0.72, 0.30), 0.25, 10.0),  # paws
    ((-0.70, -0.72, -0.30), 0.25, 10.0),
)


def bunny(model: str = "", *, triangles: int = TRIANGLES) -> Mesh:
    """A bunny of exactly so many triangles, within the unit sphere, with vertex normals.

    Parameters
    ----------
    model : str
        A model file; all of it is reduced by edge collapse. The procedural stand-in if empty.
    triangles : int
        Even, if the surface is closed.

    Raises
    ------
    SceneError
        A model that cannot be read, or that cannot be brought to this number.
    """
    if model:
        whole = one_mesh(Scene.load(model))
        points, faces = closed(*_welded(whole.vertices, whole.faces.astype(np.int64)))
    else:
        points, faces = _stand_in()
    points, faces = reduced(points, faces, triangles)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    points = (points - middle) / (np.linalg.norm(points - middle, axis=1).max() or 1.0)
    return Mesh(points, faces, name="bunny", color=COLOR, normals=vertex_normals(points, faces))


def _stand_in() -> tuple[Floats, Ints]:
    """Trunk, head, ears, tail and legs: a surface with one point in each direction."""
    directions, faces = icosphere(5)
    radius = 0.55 + 0.0 * directions[:, 0]
    for toward, reach, narrow in _LOBES:
        axis = np.asarray(toward) / np.linalg.norm(toward)
        radius += reach * np.exp(narrow * (directions @ axis - 1.0))
    return directions * radius[:, None], faces


def _welded(points: Floats, faces: Ints) -> tuple[Floats, Ints]:
    """Vertices in the same place made one, and triangles without area left out."""
    unique, index = np.unique(points, axis=0, return_inverse=True)
    faces = index.reshape(-1)[faces]
    a, b, c = faces.T
    return unique, faces[(a != b) & (b != c) & (c != a)]


def closed(points: Floats, faces: Ints) -> tuple[Floats, Ints]:
    """A surface with its holes filled, a fan to the middle of each, and its triangles turned outward.

    The Stanford bunny has holes in its base, through which one would look into it.
    """
    half = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    there = set(map(tuple, half.tolist()))
    after = {b: a for a, b in there if (b, a) not in there}
    corners, added = [points], [faces]
    count = len(points)
    while after:
        loop = [next(iter(after))]
        while (following := after.pop(loop[-1], None)) is not None:
            loop.append(following)
        if len(loop) < 4 or loop[0] != loop[-1]:
            continue  # not a ring: two holes share a corner
        ring = np.array(loop)
        corners.append(points[ring[1:]].mean(axis=0, keepdims=True))
        added.append(np.column_stack([ring[:-1], ring[1:], np.full(len(ring) - 1, count)]))
        count += 1
    points, faces = np.concatenate(corners), np.concatenate(added)
    a, b, c = (points[faces[:, i]] for i in range(3))
    inside_out = (np.cross(a, b) * c).sum() < 0
    return points, faces[:, ::-1] if inside_out else faces


def reduced(points: Floats, faces: Ints, count: int) -> tuple[Floats, Ints]:
    """A surface brought to exactly `count` triangles: edge collapse, then the longest edges are split.

    Raises
    ------
    SceneError
        A closed surface and an odd number, or no triangles.
    """
    target = count
    coarse_points, coarse = points, faces
    while len(coarse) > count and target > 0:
        # it counts what it has collapsed, and may stop at one triangle more
        found, corners = collapse(points.astype(np.float32), faces.astype(np.int32), target_count=target)
        coarse_points, coarse = _welded(found.astype(np.float64), corners.astype(np.int64))
        target -= 1
    while 0 < len(coarse) < count:
        coarse_points, coarse = _split_longest(coarse_points, coarse, count - len(coarse))
    if len(coarse) != count:
        raise SceneError(f"bunnies: {len(faces)} triangles cannot be brought to {count}; take another model")
    used, index = np.unique(coarse, return_inverse=True)
    return coarse_points[used], index.reshape(-1, 3)


def _split_longest(points: Floats, faces: Ints, at_most: int) -> tuple[Floats, Ints]:
    """Halve the longest edge with no more than `at_most` triangles beside it."""
    edges, beside = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)), axis=0, return_counts=True)
    length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    length[beside > at_most] = -1.0
    best = int(np.argmax(length))
    if length[best] < 0:
        return points, faces[:0]
    a, b = edges[best].tolist()
    new = len(points)
    touched = (faces == a).any(axis=1) & (faces == b).any(axis=1)
    first, second = faces[touched].copy(), faces[touched].copy()
    first[first == a] = new
    second[second == b] = new
    return np.vstack([points, (points[a] + points[b]) / 2]), np.concatenate([faces[~touched], first, second])
