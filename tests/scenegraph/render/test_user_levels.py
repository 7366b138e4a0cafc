"""Coarser levels of users' actors: fewer triangles, nearly the same picture, and nothing left behind."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from scenegraph import Frame, Pipeline, Stage
from scenegraph.compare.metrics import snr_db
from scenegraph.render.driver import Driver

pytestmark = pytest.mark.gl
pv = pytest.importorskip("pyvista")


class Coarse(Stage):
    """Draws everything at its level 3, if it has that many."""

    name = "coarse"
    needs = ("levels",)
    writes = ("level",)

    def run(self, frame: Frame) -> None:
        frame.coarsen(np.arange(frame.snapshot.n), np.minimum(frame.snapshot.level_count - 1, 3))


def ball(**place: Any) -> Any:
    return pv.Sphere(radius=0.8, theta_resolution=32, phi_resolution=32, **place)


Fill = Callable[[Any], None]


@pytest.fixture
def made() -> Iterator[Callable[..., tuple[Any, Driver]]]:
    opened: list[tuple[Any, Driver]] = []

    def make(fill: Fill, pipeline: Pipeline | None = None, **options: Any) -> tuple[Any, Driver]:
        plotter = pv.Plotter(off_screen=True, window_size=(320, 240))
        fill(plotter)
        plotter.disable_anti_aliasing()
        plotter.show(auto_close=False)
        driver = Driver(plotter, Pipeline([Coarse()]) if pipeline is None else pipeline, **options)
        opened.append((plotter, driver))
        return plotter, driver

    yield make
    for plotter, driver in opened:
        driver.detach()
        plotter.close()


def shot(plotter: Any) -> np.ndarray:
    plotter.render()
    return np.array(plotter.screenshot(None))[..., :3]


def props(plotter: Any) -> list[Any]:
    found = plotter.renderer.GetViewProps()
    return [found.GetItemAsObject(i) for i in range(found.GetNumberOfItems())]


def drawn(plotter: Any) -> tuple[np.ndarray, list[int]]:
    """A picture, and the triangles of each actor that was drawn for it."""
    counts: list[list[int]] = []

    def count(*_: object) -> None:
        data = [prop.GetMapper().GetInputDataObject(0, 0) for prop in props(plotter) if prop.IsA("vtkActor")]
        counts.append([d.GetPolys().GetNumberOfCells() for d in data])

    observer = plotter.renderer.AddObserver("StartEvent", count, -1.0)
    plotter.render()
    plotter.renderer.RemoveObserver(observer)
    return shot(plotter), counts[-1]


def whole(plotter: Any, driver: Driver) -> np.ndarray:
    driver.paused = True
    picture = shot(plotter)
    driver.paused = False
    return picture


def two(plotter: Any, **look: Any) -> None:
    for x in (-0.9, 0.9):
        plotter.add_mesh(ball(center=(x, 0, 0)), smooth_shading=True, **({"color": "tomato"} | look))
    plotter.camera_position = [(0, -8, 1), (0, 0, 0), (0, 0, 1)]


def textured(plotter: Any) -> None:
    image = np.full((16, 16, 3), 255, np.uint8)
    image[::2, :, 1:] = 0
    ground = pv.Plane(i_resolution=40, j_resolution=40, direction=(0, -1, 0.3))
    plotter.add_mesh(ground, texture=pv.Texture(image))
    plotter.camera_position = [(0, -3, 1), (0, 0, 0), (0, 0, 1)]


def mapped(plotter: Any) -> None:
    two(plotter)
    high = ball(center=(0, 0, 1.4))
    high["height"] = high.points[:, 2]
    plotter.add_mesh(high, scalars="height", cmap="viridis", smooth_shading=True, show_scalar_bar=False)


def placed(plotter: Any) -> None:
    actor = plotter.add_mesh(ball(), color="gold", smooth_shading=True)
    actor.position, actor.scale, actor.orientation = (0.5, 1, 0), (1, 2, 0.5), (30, 20, 10)
    plotter.camera_position = [(0, -8, 1), (0, 0, 0), (0, 0, 1)]


def far_off(plotter: Any) -> None:
    origin = np.array([4.4e5, 5.2e6, 300.0])
    ground = ball()
    ground.points = ground.points.astype(float) + origin
    plotter.add_mesh(ground, color="tan", smooth_shading=True)
    plotter.camera_position = [origin + (0, -4, 1), origin, (0, 0, 1)]


@pytest.mark.parametrize("fill", [two, textured, mapped, placed, far_off])
def test_the_picture_is_nearly_the_same_with_far_fewer_triangles(made: Callable[..., Any], fill: Fill) -> None:
    plotter, driver = made(fill)
    finest = whole(plotter, driver)
    picture, triangles = drawn(plotter)
    assert driver.off_because == ""
    assert driver.frame is not None
    assert sum(triangles) == driver.frame.record.triangles
    assert sum(triangles) < 0.2 * driver.snapshot.triangles[0].sum()
    assert 22 < snr_db(picture, finest) < np.inf


@pytest.mark.parametrize(
    "look", [{"show_edges": True}, {"opacity": 0.5}, {"style": "points"}, {"style": "wireframe"}], ids=str
)
def test_what_is_more_than_a_surface_is_drawn_as_it_is(made: Callable[..., Any], look: dict[str, Any]) -> None:
    plotter, driver = made(lambda p: two(p, **look))
    picture = shot(plotter)
    assert driver.off_because == ""
    assert driver.frame is not None
    assert driver.frame.level.any()
    assert driver.frame.record.triangles == driver.snapshot.triangles[0].sum()
    assert np.array_equal(picture, whole(plotter, driver))


def test_edits_of_the_color_are_followed(made: Callable[..., Any]) -> None:
    plotter, driver = made(two)
    shot(plotter)
    for actor in props(plotter):
        actor.GetProperty().SetColor(0.0, 0.0, 1.0)
    picture, triangles = drawn(plotter)
    assert sum(triangles) < 1000
    assert 22 < snr_db(picture, whole(plotter, driver)) < np.inf


def test_an_actor_whose_scalars_are_mapped_otherwise_is_drawn_as_it_is(made: Callable[..., Any]) -> None:
    plotter, driver = made(mapped)
    _, before = drawn(plotter)
    actor = props(plotter)[2]
    actor.mapper.lookup_table.apply_cmap("plasma")
    picture, after = drawn(plotter)
    assert after[:2] == before[:2]
    assert after[2] == driver.snapshot.triangles[0].max() > before[2]
    # the others are levels
    assert 22 < snr_db(picture, whole(plotter, driver)) < np.inf


def test_actors_are_put_back_after_each_frame_and_for_good(made: Callable[..., Any]) -> None:
    plotter, driver = made(two)
    own = [prop.GetAddressAsString("") for prop in props(plotter)]
    finest = whole(plotter, driver)
    assert not np.array_equal(shot(plotter), finest)
    assert [prop.GetAddressAsString("") for prop in props(plotter)] == own
    driver.detach()
    assert [prop.GetAddressAsString("") for prop in props(plotter)] == own
    assert np.array_equal(shot(plotter), finest)


def test_batches_and_levels_stand_side_by_side(made: Callable[..., Any]) -> None:
    def crowd(plotter: Any) -> None:
        rng = np.random.default_rng(0)
        for i in range(12):
            center = rng.uniform(-2, 2, 3)
            # cubes have no levels, and share a batch
            plotter.add_mesh(ball(center=center) if i < 4 else pv.Cube(center=center), color=rng.random(3))
        plotter.camera_position = [(0, -9, 1), (0, 0, 0), (0, 0, 1)]

    one, _ = made(crowd)
    other, _ = made(crowd, batches=True)
    picture, triangles = drawn(one)
    again, batched = drawn(other)
    assert len(batched) < len(triangles)
    assert sum(batched) < 1200
    assert np.array_equal(picture, again)


def test_a_plotter_says_how_many_triangles_were_drawn() -> None:
    plotter = pv.Plotter(off_screen=True, window_size=(320, 240))
    two(plotter)
    plotter.scenegraph.enable("frustum | lod_error(pixels=2)", background=False)
    plotter.show(auto_close=False)
    _, triangles = drawn(plotter)
    assert 0 < sum(triangles) < 3840
    assert f"2 of 2 drawn with {sum(triangles):,} of 3,840 triangles" in plotter.scenegraph.status
    plotter.close()
