"""glTF written by hand: cameras, textures, instances, odd accessors, broken containers."""

from __future__ import annotations

import base64
import io
import json
import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from scenegraph.errors import SceneError
from scenegraph.exchange import load
from scenegraph.exchange.gltf import node_matrix
from scenegraph.nodes import Geode, Group, Transform
from scenegraph.scene import Scene

POINTS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "<f4")
INDICES = np.array([0, 1, 2, 0, 2, 3], "<u2")
UV = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], "<f4")


class Writer:
    """Collects accessors in one buffer."""

    def __init__(self) -> None:
        self.data = b""
        self.tree: dict[str, Any] = {"asset": {"version": "2.0"}, "accessors": [], "bufferViews": [], "scene": 0}

    def view(self, data: bytes) -> int:
        self.tree["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)})
        self.data += data + b"\0" * (-len(data) % 4)
        return len(self.tree["bufferViews"]) - 1

    def accessor(self, values: np.ndarray, **more: Any) -> int:
        code = {"<f4": 5126, "<u2": 5123, "|u1": 5121, "|i1": 5120, "<u4": 5125, "<i2": 5122}[values.dtype.str]
        kind = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}[values.shape[1] if values.ndim == 2 else 1]
        self.tree["accessors"].append(
            {
                "bufferView": self.view(values.tobytes()),
                "componentType": code,
                "count": len(values),
                "type": kind,
                **more,
            }
        )
        return len(self.tree["accessors"]) - 1

    def quad(self, **attributes: int) -> dict[str, Any]:
        return {
            "attributes": {"POSITION": self.accessor(POINTS), **attributes},
            "indices": self.accessor(INDICES),
        }

    def write(self, path: Path, **tree: Any) -> Path:
        full = {**self.tree, **tree}
        if "scenes" not in full:
            below = {c for n in full.get("nodes", []) for c in n.get("children", [])}
            full["scenes"] = [{"nodes": [i for i in range(len(full.get("nodes", []))) if i not in below]}]
        if path.suffix == ".glb":
            full["buffers"] = [{"byteLength": len(self.data)}]
            head = json.dumps(full).encode()
            head += b" " * (-len(head) % 4)
            chunks = struct.pack("<II", len(head), 0x4E4F534A) + head
            chunks += struct.pack("<II", len(self.data), 0x004E4942) + self.data
            path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
        else:
            uri = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
            full["buffers"] = [{"byteLength": len(self.data), "uri": uri}]
            path.write_text(json.dumps(full))
        return path


def png(array: np.ndarray) -> bytes:
    out = io.BytesIO()
    Image.fromarray(array).save(out, format="PNG")
    return out.getvalue()


def geodes(scene: Scene) -> dict[str, Geode]:
    return {node.name: node for node in scene.root.walk() if isinstance(node, Geode)}


def close(actual: Any, expected: Any) -> None:
    np.testing.assert_allclose(actual, expected, atol=1e-6)


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
def test_cameras_become_views_with_the_transform_of_their_node(tmp_path: Path, suffix: str) -> None:
    w = Writer()
    turn = [0.0, math.sin(math.pi / 4), 0.0, math.cos(math.pi / 4)]  # 90 degrees about y: -z becomes -x
    path = w.write(
        tmp_path / f"cameras{suffix}",
        meshes=[{"primitives": [w.quad()]}],
        cameras=[
            {"type": "perspective", "perspective": {"yfov": 0.5, "aspectRatio": 2.0, "znear": 0.25}},
            {"name": "plan", "type": "orthographic", "orthographic": {"xmag": 3, "ymag": 2, "znear": 0, "zfar": 9}},
        ],
        nodes=[
            {"name": "quad", "mesh": 0},
            {"name": "rig", "translation": [10, 0, 0], "scale": [2, 2, 2], "children": [2]},
            {"name": "eye", "rotation": turn, "translation": [0, 3, 0], "camera": 0, "children": [3]},
            {"name": "held by the camera", "mesh": 0},
            {"name": "eye", "camera": 1},
            {"name": "eye", "camera": 1},
        ],
    )
    scene = load(path)
    assert list(scene.views) == ["eye", "plan", "plan 2"]
    assert "held by the camera" in geodes(scene), "what hangs below a camera is not lost"
    eye = scene.views["eye"]
    close(eye.eye, (10, 6, 0))
    close(eye.forward, (-1, 0, 0))
    close(eye.axes[1], (0, 1, 0))
    assert eye.fov == pytest.approx(math.degrees(0.5))
    assert eye.width / eye.height == 2.0
    assert eye.near == 0.25
    assert eye.far > 20, "no far plane in the file means far enough for the scene"
    plan = scene.views["plan"]
    assert (plan.parallel_scale, plan.near, plan.far) == (2.0, 0.0, 9.0)
    assert plan.width / plan.height == 1.5
    close(plan.forward, (0, 0, -1))
    assert scene.up == (0.0, 1.0, 0.0)
    assert scene.problems == []


