"""The device: one context per window, VTK's state left as it was, and depth as VTK draws it."""

from __future__ import annotations

import numpy as np
import pytest

from drawn_scenes import ball, town, town_views
from scenegraph import Geode, Group, Lod, Scene, Transform, View
from scenegraph.render.context import context_of, guard
from scenegraph.render.device import Device
from scenegraph.render.drawing import Drawing
from scenegraph.render.window import OffscreenWindow

pytestmark = pytest.mark.gl
pytest.importorskip("moderngl")


def test_one_context_per_window(window: OffscreenWindow) -> None:
    gl = context_of(window.render_window)
    assert context_of(window.render_window) is gl
    with OffscreenWindow(20, 20) as other:
        assert context_of(other.render_window) is not gl
    assert Device(window).gl is gl
    assert Device(window.render_window).version_code == gl.version_code >= 330


def test_guard_hides_sloppy_state_from_vtk(window: OffscreenWindow) -> None:
    view = town_views()["above"]
    Drawing(town().snapshot(), window.renderer)
    window.draw(view)
    image = window.image()
    gl = context_of(window.render_window)
    for _ in range(3):
        with guard(window.render_window):
            target = gl.simple_framebuffer((64, 64))
            target.use()
            gl.enable_only(gl.BLEND | gl.CULL_FACE)
            gl.depth_func = ">"
            gl.viewport = (3, 3, 9, 9)
            gl.front_face = "cw"
            target.depth_mask = False
            target.color_mask = False, True, False, True
            target.clear()
            target.use()
        window.draw(view)
        assert np.array_equal(window.image(), image)


def test_guard_restores_after_an_error(window: OffscreenWindow) -> None:
    view = town_views()["above"]
    Drawing(town().snapshot(), window.renderer)
    window.draw(view)
    image = window.image()

    def fail() -> None:
        with guard(window.render_window):
            context_of(window.render_window).enable_only(0)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    window.draw(view)
    assert np.array_equal(window.image(), image)


@pytest.mark.parametrize("name", town_views())
def test_depth_of_all_rows_is_the_depth_that_vtk_draws(window: OffscreenWindow, name: str) -> None:
    snapshot, view = town(translucent=False).snapshot(), town_views()[name]
    Drawing(snapshot, window.renderer)
    window.draw(view)
    device = Device(window)
    with device.guard():
        target = device.depth_target(view.width, view.height)
        assert device.depth_target(view.width, view.height) is target
        device.draw_depth(target, view, snapshot)
        depth = target.read()
    assert np.array_equal(depth[::-1], window.depth())
    assert np.count_nonzero(depth < 1) > 1000
    device.close()
    device.close()


def test_depth_of_chosen_rows(window: OffscreenWindow, rng: np.random.Generator) -> None:
    snapshot, view = town(translucent=False).snapshot(), town_views()["above"]
    drawing, device = Drawing(snapshot, window.renderer), Device(window)
    for share in (0.0, 0.1, 0.6):
        chosen = rng.random(snapshot.n) < share
        drawing.show(chosen)
        window.draw(view)
        with device.guard():
            target = device.depth_target(view.width, view.height)
            device.draw_depth(target, view, snapshot, chosen)
            rows = device.rows(snapshot)
            assert device.rows(snapshot) is rows
            depth = target.read()
        assert np.array_equal(depth[::-1], window.depth())
    with device.guard():
        device.draw_depth(target, view, snapshot, ~chosen, clear=False)
        both = target.read()
        device.draw_depth(target, view, snapshot)
        assert np.array_equal(both, target.read())


@pytest.mark.parametrize("levels", [False, True])
def test_depth_of_rows_given_by_number(window: OffscreenWindow, rng: np.random.Generator, levels: bool) -> None:
    snapshot, view = town(translucent=False).snapshot(), town_views()["above"]
    if levels:
        snapshot = leveled_scene().snapshot()
    device = Device(window)
    with device.guard():
        target = device.depth_target(view.width, view.height)
        for share in (0.0, 0.02, 0.5, 1.0):
            chosen = rng.random(snapshot.n) < share
            level = rng.integers(0, 4, snapshot.n).astype(np.uint8) if levels else None
            device.draw_depth(target, view, snapshot, chosen, level)
            depth = target.read()
            device.draw_depth(target, view, snapshot, rng.permutation(np.flatnonzero(chosen)), level)
            assert np.array_equal(target.read(), depth)
            assert (depth < 1).any() == (share > 0)
        device.draw_depth(target, view, snapshot, np.zeros(0, np.int64))
        assert (target.read() == 1).all()
        assert device.gl.error == "GL_NO_ERROR"
    device.close()


def leveled_scene() -> Scene:
    """Light and heavy meshes with one to three levels."""
    meshes = [ball(40, 40), ball(12, 12), ball(5, 5)]
    group = Group()
    for i in range(60):
        drawable = Lod(*meshes[i % 2 :]) if i % 3 else Geode(meshes[i % 2])
        group.add(Transform(drawable, translation=(i % 10 * 4 - 20, i // 10 * 4, 0)))
    return Scene(group)


def test_depth_target_need_not_have_the_size_of_the_view(window: OffscreenWindow) -> None:
    snapshot, device = town(translucent=False).snapshot(), Device(window)
    view = View((0, -160, 60), (0, 0, 0), near=1, far=1000, width=640, height=360)
    with device.guard():
        target = device.depth_target(97, 53)
        device.draw_depth(target, view, snapshot)
        assert target.read().shape == (53, 97)
        assert target.read().min() < 1


def test_rows_follow_sync(window: OffscreenWindow) -> None:
    scene, view = town(translucent=False), town_views()["above"]
    snapshot, device = scene.snapshot(), Device(window)
    first = scene.root.children[0]

    def depth() -> np.ndarray:
        with device.guard():
            target = device.depth_target(view.width, view.height)
            device.draw_depth(target, view, snapshot)
            return target.read()

    before = depth()
    first.matrix = np.diag([1.0, 1.0, 2.0, 1.0])  # type: ignore[attr-defined]
    snapshot.sync()
    taller = depth()
    assert not np.array_equal(taller, before)
    first.remove(first.children[-1])  # type: ignore[attr-defined]
    snapshot.sync()
    assert depth().shape == before.shape
