"""Occlusion queries: both ways agree, nothing visible gets 0, and VTK's pictures stay what they are."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from drawn_scenes import FAR, town, town_views
from scenegraph import GLError, Scene, View
from scenegraph.render.device import Device
from scenegraph.render.drawing import Drawing
from scenegraph.render.item_buffer import ItemBuffer
from scenegraph.render.window import OffscreenWindow
from scenegraph.testing import PLACES, grid_scene, random_views, wall_scene, wall_views

pytestmark = pytest.mark.gl
pytest.importorskip("moderngl")


def odd_boxes(rng: np.random.Generator, size: float) -> np.ndarray:
    """Boxes of all kinds around the origin: plain, flat, inverted, tiny, huge, not a number, endless."""
    boxes = np.concatenate([rng.uniform(-3, 3, (3, 200)), 10.0 ** rng.uniform(-6, 0.5, (3, 200))]) * size
    boxes[3, :20] = 0.0
    boxes[3:, 20:30] = 0.0
    boxes[3:, 30:50] *= -1
    boxes[1, 50] = np.nan
    boxes[4, 51] = np.inf
    boxes[3:, 52] = 1e300
    boxes[0, 53] = 1e30
    return boxes


def test_both_ways_agree_about_boxes_of_all_kinds(window: OffscreenWindow, rng: np.random.Generator) -> None:
    snapshot = grid_scene(4).snapshot()
    with closing(Device(window)) as device:
        for view in random_views(rng, 12, 8.0):
            boxes = odd_boxes(rng, 4.0)
            with device.guard():
                target = device.depth_target(view.width, view.height)
                device.draw_depth(target, view, snapshot, rng.random(snapshot.n) < 0.5)
                before = target.read()
                counted = device.queries.count(view, boxes, target)
                ticket = device.queries.issue(view, boxes, target)
                asked = device.queries.result(ticket)
                assert device.queries.ready(ticket).all()
                whether = device.queries.result(device.queries.issue(view, boxes, target, any_samples=True))
                marked = device.queries.count(view, boxes, target, any_samples=True)
                assert np.array_equal(target.read(), before)
                assert device.gl.error == "GL_NO_ERROR"
            unknown = device.queries.unknown(view, boxes)
            assert np.array_equal(counted, asked)
            assert np.array_equal(counted > 0, whether > 0)
            assert np.array_equal(marked, whether)
            assert whether[~unknown].max(initial=0) <= 1
            assert unknown[50:52].all()
            assert (counted[unknown] == view.width * view.height).all()
        assert device.queries.distrusted == 0
        assert not device.queries.fallback


def test_query_objects_rest_before_they_are_used_again(window: OffscreenWindow) -> None:
    snapshot, view = grid_scene(2).snapshot(), View((0, -20, 3), (0, 0, 0), width=64, height=48)
    used: list[list[int]] = []
    with closing(Device(window)) as device, device.guard():
        target = device.depth_target(64, 48)
        target.clear()
        for _ in range(60):
            ticket = device.queries.issue(view, snapshot.boxes, target)
            used.append(ticket.names)
            assert (device.queries.result(ticket) > 0).all()
        recent = used[-1 - 256 // snapshot.n :]
        assert len({name for names in recent for name in names}) == sum(map(len, recent))
        assert device.queries.objects.made <= 256 + snapshot.n


def test_one_query_for_several_boxes(window: OffscreenWindow, rng: np.random.Generator) -> None:
    snapshot = grid_scene(4).snapshot()
    with closing(Device(window)) as device, device.guard():
        for view in random_views(rng, 4, 8.0):
            boxes = odd_boxes(rng, 4.0)
            target = device.depth_target(view.width, view.height)
            device.draw_depth(target, view, snapshot)
            each, unknown = device.queries.count(view, boxes, target), device.queries.unknown(view, boxes)
            groups = np.array([0, 1, 3, 3, 40, 130, 200])
            found = device.queries.result(device.queries.issue(view, boxes, target, groups=groups))
            for i, (a, b) in enumerate(pairwise(groups)):
                known = a < b and not unknown[a:b].any()
                assert found[i] == (each[a:b].sum() if known else view.width * view.height)


def visible_and_counted(window: OffscreenWindow, scene: Scene, views: list[View]) -> list[tuple[Any, ...]]:
    """For each view: pixels of the truth, and the samples of each row's box before the depth of everything."""
    snapshot = scene.snapshot()
    opaque = np.ones(snapshot.n, bool)
    found = []
    with closing(ItemBuffer(snapshot)) as truth, closing(Device(window)) as device:
        for view in views:
            with device.guard():
                target = device.depth_target(view.width, view.height)
                device.draw_depth(target, view, snapshot, opaque)
                samples = device.queries.count(view, snapshot.boxes, target)
            found.append((truth.render(view).pixels, samples))
    return found