def test_a_broken_camera_is_named_and_the_rest_kept(tmp_path: Path) -> None:
    w = Writer()
    path = w.write(
        tmp_path / "x.gltf",
        meshes=[{"primitives": [w.quad()]}],
        cameras=[{"perspective": {"yfov": 9.0, "znear": 1.0}}, {"perspective": {"yfov": 1.0, "znear": 1.0}}],
        nodes=[{"mesh": 0}, {"camera": 0, "name": "wide"}, {"camera": 1, "name": "flat", "scale": [0, 1, 1]}],
    )
    scene = load(path)
    assert scene.views == {}
    assert any("cameras that cannot be used" in p and "'wide'" in p and "'flat'" in p for p in scene.problems)


def test_instances_share_one_mesh_and_names_and_groups_are_kept(tmp_path: Path) -> None:
    w = Writer()
    path = w.write(
        tmp_path / "x.glb",
        meshes=[{"name": "chair", "primitives": [w.quad()]}],
        nodes=[
            {"name": "hall", "children": [1, 2, 3]},
            {"name": "left", "mesh": 0, "translation": [-1, 0, 0]},
            {"name": "right", "mesh": 0, "matrix": [0, 2, 0, 0, -2, 0, 0, 0, 0, 0, 2, 0, 5, 6, 7, 1]},
            {"name": "here", "mesh": 0},
        ],
    )
    scene = load(path)
    found = geodes(scene)
    assert [g.path() for g in found.values()] == ["/x/hall/left/left", "/x/hall/right/right", "/x/hall/here"]
    assert len({id(g.mesh) for g in found.values()}) == 1
    assert found["here"].mesh.name == "chair"
    right = found["right"].parent
    assert isinstance(right, Transform)
    np.testing.assert_array_equal(right.matrix @ [1, 0, 0, 1], [5, 8, 7, 1])


def test_rotation_and_scale_are_applied_in_the_order_of_the_format() -> None:
    half = math.sqrt(0.5)
    m = node_matrix({"translation": [1, 2, 3], "rotation": [0, 0, half, half], "scale": [2, 3, 4]})
    close(m @ [1, 0, 0, 1], [1, 4, 3, 1])
    close(m @ [0, 1, 0, 1], [-2, 2, 3, 1])
    np.testing.assert_array_equal(node_matrix({}), np.eye(4))


def test_every_primitive_is_a_drawable_with_its_own_material(tmp_path: Path) -> None:
    w = Writer()
    factor: Callable[..., dict[str, Any]] = lambda *c: {"pbrMetallicRoughness": {"baseColorFactor": c}}  # noqa: E731
    path = w.write(
        tmp_path / "x.glb",
        materials=[
            {"name": "red", **factor(1, 0, 0, 0.5)},
            {"name": "glass", "alphaMode": "BLEND", **factor(0, 0, 1, 0.4)},
        ],
        meshes=[{"name": "m", "primitives": [{**w.quad(), "material": 0}, {**w.quad(), "material": 1}, w.quad()]}],
        nodes=[{"name": "n", "mesh": 0}],
    )
    found = geodes(load(path))
    assert list(found) == ["n:red", "n:glass", "n:2"]
    assert isinstance(found["n:red"].parent, Group)
    assert found["n:red"].parent.name == "n"
    assert found["n:red"].mesh.color == (1.0, 0.0, 0.0, 1.0), "opaque unless the material blends"
    close(found["n:glass"].mesh.color, (0, 0, 1, 0.4))
    assert found["n:2"].mesh.color is None


