"""The door: which files are refused with which sentence, and what the plain formats keep."""

from __future__ import annotations

import io
import os
import stat
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from scenegraph.errors import SceneError, ScenegraphError
from scenegraph.exchange import load, readable_suffixes
from scenegraph.exchange.load import guess_up
from scenegraph.nodes import Geode
from scenegraph.scene import Scene

Y_UP, Z_UP = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def drawn(scene: Scene) -> list[Geode]:
    return [node for node in scene.root.walk() if isinstance(node, Geode)]


def refused(path: Path | str) -> str:
    with pytest.raises(SceneError) as caught:
        load(path)
    message = str(caught.value)
    assert isinstance(caught.value, ScenegraphError)
    assert str(path) in message
    assert "\n" not in message
    assert "; " in message, "fault; cure"
    return message


def test_missing_file_and_folder(tmp_path: Path) -> None:
    assert "does not exist" in refused(tmp_path / "gone.glb")
    assert "is a folder" in refused(tmp_path)
    (tmp_path / "folder.obj").mkdir()
    assert "is a folder" in refused(tmp_path / "folder.obj")


@pytest.mark.parametrize(
    ("name", "says"), [("model.blend", r"end in .blend cannot be read"), ("model", "has no suffix")]
)
def test_unknown_kinds_are_answered_with_the_known_ones(tmp_path: Path, name: str, says: str) -> None:
    (tmp_path / name).write_bytes(b"?")
    message = refused(tmp_path / name)
    assert says in message
    assert "glb, gltf, obj, off, ply, stl" in message
    assert set(readable_suffixes()) >= {"glb", "gltf", "obj", "ply", "stl", "off", "3mf", "zip"}


@pytest.mark.skipif(os.geteuid() == 0 if hasattr(os, "geteuid") else True, reason="the superuser may read everything")
def test_unreadable_file(tmp_path: Path) -> None:
    path = tmp_path / "secret.ply"
    path.write_bytes(b"ply")
    path.chmod(stat.S_IWUSR)
    assert "check its permissions" in refused(path)


def test_a_file_that_cannot_be_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "secret.ply"
    path.write_bytes(b"ply")

    def deny(*args: Any, **kwargs: Any) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", deny)
    assert "cannot be read (Permission denied); check its permissions" in refused(path)


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "off", "glb", "gltf", "3mf", "zip", "dae"])
@pytest.mark.parametrize("content", [b"", b"\0", b"garbage\n", b"\xff" * 200])
def test_garbage_is_refused_in_one_sentence(tmp_path: Path, suffix: str, content: bytes) -> None:
    path = tmp_path / f"broken.{suffix}"
    path.write_bytes(content)
    message = refused(path)
    assert any(
        text in message for text in ("is empty", "is not", "has no triangles", "is cut short", "need the Python")
    )


@pytest.mark.parametrize("fraction", [0.3, 0.6, 0.95])
@pytest.mark.parametrize("suffix", ["ply", "ascii.ply", "stl", "ascii.stl", "glb", "off", "3mf"])
def test_files_that_end_too_early(tmp_path: Path, suffix: str, fraction: float) -> None:
    ball = trimesh.creation.icosphere(subdivisions=2)
    kind = suffix.removeprefix("ascii.")
    options = {"ascii.ply": {"encoding": "ascii"}, "off": {"digits": 10}}.get(suffix, {})
    model = trimesh.Scene(ball) if kind in ("glb", "3mf") else ball
    whole = model.export(file_type="stl_ascii" if suffix == "ascii.stl" else kind, **options)
    raw = whole if isinstance(whole, bytes) else whole.encode()
    path = tmp_path / f"short.{suffix}"
    path.write_bytes(raw[: int(len(raw) * fraction)])
    refused(path)


def damaged(raw: bytes, rng: np.random.Generator) -> bytes:
    out = bytearray(raw)
    for _ in range(rng.integers(1, 8)):
        at = int(rng.integers(len(out))) if out else 0
        match rng.integers(3):
            case 0:
                out[at : at + 1] = bytes([rng.integers(256)])
            case 1:
                del out[at : at + int(rng.integers(1, 30))]
            case _:
                out[at:at] = bytes(rng.choice(list(b"0123456789-/ \n{}[],.e"), 4).tolist())
    return bytes(out)


