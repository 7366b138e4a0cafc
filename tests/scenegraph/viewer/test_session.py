"""The viewer without a window system: what is drawn, what is frozen, what is said, and that nothing leaks."""

from __future__ import annotations

import gc
import json
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from drawn_scenes import town, town_views
from scenegraph import Frame, Pipeline, Registry, Snapshot, Stage, parameter
from scenegraph.compare.sources import read_path
from scenegraph.overlay import Overlay
from scenegraph.render.drawing import Drawing
from scenegraph.render.window import OffscreenWindow
from scenegraph.viewer.canvas import Canvas
from scenegraph.viewer.command import measured
from scenegraph.viewer.window import ViewerWindow

pytestmark = pytest.mark.gl
SNAPSHOT = town().snapshot()
STREET = town_views()["street"]
PATH = [STREET.moved(eye=(6, -95 + 20 * i, 2)) for i in range(4)]


class Greedy(Stage):
    """Hides every so many rows, visible or not."""

    name = "greedy"
    every: int = parameter(5, minimum=1, maximum=100)

    def run(self, frame: Frame) -> None:
        frame.hide(np.arange(0, frame.snapshot.n, self.every))


class Broken(Stage):
    """Fails."""

    name = "broken"

    def run(self, frame: Frame) -> None:
        raise RuntimeError("this stage is broken")


class FailsToOpen(Stage):
    """Cannot be prepared the first time."""

    name = "fails_to_open"
    tries = 0

    def open(self, snapshot: Snapshot, progress: object) -> None:
        self.tries += 1
        if self.tries == 1:
            raise RuntimeError("no such file")

    def run(self, frame: Frame) -> None:
        frame.hide([1])


class Slow(Stage):
    """Takes its time to prepare what its parameter says."""

    name = "slow"
    hides: int = parameter(1, minimum=1, maximum=20)
    prepared = 0

    def open(self, snapshot: Snapshot, progress: object) -> None:
        self.gate.wait(20)
        self.prepared = self.hides

    def run(self, frame: Frame) -> None:
        frame.hide(np.arange(self.prepared))

    gate = threading.Event()


class Checkers(Overlay):
    """A picture, lines, and a key of its own."""

    name = "checkers"
    key = "o"

    def inset(self, frame: Frame) -> np.ndarray:
        return np.kron(np.array([[0, 1], [1, 0]], np.uint8), np.full((4, 6), 255, np.uint8))[..., None].repeat(3, 2)


class Taken(Overlay):
    """Wants a key that the viewer has, and so has none."""

    name = "taken"
    key = "f"


class Blue(Overlay):
    """A coloring with a key of its own."""

    name = "blue"
    key = "y"

    def colors(self, frame: Frame) -> np.ndarray:
        return np.tile((0.0, 0.0, 1.0, 1.0), (frame.snapshot.n, 1))


@pytest.fixture
def viewer() -> Iterator[Callable[..., ViewerWindow]]:
    opened: list[ViewerWindow] = []

    def make(*pipelines: Pipeline | str, **options: object) -> ViewerWindow:
        made = [p if isinstance(p, Pipeline) else Pipeline.parse(p) for p in pipelines]
        window = ViewerWindow(
            SNAPSHOT,
            made,
            Registry(),
            path=PATH,
            size=(480, 270),
            off_screen=True,
            **options,  # type: ignore[arg-type]
        )
        opened.append(window)
        window.plotter.show(auto_close=False)
        window.session.view = PATH[0].resized(480, 270)
        window.render()
        return window

    yield make
    for window in opened:
        window.close()


def test_a_screenshot_is_what_a_suite_draws(viewer: Callable[..., ViewerWindow]) -> None:
    window = viewer("frustum", "none")
    with OffscreenWindow(480, 270, SNAPSHOT.scene.background) as suite:
        drawing = Drawing(SNAPSHOT, suite.renderer)
        with Pipeline.parse("frustum").open(SNAPSHOT) as pipeline:
            for view in (PATH[0], PATH[2], town_views()["above"]):
                window.session.view = view
                drawing.apply(pipeline.run(view))
                suite.draw(view)
                assert np.array_equal(window.session.picture(), suite.image())


