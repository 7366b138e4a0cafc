"""What the viewer can show of the stage `shadow`."""

from __future__ import annotations

import numpy as np
import pytest

import scenegraph as sg
from scenegraph.testing import wall_scene, wall_views
from scenegraph_shadow import Shadow, ShadowFrusta
from scenegraph_shadow.overlays import ByOccluder, Shadows, hidden_by_occluder, silhouette
from shadow_scenes import run, street_views, town


@pytest.mark.parametrize("options", [{}, {"parallel_scale": 8.0}], ids=str)
def test_wall_is_outlined_and_its_shadow_drawn(options: dict[str, float]) -> None:
    (frame,) = run(Shadow(), wall_scene().snapshot(), wall_views(**options)[0])
    outline, rays = Shadows().lines(frame)
    assert np.ptp(outline.ends.reshape(-1, 3), axis=0)[[0, 2]] == pytest.approx([8, 6])
    way = np.diff(rays.ends, axis=1)[:, 0]
    from_eye = np.broadcast_to(frame.view.forward, way.shape) if options else rays.ends[:, 0] - frame.view.eye
    assert np.allclose(np.cross(way, from_eye), 0, atol=1e-9)
    assert ((way * from_eye).sum(axis=1) > 0).all()
    for faces in Shadows().faces(frame):
        assert 0 <= faces.triangles.min() <= faces.triangles.max() < len(faces.points)


def test_what_it_hides_has_its_color() -> None:
    (frame,) = run(Shadow(), wall_scene().snapshot(), wall_views()[0])
    colors = ByOccluder().colors(frame)
    assert colors is not None
    hidden = np.unique(colors[~frame.visible], axis=0)
    assert len(hidden) == 1
    assert not (colors[frame.visible] == hidden).all(axis=1).any()
    assert "solid: 15" in [text for text, _ in ByOccluder().legend(frame)]


def test_every_hidden_row_is_put_down_to_one_that_hides_it() -> None:
    snapshot = town(300).snapshot()
    for frame in run(Shadow(active=30), snapshot, *street_views(6)):
        frusta = frame.get(ShadowFrusta)
        rows = np.flatnonzero(~frame.visible)
        rank = hidden_by_occluder(frusta, frame, rows)
        assert frusta.hides(snapshot.boxes[:, rows])[rank, np.arange(len(rows))].all()
        owner = frusta.owner[rank]
        assert not ((rows >= owner[:, 0]) & (rows < owner[:, 1])).any()
        colors = ByOccluder().colors(frame)
        assert colors is not None
        assert colors.shape == (snapshot.n, 4)


def test_silhouettes_are_closed() -> None:
    table = town(50).snapshot().occluders
    for number in range(len(table)):
        edges = silhouette(table, number, np.array([100.0, -70.0, 30.0]), None)
        assert (np.unique(edges, return_counts=True)[1] == 2).all()
        assert len(edges) in ((4, 6) if table.solid[number] else (4,))


def test_nothing_to_show_without_the_stage() -> None:
    with sg.Pipeline([]).open(wall_scene().snapshot()) as pipeline:
        frame = pipeline.run(wall_views()[0])
    assert ByOccluder().colors(frame) is None
    assert ByOccluder().legend(frame) == []
    assert Shadows().lines(frame) == []
    assert Shadows().faces(frame) == []
