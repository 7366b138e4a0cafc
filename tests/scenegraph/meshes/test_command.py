"""`scenegraph occluders`: table, JSON and files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from scenegraph.cli import app
from strict_json import parsed


def run(*arguments: str, code: int = 0) -> tuple[str, str]:
    result = CliRunner().invoke(app, ["occluders", *arguments])
    assert result.exit_code == code, (result.output, result.exception)
    return result.stdout, result.stderr


@pytest.fixture
def model(tmp_path: Path) -> str:
    """Two blocks that share a mesh, far apart; and an open shed."""
    scene = trimesh.Scene()
    block = trimesh.creation.box()
    scene.add_geometry(block, geom_name="block", node_name="a")
    scene.graph.update("b", matrix=trimesh.transformations.translation_matrix((9, 0, 0)), geometry="block")
    shed = trimesh.creation.box(extents=(1, 2, 1))
    shed.update_faces(shed.face_normals[:, 2] > -0.5)
    shed.apply_translation((0, 9, 0))
    scene.add_geometry(shed, geom_name="shed", node_name="shed")
    path = tmp_path / "model.glb"
    scene.export(path)
    return str(path)


def test_table(model: str) -> None:
    out, _ = run(model, "--cells", "12")
    lines = out.splitlines()
    assert lines[0].split()[:4] == ["mesh", "drawables", "triangles", "closed"]
    block = next(line.split() for line in lines if line.startswith("block"))
    assert block[1:7] == ["2", "12", "yes", "1", "0", "100%"]
    shed = next(line.split() for line in lines if line.startswith("shed"))
    assert shed[3:5] == ["no", "0"]
    assert any(line.startswith("no solids: open: shed") for line in lines)
    assert lines[-1] == "7 occluders for 3 drawables."
    out, _ = run(model, "--cells", "12")
    assert "cached" in out


def test_json(model: str) -> None:
    out, _ = run(model, "--json", "--cells", "12", "--openings", "outward", "--shape", "box", "--memory", "--fresh")
    found = parsed(out)
    assert found["drawables"] == 3
    assert found["meshes_left"] == 0
    meshes = {m["mesh"]: m for m in found["meshes"]}
    assert set(meshes) == {"block", "shed"}
    assert meshes["shed"]["is_covered"]
    assert [o["kind"] for o in meshes["shed"]["occluders"]] == ["box"]
    assert meshes["block"]["coverage"] == pytest.approx(1, abs=1e-3)
    assert meshes["block"]["peak_bytes"] > 0
    assert found["occluders"] == sum(m["placed"] for m in found["meshes"])


def test_occluders_are_written_in_world_coordinates(model: str, tmp_path: Path) -> None:
    data, picture = tmp_path / "found.json", tmp_path / "found.glb"
    run(model, "--out", str(data), "--cells", "12", "--openings", "outward")
    found = parsed(data)["occluders"]
    assert len(found) == 3
    middles = sorted(np.mean(o["vertices"], axis=0).round(2).tolist() for o in found)
    assert middles == [[0, 0, 0], [0, 9, 0], [9, 0, 0]]
    assert {o["kind"] for o in found} == {"solid"}
    assert all(len(o["faces"]) == 6 for o in found)
    run(model, "--out", str(picture), "--cells", "12", "--openings", "outward")
    scene = trimesh.load_scene(str(picture))
    assert len(scene.geometry) == 3
    assert scene.bounds == pytest.approx(np.array([[-0.5, -0.5, -0.5], [9.5, 10, 0.5]]), abs=1e-4)


def test_what_is_wrong_is_one_sentence(model: str, tmp_path: Path) -> None:
    for arguments, sentence in (
        (["nothing.glb"], "nothing.glb"),
        ([model, "--cells", "3"], "cells=3 is not between 8 and 160"),
        ([model, "--shape", "ball"], "use 'box' or 'polytope'"),
        ([model, "--openings", "all"], "use 'none', 'outward' or 'any'"),
        ([model, "--out", "found.txt"], "occluders are written as one of .json"),
        ([model, "--cells", "12", "--out", str(tmp_path / "no" / "found.json")], "choose another place"),
    ):
        out, err = run(*arguments, code=2)
        assert out == ""
        assert err.startswith("scenegraph: ")
        assert sentence in err
        assert len(err.splitlines()) == 1
