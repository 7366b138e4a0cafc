"""The city: as many buildings as asked for, the same for the same seed, and streets that one can walk."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest

from scenegraph import Geode, Group, Occluder, Scene, SceneError, Transform
from scenegraph.scenes.city import build
from scenegraph.scenes.city_layout import LOTS, lay_out, street_walk
from scenegraph.scenes.paths import distance_to_line


@pytest.fixture(scope="module")
def city() -> Scene:
    return build()


def buildings(scene: Scene) -> list[Transform]:
    return [n for n in scene.root.walk() if isinstance(n, Transform) and n.name.startswith("building ")]


def geodes(node: Group) -> list[Geode]:
    return [n for n in node.walk() if isinstance(n, Geode)]


def triangles(node: Group) -> int:
    return sum(g.mesh.triangles for g in geodes(node))


def digest(scene: Scene) -> str:
    """Everything that is drawn, hidden by or looked from."""
    sha = hashlib.sha256()
    for node in scene.root.walk():
        sha.update(f"{type(node).__name__} {node.path()}".encode())
        if isinstance(node, Geode):
            sha.update(f"{node.mesh.key} {node.color}".encode())
            colors = node.mesh.vertex_colors
            sha.update(b"" if colors is None else colors.tobytes())
        elif isinstance(node, Transform):
            sha.update(node.matrix.tobytes())
        elif isinstance(node, Occluder):
            sha.update(node.vertices.tobytes())
    sha.update(repr((scene.paths, scene.views)).encode())
    return sha.hexdigest()


def test_the_default_city_has_the_size_of_the_papers(city: Scene) -> None:
    found = buildings(city)
    assert len(found) == 2000
    assert 450_000 <= triangles(city.root) <= 550_000
    sizes = np.array([triangles(b) for b in found])
    assert 150 <= sizes.mean() <= 400
    assert all(len(geodes(b)) == 3 for b in found)


@pytest.mark.parametrize("count", [1, 2, 16, 17, 300])
@pytest.mark.parametrize("detail", [0, 1])
def test_there_are_exactly_as_many_buildings_as_asked_for(count: int, detail: int) -> None:
    scene = build(buildings=count, detail=detail)
    assert len(buildings(scene)) == count
    assert len(scene.paths["street"]) == 72
    assert set(scene.views) == {"A", "B", "C"}


def test_without_detail_a_building_is_a_box() -> None:
    found = buildings(build(buildings=50, detail=0))
    assert {triangles(b) for b in found} == {12}
    assert len({id(geodes(b)[0].mesh) for b in found}) == 1


def test_more_detail_is_more_triangles_on_the_same_plan() -> None:
    plain, fine = build(buildings=40), build(buildings=40, detail=2)
    assert triangles(fine.root) > 1.5 * triangles(plain.root)
    assert fine.paths == plain.paths
    for a, b in zip(buildings(plain), buildings(fine), strict=True):
        assert np.array_equal(a.matrix, b.matrix)


def test_meshes_are_shared(city: Scene) -> None:
    drawn = geodes(city.root)
    meshes = {id(g.mesh): g.mesh for g in drawn}
    assert len(meshes) < 0.06 * len(drawn)
    assert sum(m.nbytes for m in meshes.values()) < 10e6
    shapes = {id(n.vertices) for n in city.root.walk() if isinstance(n, Occluder)}
    assert len(shapes) < 0.2 * sum(isinstance(n, Occluder) for n in city.root.walk())


def test_the_seed_decides_everything() -> None:
    first = digest(build(buildings=60, seed=4))
    assert digest(build(buildings=60, seed=4)) == first
    assert digest(build(buildings=60, seed=5)) != first


def test_the_city_does_not_depend_on_the_order_of_sets() -> None:
    code = (
        "import importlib.util, sys; spec = importlib.util.spec_from_file_location('t', sys.argv[1]);"
        "t = importlib.util.module_from_spec(spec); spec.loader.exec_module(t); print(t.digest(t.build(buildings=20)))"
    )
    found = set()
    for seed in ("1", "2"):
        run = subprocess.run(
            [sys.executable, "-c", code, __file__],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        )
        found.add(run.stdout)
    assert len(found) == 1


@pytest.mark.parametrize("kind", ["solid", "planar"])
def test_occluders_of_one_kind(kind: str) -> None:
    scene = build(buildings=30, occluders=kind)  # type: ignore[arg-type]
    assert {n.kind for n in scene.root.walk() if isinstance(n, Occluder)} == {kind}
    assert not [n for n in build(buildings=30, occluders="none").root.walk() if isinstance(n, Occluder)]


def test_every_building_owns_a_solid_and_facades(city: Scene) -> None:
    for building in buildings(city):
        kinds = [n.kind for n in building if isinstance(n, Occluder)]
        assert 1 <= kinds.count("solid") <= 2
        assert kinds.count("planar") >= 4
        assert all(n.owner is building for n in building if isinstance(n, Occluder))


def test_the_hierarchy_is_districts_of_blocks_of_buildings(city: Scene) -> None:
    for building in buildings(city):
        block = building.parent
        assert block is not None
        assert block.name.startswith("block ")
        assert block.parent is not None
        assert block.parent.name.startswith("district ")
        assert block.parent.parent is city.root
    assert max(len(n) for n in city.root.walk() if isinstance(n, Group)) < 64


def test_buildings_stand_apart(city: Scene) -> None:
    snapshot = city.snapshot()
    bodies = [row for row, g in enumerate(snapshot.geodes) if g.name == "body"]
    center, half = snapshot.boxes[:2, bodies], snapshot.boxes[3:5, bodies]
    # neighbors within a block are all that can touch: compare each with those near it
    order = np.argsort(center[0])
    center, half = center[:, order], half[:, order]
    for shift in range(1, 60):
        gap = np.abs(center[:, shift:] - center[:, :-shift]) - half[:, shift:] - half[:, :-shift]
        assert (gap.max(axis=0) > 0.25).all()


def test_nothing_stands_in_the_way_of_the_walk(city: Scene) -> None:
    snapshot = city.snapshot()
    solid = {"house", "apartments", "offices", "tower", "car", "lamp"}
    rows = [row for row, g in enumerate(snapshot.geodes) if g.mesh.name in solid]
    boxes = snapshot.boxes[:, rows]
    for view in city.paths["street"]:
        gap = np.abs(boxes[:3] - np.array(view.eye)[:, None]) - boxes[3:]
        assert gap.max(axis=0).min() > 0.5


def test_the_walk_is_at_street_level_and_comes_close_to_facades(city: Scene) -> None:
    street = city.paths["street"]
    eyes = np.array([v.eye for v in street])
    assert len(street) >= 60
    assert np.allclose(eyes[:, 2], 1.7)
    assert np.linalg.norm(np.diff(eyes, axis=0), axis=1).max() < 12
    snapshot = city.snapshot()
    bodies = [row for row, g in enumerate(snapshot.geodes) if g.name == "body"]
    for name, reach in {"A": 4.0, "B": 9.0, "C": 9.0}.items():
        view = city.views[name]
        assert view in street
        gap = np.abs(snapshot.boxes[:2, bodies] - np.array(view.eye[:2])[:, None]) - snapshot.boxes[3:5, bodies]
        assert np.linalg.norm(np.maximum(gap, 0), axis=0).min() < reach


def test_the_overview_sees_the_city_from_above(city: Scene) -> None:
    for view in city.paths["overview"]:
        assert view.eye[2] > 100
        assert view.forward[2] < -0.2


def test_a_layout_fills_lots_from_the_middle(rng: np.random.Generator) -> None:
    layout = lay_out(500, rng)
    blocks, counts = np.unique(layout.block, return_counts=True)
    assert counts.max() <= LOTS
    distance = np.linalg.norm(layout.block_center(blocks), axis=1)
    assert counts[distance < np.median(distance)].min() >= 10
    route, moments = street_walk(layout)
    at = np.array([m.at[:2] for m in moments])
    assert distance_to_line(at, route[:, :2]).max() < 1e-9


@pytest.mark.parametrize(
    ("option", "value"),
    [("buildings", 0), ("detail", 3), ("detail", -1), ("occluders", "walls"), ("views", 1)],
)
def test_options_out_of_range_are_refused(option: str, value: object) -> None:
    with pytest.raises(SceneError, match=f"city: {option}="):
        build(**{option: value})  # type: ignore[arg-type]
