"""glTF and GLB: trimesh reads the meshes, the node tree and the cameras are read here.

trimesh gives the parts of a mesh with several materials random names, knows one perspective camera only, loses what is
below a camera node, and follows a node that has two parents once.
"""

from __future__ import annotations

import importlib.util
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from ..errors import SceneError
from ..nodes import Group, Node
from . import problems as kinds
from .build import Builder, Part, node_of
from .cameras import FileCamera
from .gltf_data import Tree, accessor_fault, plain_accessors, read_buffers, read_container, read_images
from .materials import Looks
from .problems import Problems

#: Extensions that replace the geometry itself: without a decoder there is nothing to draw.
_DRACO, _MESHOPT = "KHR_draco_mesh_compression", "EXT_meshopt_compression"
_INSTANCING = "EXT_mesh_gpu_instancing"
#: Extensions that are read, or that change nothing of what is kept here.
_KNOWN = {
    _DRACO,
    "EXT_texture_webp",
    "KHR_lights_punctual",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
}


def load_gltf(path: Path, problems: Problems) -> tuple[Group, list[FileCamera], bool]:
    """The default scene of a glTF file.

    Returns
    -------
    root : Group
    cameras : list of FileCamera
    declared : bool
        Whether the rule that y is up can be relied on; trimesh does not turn the coordinates that it writes.
    """
    tree, binary = read_container(path)
    _check_extensions(path, tree, problems)
    parts = _read_meshes(path, tree, binary, problems)
    declared = "trimesh" not in str(tree.get("asset", {}).get("generator", ""))
    root, cameras = _Nodes(path, tree, parts, problems).build()
    return root, cameras, declared


def _check_extensions(path: Path, tree: Tree, problems: Problems) -> None:
    required = tree.get("extensionsRequired", [])
    if _MESHOPT in required:
        raise SceneError(f"{path} is compressed with {_MESHOPT}, which cannot be read; export it uncompressed")
    if _DRACO in required and importlib.util.find_spec("DracoPy") is None:
        raise SceneError(f"{path} is compressed with Draco; install its reader (pip install DracoPy)")
    unread = set(required) - _KNOWN | {"KHR_texture_transform", _INSTANCING} & set(tree.get("extensionsUsed", []))
    for name in sorted(unread):
        problems.note("glTF extensions that are not read, what they change is shown without them", name)


def _read_meshes(path: Path, tree: Tree, binary: bytes | None, problems: Problems) -> dict[int, list[tuple[str, Part]]]:
    """Drawable parts of every mesh, each with the name of its material."""
    meshes = tree.get("meshes", [])
    if not meshes:
        return {}
    buffers = read_buffers(path, tree, binary)
    skipped = ("nodes", "scenes", "scene", "cameras", "skins", "animations")
    plain = {k: list(v) if isinstance(v, list) else v for k, v in tree.items() if k not in skipped}
    plain_accessors(plain, buffers)
    for index in range(len(plain.get("accessors", []))):
        if fault := accessor_fault(plain, index):
            raise SceneError(f"{path}: {fault}; export it again")
    # one mesh per primitive, under a number: trimesh then keeps them apart and in order
    plain["meshes"] = [
        {"name": f"{m}.{p}", "primitives": [primitive]}
        for m, mesh in enumerate(plain["meshes"])
        for p, primitive in enumerate(mesh.get("primitives", []))
    ]
    files: dict[str, Any] = dict(read_images(path, tree, problems))
    plain["buffers"] = [{"uri": f"buffer {i}", "byteLength": len(data)} for i, data in enumerate(buffers)]
    files.update((f"buffer {i}", data) for i, data in enumerate(buffers))
    loaded = trimesh.load_scene(
        io.BytesIO(json.dumps(plain).encode()),
        file_type="gltf",
        resolver=trimesh.resolvers.ZipResolver(files),
        process=False,
        ignore_broken=True,
    ).geometry
    builder, looks = Builder(problems), Looks(problems)
    materials = tree.get("materials", [])
    out: dict[int, list[tuple[str, Part]]] = {}
    for m, mesh in enumerate(meshes):
        primitives = mesh.get("primitives", [])
        for p, primitive in enumerate(primitives):
            label = str(mesh.get("name") or f"mesh {m}") + (f".{p}" if len(primitives) > 1 else "")
            found = loaded.get(f"{m}.{p}")
            if found is None or not hasattr(found, "faces"):
                problems.note(kinds.NO_TRIANGLES, label, f"mode {primitive.get('mode', 4)}")
                continue
            material = materials[primitive["material"]] if "material" in primitive else {}
            look = looks.of(found, label)
            name = str(material.get("name") or p)
            if look.texture is None and "baseColorTexture" in material.get("pbrMetallicRoughness", {}):
                problems.note(kinds.NO_TEXTURE, str(material.get("name") or label))
            normals = found.vertex_normals if "vertex_normals" in found._cache else None
            part = builder.part(found.vertices, found.faces, name=label, look=look, normals=normals)
            if part is not None:
                out.setdefault(m, []).append((name, part))
    return out


