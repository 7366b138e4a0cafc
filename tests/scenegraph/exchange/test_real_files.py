"""Every real model of the data folder, against the table in its README and against trimesh's own reading."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from scenegraph.exchange import load
from scenegraph.exchange.build import world_bounds
from scenegraph.nodes import Geode, Transform
from scenegraph.scene import Scene

pytestmark = pytest.mark.data

Y_UP, Z_UP = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Real:
    path: str
    triangles: int
    drawables: int
    meshes: int
    lo: tuple[float, float, float]
    hi: tuple[float, float, float]
    up: tuple[float, float, float] = Y_UP
    views: int = 0


FILES = [
    Real("meshes/bunny.ply", 69451, 1, 1, (-0.09469, 0.03299, -0.06187), (0.06101, 0.1873, 0.0588)),
    Real("meshes/bunny_res2.ply", 16301, 1, 1, (-0.09457, 0.03339, -0.06187), (0.06093, 0.1866, 0.05869)),
    Real("meshes/bunny_res3.ply", 3851, 1, 1, (-0.09436, 0.03341, -0.06167), (0.06093, 0.1848, 0.05847)),
    Real("meshes/bunny_res4.ply", 948, 1, 1, (-0.09315, 0.03362, -0.05664), (0.05816, 0.1819, 0.0578)),
    Real("meshes/armadillo_86k.ply", 86482, 1, 1, (-0.4353, -0.5734, -0.3795), (0.4033, 0.4265, 0.3833)),
    Real("meshes/armadillo_30k.ply", 29170, 1, 1, (-0.4344, -0.5716, -0.3748), (0.4031, 0.4263, 0.378)),
    Real("meshes/dragon_res2.ply", 202520, 1, 1, (-0.1082, 0.05274, -0.05035), (0.09641, 0.1971, 0.04114)),
    Real("meshes/dragon_res3.ply", 47794, 1, 1, (-0.1077, 0.05277, -0.05005), (0.09598, 0.1966, 0.04083)),
    Real("meshes/dragon_res4.ply", 11102, 1, 1, (-0.1076, 0.05284, -0.04984), (0.09524, 0.1963, 0.04083)),
    Real("meshes/horse.ply", 96966, 1, 1, (-0.042, -0.09167, -0.07642), (0.042, 0.09167, 0.07642)),
    Real("scenes/virtual_city.glb", 8383, 167, 167, (-83.14, -1.257, -83.14), (83.14, 96.94, 85.99), views=14),
    Real("scenes/reciprocating_saw.glb", 198470, 113, 65, (-298.3, -42.42, -29.52), (76.47, 41.5, 119.2), views=1),
    Real("scenes/cafe.glb", 23834, 517, 517, (-200.3, -480.4, 0.0), (200.3, 480.4, 112.9), Z_UP),
    Real("scenes/duplex_building.glb", 26348, 215, 153, (-0.2415, -22.18, -1.55), (9.042, 4.383, 6.635), Z_UP),
    Real("scenes/sibenik.ply", 75284, 1, 1, (-20.14, -15.31, -8.497), (20.14, 15.3, 8.497), Z_UP),
    Real("scenes/bathroom.glb", 1016615, 71, 71, (-20.14, -2.455, -22.95), (18.97, 36.96, 53.53)),
    Real("city/delft_3dfier.obj", 28619, 570, 570, (84616.5, 447423.0, -0.47), (85140.8, 447750.6, 13.58), Z_UP),
    Real(
        "city/ingolstadt_lod3.obj", 148883, 379, 379, (678016.2, 5403455.8, 412.9), (678206.7, 5403946.4, 436.9), Z_UP
    ),
    Real("foliage/white_birch.ply", 39239, 1, 1, (-5.305, -5.548, 0), (4.617, 5.438, 16.22), Z_UP),
]


def geodes(scene: Scene) -> list[Geode]:
    return [node for node in scene.root.walk() if isinstance(node, Geode)]


def world_matrix(node: Geode) -> NDArray[np.float64]:
    matrix, above = np.eye(4), node.parent
    while above is not None:
        if isinstance(above, Transform):
            matrix = above.matrix @ matrix
        above = above.parent
    return matrix


def world_triangles(node: Geode) -> NDArray[np.float64]:
    matrix = world_matrix(node)
    return (node.mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3])[node.mesh.faces]


def areas(triangles: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])).sum())


def signature(triangles: NDArray[np.float64]) -> list[float]:
    return [len(triangles), areas(triangles), *triangles.min(axis=(0, 1)), *triangles.max(axis=(0, 1))]


@pytest.mark.parametrize("real", FILES, ids=lambda real: Path(real.path).name)
def test_counts_bounds_and_up_are_those_of_the_table(real: Real, data_dir: Path) -> None:
    scene = load(data_dir / real.path)
    drawn = geodes(scene)
    assert len(drawn) == real.drawables
    assert len({id(g.mesh) for g in drawn}) == real.meshes
    assert sum(g.mesh.triangles for g in drawn) == real.triangles
    size = max(np.subtract(real.hi, real.lo))
    np.testing.assert_allclose(world_bounds(scene.root), [real.lo, real.hi], rtol=5e-4, atol=5e-4 * size)
    assert scene.up == real.up
    assert len(scene.views) == real.views
    assert scene.name == Path(real.path).stem


@pytest.mark.parametrize("real", FILES, ids=lambda real: Path(real.path).name)
def test_every_drawable_is_where_trimesh_has_it(real: Real, data_dir: Path) -> None:
    options: dict[str, Any] = {"split_objects": True, "group_material": False} if real.path.endswith("obj") else {}
    theirs = trimesh.load_scene(str(data_dir / real.path), process=False, **options)
    expected = []
    for node in theirs.graph.nodes_geometry:
        matrix, key = theirs.graph.get(node)
        mesh = theirs.geometry[key]
        vertices = np.asarray(mesh.vertices) @ matrix[:3, :3].T + matrix[:3, 3]
        expected.append(signature(vertices[np.asarray(mesh.faces)]))
    ours = [signature(world_triangles(g)) for g in geodes(load(data_dir / real.path))]
    assert len(ours) == len(expected)
    # instances have the same size: pair each drawable with its likeliest partner before comparing
    pairs = linear_sum_assignment(cdist(ours, expected))
    size = max(np.subtract(real.hi, real.lo))
    np.testing.assert_allclose(np.array(ours)[pairs[0]], np.array(expected)[pairs[1]], rtol=1e-9, atol=1e-7 * size)


@pytest.mark.parametrize("name", ["delft_3dfier", "ingolstadt_lod3"])
def test_georeferenced_vertices_survive_bit_for_bit(name: str, data_dir: Path) -> None:
    path = data_dir / "city" / f"{name}.obj"
    lines = [line.split() for line in path.read_text().splitlines()]
    vertices = np.array([line[1:4] for line in lines if line[:1] == ["v"]], np.float64)
    used = {int(ref.split("/")[0]) - 1 for line in lines if line[:1] == ["f"] for ref in line[1:]}
    scene = load(path)
    drawn = geodes(scene)
    found = np.concatenate([world_triangles(g).reshape(-1, 3) for g in drawn])
    assert {tuple(v) for v in found.tolist()} == {tuple(v) for v in vertices[sorted(used)].tolist()}
    # local vertices are small, so that float32 resolves them to a hundredth of a millimeter
    assert max(float(np.abs(g.mesh.vertices).max()) for g in drawn) < 500.0
    assert len({id(g.parent) for g in drawn}) == 1, "one common transform, not one per object"
    records = [line[1] for line in lines if line[:1] == ["o"]]
    assert [g.name for g in drawn] == records


def test_cameras_of_the_city_look_at_it(data_dir: Path) -> None:
    scene = load(data_dir / "scenes" / "virtual_city.glb")
    bounds = world_bounds(scene.root)
    for view in scene.views.values():
        assert view.near == 1.0
        assert view.far == 10000.0
        assert np.degrees(1.0) == pytest.approx(view.fov)
        assert (np.abs(view.eye) < 10 * np.abs(bounds).max()).all()


def test_an_image_is_kept_once(data_dir: Path) -> None:
    scene = load(data_dir / "scenes" / "virtual_city.glb")
    textures = {id(g.mesh.texture): g.mesh.texture for g in geodes(scene) if g.mesh.texture is not None}
    assert sum(g.mesh.texture is not None for g in geodes(scene)) > len(textures)
    assert len(textures) <= 20, "the file has 20 images"


def test_hierarchy_of_the_duplex_is_kept(data_dir: Path) -> None:
    scene = load(data_dir / "scenes" / "duplex_building.glb")
    depth = [re.sub(r"^/duplex_building/", "", g.path()).count("/") for g in geodes(scene)]
    assert min(depth) >= 3, "project, site, building, storey, element"
    assert scene.problems == []
