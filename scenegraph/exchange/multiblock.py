"""Graphs as nested pyvista multi-blocks."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..mesh import Color, Mesh
from ..nodes import Geode, Group, Lod, Node, Switch, Transform
from ..scene import Scene


def to_multiblock(scene: Scene) -> Any:
    """The same hierarchy as a nested `pyvista.MultiBlock`, in world coordinates.

    Every drawable is a `PolyData` with float64 points under the name of its node. Its base color is the field "color"
    (RGBA in 0..1), its vertex colors are the point array "colors" (8-bit RGBA). Normals and texture coordinates are
    kept; images cannot be. Levels of detail are exported with their finest level, switches with their active children;
    occluders are left out. A group or transform with a single drawable of its own name is one block.

    Returns
    -------
    pyvista.MultiBlock
    """
    pyvista = import_module("pyvista")
    out = pyvista.MultiBlock()
    top = scene.root.matrix if isinstance(scene.root, Transform) else np.eye(4)
    stack: list[tuple[Node, NDArray[np.float64], Any]] = [(c, top, out) for c in reversed(_shown(scene.root))]
    while stack:
        node, world, blocks = stack.pop()
        name = node.name or type(node).__name__
        if isinstance(node, Transform):
            with np.errstate(all="ignore"):
                world = world @ node.matrix
        below = _shown(node)
        if isinstance(node, Group) and len(below) == 1 and isinstance(below[0], Geode) and below[0].name == node.name:
            node = below[0]
        if isinstance(node, (Geode, Lod)):
            geode = node if isinstance(node, Geode) else node.levels[0]
            blocks.append(_poly(pyvista, geode.mesh, geode.color or geode.mesh.color, world), name)
            continue
        nested = pyvista.MultiBlock()
        blocks.append(nested, name)
        stack.extend((child, world, nested) for child in reversed(below))
    return out


def _shown(node: Node) -> list[Node]:
    if isinstance(node, Switch):
        children = node.active_children()
    else:
        children = list(node) if isinstance(node, Group) else []
    return [c for c in children if isinstance(c, (Group, Geode, Lod))]


def _poly(pyvista: Any, mesh: Mesh, color: Color | None, world: NDArray[np.float64]) -> Any:
    linear = world[:3, :3]
    with np.errstate(all="ignore"):
        points = mesh.vertices @ linear.T + world[:3, 3]
        mirrored = np.linalg.det(linear) < 0
    faces = mesh.faces[:, ::-1] if mirrored else mesh.faces
    poly = pyvista.PolyData.from_regular_faces(points, np.ascontiguousarray(faces))
    if color is not None:
        poly.field_data["color"] = np.array(color)
    if mesh.normals is not None:
        with np.errstate(all="ignore"):
            normals = mesh.normals @ _cofactor(linear).T
            normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        poly.point_data["Normals"] = normals.astype(np.float32)
        poly.point_data.active_normals_name = "Normals"
    if mesh.uv is not None:
        poly.active_texture_coordinates = mesh.uv
    if mesh.vertex_colors is not None:
        poly.point_data["colors"] = mesh.vertex_colors
        poly.set_active_scalars("colors", preference="point")
    return poly


def _cofactor(m: NDArray[np.float64]) -> NDArray[np.float64]:
    # what normals are multiplied by: det(m) times the inverse transposed, but exists for singular matrices too
    x, y, z = m.T
    turned = np.array([np.cross(y, z), np.cross(z, x), np.cross(x, y)]).T
    return np.asarray(-turned if np.linalg.det(m) < 0 else turned)
