"""What the viewer can show of the stage `query`."""

from __future__ import annotations

from contextlib import closing

import numpy as np
import pytest

import scenegraph as sg
from scenegraph.render.device import Device
from scenegraph.render.window import OffscreenWindow
from scenegraph.testing import wall_scene, wall_views
from scenegraph_query import Query, QueryHistory
from scenegraph_query.overlays import HIDDEN, Asked, ByAge, box_edges

pytestmark = pytest.mark.gl
pytest.importorskip("moderngl")


def frames(stage: sg.Stage, count: int) -> list[sg.Frame]:
    pipeline = sg.Pipeline([stage])
    with OffscreenWindow(320, 240) as window, closing(Device(window)) as device, closing(pipeline):
        pipeline.open(wall_scene().snapshot(), device=device)
        return [pipeline.run(wall_views()[0]) for _ in range(count)]


def test_edges_of_boxes() -> None:
    boxes = np.array([[0, 0, 0, 1, 2, 3], [np.nan, 0, 0, 1, 1, 1]]).T
    edges = box_edges(boxes)
    assert edges.shape == (12, 2, 3)
    lengths = np.linalg.norm(np.diff(edges, axis=1)[:, 0], axis=1)
    assert sorted(lengths.tolist()) == [2.0] * 4 + [4.0] * 4 + [6.0] * 4


@pytest.mark.parametrize("traversal", ["batched", "coherent", "stop_and_wait"])
def test_every_box_that_was_asked_is_shown(traversal: str) -> None:
    for frame in frames(Query(least=1, traversal=traversal), 2):
        history = frame.get(QueryHistory)
        lines = Asked().lines(frame)
        assert sum(len(part.ends) for part in lines) == 12 * len(history.seen) > 0
        seen, hidden = (int(text.split(": ")[1]) for text, _ in Asked().legend(frame))
        assert seen == np.count_nonzero(history.seen)
        assert seen + hidden == len(history.seen)


def test_colors_by_age() -> None:
    all_frames = frames(Query(least=1, period=3), 6)
    for frame in all_frames:
        colors = ByAge().colors(frame)
        assert colors is not None
        assert (colors[~frame.visible, :3] == HIDDEN).all()
        assert not (colors[frame.visible, :3] == HIDDEN).all(axis=1).any()
    ages = all_frames[-1].get(QueryHistory).ages()
    colors = ByAge().colors(all_frames[-1])
    assert colors is not None
    assert len(np.unique(colors[ages >= 0], axis=0)) == len(np.unique(ages[ages >= 0])) > 1
    assert "answers up to 2 frames old" in [text for text, _ in ByAge().legend(all_frames[-1])]


def test_a_skipped_stage_shows_nothing() -> None:
    (frame,) = frames(Query(), 1)
    assert frame.record.stages[0].skipped
    assert Asked().lines(frame) == []
    assert Asked().legend(frame) == []
    assert ByAge().colors(frame) is None
    assert len(ByAge().legend(frame)) == 4
