"""Users' actors drawn together: the same picture, and nothing else that anybody could notice."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

pytestmark = pytest.mark.gl
pv = pytest.importorskip("pyvista")


def fill(plotter: Any, *, smooth: bool = False, mixed: bool = True) -> None:
    """Shapes of all sizes that run into each other, in every place; one in seven has colors of its own."""
    rng = np.random.default_rng(0)
    for i in range(70):
        center = rng.uniform(-40, 40, 3)
        shape = (
            pv.Sphere(radius=rng.uniform(1, 9), center=center, theta_resolution=6, phi_resolution=5)
            if i % 3
            else pv.Cube(center=center, x_length=rng.uniform(0.1, 40), y_length=rng.uniform(1, 40))
        )
        look: dict[str, Any] = {"color": rng.random(3)}
        if i % 7 == 0:
            shape.point_data["rgb"] = rng.integers(0, 255, (shape.n_points, 3)).astype(np.uint8)
            look = {"scalars": "rgb", "rgb": True}
        if mixed:
            look |= {"opacity": 0.5 if i % 11 == 5 else 1.0, "show_edges": i % 13 == 3}
            look |= {"specular": 0.4 if i % 7 and (i // 20) % 2 else 0.0}
        actor = plotter.add_mesh(shape, smooth_shading=smooth, **look)
        if i % 2:
            actor.orientation = rng.uniform(0, 90, 3)
            actor.scale = rng.uniform(-2, 2, 3) if i % 4 == 1 else rng.uniform(0.5, 2)
    plotter.add_axes()
    plotter.camera_position = [(60, 80, 50), (0, 0, 0), (0, 0, 1)]


@pytest.fixture
def made() -> Iterator[Callable[..., Any]]:
    opened: list[Any] = []

    def make(samples: int = 0, change: Callable[[Any], None] = lambda plotter: None, **options: Any) -> Any:
        plotter = pv.Plotter(off_screen=True, window_size=(320, 240))
        opened.append(plotter)
        fill(plotter, **options)
        if not samples:
            plotter.disable_anti_aliasing()
        plotter.render_window.SetMultiSamples(samples)
        change(plotter)
        plotter.show(auto_close=False)
        return plotter

    yield make
    for plotter in opened:
        plotter.close()


def grow(mesh: Any) -> None:
    # not in place: VTK hears of that only as long as Python holds the same wrapper
    mesh.points = np.asarray(mesh.points) * 1.5


def shot(plotter: Any, **options: Any) -> np.ndarray:
    plotter.render()
    return np.asarray(plotter.screenshot(return_img=True, **options))


def in_batches(plotter: Any) -> int:
    (driver,) = plotter.scenegraph.drivers
    return int((driver._subject._batches.label >= 0).sum())


def runs(plotter: Any) -> int:
    """Calls that batches were drawn by, at most in one frame."""
    (driver,) = plotter.scenegraph.drivers
    return sum(len(batch._runs) for batch in driver._subject._batches._batches)


CHANGES: dict[str, Callable[[Any], None]] = {
    "plain": lambda p: None,
    "depth peeling": lambda p: p.enable_depth_peeling(),
    "parallel": lambda p: p.enable_parallel_projection(),
    "own lights": lambda p: (p.remove_all_lights(), p.add_light(pv.Light(position=(9, 30, 80), positional=True))),
    "ambient occlusion": lambda p: p.enable_ssao(radius=5),
}


@pytest.mark.parametrize(
    ("change", "samples", "smooth"), [*((c, 0, False) for c in CHANGES), ("plain", 0, True), ("plain", 8, False)]
)
def test_not_a_pixel_differs(made: Callable[..., Any], change: str, samples: int, smooth: bool) -> None:
    plain, culled = (made(samples, CHANGES[change], smooth=smooth) for _ in range(2))
    culled.scenegraph.enable("frustum", batches=True)
    (driver,) = culled.scenegraph.drivers
    for _ in range(4):
        for plotter in (plain, culled):
            plotter.camera.Azimuth(50)
            plotter.camera.Yaw(10)
            plotter.renderer.ResetCameraClippingRange()
        assert np.array_equal(shot(plain), shot(culled))
        assert driver.off_because == ""
    assert in_batches(culled) > 40
    assert runs(culled) > 1
    # tiles clip more, and Mesa's rasterizer then draws some pixels of long calls differently
    tiled = (shot(plain, scale=2) != shot(culled, scale=2)).any(axis=2)
    assert tiled.mean() < 1e-4


def test_all_that_look_alike_are_few_calls(made: Callable[..., Any]) -> None:
    plain, culled = (made(mixed=False) for _ in range(2))
    culled.scenegraph.enable("frustum", batches=True)
    assert np.array_equal(shot(plain), shot(culled))
    assert in_batches(culled) == 70
    (driver,) = culled.scenegraph.drivers
    assert 0 < runs(culled) < driver.frame.visible_count / 3


def test_they_are_drawn_one_by_one_unless_asked(made: Callable[..., Any]) -> None:
    plain, plotter = made(8), made(8)
    plotter.scenegraph.enable("frustum")
    assert np.array_equal(shot(plain), shot(plotter))
    assert np.array_equal(shot(plain, scale=2), shot(plotter, scale=2))
    assert runs(plotter) == 0


def test_the_renderer_holds_what_the_user_put_there(made: Callable[..., Any]) -> None:
    plotter = made()
    props = plotter.renderer.GetViewProps()

    def held() -> list[str]:
        return [props.GetItemAsObject(i).GetAddressAsString("") for i in range(props.GetNumberOfItems())]

    before, during = held(), []
    plotter.scenegraph.enable("frustum", batches=True)
    (driver,) = plotter.scenegraph.drivers
    plotter.renderer.AddObserver("StartEvent", lambda *_: during.append(held()), -1.0)
    shot(plotter)
    assert during
    assert len(during[-1]) < len(before)
    assert held() == before
    # whatever goes wrong while it is decided what is drawn
    driver._subject._batches.runs = lambda *_: 1 / 0
    plain = made()
    assert np.array_equal(shot(plotter), shot(plain))
    assert "ZeroDivisionError" in driver.off_because
    assert held() == before
    plotter.scenegraph.disable()
    assert held() == before


def test_what_comes_and_goes_while_a_frame_is_drawn_is_kept(made: Callable[..., Any]) -> None:
    plotter = made()
    plotter.scenegraph.enable("frustum", batches=True)
    (driver,) = plotter.scenegraph.drivers
    late, gone = pv.Actor(mapper=pv.DataSetMapper(pv.Sphere())), []
    props = plotter.renderer.GetViewProps()

    def meddle(*_: object) -> None:
        if not gone:
            mine = [prop for prop in driver._subject._list if props.IsItemPresent(prop)]
            gone.append(mine[0])
            plotter.renderer.AddActor(late)
            plotter.renderer.RemoveActor(mine[0])

    plotter.renderer.AddObserver("StartEvent", meddle, -1.0)
    count = props.GetNumberOfItems()
    shot(plotter)
    assert props.GetNumberOfItems() == count
    assert props.IsItemPresent(late)
    assert not props.IsItemPresent(gone[0])
    shot(plotter)
    assert "removed" in driver.off_because


@pytest.mark.parametrize(
    "edit",
    [
        lambda a: setattr(a.prop, "color", "red"),
        lambda a: setattr(a.prop, "ambient", 0.7),
        lambda a: setattr(a.prop, "interpolation", "gouraud"),
        lambda a: setattr(a.prop, "lighting", False),
        lambda a: setattr(a.prop, "show_edges", True),
        lambda a: setattr(a.prop, "opacity", 0.3),
        lambda a: setattr(a.prop, "style", "wireframe"),
        lambda a: setattr(a, "position", (3, 2, 1)),
        lambda a: setattr(a, "visibility", False),
        lambda a: setattr(a, "prop", pv.Property(color="blue")),
        lambda a: setattr(a.mapper.dataset, "points", a.mapper.dataset.points * 1.5),
    ],
)
def test_edits_show_at_once(made: Callable[..., Any], edit: Callable[[Any], None]) -> None:
    plain, culled = (made(mixed=False) for _ in range(2))
    culled.scenegraph.enable("frustum", batches=True)
    (driver,) = culled.scenegraph.drivers
    before = shot(culled)
    assert np.array_equal(shot(plain), before)
    for plotter in (plain, culled):
        props = plotter.renderer.GetViewProps()
        for i in (2, 8, 9):
            edit(props.GetItemAsObject(i))
    after = shot(culled)
    assert np.array_equal(shot(plain), after)
    assert not np.array_equal(before, after)
    assert in_batches(culled) == 70 - 3 or "edited" in driver.off_because
