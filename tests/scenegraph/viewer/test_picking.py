"""Picking: the row under a pixel, against the item buffer where there is one."""

from __future__ import annotations

import numpy as np
import pytest

import scenegraph as sg
from drawn_scenes import FAR, town, town_views
from scenegraph.testing import box_at
from scenegraph.viewer.picking import row_at


def test_what_is_nearest_is_picked_and_what_is_hidden_is_not() -> None:
    scene = sg.Scene().add(box_at((0, 0, 0), name="front"), box_at((0, 4, 0), 3.0, name="back"))
    snapshot = scene.snapshot()
    view = sg.View((0, -10, 0), (0, 0, 0), width=200, height=100)
    frame = sg.Frame(snapshot, view)
    row = {g.name: r for r, g in enumerate(snapshot.geodes)}
    assert row_at(frame, 100, 50) == row["front"]
    assert row_at(frame, 100, 57.5) == row["back"]
    assert row_at(frame, 5, 5) is None
    frame.hide([row["front"]])
    assert row_at(frame, 100, 50) == row["back"]


def test_an_empty_scene_and_boxes_that_are_no_numbers() -> None:
    view = sg.View((0, -10, 0), (0, 0, 0))
    assert row_at(sg.Frame(sg.Scene().snapshot(), view), 1, 1) is None
    broken = sg.Mesh([(np.nan, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    assert row_at(sg.Frame(sg.Scene().add(sg.Geode(broken)).snapshot(), view), 640, 360) is None


@pytest.mark.gl
@pytest.mark.parametrize("name", ["above", "parallel", "inside"])
def test_the_item_buffer_agrees(name: str) -> None:
    from scenegraph.render.item_buffer import ItemBuffer

    snapshot, view = town(FAR, translucent=False).snapshot(), town_views(FAR)[name]
    ids = ItemBuffer(snapshot).render(view).ids
    frame = sg.Frame(snapshot, view)
    rng = np.random.default_rng(3)
    differ = 0
    for x, y in rng.integers(0, [view.width, view.height], (60, 2)).tolist():
        found = row_at(frame, x + 0.5, y + 0.5)
        differ += (-1 if found is None else found) != ids[view.height - 1 - y, x]
    assert differ <= 2
