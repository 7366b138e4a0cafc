"""The bunnies: exact numbers of triangles, one set of meshes, and a flight that is free."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from data_files import require_data
from scenegraph import Lod, Scene, SceneError, Transform, registry
from scenegraph.scenes.bunnies import dense, sparse
from scenegraph.scenes.rabbit import bunny, closed, reduced
from scenegraph.scenes.shapes import icosphere


def bunnies(scene: Scene) -> list[Lod]:
    return [n for n in scene.root.walk() if isinstance(n, Lod)]


def unbalanced_edges(faces: np.ndarray) -> int:
    """Edges that are not passed as often in one direction as in the other."""
    half = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    edges, of = np.unique(np.sort(half, axis=1), axis=0, return_inverse=True)
    return int((np.bincount(of.ravel(), np.where(half[:, 0] < half[:, 1], 1, -1), minlength=len(edges)) != 0).sum())


@pytest.mark.parametrize(("build", "triangles"), [(dense, 294_058_800), (sparse, 588_058_800)])
def test_triangles_of_the_thesis(build, triangles) -> None:
    snapshot = build(ceiling=20).snapshot()
    assert int(snapshot.triangles[0].sum(dtype=np.int64)) == triangles
    assert (snapshot.triangles[:, 0] == [98 * (3 * n * n // 2) for n in range(20, 0, -1)]).all()
    assert len(snapshot.meshes) == 20
    assert (np.diff(snapshot.errors[:, 0]) >= 0).all()


def test_they_are_found_by_name() -> None:
    scenes = registry().scenes
    assert {"bunnies-5001", "bunnies-10001", "foliage"} <= set(scenes)
    assert scenes["bunnies-5001"].build(count=10, ceiling=1).name == "bunnies-5001"


def test_they_turn_about_x_and_only_the_sparse_ones_differ_in_size() -> None:
    for scene, sizes in ((dense(count=40), (1, 1)), (sparse(count=40), (0.5, 1.5))):
        for lod in bunnies(scene):
            assert isinstance(lod.parent, Transform)
            linear = lod.parent.matrix[:3, :3]
            size = np.cbrt(np.linalg.det(linear))
            assert sizes[0] - 1e-9 <= size <= sizes[1] + 1e-9
            assert np.allclose(linear[:, 0], [size, 0, 0])
            assert np.allclose(linear @ linear.T, size**2 * np.eye(3))


@pytest.mark.parametrize("build", [dense, sparse])
def test_the_flight_hits_nothing_and_begins_with_everything_in_view(build) -> None:
    scene = build(count=3000, ceiling=1)
    snapshot = scene.snapshot()
    place = np.array([lod.parent.matrix[:3, 3] for lod in bunnies(scene)])
    size = np.array([np.cbrt(np.linalg.det(lod.parent.matrix[:3, :3])) for lod in bunnies(scene)])
    views = [v for path in scene.paths.values() for v in path]
    assert len(views) == 150
    for view in views:
        assert (np.linalg.norm(place - view.eye, axis=1) - size).min() > view.near
    step = np.linalg.norm(np.diff([v.eye for v in views], axis=0), axis=1)
    assert step.max() < 0.15 * np.ptp(place)
    outside = next(iter(scene.paths.values()))
    for view in outside if build is dense else outside[:1]:
        rects, _, crossing = view.resized(1024, 768).box_rects(snapshot.boxes)
        assert not crossing.any()
        assert ((rects[2] > rects[0]) & (rects[3] > rects[1])).all()


def test_the_same_seed_gives_the_same_scene() -> None:
    def places(seed: int) -> bytes:
        return b"".join(lod.parent.matrix.tobytes() for lod in bunnies(dense(count=30, ceiling=1, seed=seed)))

    assert places(2) == places(2)
    assert places(2) != places(3)


@pytest.mark.parametrize(
    ("option", "value"),
    [("ceiling", 0), ("ceiling", 21), ("count", 0), ("spacing", 0.0), ("spacing", float("nan"))],
)
def test_options_out_of_range_are_refused(option, value) -> None:
    for build in (dense, sparse):
        with pytest.raises(SceneError, match=f"bunnies: {option}="):
            build(**{option: value})


# The bunny


def test_the_stand_in_is_a_closed_surface_of_98_triangles() -> None:
    mesh = bunny()
    assert mesh.triangles == 98
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert solid.is_watertight
    assert solid.volume > 0
    assert np.linalg.norm(mesh.vertices, axis=1).max() == pytest.approx(1)


@pytest.mark.data
@pytest.mark.parametrize("name", ["bunny.ply", "bunny_res4.ply", "armadillo_30k.ply"])
def test_models_are_brought_to_98_triangles(name) -> None:
    mesh = bunny(str(require_data() / "meshes" / name))
    assert mesh.triangles == 98
    assert np.linalg.norm(mesh.vertices, axis=1).max() == pytest.approx(1)
    if name == "bunny.ply":
        assert unbalanced_edges(mesh.faces) == 0
        assert trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).volume > 0


@pytest.mark.parametrize("count", [4, 20, 40, 98, 320, 322, 400])
def test_surfaces_are_brought_to_any_even_number(count) -> None:
    points, faces = icosphere(2)
    found, triangles = reduced(points, faces, count)
    assert len(triangles) == count
    assert unbalanced_edges(triangles) == 0
    assert len(np.unique(triangles)) == len(found)


def test_an_odd_number_of_triangles_is_refused_for_a_closed_surface_and_made_of_an_open_one() -> None:
    points, faces = icosphere(1)
    with pytest.raises(SceneError, match="cannot be brought to 99"):
        reduced(points, faces, 99)
    assert len(reduced(points, faces[1:], 99)[1]) == 99


def test_holes_are_filled_and_what_is_inside_out_is_turned() -> None:
    points, faces = icosphere(2)
    pierced = np.delete(faces, [10, 200], axis=0)
    for given in (pierced, pierced[:, ::-1]):
        whole, triangles = closed(points, given)
        assert unbalanced_edges(triangles) == 0
        assert trimesh.Trimesh(whole, triangles, process=False).volume > 0