def test_a_frozen_view_shows_what_the_last_live_frame_drew(viewer: Callable[..., ViewerWindow]) -> None:
    window = viewer(Pipeline([Greedy()]), "none")
    session = window.session
    session.view = PATH[1].resized(480, 270)
    window.render()
    live = session.driver.frame
    assert live is not None
    window.press("f")
    assert session.frozen
    session.view = town_views()["above"]
    window.render()
    assert session.driver.frame is live
    frozen = session.picture()
    with OffscreenWindow(480, 270, SNAPSHOT.scene.background) as other:
        drawing = Drawing(SNAPSHOT, other.renderer)
        drawing.show(live.visible, live.level)
        other.draw(town_views()["above"])
        assert np.array_equal(frozen, other.image())
    # settings still count, for the frozen camera
    session.set_parameter("greedy", "every", 2)
    window.render()
    assert session.driver.frame.visible_count < live.visible_count
    assert session.driver.frame.view == live.view
    window.press("f")
    window.render()
    assert session.driver.frame.view.eye == pytest.approx(town_views()["above"].eye)


def test_toggling_a_stage_a_thousand_times_leaks_nothing(viewer: Callable[..., ViewerWindow]) -> None:
    window = viewer("frustum", "none")
    for _ in range(20):
        window.press("1")
    gc.collect()
    objects, actors = len(gc.get_objects()), window.plotter.renderer.GetViewProps().GetNumberOfItems()
    for _ in range(1000):
        window.session.toggle_stage(0)
        if _ % 50 == 0:
            window.render()
    window.render()
    gc.collect()
    assert abs(len(gc.get_objects()) - objects) < 50
    assert window.plotter.renderer.GetViewProps().GetNumberOfItems() == actors
    assert window.session.pipeline.disabled == set()


def test_a_stage_that_raises_is_off_and_said_so(viewer: Callable[..., ViewerWindow]) -> None:
    window = viewer(Pipeline([Broken(), Greedy()]), "none")
    window.render()
    numbers = window.session.numbers()
    assert numbers.failures == {"broken": "RuntimeError: this stage is broken"}
    assert numbers.off == ""
    assert window.session.driver.frame.visible_count < SNAPSHOT.n
    # switched on again, it is given another chance
    window.press("1")
    assert window.session.driver.failures == {"broken": "RuntimeError: this stage is broken"}


def test_a_stage_that_could_not_be_opened_gets_another_chance(viewer: Callable[..., ViewerWindow]) -> None:
    window = viewer(Pipeline([Greedy(every=100), FailsToOpen()]), "none")
    session = window.session
    assert session.driver.failures == {"fails_to_open": "RuntimeError: no such file"}
    assert [r.name for r in session.driver.frame.record.stages] == ["greedy"]
    window.press("2")
    assert session.driver.failures == {}
    assert [r.name for r in session.driver.frame.record.stages] == ["greedy", "fails_to_open"]
    assert not session.driver.frame.visible[1]


@pytest.mark.parametrize("frozen", [False, True])
def test_a_slider_of_a_stage_that_prepares_does_not_block(viewer: Callable[..., ViewerWindow], frozen: bool) -> None:
    stage = Slow()
    Slow.gate.set()
    window = viewer(Pipeline([stage]), "none")
    session = window.session
    assert session.driver.frame.visible_count == SNAPSHOT.n - 1
    if frozen:
        window.press("f")
    session.driver.background = True
    Slow.gate.clear()
    start = time.monotonic()
    session.set_parameter("slow", "hides", 7)
    window.render()
    assert time.monotonic() - start < 5
    assert session.driver.preparing
    assert session.frozen == frozen
    Slow.gate.set()
    deadline = time.monotonic() + 20
    while session.driver.preparing and time.monotonic() < deadline:
        window.tick()
    assert session.driver.frame.visible_count == SNAPSHOT.n - 7
    assert session.frozen == frozen


def test_an_overlay_has_a_key_and_an_inset(viewer: Callable[..., ViewerWindow]) -> None:
    window = viewer("frustum", "none")
    window.session.overlays += [Checkers(), Taken(), Blue()]
    assert [overlay.name for overlay in window.overlay_keys().values()] == ["checkers", "blue"]
    window.show_hud = False
    plain, scene = window.image(), window.session.picture()
    assert window.press("o")
    shown = window.image()
    changed = np.argwhere((plain != shown).any(axis=2))
    # in the lower right corner, and the squares are where they belong: the upper left one is black
    low, high = changed.min(axis=0), changed.max(axis=0)
    assert low[0] > 15
    assert tuple(high) == (270 - 17, 480 - 17)
    squares = shown[-17 - 180 : -17 - 12, 480 - 16 - 300 : 480 - 16 - 16]
    assert squares[2, 2].tolist() == squares[-3, -3].tolist() == [0, 0, 0]
    assert squares[2, -3].tolist() == squares[-3, 2].tolist() == [255, 255, 255]
    assert np.array_equal(window.session.picture(), scene)
    assert "checkers" in window.session.numbers().state
    window.press("o")
    assert np.array_equal(window.image(), plain)
    # all that draws, together
    window.press("g")
    assert len(window.session.marks.insets) == 1
    window.press("g")
    window.press("y")
    assert window.session.coloring is not None
    assert window.session.coloring.name == "blue"
    window.press("y")
    assert window.session.coloring is None
    window.press("f")
    assert window.session.frozen


