"""`scenegraph view` on real models, and what it writes: pictures, movies and the table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from scenegraph import Pipeline, Registry, Scene
from scenegraph.render.drawing import Drawing
from scenegraph.render.window import OffscreenWindow
from scenegraph.viewer import command
from scenegraph.viewer.command import run_view
from scenegraph.viewer.window import ViewerWindow

pytestmark = pytest.mark.gl


@pytest.mark.data
@pytest.mark.parametrize("name", ["scenes/virtual_city.glb", "scenes/duplex_building.glb", "city/delft_3dfier.obj"])
def test_a_model_is_shown_as_a_suite_draws_it(data_dir: Path, name: str) -> None:
    scene = Scene.load(data_dir / name)
    snapshot = scene.snapshot()
    pipelines = [Pipeline.parse("frustum"), Pipeline.parse("none")]
    viewer = ViewerWindow(snapshot, pipelines, Registry(), size=(400, 300), off_screen=True)
    viewer.plotter.show(auto_close=False)
    viewer.press("Home")
    first = viewer.session.view
    hidden = 0
    with OffscreenWindow(400, 300, scene.background) as suite:
        drawing = Drawing(snapshot, suite.renderer)
        with Pipeline.parse("frustum").open(snapshot) as pipeline:
            # from outside, and from near by to one side
            middle, corner = snapshot.boxes[:3].mean(axis=1), (snapshot.boxes[:3] + snapshot.boxes[3:]).max(axis=1)
            for view in (first, first.moved(eye=0.2 * np.asarray(first.eye) + 0.8 * middle, target=corner)):
                viewer.session.view = view
                frame = pipeline.run(view)
                drawing.apply(frame)
                suite.draw(view)
                picture = viewer.session.picture()
                assert np.array_equal(picture, suite.image())
                assert view is not first or len(np.unique(picture.reshape(-1, 3), axis=0)) > 5
                hidden += snapshot.n - frame.visible_count
    assert hidden > 0
    viewer.close()


def test_what_a_replay_writes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    scene = Registry().scene("city").build(buildings=60, views=4)
    monkeypatch.setattr(command, "find_scene", lambda *_: scene)
    options = {"pipelines": ["frustum"], "path": "street", "size": (160, 120)}
    run_view("city", movie=tmp_path / "walk.gif", **options)
    with Image.open(tmp_path / "walk.gif") as movie:
        assert movie.n_frames == len(scene.paths["street"])
        assert movie.size == (160, 120)
    run_view("city", picture=tmp_path / "first.png", **options)
    assert np.asarray(Image.open(tmp_path / "first.png")).std() > 10
    run_view("city", benchmark=True, **options)
    printed = capsys.readouterr().out
    assert f"{len(scene.paths['street'])} views" in printed
    assert "frustum" in printed
    assert "none" in printed
