"""`plotter.scenegraph`: faster, and not one pixel, pick or bound different."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from scenegraph import PipelineError, SceneError

vtk = pytest.importorskip("vtkmodules.vtkRenderingCore")
vtkCellPicker, vtkHardwareSelector = vtk.vtkCellPicker, vtk.vtkHardwareSelector  # noqa: N816

pytestmark = pytest.mark.gl
pv = pytest.importorskip("pyvista")


def fill(plotter: Any, *, seed: int = 0) -> None:
    """Balls around the eye, one of them translucent, some behind."""
    rng = np.random.default_rng(seed)
    for i in range(60):
        ball = pv.Sphere(radius=0.35, center=rng.uniform(-5, 5, 3), theta_resolution=14, phi_resolution=14)
        plotter.add_mesh(ball, color=rng.random(3), opacity=0.4 if i % 6 == 0 else 1.0, show_edges=i % 7 == 0)
    plotter.add_text("a title", font_size=8)
    plotter.camera_position = [(0, -1, 0), (0.4, 5, 1), (0, 0, 1)]


@pytest.fixture
def made() -> Iterator[Callable[..., Any]]:
    opened: list[Any] = []

    def make(change: Callable[[Any], None] = lambda plotter: None, **options: Any) -> Any:
        plotter = pv.Plotter(off_screen=True, window_size=(300, 220), **options)
        opened.append(plotter)
        rows, columns = plotter.shape
        for row in range(rows):
            for column in range(columns):
                plotter.subplot(row, column)
                fill(plotter, seed=row * columns + column)
                change(plotter)
        plotter.show(auto_close=False)
        return plotter

    yield make
    for plotter in opened:
        plotter.close()


def shot(plotter: Any, **options: Any) -> np.ndarray:
    plotter.render()
    return np.asarray(plotter.screenshot(return_img=True, **options))


def turn(*plotters: Any) -> None:
    for plotter in plotters:
        for renderer in plotter.renderers:
            renderer.camera.Azimuth(40)
            renderer.ResetCameraClippingRange()


MODES: dict[str, tuple[dict[str, Any], Callable[[Any], None]]] = {
    "plain": ({}, lambda p: None),
    "without multisampling": ({}, lambda p: p.disable_anti_aliasing()),
    "multisampling": ({}, lambda p: p.enable_anti_aliasing("msaa", multi_samples=8)),
    "depth peeling": ({}, lambda p: p.enable_depth_peeling()),
    "parallel": ({}, lambda p: p.enable_parallel_projection()),
    "subplots": ({"shape": (1, 2)}, lambda p: None),
}


@pytest.mark.parametrize("mode", MODES)
def test_no_pixel_differs(made: Callable[..., Any], mode: str) -> None:
    options, change = MODES[mode]
    plain, culled = made(change, **options), made(change, **options)
    culled.scenegraph.enable("frustum")
    hidden = 0
    for _ in range(3):
        assert np.array_equal(shot(plain), shot(culled))
        for driver in culled.scenegraph.drivers:
            assert driver.off_because == ""
            hidden += driver.snapshot.n - driver.frame.visible_count
        turn(plain, culled)
    assert len(culled.scenegraph.drivers) == len(culled.renderers)
    assert hidden > 30 * len(culled.scenegraph.drivers)
    assert np.array_equal(shot(plain, scale=2), shot(culled, scale=2))


def test_with_shadows_hidden_casters_still_cast(made: Callable[..., Any]) -> None:
    def light(plotter: Any) -> None:
        plotter.enable_shadows()

    plain, culled = made(light), made(light)
    culled.scenegraph.enable("frustum")
    assert np.array_equal(shot(plain), shot(culled))
    assert "shadows" in culled.scenegraph.status


def test_disabling_restores_everything(made: Callable[..., Any]) -> None:
    plain, culled = made(), made()
    visible = [a.GetVisibility() for a in plain.renderer.actors.values()]
    culled.scenegraph.enable("frustum")
    shot(culled)
    assert [a.GetVisibility() for a in culled.renderer.actors.values()] == visible
    assert culled.renderer.ComputeVisiblePropBounds() == plain.renderer.ComputeVisiblePropBounds()
    assert culled.renderer.HasObserver("StartEvent")
    culled.scenegraph.disable()
    culled.scenegraph.disable()
    assert culled.scenegraph.status == "off"
    assert not culled.renderer.HasObserver("StartEvent")
    assert np.array_equal(shot(plain), shot(culled))
    culled.scenegraph.enable("frustum")
    assert np.array_equal(shot(plain), shot(culled))


def test_picking_finds_what_is_hidden_too(made: Callable[..., Any]) -> None:
    """A pick from another direction than the last frame's: what that frame hid is found."""
    plain, culled = made(), made()
    culled.scenegraph.enable("frustum")
    picked = []
    for plotter in (plain, culled):
        shot(plotter)
        picker = vtkCellPicker()
        for x, y in ((150, 110), (80, 60), (220, 160)):
            picker.Pick(x, y, 0, plotter.renderer)
            picked.append((picker.GetCellId(), picker.GetPickPosition()))
        # straight backwards, where everything is hidden
        plotter.camera.Yaw(180)
        picker.Pick(150, 110, 0, plotter.renderer)
        picked.append((picker.GetCellId(), picker.GetPickPosition()))
    assert picked[:4] == picked[4:]
    assert any(cell >= 0 for cell, _ in picked)