def test_texture_and_its_coordinates(tmp_path: Path) -> None:
    pixels = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [9, 9, 9]]], np.uint8)
    (tmp_path / "my wood.png").write_bytes(png(pixels))
    w = Writer()
    texture = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    path = w.write(
        tmp_path / "x.gltf",
        images=[{"uri": "my%20wood.png"}, {"uri": "gone.png"}, {"bufferView": w.view(b"no image")}],
        textures=[{"source": 0}, {"source": 1}, {"source": 2}],
        materials=[
            texture,
            {
                "name": "lost",
                "pbrMetallicRoughness": {"baseColorTexture": {"index": 1}, "baseColorFactor": [0, 1, 0, 1]},
            },
            {"name": "torn", "pbrMetallicRoughness": {"baseColorTexture": {"index": 2}}},
        ],
        meshes=[
            {"primitives": [{**w.quad(TEXCOORD_0=w.accessor(UV)), "material": i}], "name": f"m{i}"}
            for i in (0, 1, 2, 0)
        ],
        nodes=[{"mesh": i, "name": f"n{i}"} for i in range(4)],
    )
    scene = load(path)
    found = geodes(scene)
    mesh = found["n0"].mesh
    assert mesh.texture is not None
    assert mesh.uv is not None
    np.testing.assert_array_equal(mesh.texture, pixels)
    # glTF counts v from the top, a Mesh from the bottom
    np.testing.assert_array_equal(mesh.uv, [[0, 0], [1, 0], [1, 1], [0, 1]])
    assert found["n3"].mesh.texture is mesh.texture, "meshes with one image share it"
    assert found["n1"].mesh.texture is None
    assert found["n1"].mesh.color == (0.0, 1.0, 0.0, 1.0)
    assert len(scene.problems) == 1
    assert all(word in scene.problems[0] for word in ("textures that cannot be read", "'gone.png'", "'lost'", "'torn'"))