@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.0), FAR], ids=["here", "far"])
def test_every_sample_of_a_drawable_is_one_of_its_box(window: OffscreenWindow, offset: tuple[float, ...]) -> None:
    views = list(town_views(offset).values())  # type: ignore[arg-type]
    for pixels, samples in visible_and_counted(window, town(offset, translucent=False), views):  # type: ignore[arg-type]
        assert (samples >= pixels).all()
        assert (pixels > 0).any()
        assert (samples == 0).any()


@pytest.mark.parametrize(("scale", "shift"), PLACES)
def test_every_sample_at_all_scales(window: OffscreenWindow, scale: float, shift: float) -> None:
    for pixels, samples in visible_and_counted(window, wall_scene(scale, shift), wall_views(scale, shift)):
        assert (samples >= pixels).all()
        assert (samples == 0).any()


def test_boxes_that_are_their_contents_and_smaller_than_a_pixel(
    window: OffscreenWindow, rng: np.random.Generator
) -> None:
    # the faces of box and contents coincide, so that a wrong rounding either way loses samples
    scene = grid_scene(12)
    for view in (*random_views(rng, 20, 20.0), View((0, -3000, 7), (1, 0, 0), near=1, far=9000, width=640, height=480)):
        for pixels, samples in visible_and_counted(window, scene, [view]):
            assert (samples >= pixels).all()


def test_a_ratio_of_near_to_far_of_a_billion(window: OffscreenWindow) -> None:
    views = [View(v.eye, v.target, near=1e-6, far=1e3, width=320, height=240) for v in wall_views()]
    for pixels, samples in visible_and_counted(window, wall_scene(), views):
        assert (samples >= pixels).all()


def test_boxes_at_the_eye_are_not_asked(window: OffscreenWindow) -> None:
    view = View((0, 0, 0), (0, 1, 0), near=0.1, far=100, width=64, height=48)
    boxes = np.array([[0, 0, 0, 1, 1, 1], [0, 0.1, 0, 0.01, 0.01, 0.01], [0, 5, 0, 1, 1, 1], [0, -5, 0, 1, 1, 1]]).T
    with closing(Device(window)) as device:
        assert device.queries.unknown(view, boxes).tolist() == [True, True, False, False]
        with device.guard():
            target = device.depth_target(64, 48)
            target.clear(1e-5)
            assert device.queries.count(view, boxes, target).tolist() == [3072, 3072, 0, 0]
            target.clear()
            counts = device.queries.count(view, boxes, target)
            assert counts[3] == 0
            assert counts[2] > 100
            none = device.queries.count(view, np.zeros((6, 0)), target)
            assert none.shape == (0,)
            assert device.queries.result(device.queries.issue(view, np.zeros((6, 0)), target)).shape == (0,)


@pytest.mark.parametrize("multisamples", [0, 4])
def test_pictures_do_not_change(multisamples: int, rng: np.random.Generator) -> None:
    snapshot, view = town().snapshot(), town_views()["above"]
    with OffscreenWindow(480, 270, multisamples=multisamples) as window:
        Drawing(snapshot, window.renderer)
        window.draw(view)
        image = window.image()
        with closing(Device(window)) as device:
            for _ in range(3):
                with device.guard():
                    target = device.depth_target(view.width, view.height)
                    device.draw_depth(target, view, snapshot, rng.random(snapshot.n) < 0.2)
                    ticket = device.queries.issue(view, snapshot.boxes, target)
                    device.queries.count(view, snapshot.boxes, target)
                window.draw(view)
                assert np.array_equal(window.image(), image)
                with device.guard():
                    device.queries.result(ticket)
                window.draw(view)
                assert np.array_equal(window.image(), image)


def test_targets_may_be_drawn_on_after_a_query(window: OffscreenWindow) -> None:
    snapshot, view = wall_scene().snapshot(), wall_views()[0]
    with closing(Device(window)) as device, device.guard():
        target = device.depth_target(view.width, view.height)
        device.draw_depth(target, view, snapshot)
        whole = target.read()
        first = np.arange(snapshot.n) < 5
        device.draw_depth(target, view, snapshot, first)
        device.queries.count(view, snapshot.boxes, target)
        device.queries.issue(view, snapshot.boxes, target)
        device.draw_depth(target, view, snapshot, ~first, clear=False)
        assert np.array_equal(target.read(), whole)


# -- what can go wrong ------------------------------------------------------------------------------------------------