def test_area_selection_sees_all(made: Callable[..., Any]) -> None:
    counts = []
    for plotter in (made(), culled := made()):
        if plotter is culled:
            plotter.scenegraph.enable("frustum")
        shot(plotter)
        selector = vtkHardwareSelector()
        selector.SetRenderer(plotter.renderer)
        selector.SetArea(0, 0, 299, 219)
        counts.append(selector.Select().GetNumberOfNodes())
        shot(plotter)
    assert counts[0] == counts[1] > 2


def test_widgets_and_movies_go_on(made: Callable[..., Any], tmp_path: Any) -> None:
    plain, culled = made(), made()
    culled.scenegraph.enable("frustum")
    frames = []
    for plotter in (plain, culled):
        plotter.iren.initialize()
        plotter.add_slider_widget(lambda value: None, (0, 1), value=0.5)
        for _ in range(3):
            frames.append(shot(plotter))
            turn(plotter)
    for first, second in zip(frames[:3], frames[3:], strict=True):
        assert np.array_equal(first, second)


def test_what_is_wrong_is_said_in_a_sentence(made: Callable[..., Any]) -> None:
    plotter = made()
    with pytest.raises(PipelineError, match="there is no stage 'frustrum'"):
        plotter.scenegraph.enable("frustrum")
    empty = pv.Plotter(off_screen=True)
    with pytest.raises(SceneError, match="add a mesh"):
        empty.scenegraph.enable("frustum")
    empty.close()


def test_later_meshes_are_drawn_and_told(made: Callable[..., Any]) -> None:
    plotter = made()
    plotter.scenegraph.enable("frustum")
    shot(plotter)
    plotter.add_mesh(pv.Sphere(center=(0, 3, 0)), reset_camera=False)
    shot(plotter)
    assert "1 added since, call update()" in plotter.scenegraph.status
    plotter.scenegraph.update()
    shot(plotter)
    assert "added" not in plotter.scenegraph.status


def test_closing_the_plotter_lets_go() -> None:
    plotter = pv.Plotter(off_screen=True)
    fill(plotter)
    plotter.scenegraph.enable("frustum")
    component = plotter.scenegraph
    plotter.show(auto_close=False)
    plotter.close()
    assert not component.enabled


def city_of_boxes(plotter: Any) -> None:
    """300 boxes of three kinds in rows, and the eye in a street between them."""
    rng = np.random.default_rng(3)
    kinds = [pv.Box(bounds=(-1.4, 1.4, -1.4, 1.4, 0, height)) for height in (2.5, 3.5, 5.0)]
    for i in range(300):
        actor = plotter.add_mesh(kinds[i % 3], color=rng.random(3))
        actor.position = ((i % 20 - 9.5) * 4, (i // 20) * 4, 0)
    plotter.camera_position = [(0.3, -5, 1.2), (0.9, 30, 1.0), (0, 0, 1)]


@pytest.mark.parametrize("background", [False, True])
def test_occluders_are_fitted_to_the_users_meshes(background: bool) -> None:
    """One line, and what stands behind other meshes is not drawn; no pixel differs before, while and after."""
    plain, culled = (pv.Plotter(off_screen=True, window_size=(400, 300)) for _ in range(2))
    for plotter in (plain, culled):
        city_of_boxes(plotter)
        plotter.show(auto_close=False)
    culled.scenegraph.enable("frustum | shadow", background=background)
    (driver,) = culled.scenegraph.drivers
    wanted = shot(plain)
    assert np.array_equal(wanted, shot(culled))
    deadline = time.monotonic() + 60
    while driver.preparing and not driver.pump(0.05) and time.monotonic() < deadline:
        pass
    hidden = 0
    for _ in range(6):
        assert np.array_equal(shot(plain), shot(culled))
        assert driver.off_because == ""
        assert driver.failures == {}
        _, shadow = driver.frame.record.stages
        assert shadow.skipped is None
        hidden += shadow.hidden
        for plotter in (plain, culled):
            plotter.camera.Yaw(11)
            plotter.renderer.ResetCameraClippingRange()
    assert len(driver.snapshot.occluders) > 100
    assert hidden > 200
    for plotter in (plain, culled):
        plotter.close()
