"""The foliage: holes of equal area, and as much to be seen of both objects."""

from __future__ import annotations

import numpy as np
import pytest

from scenegraph import Geode, Scene, SceneError
from scenegraph.scenes.foliage import PANEL, build, panel, small_holes


def area(geode: Geode) -> float:
    a, b, c = (geode.mesh.vertices[geode.mesh.faces[:, i]] for i in range(3))
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def sheet(scene: Scene, name: str) -> Geode:
    found = scene.root.find(name)
    assert isinstance(found, Geode)
    return found


@pytest.mark.parametrize("part", [0.1, 0.3, 0.5])
def test_holes_have_the_same_area(part: float) -> None:
    scene = build(ceiling=1, part=part)
    wall, tree = (4 * PANEL**2 - area(sheet(scene, name)) for name in ("wall", "tree"))
    assert wall == pytest.approx(tree, rel=1e-9)
    assert wall > 0.5 * part


def test_a_panel_is_one_flat_piece_without_gaps(rng: np.random.Generator) -> None:
    mesh = panel(5, small_holes(np.array([-1.0, -0.5, 0.8, 1.0]), 5, 0.3, rng))
    assert np.ptp(mesh.vertices[:, 1]) == 0
    edges = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    used = np.unique(edges, axis=0, return_counts=True)[1]
    # four sides of each hole and of the panel's border are used once, all others twice
    assert sorted(np.unique(used).tolist()) == [1, 2]
    assert (used == 1).sum() == 4 * 25 + 4 * 7


@pytest.mark.gl
def test_as_many_pixels_of_both_objects_can_be_seen() -> None:
    from scenegraph.render.item_buffer import ItemBuffer

    snapshot = build(ceiling=8).snapshot()
    buffer = ItemBuffer(snapshot)
    seen = {}
    for name, view in snapshot.scene.views.items():
        row = next(r for r, g in enumerate(snapshot.geodes) if g.name.endswith(f"the {name}"))
        seen[name] = int(buffer.render(view.resized(1024, 768)).pixels[row])
    buffer.close()
    assert seen["wall"] > 5000
    assert seen["tree"] == pytest.approx(seen["wall"], rel=0.1)


@pytest.mark.parametrize(
    ("option", "value"), [("ceiling", 0), ("ceiling", 21), ("holes", 0), ("holes", 65), ("part", 0.0), ("part", 0.95)]
)
def test_options_out_of_range_are_refused(option: str, value: float) -> None:
    with pytest.raises(SceneError, match=f"foliage: {option}="):
        build(**{option: value})  # type: ignore[arg-type]
