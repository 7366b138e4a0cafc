"""What becomes of every broken or odd file of the data folder."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from scenegraph.errors import SceneError
from scenegraph.exchange import load
from scenegraph.exchange.build import world_bounds
from scenegraph.nodes import Geode, Transform

pytestmark = pytest.mark.data

REFUSED = {
    "empty_0_bytes.obj": r"is empty \(0 bytes\)",
    "empty_nodes.glb": r"has no triangles to draw",
    "index_buffer_degenerate_triangle.gltf": r"has no triangles to draw \(geometry that no node places.*'mesh 0'\)",
    "missing_buffer.gltf": r"needs the file 'BoxTextured0\.bin', which cannot be found",
    "no_bin_chunk.glb": r"has no triangles to draw",
    "points_no_faces.ply": r"has no triangles to draw \(points.*1024 points\)",
    "recursive_nodes.gltf": r"has no triangles to draw \(nodes .*inside themselves.*'node 0'\)",
    "truncated.glb": r"is cut short: it announces 48 bytes and has 47",
    "unparseable.stl": r"is not a valid \.stl file",
}

# triangles, drawables, what the problems say
KEPT = {
    "IndexOutOfRange.gltf": (
        11,
        1,
        [r"faces dropped because they name vertices that do not exist: 'Mesh' \(1 of 12\)"],
    ),
    "degenerate_39_parts.obj": (4418, 1, []),
    "infinite_positions.glb": (12, 1, [r"vertices that are not finite.*: 'Mesh' \(24 of 24\)"]),
    "nan_vertices.obj": (36, 8, [r"material files.*'cornell_box\.mtl'", r"not finite.*: 'floor' \(4 of 12\)"]),
    "negative_scale.glb": (7724, 11, []),
    "non_manifold.obj": (1442, 1, []),
    "open_interior_holes.obj": (66, 1, [r"material files.*'00\.mtl'"]),
    "thingi10k_112932.stl": (7880, 1, []),
    "triangle_soup.stl": (100, 1, []),
    "zero_area_face.obj": (1, 1, []),
    "zero_area_triangle.stl": (14, 1, []),
}

BOUNDS = {
    "degenerate_39_parts.obj": [[4645.9, -20171.1, 1482.3], [5362.2, -18786.7, 5449.3]],
    "negative_scale.glb": [[-5.162, -4.454, -0.5], [5.162, 4.454, 0.5]],
    "non_manifold.obj": [[-18, -10.4, -217.0], [-16, 7.6, -204.0]],
    "open_interior_holes.obj": [[0, 0, -10], [10, 15, 0]],
    "thingi10k_112932.stl": [[-7.5, -12, 0], [7.5, 25, 9.5]],
    "triangle_soup.stl": [[0.002359, 0.002531, 0.006098], [0.9998, 0.9991, 0.999]],
    "zero_area_face.obj": [[-1.7, 0, -1], [1, 0, -1]],
    "zero_area_triangle.stl": [[0, 0, 0], [10, 10, 10]],
    "IndexOutOfRange.gltf": [[-0.5, -0.5, -0.5], [0.5, 0.5, 0.5]],
}


def test_the_tables_cover_the_folder(data_dir: Path) -> None:
    files = {p.name for p in (data_dir / "hostile").iterdir() if p.suffix != ".bin"}
    assert files == REFUSED.keys() | KEPT.keys()


@pytest.mark.parametrize(("name", "says"), REFUSED.items())
def test_refused_with_one_sentence_that_names_the_file_and_a_cure(name: str, says: str, data_dir: Path) -> None:
    path = data_dir / "hostile" / name
    with pytest.raises(SceneError, match=says) as caught:
        load(path)
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    assert "; " in message, "a cure follows the fault"


@pytest.mark.parametrize(("name", "expected"), KEPT.items())
def test_kept_and_counted(name: str, expected: tuple[int, int, list[str]], data_dir: Path) -> None:
    triangles, drawables, problems = expected
    scene = load(data_dir / "hostile" / name)
    drawn = [n for n in scene.root.walk() if isinstance(n, Geode)]
    assert (sum(g.mesh.triangles for g in drawn), len(drawn)) == (triangles, drawables)
    assert len(scene.problems) == len(problems), scene.problems
    for sentence, pattern in zip(scene.problems, problems, strict=True):
        assert re.search(pattern, sentence), sentence
    if name in BOUNDS:
        np.testing.assert_allclose(world_bounds(scene.root), BOUNDS[name], rtol=5e-4, atol=1e-3)


def test_the_floor_with_nan_is_one_of_the_drawables(data_dir: Path) -> None:
    scene = load(data_dir / "hostile" / "nan_vertices.obj")
    floor = scene.root.find("floor")
    assert isinstance(floor, Geode)
    assert not floor.mesh.is_finite
    assert np.isnan(floor.mesh.bounds).any()
    light = scene.root.find("light")
    assert isinstance(light, Geode), "its face is written with relative indices"
    np.testing.assert_array_equal(light.mesh.bounds, [[213, 548, 227], [343, 548, 332]])


def test_mirrored_nodes_keep_their_negative_determinant(data_dir: Path) -> None:
    scene = load(data_dir / "hostile" / "negative_scale.glb")
    turns = [np.linalg.det(n.matrix[:3, :3]) for n in scene.root.walk() if isinstance(n, Transform)]
    assert min(turns) < 0 < max(turns)