def test_vertex_colors_of_all_widths(tmp_path: Path) -> None:
    w = Writer()
    values = np.array([[0, 0.5, 1], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    colors = [
        w.accessor(values.astype("<f4")),
        w.accessor(np.rint(values * 65535).astype("<u2"), normalized=True),
        w.accessor(np.column_stack([np.rint(values * 255), [255] * 4]).astype("|u1"), normalized=True),
    ]
    path = w.write(
        tmp_path / "x.glb",
        materials=[{}],
        meshes=[{"primitives": [{**w.quad(COLOR_0=c), **more}]} for c in colors for more in ({}, {"material": 0})],
        nodes=[{"mesh": i, "name": f"n{i}"} for i in range(6)],
    )
    found = geodes(load(path))
    assert len(found) == 6
    for geode in found.values():
        assert geode.mesh.vertex_colors is not None
        np.testing.assert_allclose(geode.mesh.vertex_colors[:, :3], values * 255, atol=0.51)
        assert (geode.mesh.vertex_colors[:, 3] == 255).all()


def test_sparse_normalized_and_quantized_accessors(tmp_path: Path) -> None:
    w = Writer()
    rows, values = w.view(np.array([2], "<u2").tobytes()), w.view(np.array([[7, 8, 9]], "<f4").tobytes())
    sparse = {"count": 1, "indices": {"bufferView": rows, "componentType": 5123}, "values": {"bufferView": values}}
    moved = w.accessor(POINTS, sparse=sparse)
    short = w.accessor(np.array([[0, 0, 0], [32767, 0, 0], [0, -32767, 0], [0, 0, 0]], "<i2"), normalized=True)
    plain = w.accessor(np.array([[0, 0, 0], [500, 0, 0], [0, -500, 0], [0, 0, 9]], "<i2"))
    uv = w.accessor(np.array([[0, 255], [255, 255], [255, 0], [0, 0]], "|u1"), normalized=True)
    primitive = {"indices": w.accessor(INDICES)}
    path = w.write(
        tmp_path / "x.glb",
        extensionsUsed=["KHR_mesh_quantization"],
        materials=[{}],
        meshes=[
            {"primitives": [{"attributes": {"POSITION": i, "TEXCOORD_0": uv}, **primitive, "material": 0}]}
            for i in (moved, short, plain)
        ],
        nodes=[{"mesh": i, "name": f"n{i}"} for i in range(3)],
    )
    found = geodes(load(path))
    close(found["n0"].mesh.vertices, [[0, 0, 0], [1, 0, 0], [7, 8, 9], [0, 1, 0]])
    close(found["n1"].mesh.vertices, [[0, 0, 0], [1, 0, 0], [0, -1, 0], [0, 0, 0]])
    close(found["n2"].mesh.vertices, [[0, 0, 0], [500, 0, 0], [0, -500, 0], [0, 0, 9]])
    close(found["n0"].mesh.uv, [[0, 0], [1, 0], [1, 1], [0, 1]])


def test_cycles_and_shared_nodes_are_placed_once(tmp_path: Path) -> None:
    w = Writer()
    path = w.write(
        tmp_path / "x.glb",
        meshes=[{"primitives": [w.quad()]}],
        nodes=[
            {"name": "a", "mesh": 0, "children": [1, 2]},
            {"name": "b", "mesh": 0, "children": [0, 2]},
            {"name": "c", "mesh": 0},
        ],
        scenes=[{"nodes": [0, 0]}],
    )
    scene = load(path)
    assert list(geodes(scene)) == ["a", "b", "c"]
    (problem,) = scene.problems
    assert "placed once" in problem
    assert "'a'" in problem
    assert "'c'" in problem


def test_what_is_no_triangle_or_not_placed_is_named(tmp_path: Path) -> None:
    w = Writer()
    lines = {"attributes": {"POSITION": w.accessor(POINTS)}, "mode": 1}
    points = {"attributes": {"POSITION": w.accessor(POINTS)}, "mode": 0}
    path = w.write(
        tmp_path / "x.glb",
        meshes=[
            {"name": "mixed", "primitives": [w.quad(), lines, points]},
            {"name": "spare", "primitives": [w.quad()]},
        ],
        nodes=[{"mesh": 0, "name": "n"}],
        scenes=[{"nodes": [0]}, {"nodes": []}],
    )
    scene = load(path)
    assert list(geodes(scene)) == ["n"]
    text = "\n".join(scene.problems)
    assert "'mixed.1' (mode 1), 'mixed.2' (mode 0)" in text
    assert "no node places, left out: 'spare'" in text
    assert "1 other scenes of the file are left out" in text


def test_without_scenes_all_root_nodes_are_shown(tmp_path: Path) -> None:
    w = Writer()
    path = w.write(tmp_path / "x.glb", meshes=[{"primitives": [w.quad()]}], nodes=[{"mesh": 0}], scenes=[])
    assert list(geodes(load(path))) == ["node 0"]


def test_singular_and_endless_nodes_are_kept_and_named(tmp_path: Path) -> None:
    w = Writer()
    path = w.write(
        tmp_path / "x.gltf",
        meshes=[{"primitives": [w.quad()]}],
        nodes=[
            {"mesh": 0, "name": "flat", "scale": [1, 0, 1]},
            {"mesh": 0, "name": "endless", "translation": [1e309, 0, 0]},
            {"mesh": 0, "name": "tilted", "matrix": [1, 0, 0, 0.5, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]},
        ],
    )
    scene = load(path)
    assert list(geodes(scene)) == ["flat", "endless"]
    text = "\n".join(scene.problems)
    assert "'/x/flat'" in text
    assert "'/x/endless'" in text
    assert "last row is not 0 0 0 1, objects left out: 'tilted'" in text


def test_files_of_trimesh_do_not_declare_y_up(tmp_path: Path) -> None:
    tower = trimesh.Scene(trimesh.creation.box(bounds=[[-1, -2, 0], [1, 2, 9]]))
    (tmp_path / "x.glb").write_bytes(tower.export(file_type="glb"))
    assert load(tmp_path / "x.glb").up == (0.0, 0.0, 1.0)


def test_extensions_that_are_not_read_are_named(tmp_path: Path) -> None:
    w = Writer()
    path = w.write(
        tmp_path / "x.glb",
        meshes=[{"primitives": [w.quad()]}],
        nodes=[{"mesh": 0, "skin": 0, "name": "n"}],
        extensionsUsed=["EXT_mesh_gpu_instancing", "KHR_materials_unlit", "FUN_optional"],
        extensionsRequired=["KHR_mesh_quantization", "FUN_required"],
    )
    scene = load(path)
    assert list(geodes(scene)) == ["n"]
    text = "\n".join(scene.problems)
    assert "extensions that are not read" in text
    assert "'EXT_mesh_gpu_instancing', 'FUN_required'" in text
    assert "skins are not applied: 1 nodes" in text


def test_draco_without_its_reader_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(SceneError, match=r"compressed with Draco; install its reader \(pip install DracoPy\)"):
        load(faulty(tmp_path, lambda t: t.update(extensionsRequired=["KHR_draco_mesh_compression"])))


def faulty(tmp_path: Path, change: Callable[[dict[str, Any]], Any]) -> Path:
    w = Writer()
    path = w.write(tmp_path / "x.gltf", meshes=[{"primitives": [w.quad()]}], nodes=[{"mesh": 0}])
    tree = json.loads(path.read_text())
    change(tree)
    path.write_text(json.dumps(tree))
    return path


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda t: t["buffers"][0].update(uri="gone.bin"), r"needs the file 'gone\.bin'"),
        (lambda t: t["bufferViews"][1].update(byteLength=999), r"buffer view 1 reads \d+ bytes"),
        (lambda t: t["bufferViews"][0].update(buffer=7), r"of 'no buffer'"),
        (lambda t: t["accessors"][0].update(count=999), r"accessor 0 reads \d+ bytes"),
        (lambda t: t["scenes"][0].update(nodes=[4]), r"node 4 does not exist"),
        (lambda t: t["asset"].update(version="1.0"), r"is glTF version 1\.0; convert it"),
        (lambda t: t.update(extensionsRequired=["EXT_meshopt_compression"]), r"EXT_meshopt_compression"),
        (lambda t: t["meshes"][0]["primitives"][0]["attributes"].clear(), r"has no triangles to draw"),
        (lambda t: t["nodes"][0].update(rotation="north"), r"is not a valid \.gltf file"),
    ],
)
def test_broken_trees_are_refused(tmp_path: Path, change: Callable[[dict[str, Any]], Any], says: str) -> None:
    with pytest.raises(SceneError, match=says) as caught:
        load(faulty(tmp_path, change))
    assert "; " in str(caught.value)


@pytest.mark.parametrize(
    ("raw", "says"),
    [
        (b"{}", "has no triangles"),
        (b"[]", "its JSON is not an object"),
        (b"{", "is not valid glTF"),
        (b"glTF", "is cut short"),
        (struct.pack("<4sII", b"glTF", 1, 20) + b"\0" * 8, "version 1; convert it"),
        (struct.pack("<4sIIII", b"glTF", 2, 20, 99, 0x4E4F534A), "a chunk of 99 bytes"),
        (struct.pack("<4sIIII", b"glTF", 2, 20, 0, 0x004E4942), "without a JSON chunk"),
    ],
)
def test_broken_containers_are_refused(tmp_path: Path, raw: bytes, says: str) -> None:
    path = tmp_path / "x.glb"
    path.write_bytes(raw)
    with pytest.raises(SceneError, match=says):
        load(path)