@pytest.mark.parametrize("suffix", ["ply", "ascii.ply", "stl", "obj", "off", "glb", "gltf", "3mf"])
def test_damaged_files_give_a_scene_or_one_sentence(tmp_path: Path, suffix: str, rng: np.random.Generator) -> None:
    ball, kind = trimesh.creation.icosphere(subdivisions=1), suffix.removeprefix("ascii.")
    if kind == "gltf":
        files = trimesh.Scene(ball).export(file_type="gltf", merge_buffers=True, embed_buffers=True)
        whole = files["model.gltf"]
    elif kind in ("glb", "3mf"):
        whole = trimesh.Scene(ball).export(file_type=kind)
    else:
        whole = ball.export(file_type=kind, **({"encoding": "ascii"} if suffix == "ascii.ply" else {}))
    raw = whole if isinstance(whole, bytes) else whole.encode()
    path = tmp_path / f"damaged.{suffix}"
    for _ in range(60):
        path.write_bytes(damaged(raw, rng))
        try:
            scene = load(path)
        except SceneError as error:
            assert "\n" not in str(error)  # noqa: PT017 - either outcome is right
            assert "; " in str(error)  # noqa: PT017
        else:
            for geode in drawn(scene):
                assert geode.mesh.triangles > 0
                assert 0 <= geode.mesh.faces.min() <= geode.mesh.faces.max() < len(geode.mesh.vertices)
                assert geode.mesh.is_finite or any("not finite" in p for p in scene.problems)


def test_a_missing_reader_names_the_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "x.dae").write_text("<COLLADA/>")
    monkeypatch.setitem(sys.modules, "collada", None)
    message = refused(tmp_path / "x.dae")
    assert "pip install pycollada" in message


@pytest.mark.parametrize("suffix", ["ply", "stl", "off", "obj", "glb", "3mf", "STL"])
def test_plain_formats_keep_every_triangle(tmp_path: Path, suffix: str) -> None:
    ball = trimesh.creation.icosphere(subdivisions=2, radius=1e-6)
    path = tmp_path / f"ball.{suffix}"
    path.write_bytes(_bytes(trimesh.Scene(ball) if suffix in ("glb", "3mf") else ball, suffix.lower()))
    (geode,) = drawn(load(path))
    assert geode.mesh.triangles == len(ball.faces)
    assert len(geode.mesh.vertices) == len(ball.vertices), "tiny models are not collapsed by welding"
    found = geode.mesh.vertices[geode.mesh.faces]
    np.testing.assert_allclose(found.mean(axis=1), ball.triangles.mean(axis=1), atol=1e-12)


def _bytes(model: Any, kind: str) -> bytes:
    digits = {"digits": 17} if kind in ("obj", "off") else {}
    out = model.export(file_type=kind, **digits)
    return out if isinstance(out, bytes) else out.encode()


def test_vertex_and_face_colors(tmp_path: Path) -> None:
    box = trimesh.creation.box()
    box.visual.vertex_colors = np.arange(32, dtype=np.uint8).reshape(8, 4)
    (tmp_path / "v.ply").write_bytes(box.export(file_type="ply"))
    (geode,) = drawn(load(tmp_path / "v.ply"))
    assert geode.mesh.vertex_colors is not None
    np.testing.assert_array_equal(geode.mesh.vertex_colors, np.arange(32).reshape(8, 4))
    box = trimesh.creation.box()
    box.visual.face_colors = np.arange(48, dtype=np.uint8).reshape(12, 4)
    (tmp_path / "f.ply").write_bytes(box.export(file_type="ply"))
    (geode,) = drawn(load(tmp_path / "f.ply"))
    assert geode.mesh.vertex_colors is not None
    np.testing.assert_array_equal(geode.mesh.vertex_colors[geode.mesh.faces[:, 0]], np.arange(48).reshape(12, 4))
    box = trimesh.creation.box()
    box.visual.face_colors = [255, 0, 51, 255]
    (tmp_path / "u.ply").write_bytes(box.export(file_type="ply"))
    (geode,) = drawn(load(tmp_path / "u.ply"))
    assert geode.mesh.color == (1.0, 0.0, 0.2, 1.0)
    assert geode.mesh.vertex_colors is None


