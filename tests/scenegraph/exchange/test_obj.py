"""OBJ written by hand: objects, materials, coordinates far away, text that trimesh stumbles over."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from scenegraph.errors import SceneError
from scenegraph.exchange import load
from scenegraph.nodes import Geode, Group, Transform
from scenegraph.scene import Scene

QUAD = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
COLORS = "newmtl red\nKd 1 0 0\nnewmtl half green\nKd 0 1 0\nd 0.5\nnewmtl clear\nKd 0 0 1\nTr 0.75\n"


def written(tmp_path: Path, text: str, **files: str) -> Scene:
    for name, content in files.items():
        (tmp_path / name.replace("_", ".")).write_text(content)
    path = tmp_path / "model.obj"
    path.write_text(text)
    return load(path)


def geodes(scene: Scene) -> dict[str, Geode]:
    return {node.name: node for node in scene.root.walk() if isinstance(node, Geode)}


def triangles(geode: Geode) -> list[Any]:
    return geode.mesh.vertices[geode.mesh.faces].tolist()


def test_materials_give_base_colors(tmp_path: Path) -> None:
    scene = written(
        tmp_path,
        f"mtllib colors.mtl\n{QUAD}o a\nusemtl red\nf 1 2 3\no b\nusemtl half green\nf 1 2 3\n"
        "usemtl clear\no c\nf 1 3 4\n",
        colors_mtl=COLORS,
    )
    colors = {name: g.mesh.color for name, g in geodes(scene).items()}
    assert colors == {"a": (1, 0, 0, 1), "b": (0, 1, 0, 0.5), "c": (0, 0, 1, 0.25)}
    assert scene.problems == []


def test_an_object_of_several_plain_materials_stays_one_drawable(tmp_path: Path) -> None:
    scene = written(
        tmp_path,
        f"mtllib colors.mtl\n{QUAD}o a\nusemtl red\nf 1 2 3\nusemtl clear\nf 1 3 4\nusemtl red\nf 2 3 4\n",
        colors_mtl=COLORS,
    )
    (geode,) = geodes(scene).values()
    mesh = geode.mesh
    assert mesh.vertex_colors is not None
    of_face = {
        tuple(map(tuple, t)): tuple(c)
        for t, c in zip(triangles(geode), mesh.vertex_colors[mesh.faces[:, 0]], strict=True)
    }
    corner = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)]
    red, clear = (255, 0, 0, 255), (0, 0, 255, 64)
    assert of_face == {
        (corner[0], corner[1], corner[2]): red,
        (corner[1], corner[2], corner[3]): red,
        (corner[0], corner[2], corner[3]): clear,
    }


def test_textured_materials_divide_an_object(tmp_path: Path) -> None:
    pixels = np.arange(12, dtype=np.uint8).reshape(2, 2, 3)
    (tmp_path / "textures").mkdir()
    Image.fromarray(pixels).save(tmp_path / "textures" / "wood.png")
    uv = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
    scene = written(
        tmp_path,
        f"mtllib colors.mtl\n{QUAD}{uv}o a\nusemtl wood\nf 1/1 2/2 3/3\nusemtl red\nf 1 3 4\n"
        "o b\nusemtl gone\nf 1/1 2/2 3/3\no c\nusemtl wood\nf 1 2 3\n",
        colors_mtl=COLORS
        + "newmtl wood\nKd 0 0 0\nmap_Kd textures\\wood.png\nnewmtl gone\nKd 1 1 0\nmap_Kd gone.png\n",
    )
    found = geodes(scene)
    assert list(found) == ["a:wood", "a:red", "b", "c"]
    assert isinstance(found["a:wood"].parent, Group)
    wood = found["a:wood"].mesh
    assert wood.texture is not None
    assert wood.uv is not None
    np.testing.assert_array_equal(wood.texture, pixels)
    assert dict(zip(map(tuple, wood.vertices.tolist()), map(tuple, wood.uv.tolist()), strict=True)) == {
        (0, 0, 0): (0, 0), (1, 0, 0): (1, 0), (1, 1, 0): (1, 1)
    }  # fmt: skip
    assert wood.color is None, "a black Kd beside a texture is a habit of exporters, not a color"
    assert found["a:red"].mesh.color == (1, 0, 0, 1)
    assert found["b"].mesh.color == (1, 1, 0, 1)
    assert found["c"].mesh.texture is None
    assert len(scene.problems) == 2
    assert "'gone.png' (not found)" in scene.problems[0]
    assert "without usable texture coordinates" in scene.problems[1]


def test_groups_divide_a_file_without_objects(tmp_path: Path) -> None:
    scene = written(tmp_path, f"{QUAD}f 1 2 4\ng wall\nf 1 2 3\ng roof\nf 1 3 4\ng wall\nf 2 3 4\n")
    assert {name: g.mesh.triangles for name, g in geodes(scene).items()} == {"model": 1, "wall": 2, "roof": 1}


def test_objects_of_one_name_are_kept_apart_and_groups_in_objects_are_not(tmp_path: Path) -> None:
    scene = written(tmp_path, f"{QUAD}o a\ng x\nf 1 2 3\ng y\nf 1 3 4\no a\nf 2 3 4\no empty\n")
    drawn = [n for n in scene.root.walk() if isinstance(n, Geode)]
    assert [(g.name, g.mesh.triangles) for g in drawn] == [("a", 2), ("a", 1)]


def test_coordinates_of_a_map_survive_exactly(tmp_path: Path, rng: np.random.Generator) -> None:
    vertices = rng.uniform(0, 100, (300, 3)) + [691_000.123, 5_400_000.456, 400]
    faces = np.arange(300).reshape(-1, 3) + 1
    text = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in vertices.tolist())
    for i, chunk in enumerate(np.split(faces, 10)):
        text += f"o part{i}\n" + "".join("f {} {} {}\n".format(*f) for f in chunk)
    scene = written(tmp_path, text)
    (origin,) = scene.root.children
    assert isinstance(origin, Transform)
    assert origin.name == "origin"
    assert len(origin.children) == 10
    world = np.concatenate([g.mesh.vertices[g.mesh.faces] for g in geodes(scene).values()]) + origin.matrix[:3, 3]
    np.testing.assert_array_equal(world.reshape(-1, 3), vertices)
    assert max(np.abs(g.mesh.vertices).max() for g in geodes(scene).values()) < 500
    assert scene.up == (0, 0, 1)


def test_faces_beyond_the_vertices_are_dropped_counted_and_named(tmp_path: Path) -> None:
    scene = written(tmp_path, f"{QUAD}o a\nf 1 2 3\nf 1 2 99\no b\nf 1 3 4\nf 0 1 2\nf 1 2\no lost\nf 7 8 9\n")
    assert {name: g.mesh.triangles for name, g in geodes(scene).items()} == {"a": 1, "b": 1}
    assert scene.problems == [
        "faces dropped because they name vertices that do not exist: 'a' (1), 'b' (2), 'lost' (1)"
    ]


def test_relative_indices_count_from_where_they_stand(tmp_path: Path) -> None:
    scene = written(
        tmp_path, "o a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\no b\nv 5 0 0\nv 6 0 0\nv 5 1 0\nf -3 -2 -1\n"
    )
    found = geodes(scene)
    assert triangles(found["a"]) == [[[0, 0, 0], [1, 0, 0], [0, 1, 0]]]
    assert triangles(found["b"]) == [[[5, 0, 0], [6, 0, 0], [5, 1, 0]]]


def test_odd_text(tmp_path: Path) -> None:
    text = "\ufeff# c\r\n  o\ta b \r\n\tv 0 0 0\r\nv 1 0 0\r\nv 1 1\\\r\n 0\r\nv\t0 1 0\r\n"
    text += "v 1.#QNAN -1.#IND nan(ind)\r\nf 1 2 3 4\r\n"
    (geode,) = geodes(written(tmp_path, text)).values()
    assert geode.name == "a b"
    assert geode.mesh.triangles == 2
    assert geode.mesh.is_finite, "the vertex that is not a number is used by no face"


def test_polygons_are_triangulated_and_normals_kept(tmp_path: Path) -> None:
    text = QUAD + "v 0.5 2 0\nvn 0 0 1\no flat\nf 1 2 3 5 4\no mixed\nf 1 2 3\nf 1 2 3 4\no smooth\nf 1//1 2//1 3//1\n"
    found = geodes(written(tmp_path, text))
    assert {name: g.mesh.triangles for name, g in found.items()} == {"flat": 3, "mixed": 3, "smooth": 1}
    assert found["smooth"].mesh.normals is not None
    np.testing.assert_array_equal(found["smooth"].mesh.normals, [[0, 0, 1]] * 3)
    assert found["flat"].mesh.normals is None


def test_vertex_colors(tmp_path: Path) -> None:
    text = "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nf 1 2 3\n"
    (geode,) = geodes(written(tmp_path, text)).values()
    assert geode.mesh.vertex_colors is not None
    np.testing.assert_array_equal(geode.mesh.vertex_colors, [[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255]])


def test_several_material_files(tmp_path: Path) -> None:
    scene = written(
        tmp_path,
        f"mtllib a.mtl b.mtl gone.mtl\nmtllib with space.mtl\n{QUAD}o a\nusemtl one\nf 1 2 3\n"
        "o b\nusemtl two\nf 1 2 3\no c\nusemtl three\nf 1 2 3\n",
        a_mtl="newmtl one\nKd 1 0 0\n",
        b_mtl="newmtl two\nKd 0 1 0\n",
        **{"with space_mtl": "newmtl three\nKd 0 0 1\n"},
    )
    assert [g.mesh.color for g in geodes(scene).values()] == [(1, 0, 0, 1), (0, 1, 0, 1), (0, 0, 1, 1)]
    assert scene.problems == ["material files that are missing, objects kept without their colors: 'gone.mtl'"]


@pytest.mark.parametrize("text", ["# nothing\n", "v 0 0 0\n", QUAD, "f 1 2 3\n", "v a b c\nf 1 1 1\n", "o a\ng b\n"])
def test_files_without_triangles_are_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(SceneError, match=r"model\.obj (has no triangles|is not a valid)"):
        written(tmp_path, text)
