"""What the stage `hom` hands on: the occlusion map and the level of visibility."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import scenegraph as sg
import scenegraph_hom
from scenegraph import LevelOfVisibility
from scenegraph.testing import box_at, wall_scene, wall_views
from scenegraph_hom import Hom, OcclusionMap


def run(scene: sg.Scene | sg.Snapshot, view: sg.View, **values: Any) -> sg.Frame:
    snapshot = scene.snapshot() if isinstance(scene, sg.Scene) else scene
    with sg.Pipeline([Hom(least=1, **values)]).open(snapshot) as pipeline:
        return pipeline.run(view)


def hidden(frame: sg.Frame) -> set[str]:
    return {g.name for g, v in zip(frame.snapshot.geodes, frame.visible, strict=True) if not v}


def names(scene: sg.Scene, start: str) -> set[str]:
    return {g.name for g in scene.snapshot().geodes if g.name.startswith(start)}


# Products


def test_the_map_tells_what_it_covers_and_how_far() -> None:
    scene = sg.Scene().add(box_at((0, 0, 0), (4, 2, 2), name="box"), box_at((0, 5, 0), 0.1, color=(1, 1, 1, 0.5)))
    view = sg.View((0, -10, 0), (0, 0, 0), parallel_scale=4, width=320, height=160)
    occlusion = run(scene, view, width=64, height=32).get(OcclusionMap)
    # 8 texels a unit, upright: 4 × 2 units without what the border touches
    assert occlusion.size == (64, 32)
    expected = np.zeros((32, 64), bool)
    expected[13:19, 25:39] = True
    assert occlusion.covered[expected].all()
    assert occlusion.covered.sum() <= 16 * 32
    assert occlusion.depth()[16, 32] == pytest.approx(9, abs=0.01)
    assert occlusion.depth()[0, 0] == np.inf
    assert np.array_equal(occlusion.picture(), np.where(occlusion.covered[::-1], 255, 0))
    assert occlusion.counts[-1].tolist() == [[occlusion.covered.sum()]]
    assert occlusion.sums[-1, -1] == occlusion.covered.sum()
    assert not occlusion.declared.size
    assert len(occlusion.rows) == 1


def test_visibility_of_hidden_free_and_partly_covered_things() -> None:
    scene = sg.Scene().add(box_at((0, 0, 0), (6, 0.5, 6), name="wall"))
    scene.add(
        box_at((0, 4, 0), 2.0, name="hidden"), box_at((-30, 30, 0), 2.0, name="free"), box_at((0, -6, 0), name="front")
    )
    scene.add(box_at((3.5, 5, 0), 3.0, name="half"))
    scene.add(box_at((0, -12, 0), 3.0, name="around the eye", color=(1, 1, 1, 0.1)))
    frame = run(scene, sg.View((0, -12, 0), (0, 0, 0), fov=90))
    values = dict(zip([g.name for g in frame.snapshot.geodes], frame.get(LevelOfVisibility).values, strict=True))
    assert values["hidden"] == 1.0
    assert values["free"] == values["front"] == values["around the eye"] == -1.0
    # something small stands before it; it does not stand before itself
    assert -1.0 < values["wall"] < -0.5
    assert -1.0 <= values["half"] < 1.0
    assert hidden(frame) == {"hidden"}


def slats(count: int, width: float = 4.0) -> list[sg.Geode]:
    """A fence that covers half of its area, with this many slats."""
    step = width / count
    return [box_at((-width / 2 + (i + 0.25) * step, 0, 0), (step / 2, 0.05, 4), name="slat") for i in range(count)]


def test_small_gaps_show_less_than_large_ones() -> None:
    """Figure 3.1 by the stage: equal visible area, higher level of visibility value behind many small gaps."""
    view = sg.View((0, -20, 0), (0, 0, 0), parallel_scale=3, width=512, height=256)
    value, share = {}, {}
    for count in (1, 2, 8):
        scene = sg.Scene().add(*slats(count), box_at((0, 3, 0), (3.9, 1, 3.9), name="behind"))
        frame = run(scene, view, strict=False)
        row = [g.name for g in frame.snapshot.geodes].index("behind")
        value[count] = frame.get(LevelOfVisibility).values[row]
        occlusion = frame.get(OcclusionMap)
        x0, y0, x1, y1 = occlusion.footprint(frame.snapshot.boxes[:, [row]]).texels[:, 0]
        share[count] = occlusion.covered[y0:y1, x0:x1].mean()
    assert share[1] == pytest.approx(share[8], abs=0.03)
    assert value[8] > value[2] + 0.2
    assert value[8] > value[1] + 0.2


def test_in_the_thesis_way_occluders_are_seen_in_full() -> None:
    scene = sg.Scene().add(*slats(6), box_at((0, 3, 0), (3.9, 1, 3.9), name="behind"))
    view = sg.View((0, -20, 0), (0, 0, 0), parallel_scale=3)
    frame = run(scene, view, strict=False, depth="distance", ranking="distance", reach=20.5)
    values = frame.get(LevelOfVisibility).values
    for geode, value in zip(frame.snapshot.geodes, values, strict=True):
        assert (value == -1.0) == (geode.name == "slat")


def test_the_block_of_an_object_is_what_its_value_comes_from() -> None:
    scene = sg.Scene().add(*slats(8), box_at((0, 3, 0), (3.9, 1, 3.9), name="behind"))
    scene.add(box_at((0, -20, 0), 1.0, name="around the eye", color=(1, 1, 1, 0.1)))
    view = sg.View((0, -20, 0), (0, 0, 0), fov=20)
    frame = run(scene, view, strict=False)
    occlusion, values = frame.get(OcclusionMap), frame.get(LevelOfVisibility).values
    for row, geode in enumerate(frame.snapshot.geodes):
        block = occlusion.block(frame.snapshot.boxes[:, row])
        if geode.name == "around the eye":
            assert block is None
            continue
        assert block is not None
        x0, y0, x1, y1 = block.cells
        assert block.opacity.shape == (y1 - y0, x1 - x0)
        assert 0.0 <= block.opacity.min() <= block.opacity.max() <= 1.0
        assert block.visibility == pytest.approx(values[row], abs=1e-6)
        f00, f10, f01, f11 = block.coefficients
        area = (x1 - x0) * (y1 - y0)
        assert f00 == pytest.approx((block.opacity - 0.5).sum() / np.sqrt(area))
        printed = (f00 - abs(f10) - abs(f01) - abs(f11)) / (0.5 * np.sqrt(area))
        assert block.visibility == pytest.approx(np.clip(printed, -1, 1))


def test_the_figure_of_a_block_shows_its_numbers() -> None:
    scene = sg.Scene().add(*slats(8), box_at((0, 3, 0), (3.9, 1, 3.9), name="behind"))
    frame = run(scene, sg.View((0, -20, 0), (0, 0, 0), fov=20), strict=False)
    occlusion = frame.get(OcclusionMap)
    row = [g.name for g in frame.snapshot.geodes].index("behind")
    box = frame.snapshot.boxes[:, row]
    block = occlusion.block(box)
    assert block is not None
    whole, cells, bars = scenegraph_hom.plot_block(occlusion, box).axes
    assert np.array_equal(whole.images[0].get_array(), occlusion.picture())
    assert np.array_equal(cells.images[0].get_array(), block.opacity)
    assert [bar.get_height() for bar in bars.patches] == pytest.approx(list(block.coefficients))
    assert bars.get_title() == f"level of visibility {block.visibility:+.2f}"
    with pytest.raises(ValueError, match="near plane"):
        scenegraph_hom.plot_block(occlusion, np.array([0, -20, 0, 1, 1, 1.0]))


def test_visibility_is_worked_out_only_when_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    monkeypatch.setattr("scenegraph_hom.hom.map_visibility", lambda *a: calls.append(a) or np.zeros(a[1].shape[1]))
    frame = run(wall_scene(), wall_views()[0])
    assert not calls
    visibility = frame.get(LevelOfVisibility)
    assert visibility.values is visibility.values
    assert len(calls) == 1