def test_keys_of_overlays_are_listed(viewer: Callable[..., ViewerWindow], monkeypatch: pytest.MonkeyPatch) -> None:
    window = viewer("frustum", "none")
    window.session.overlays.append(Checkers())
    written: list[str] = []
    real = Canvas.text
    monkeypatch.setattr(Canvas, "text", lambda *args, **kw: (written.append(args[3]), real(*args, **kw))[1])
    window.press("h")
    at = written.index("o")
    assert written[at + 1] == "checkers"


@pytest.mark.parametrize("method", ["colors", "legend"])
def test_an_overlay_that_raises_is_off_and_said_so(
    viewer: Callable[..., ViewerWindow], monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    def fail(self: Overlay, frame: Frame) -> None:
        raise RuntimeError("this overlay is broken")

    monkeypatch.setattr(Blue, method, fail)
    window = viewer("frustum", "none")
    window.session.coloring = Blue()
    window.window.Render()
    assert window.session.coloring is None
    assert "this overlay is broken" in window.session.messages[0]


def test_truth_finds_false_hides_and_names_them(viewer: Callable[..., ViewerWindow]) -> None:
    window = viewer(Pipeline([Greedy(every=1)]), "frustum")
    verdict = window.session.check_truth()
    assert verdict is not None
    assert len(verdict.rows) == verdict.visible > 10
    assert verdict.names
    assert verdict.snr < 30
    window.press("t")
    assert window.session.truth
    window.press("Tab")
    window.render()
    verdict = window.session.check_truth()
    assert verdict is not None
    assert (len(verdict.rows), verdict.snr) == (0, float("inf"))
    assert window.session.numbers().truth.startswith("no false hides")


@pytest.mark.parametrize("key", ["c", "x", "b", "g", "h", "p"])
def test_every_mode_shows_something_and_goes_away(viewer: Callable[..., ViewerWindow], key: str) -> None:
    window = viewer(Pipeline([*Pipeline.parse("frustum").stages, Greedy(every=3)]), "none")
    window.press("f")
    window.session.view = town_views()["above"]
    window.show_hud = False
    window.session.messages.clear()
    window._message_until = 0.0
    plain = window.image()
    scene = window.session.picture()
    window.press(key)
    window._message_until = 0.0
    shown = window.image()
    assert not np.array_equal(plain, shown)
    # none of it is in a screenshot
    assert np.array_equal(window.session.picture(), scene)
    rounds = len([o for o in window.session.offered() if o.is_coloring()]) if key == "c" else 1
    for _ in range(rounds):
        window.press(key)
    window._message_until = 0.0
    assert np.array_equal(window.image(), plain)


def test_a_recorded_path_is_a_path_for_suites(viewer: Callable[..., ViewerWindow], tmp_path: Path) -> None:
    window = viewer("frustum", "none", record=tmp_path / "deep" / "path.json")
    for key in ("w", "w", "Left", "e"):
        window.press(key)
    window.close()
    views = read_path(tmp_path / "deep" / "path.json")
    assert len(views) == 5
    assert len(json.loads((tmp_path / "deep" / "path.json").read_text())) == 5
    assert views[0].eye != views[-1].eye


def test_a_replay_ends_and_can_be_repeated(viewer: Callable[..., ViewerWindow]) -> None:
    window = viewer("frustum", "none")
    eyes = []
    for _ in range(2):
        window.press("space")
        while window.replaying:
            window.tick()
            eyes.append(window.session.view.eye)
    assert len(eyes) == 2 * (len(PATH) + 1)
    assert eyes[: len(PATH)] == [view.eye for view in PATH]


def test_a_benchmark_measures_every_pipeline_on_every_view(viewer: Callable[..., ViewerWindow]) -> None:
    window = viewer("frustum", "none")
    found = measured(window, PATH)
    assert {name: len(frames) for name, frames in found.items()} == {"frustum": 4, "none": 4}
    assert [f["drawn"] for f in found["none"]] == [SNAPSHOT.n] * 4
    assert all(f["drawn"] < SNAPSHOT.n and f["stages"] for f in found["frustum"])