def test_nan_in_a_ply_is_kept_counted_and_named(tmp_path: Path) -> None:
    box = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, np.nan, 0], [1, 1, np.inf]], [[0, 1, 2], [0, 1, 3]], process=False)
    (tmp_path / "odd.ply").write_bytes(box.export(file_type="ply"))
    scene = load(tmp_path / "odd.ply")
    assert drawn(scene)[0].mesh.triangles == 2
    assert scene.problems == ["vertices that are not finite, objects kept and always drawn: 'odd.ply' (2 of 4)"]


def test_archives(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=1)
    with zipfile.ZipFile(tmp_path / "models.zip", "w") as archive:
        archive.writestr("ball.stl", ball.export(file_type="stl"))
        archive.writestr("scene.glb", trimesh.Scene(trimesh.creation.box()).export(file_type="glb"))
        archive.writestr("readme.txt", "hello")
    assert sorted(g.mesh.triangles for g in drawn(load(tmp_path / "models.zip"))) == [12, 80]


def test_a_texture_that_a_ply_names_but_lacks(tmp_path: Path) -> None:
    text = "ply\nformat ascii 1.0\ncomment TextureFile gone.png\nelement vertex 3\nproperty float x\nproperty float y\n"
    text += "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    text += "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
    (tmp_path / "x.ply").write_text(text)
    scene = load(tmp_path / "x.ply")
    assert len(drawn(scene)) == 1
    assert any("unable to load image" in p for p in scene.problems)


@pytest.mark.parametrize(("axis", "up"), [("Y_UP", Y_UP), ("Z_UP", Z_UP), ("X_UP", (1.0, 0.0, 0.0)), (None, Y_UP)])
def test_collada_says_which_way_is_up(tmp_path: Path, axis: str | None, up: tuple[float, float, float]) -> None:
    collada = pytest.importorskip("collada")
    model = collada.Collada()
    points = collada.source.FloatSource("p", np.array([0, 0, 0, 1, 0, 0, 0, 1, 0], float), ("X", "Y", "Z"))
    shape = collada.geometry.Geometry(model, "g", "g", [points])
    inputs = collada.source.InputList()
    inputs.addInput(0, "VERTEX", "#p")
    shape.primitives.append(shape.createTriangleSet(np.array([0, 1, 2]), inputs, "m"))
    model.geometries.append(shape)
    node = collada.scene.Node("n", children=[collada.scene.GeometryNode(shape, [])])
    model.scenes.append(collada.scene.Scene("s", [node]))
    model.scene = model.scenes[0]
    out = io.BytesIO()
    model.write(out)
    text = out.getvalue().decode()
    text = text.replace("<up_axis>Y_UP</up_axis>", f"<up_axis>{axis}</up_axis>" if axis else "")
    (tmp_path / "x.dae").write_text(text)
    scene = load(tmp_path / "x.dae")
    assert scene.up == up
    assert drawn(scene)[0].mesh.triangles == 1


@pytest.mark.parametrize(
    ("bounds", "up"),
    [
        ([[5e5, 5.4e6, 0], [5e5 + 90, 5.4e6 + 90, 80]], Z_UP),
        ([[-5, -5, 0], [5, 5, 16]], Z_UP),
        ([[-5, 0, -5], [5, 16, 5]], Y_UP),
        ([[0, 0, 0], [1, 1, 1]], Y_UP),
        ([[-20, -15, -8], [20, 15, 8]], Z_UP),
        ([[-20, -8, -15], [20, 8, 15]], Y_UP),
        (np.full((2, 3), np.nan), Y_UP),
    ],
)
def test_which_way_is_up(bounds: Any, up: tuple[float, float, float]) -> None:
    assert guess_up(np.asarray(bounds, float)) == up


def test_the_default_is_taken_where_nothing_speaks() -> None:
    assert guess_up(np.array([[-1.0, -1, -1], [1, 1, 1]]), default=Z_UP) == Z_UP


def test_loading_a_file_imports_neither_vtk_nor_pyvista(tmp_path: Path) -> None:
    import subprocess

    (tmp_path / "x.stl").write_bytes(trimesh.creation.box().export(file_type="stl"))
    code = (
        "import sys; from scenegraph.exchange import load; load(sys.argv[1]);"
        "print([m for m in sys.modules if m.split('.')[0] in ('vtk', 'vtkmodules', 'pyvista')])"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code, str(tmp_path / "x.stl")], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"
    assert done.stderr == ""