def test_below_4_3_query_objects_stand_in(
    window: OffscreenWindow, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    snapshot, view = wall_scene().snapshot(), wall_views()[0]
    with closing(Device(window)) as device, device.guard():
        target = device.depth_target(view.width, view.height)
        device.draw_depth(target, view, snapshot)
        counted = device.queries.count(view, snapshot.boxes, target)
    monkeypatch.setattr(Device, "version_code", 330)
    with closing(Device(window)) as device, device.guard():
        target = device.depth_target(view.width, view.height)
        device.draw_depth(target, view, snapshot)
        assert np.array_equal(device.queries.count(view, snapshot.boxes, target), counted)
        assert "3.3" in device.queries.fallback
        device.queries.count(view, snapshot.boxes, target)
    assert [r.getMessage() for r in caplog.records].count(
        "occlusion queries are asked one by one: OpenGL 3.3 has no shader storage buffers; 4.3 has"
    ) == 1


def test_a_shader_that_counts_wrongly_is_found_out(
    window: OffscreenWindow, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    snapshot, view = wall_scene().snapshot(), wall_views()[0]
    with closing(Device(window)) as device, device.guard():
        target = device.depth_target(view.width, view.height)
        device.draw_depth(target, view, snapshot)
        monkeypatch.setattr(device.queries, "read_counts", lambda corners, *_: np.full(len(corners), 7, np.uint32))
        counted = device.queries.count(view, snapshot.boxes, target)
        assert (counted == 0).any()
        assert device.queries.fallback == "a shader counts 7 and 7 samples where 64 and 0 are right"


BROKEN: dict[str, Callable[[int], Any]] = {
    "zeros": lambda k: np.zeros(k, np.uint32),
    "huge": lambda k: np.full(k, 2**32 - 1, np.uint32),
    "negative": lambda k: np.full(k, -3),
    "not numbers": lambda k: np.full(k, np.nan),
    "fractions": lambda k: np.full(k, 0.5),
    "too few": lambda k: np.zeros(k - 1, np.uint32),
    "too many": lambda k: np.zeros(k + 1, np.uint32),
    "nothing": lambda k: None,
    "text": lambda k: ["many"] * k,
}


@pytest.mark.parametrize("answer", BROKEN)
def test_broken_batches_lose_nothing(window: OffscreenWindow, monkeypatch: pytest.MonkeyPatch, answer: str) -> None:
    snapshot, view = wall_scene().snapshot(), wall_views()[0]
    with closing(Device(window)) as device, device.guard():
        target = device.depth_target(view.width, view.height)
        device.draw_depth(target, view, snapshot)
        right = device.queries.count(view, snapshot.boxes, target)
        monkeypatch.setattr(device.queries, "read_counts", lambda corners, *_: BROKEN[answer](len(corners)))
        assert (device.queries.count(view, snapshot.boxes, target) == view.width * view.height).all()
        assert device.queries.distrusted >= snapshot.n
        monkeypatch.undo()
        assert np.array_equal(device.queries.count(view, snapshot.boxes, target), right)


class Faulty:
    """Query objects whose answers are replaced."""

    def __init__(self, real: Any, *, available: bool | None = None, value: Any = None) -> None:
        self.real, self.available, self.answer = real, available, value

    def __getattr__(self, name: str) -> Any:
        return getattr(self.real, name)

    def is_available(self, name: int) -> bool:
        return self.real.is_available(name) if self.available is None else self.available

    def value(self, name: int) -> Any:
        return self.answer if self.answer is not None else self.real.value(name)


@pytest.mark.parametrize("answer", [-1, 2**32 - 1, float("nan"), 0.5, "many", [0, 0]], ids=str)
def test_broken_objects_lose_nothing(window: OffscreenWindow, answer: Any) -> None:
    snapshot, view = wall_scene().snapshot(), wall_views()[0]
    with closing(Device(window)) as device, device.guard():
        target = device.depth_target(view.width, view.height)
        device.draw_depth(target, view, snapshot)
        queries = device.queries
        queries.result(queries.issue(view, snapshot.boxes, target))
        queries.objects = Faulty(queries.objects, value=answer)
        assert (queries.result(queries.issue(view, snapshot.boxes, target)) == view.width * view.height).all()
        assert queries.distrusted == snapshot.n


def test_answers_that_never_come_are_given_up(window: OffscreenWindow) -> None:
    snapshot, view = wall_scene().snapshot(), wall_views()[0]
    with closing(Device(window)) as device, device.guard():
        target = device.depth_target(view.width, view.height)
        device.draw_depth(target, view, snapshot)
        queries = device.queries
        right = queries.result(queries.issue(view, snapshot.boxes, target))
        real = queries.objects
        queries.patience, queries.objects = 0.01, Faulty(real, available=False)
        ticket = queries.issue(view, snapshot.boxes, target)
        assert not queries.ready(ticket).any()
        assert (queries.result(ticket) == view.width * view.height).all()
        assert queries.distrusted == snapshot.n
        queries.objects = real
        assert np.array_equal(queries.result(queries.issue(view, snapshot.boxes, target)), right)


def test_a_closed_window_is_named(window: OffscreenWindow) -> None:
    view = wall_views()[0]
    other = OffscreenWindow(32, 32)
    device = Device(other)
    with device.guard():
        target = device.depth_target(32, 32)
        ticket = device.queries.issue(view, wall_scene().snapshot().boxes, target)
    other.close()
    assert (device.queries.result(ticket) == 1024).all()
    with pytest.raises(GLError, match="closed"):
        device.queries.count(view, np.zeros((6, 1)), target)
    device.close()
