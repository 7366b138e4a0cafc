"""The driver: a pipeline inside somebody's renderer, with pictures and cameras as they were."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from drawn_scenes import town, town_views
from scenegraph import Frame, Pipeline, Stage
from scenegraph.render.drawing import Drawing
from scenegraph.render.driver import Driver
from scenegraph.render.window import OffscreenWindow

pytestmark = pytest.mark.gl
pv = pytest.importorskip("pyvista")


class Behind(Stage):
    """Hides what lies behind the eye, of boxes that are small against their distance."""

    name = "behind"

    def run(self, frame: Frame) -> None:
        boxes, view = frame.snapshot.boxes, frame.view
        along = view.forward @ (boxes[:3] - np.asarray(view.eye)[:, None])
        frame.hide(along < -np.linalg.norm(boxes[3:], axis=0))


class Everything(Stage):
    """Hides all."""

    name = "everything"

    def run(self, frame: Frame) -> None:
        frame.hide(np.ones(frame.snapshot.n, bool))


class Broken(Stage):
    """Fails."""

    name = "broken"

    def run(self, frame: Frame) -> None:
        raise RuntimeError("this stage is broken")


class Deep(Stage):
    """Draws depth before VTK draws, and hides nothing."""

    name = "deep"
    needs = ("gl",)

    def run(self, frame: Frame) -> None:
        with frame.device.guard():
            target = frame.device.depth_target(frame.view.width, frame.view.height)
            frame.device.draw_depth(target, frame.view, frame.snapshot)
            frame.count(covered=float(np.count_nonzero(target.read() < 1)))


def made() -> Any:
    rng = np.random.default_rng(0)
    plotter = pv.Plotter(off_screen=True, window_size=(320, 240))
    for _ in range(60):
        ball = pv.Sphere(radius=0.3, center=rng.uniform(-5, 5, 3), theta_resolution=12, phi_resolution=12)
        plotter.add_mesh(ball, color=rng.random(3))
    plotter.add_mesh(pv.Cube(center=(0, 0, 7)), opacity=0.5)
    plotter.add_axes()
    plotter.camera_position = [(0, -1, 0), (0, 5, 1), (0, 0, 1)]
    return plotter


@pytest.fixture
def plotters() -> Iterator[Callable[[], Any]]:
    opened: list[Any] = []

    def make() -> Any:
        opened.append(made())
        return opened[-1]

    yield make
    for plotter in opened:
        plotter.close()


def shot(plotter: Any) -> np.ndarray:
    plotter.show(auto_close=False)  # what render() waits for, and nothing once it was shown
    plotter.render()
    return np.asarray(plotter.screenshot(return_img=True))


def test_pictures_ranges_and_cameras_are_as_without(plotters: Callable[[], Any]) -> None:
    plain, driven = plotters(), plotters()
    driver = Driver(driven, Pipeline([Behind()]))
    for step in range(4):
        assert np.array_equal(shot(plain), shot(driven)), step
        assert driver.off_because == ""
        assert driver.frame is not None
        # from the third step on the whole scene is in front
        assert 0 < driver.frame.visible_count <= driver.snapshot.n - (step < 2)
        for plotter in (plain, driven):
            plotter.camera.Azimuth(50)
            if step == 1:
                plotter.renderer.ResetCameraClippingRange()
            if step == 2:
                plotter.reset_camera()
                plotter.camera.Zoom(3)
        assert plain.camera.GetClippingRange() == driven.camera.GetClippingRange()
        assert plain.camera.GetPosition() == driven.camera.GetPosition()
    shown = [[a.GetVisibility() for a in p.renderer.actors.values()] for p in (plain, driven)]
    assert shown[0] == shown[1]


def test_it_is_the_pipeline_that_decides(plotters: Callable[[], Any]) -> None:
    plain, driven = plotters(), plotters()
    driver = Driver(driven, Pipeline([Everything()]))
    hidden = shot(driven)
    assert not np.array_equal(hidden, shot(plain))
    assert driver.renderer.VisibleActorCount() == plain.renderer.VisibleActorCount() > 50
    driver.detach()
    driver.detach()
    assert np.array_equal(shot(driven), shot(plain))


def test_large_screenshots(plotters: Callable[[], Any]) -> None:
    plain, driven = plotters(), plotters()
    Driver(driven, Pipeline([Behind()]))
    pictures = [np.asarray(p.screenshot(return_img=True, scale=2)) for p in (plain, driven)]
    assert pictures[0].shape == (480, 640, 3)
    assert np.array_equal(*pictures)


def test_gl_stages_leave_vtk_as_it_was(plotters: Callable[[], Any]) -> None:
    pytest.importorskip("moderngl")
    plain, driven = plotters(), plotters()
    driver = Driver(driven, Pipeline([Deep(), Behind()]))
    for _ in range(3):
        assert np.array_equal(shot(plain), shot(driven))
        assert driver.off_because == ""
        assert driver.frame is not None
        assert driver.frame.record.stages[0].counts["covered"] > 100
        for plotter in (plain, driven):
            plotter.camera.Azimuth(70)
    driver.detach()
    assert np.array_equal(shot(plain), shot(driven))


def test_with_shadows_nothing_is_hidden(plotters: Callable[[], Any]) -> None:
    plain, driven = plotters(), plotters()
    driver = Driver(driven, Pipeline([Behind()]))
    for plotter in (plain, driven):
        plotter.enable_shadows()
    assert np.array_equal(shot(plain), shot(driven))
    assert "shadows" in driver.off_because
    for plotter in (plain, driven):
        plotter.disable_shadows()
    assert np.array_equal(shot(plain), shot(driven))
    assert driver.off_because == ""


def test_what_the_snapshot_does_not_know_is_drawn_whole(plotters: Callable[[], Any]) -> None:
    driven = plotters()
    driver = Driver(driven, Pipeline([Everything()]))
    empty = shot(driven)
    ball, other = list(driven.renderer.actors.values())[:2]

    def whole_until_reload(word: str) -> None:
        assert not np.array_equal(shot(driven), empty)
        assert word in driver.off_because
        driver.reload()
        assert np.array_equal(shot(driven), empty)
        assert driver.off_because == ""

    ball.SetPosition(1, 0, 0)
    whole_until_reload("moved")
    ball.SetVisibility(False)
    whole_until_reload("hidden")
    other.mapper.dataset.points[:] *= 1.1
    other.mapper.dataset.Modified()
    whole_until_reload("edited")
    other.mapper.dataset.GetPoints().Modified()
    whole_until_reload("edited")
    # what came later is drawn, and does not stop the culling of the rest
    newcomer = driven.add_mesh(pv.Sphere(), reset_camera=False)
    assert not np.array_equal(shot(driven), empty)
    assert (driver.off_because, driver.added) == ("", 1)
    driver.reload()
    assert np.array_equal(shot(driven), empty)
    driven.remove_actor(newcomer, reset_camera=False)
    whole_until_reload("removed")
    driven.add_mesh(pv.Sphere(), reset_camera=False)
    driver.reload()
    assert np.array_equal(shot(driven), empty)
    # a color is no concern of culling
    driven.renderer.actors[next(reversed(driven.renderer.actors))].prop.color = "red"
    assert np.array_equal(shot(driven), empty)
    assert driver.off_because == ""


def test_a_broken_stage_draws_the_frame_whole_and_says_so(plotters: Callable[[], Any]) -> None:
    plain, driven = plotters(), plotters()
    driver = Driver(driven, Pipeline([Broken(), Everything()]))
    assert np.array_equal(shot(plain), shot(driven))
    assert driver.off_because == "RuntimeError: this stage is broken"


def test_a_tolerant_driver_switches_a_broken_stage_off(plotters: Callable[[], Any]) -> None:
    plain, driven = plotters(), plotters()
    driver = Driver(driven, Pipeline([Broken(), Behind()]), tolerant=True)
    assert np.array_equal(shot(plain), shot(driven))
    assert driver.off_because == ""
    assert driver.failures == {"broken": "RuntimeError: this stage is broken"}
    assert driver.frame is not None
    assert driver.frame.visible_count < driver.snapshot.n


class Unready(Everything):
    """Cannot be prepared."""

    name = "unready"

    def open(self, snapshot: object, progress: object) -> None:
        raise RuntimeError("nothing to prepare from")


def test_a_stage_that_cannot_be_prepared_is_left_out(plotters: Callable[[], Any]) -> None:
    plain, driven = plotters(), plotters()
    driver = Driver(driven, Pipeline([Unready(), Behind()]), tolerant=True)
    assert np.array_equal(shot(plain), shot(driven))
    assert driver.failures == {"unready": "RuntimeError: nothing to prepare from"}
    assert driver.pipeline.text == "behind"


class Slow(Everything):
    """Takes its time to prepare."""

    name = "slow"
    go = threading.Event()

    def open(self, snapshot: object, progress: Callable[[str, float], None]) -> None:
        progress("thinking", 0.25)
        assert self.go.wait(30)


def test_preparing_in_the_background_draws_meanwhile(plotters: Callable[[], Any]) -> None:
    plain, driven = plotters(), plotters()
    Slow.go.clear()
    driver = Driver(driven, Pipeline([Slow()]), background=True)
    assert np.array_equal(shot(plain), shot(driven))
    # the other stages run meanwhile, if they need nothing prepared
    assert not driver.pump(0.0)
    assert driver.preparing == "thinking: 25%"
    Slow.go.set()
    assert driver.pump(30)
    assert not np.array_equal(shot(plain), shot(driven))
    assert driver.preparing == ""
    driver.detach()


def test_a_held_frame_is_drawn_whatever_the_camera_does(plotters: Callable[[], Any]) -> None:
    driven = plotters()
    driver = Driver(driven, Pipeline([Behind()]))
    shot(driven)
    driver.held = held = driver.frame
    driven.camera.Azimuth(120)
    shot(driven)
    assert driver.frame is held
    driver.held = None
    shot(driven)
    assert driver.frame is not None
    assert not np.array_equal(driver.frame.visible, held.visible)


def test_cameras_that_a_view_cannot_express(plotters: Callable[[], Any]) -> None:
    driven = plotters()
    driver = Driver(driven, Pipeline([Everything()]))
    empty = shot(driven)
    driven.camera.SetUseHorizontalViewAngle(True)
    assert not np.array_equal(shot(driven), empty)
    assert "horizontal" in driver.off_because
    driven.camera.SetUseHorizontalViewAngle(False)
    driven.camera.SetViewShear(0.1, 0, 1)
    shot(driven)
    assert "sheared" in driver.off_because


def test_a_drawing_of_ours_is_culled_and_put_back(window: OffscreenWindow) -> None:
    snapshot, view = town().snapshot(), town_views()["street"]
    view = view.moved(eye=(6, -30, 2))
    drawing = Drawing(snapshot, window.renderer)
    window.draw(view)
    image, bounds = window.image(), window.renderer.ComputeVisiblePropBounds()
    driver = Driver(window.renderer, Pipeline([Behind()]), drawing=drawing)
    for _ in range(2):
        window.draw(view)
        assert np.array_equal(window.image(), image)
        assert driver.frame is not None
        assert driver.frame.visible_count < snapshot.n
        assert driver.frame.view.eye == view.eye
        assert window.renderer.ComputeVisiblePropBounds() == bounds
