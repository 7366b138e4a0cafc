"""The scatter: copies of one mesh with a free corridor into their middle."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from scenegraph import Geode, Group, Mesh, Occluder, Scene, SceneError, Transform
from scenegraph.scenes.scatter import build, knot, one_mesh, pebble


def copies(scene: Scene) -> list[Geode]:
    return [n for n in scene.root.walk() if isinstance(n, Geode)]


@pytest.mark.parametrize("count", [1, 7, 1000])
def test_there_are_count_copies_of_one_mesh(count: int) -> None:
    found = copies(build(count=count))
    assert len(found) == count
    assert len({id(g.mesh) for g in found}) == 1


def test_the_default_is_about_a_million_triangles() -> None:
    assert 1e6 <= sum(g.mesh.triangles for g in copies(build())) <= 2e6


def test_density_does_not_depend_on_the_count() -> None:
    for count in (100, 3000):
        places = np.array([g.parent.matrix[:3, 3] for g in copies(build(count=count))])  # type: ignore[union-attr]
        assert np.prod(np.ptp(places, axis=0)) / count == pytest.approx(1000.0, rel=0.25)


@pytest.mark.parametrize("mesh", ["pebble", "knot"])
def test_the_flight_hits_nothing(mesh: str) -> None:
    scene = build(count=2000, mesh=mesh)
    found = copies(scene)
    place = np.array([g.parent.matrix[:3, 3] for g in found])  # type: ignore[union-attr]
    size = np.array([np.linalg.norm(g.parent.matrix[:3, 0]) for g in found])  # type: ignore[union-attr]
    radius = size * np.linalg.norm(found[0].mesh.vertices, axis=1).max()
    for view in scene.paths["orbit"] + scene.paths["enter"]:
        assert (np.linalg.norm(place - view.eye, axis=1) - radius).min() > 0.1


def test_the_same_seed_gives_the_same_scene() -> None:
    def state(seed: int) -> list[tuple[str, bytes, object]]:
        return [(g.mesh.key, g.parent.matrix.tobytes(), g.color) for g in copies(build(count=50, seed=seed))]  # type: ignore[union-attr]

    assert state(2) == state(2)
    assert state(2) != state(3)


def test_copies_are_rotated_not_sheared() -> None:
    for geode in copies(build(count=30)):
        assert isinstance(geode.parent, Transform)
        linear = geode.parent.matrix[:3, :3]
        size = np.cbrt(np.linalg.det(linear))
        assert 1 <= size <= 3
        assert np.allclose(linear @ linear.T, size**2 * np.eye(3))


def test_every_pebble_owns_its_core(rng: np.random.Generator) -> None:
    scene = build(count=20)
    owned = [n for n in scene.root.walk() if isinstance(n, Occluder)]
    assert len(owned) == 20
    assert all(isinstance(n.owner, Transform) and isinstance(n.owner.children[0], Geode) for n in owned)
    mesh, core = pebble(rng)
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces)
    assert solid.is_watertight
    a = mesh.vertices[mesh.faces[:, 0]]
    # star-shaped about its center, so inside every face plane is inside
    assert (solid.face_normals * a).sum(axis=1).min() > np.linalg.norm(core.vertices, axis=1).max()
    assert solid.volume > 0


def test_the_knot_is_one_closed_tube_in_the_unit_ball() -> None:
    mesh = knot()
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert solid.is_watertight
    assert solid.volume > 0
    assert np.linalg.norm(mesh.vertices, axis=1).max() < 1


def test_a_model_is_centered_and_scaled(tmp_path: Path) -> None:
    file = tmp_path / "far.ply"
    trimesh.creation.box((2, 4, 6), transform=trimesh.transformations.translation_matrix((1e6, 0, 3))).export(file)
    scene = build(count=5, model=str(file))
    mesh = copies(scene)[0].mesh
    assert mesh.triangles == 12
    assert np.allclose(mesh.bounds, np.array([[-1, -2, -3], [1, 2, 3]]) / np.sqrt(14), atol=1e-6)
    assert not [n for n in scene.root.walk() if isinstance(n, Occluder)]


def test_parts_of_a_model_keep_their_colors() -> None:
    red = Geode(Mesh.box((0, 0, 0), (1, 1, 1)), color=(1, 0, 0))
    blue = Transform(Geode(Mesh.box((0, 0, 0), (1, 1, 1)), color=(0, 0, 1)), translation=(3, 0, 0))
    mesh = one_mesh(Scene(Group(red, blue)))
    assert mesh.triangles == 24
    assert mesh.vertex_colors is not None
    left = mesh.vertices[:, 0] < 0
    assert (mesh.vertex_colors[left] == (255, 0, 0, 255)).all()
    assert (mesh.vertex_colors[~left] == (0, 0, 255, 255)).all()


def test_a_model_without_finite_bounds_is_refused() -> None:
    nothing = Scene(Group(Geode(Mesh([[np.nan, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))))
    with pytest.raises(SceneError, match="finite bounds"):
        one_mesh(nothing)


@pytest.mark.parametrize(
    ("option", "value"), [("count", 0), ("spacing", 0.0), ("spacing", float("nan")), ("mesh", "teapot")]
)
def test_options_out_of_range_are_refused(option: str, value: object) -> None:
    with pytest.raises(SceneError, match=f"scatter: {option}="):
        build(**{option: value})  # type: ignore[arg-type]