class _Nodes:
    """Turns the node list of the default scene into a graph."""

    def __init__(self, path: Path, tree: Tree, parts: dict[int, list[tuple[str, Part]]], problems: Problems) -> None:
        self.path, self.tree, self.parts, self.problems = path, tree, parts, problems
        self.nodes: list[Tree] = tree.get("nodes", [])
        self.cameras: list[FileCamera] = []
        self.used: set[int] = set()

    def build(self) -> tuple[Group, list[FileCamera]]:
        order, children = self._walk(self._roots())
        made: dict[int, Node] = {}
        for index in reversed(order):  # children before parents: adding to a group without a parent is cheap
            made[index] = self._node(index, [made[c] for c in children[index]])
        roots = [made[i] for i in order if made[i].parent is None]
        for m in sorted(set(range(len(self.tree.get("meshes", [])))) - self.used):
            self.problems.note(kinds.UNPLACED, str(self.tree["meshes"][m].get("name") or f"mesh {m}"))
        skinned = sum("skin" in self.nodes[i] for i in order)
        if skinned:
            self.problems.say(f"skins are not applied: {skinned} nodes are shown without their pose")
        return Group(*roots, name=self.path.stem), self.cameras

    def _roots(self) -> list[int]:
        scenes = self.tree.get("scenes", [])
        if not scenes:
            below = {c for node in self.nodes for c in node.get("children", [])}
            return [i for i in range(len(self.nodes)) if i not in below]
        chosen = self.tree.get("scene", 0)
        if len(scenes) > 1:
            self.problems.say(f"{len(scenes) - 1} other scenes of the file are left out")
        return list(scenes[chosen].get("nodes", [])) if 0 <= chosen < len(scenes) else []

    def _walk(self, roots: list[int]) -> tuple[list[int], dict[int, list[int]]]:
        """Depth-first order, and for each node the children that it keeps: every node is placed once."""
        order: list[int] = []
        children: dict[int, list[int]] = {}
        worlds: dict[int, NDArray[np.float64]] = {}
        seen: set[int] = set()
        stack: list[tuple[int, int | None]] = [(i, None) for i in reversed(roots)]
        while stack:
            index, parent = stack.pop()
            label = self._label(index)
            if index in seen:
                self.problems.note("nodes with two parents or inside themselves, placed once", label)
                continue
            seen.add(index)
            order.append(index)
            children[index] = []
            if parent is not None:
                children[parent].append(index)
            node = self.nodes[index]
            with np.errstate(all="ignore"):
                worlds[index] = (np.eye(4) if parent is None else worlds[parent]) @ node_matrix(node)
            if "camera" in node:
                self._camera(node["camera"], label, worlds[index])
            stack.extend((i, index) for i in reversed(node.get("children", [])))
        return order, children

    def _label(self, index: int) -> str:
        if not 0 <= index < len(self.nodes):
            raise SceneError(f"{self.path}: node {index} does not exist; export it again")
        return str(self.nodes[index].get("name") or f"node {index}")

    def _camera(self, index: int, label: str, world: NDArray[np.float64]) -> None:
        cameras = self.tree.get("cameras", [])
        if not 0 <= index < len(cameras):
            return
        camera = cameras[index]
        name = str(camera.get("name") or label)
        self.cameras.append(FileCamera(name, world, camera.get("perspective"), camera.get("orthographic")))

    def _node(self, index: int, children: list[Node]) -> Node:
        node, name = self.nodes[index], self._label(index)
        mesh = node.get("mesh")
        parts = self.parts.get(mesh, []) if mesh is not None else []
        self.used.add(-1 if mesh is None else mesh)
        several = len(parts) > 1
        placed: list[Node] = [
            part.place(f"{name}:{material}" if several else name, source=index) for material, part in parts
        ]
        matrix = node_matrix(node)
        plain = np.array_equal(matrix, np.eye(4))
        if plain and len(placed) == 1 and not children:
            return placed[0]
        if not np.array_equal(matrix[3], (0, 0, 0, 1)):
            self.problems.note(kinds.PROJECTIVE, name)
            return Group(name=name)
        return node_of(matrix, [*placed, *children], name)


def node_matrix(node: Tree) -> NDArray[np.float64]:
    """(4, 4) local-to-parent matrix of a glTF node: its matrix, or translation times rotation times scale."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    m = np.eye(4)
    if "rotation" in node:
        x, y, z, w = np.array(node["rotation"], np.float64)
        n = x * x + y * y + z * z + w * w
        s = 2.0 / n if n > 0 else 0.0
        m[:3, :3] = [
            [1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
            [s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w)],
            [s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y)],
        ]
    if "scale" in node:
        m[:3, :3] *= np.array(node["scale"], np.float64)
    if "translation" in node:
        m[:3, 3] = node["translation"]
    return m
