"""The scenes for inspection: how much hides how much, and where the path goes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scenegraph import Mesh, Scene, SceneError
from scenegraph.scenes.inspection import LAYOUTS, build, figure, session


def world_points(scene: Scene) -> list[np.ndarray]:
    snapshot = scene.snapshot()
    place = snapshot.transforms[snapshot.transform_index]
    meshes = [snapshot.meshes[i] for i in snapshot.mesh_index]
    return [m.vertices @ t[:3, :3].T + t[:3, 3] for m, t in zip(meshes, place, strict=True)]


@pytest.mark.parametrize("depth", LAYOUTS)
def test_scene_has_its_models_and_its_path(depth: str) -> None:
    scene = build(depth=depth, detail=2, views=50)
    rows, columns, _ = LAYOUTS[depth]
    snapshot = scene.snapshot()
    assert snapshot.n == rows * columns
    assert list(scene.paths) == ["inspection"]
    assert len(scene.paths["inspection"]) == 50
    again = build(depth=depth, detail=2, views=50)
    assert np.array_equal(snapshot.boxes, again.snapshot().boxes)


def test_path_goes_from_overviews_to_extreme_close_ups_and_never_into_a_model() -> None:
    scene = build(depth="high", detail=4)
    points = np.concatenate(world_points(scene))
    path = scene.paths["inspection"]
    assert len(path) == 500
    from scipy.spatial import cKDTree

    away, _ = cKDTree(points).query([v.eye for v in path])
    assert (away > [v.near for v in path]).all()
    size = np.linalg.norm(np.ptp(points, axis=0))
    assert away.max() > 0.4 * size
    assert away.min() < 0.03 * size
    # the whole scene is in the first view
    first = path[0]
    planes = first.planes(first.eye)
    assert ((points - first.eye) @ planes[:, :3].T + planes[:, 3] > 0).all()
    # the camera never jumps: from view to view less than half its distance from what it looks at
    eyes, targets = np.array([v.eye for v in path]), np.array([v.target for v in path])
    step = np.linalg.norm(np.diff(eyes, axis=0), axis=1)
    assert (step < 0.5 * np.linalg.norm(eyes - targets, axis=1)[:-1]).all()


def test_depth_complexity_grows() -> None:
    """How many models a line of sight through the middle of the first view meets on average."""
    found = []
    for depth in LAYOUTS:
        scene = build(depth=depth, detail=2, views=2)
        view = scene.paths["inspection"][0].resized(64, 48)
        rects, _, _ = view.box_rects(scene.snapshot().boxes)
        layers = np.zeros((48, 64), int)
        for x0, y0, x1, y1 in np.round(rects.T).astype(int):
            layers[y0:y1, x0:x1] += 1
        found.append(layers[layers > 0].mean())
    assert found[0] < found[1] < found[2]


def test_figures_are_closed_and_as_large_as_asked() -> None:
    mesh = figure(np.random.default_rng(0), 3)
    assert mesh.triangles == 20 * 4**3
    assert np.ptp(mesh.vertices[:, 2]) == pytest.approx(2.0)
    edges = np.sort(mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


def write_obj(path: Path, mesh: Mesh) -> None:
    lines = [f"v {x} {y} {z}" for x, y, z in mesh.vertices] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces]
    path.write_text("\n".join(lines))


def test_models_of_a_folder_are_taken_once_each_at_their_finest(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for name, levels in (("a_fine", 2), ("a_coarse", 1), ("b", 1)):
        write_obj(tmp_path / f"{name}.obj", figure(rng, levels))
    scene = build(depth="middle", model=str(tmp_path), views=4)
    assert {m.name for m in scene.snapshot().meshes} == {"a_fine", "b"}
    single = build(depth="low", model=str(tmp_path / "b.obj"), views=4)
    assert {m.name for m in single.snapshot().meshes} == {"b"}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"depth": "deep"}, "choose low, middle or high"),
        ({"detail": 9}, "choose 0 to 8"),
        ({"views": 1}, "at least 2"),
    ],
)
def test_bad_options_get_one_sentence(options: dict[str, object], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        build(**options)  # type: ignore[arg-type]


def test_a_folder_without_models_gets_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="no model in the folder"):
        build(model=str(tmp_path))


def test_sessions_look_at_a_single_flat_model_too() -> None:
    flat = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float)
    assert all(np.isfinite(v.eye).all() for v in session([flat], count=20))
