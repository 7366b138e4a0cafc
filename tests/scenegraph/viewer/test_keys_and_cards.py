"""What can be tested without a window: the key table, the cards, sliders, walking."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from scenegraph import Frame, Geode, Group, Mesh, Parameter, Registry, Scene, Stage, Transform, View, parameter
from scenegraph.overlay import Overlay
from scenegraph.viewer.actions import ACTIONS
from scenegraph.viewer.canvas import Canvas
from scenegraph.viewer.command import usual_pipeline
from scenegraph.viewer.hud import Numbers, help_card, numbers_card, short
from scenegraph.viewer.keys import KEYS, docs_table
from scenegraph.viewer.panel import bounds, panel_card, share_of, value_at
from scenegraph.viewer.walking import Walker

DOCS = Path(__file__).parents[3] / "docs"


class Tuned(Stage):
    """Has one parameter of each kind."""

    name = "tuned"
    pixels: float = parameter(1.0, minimum=0.0, maximum=10_000.0, unit="px")
    share: float = parameter(0.5, minimum=0.0, maximum=1.0)
    active: int = parameter(15, minimum=0, maximum=1000)
    strict: bool = parameter(False)
    kind: str = parameter("b", choices=("a", "b", "c"))

    def run(self, frame: Frame) -> None:
        frame.count(ran=1)


def test_every_key_acts_and_is_listed_once() -> None:
    assert max(Counter(name for key in KEYS for name in key.keys).values()) == 1
    assert {key.action for key in KEYS} == set(ACTIONS)


def test_screen_and_docs_list_the_same_keys(monkeypatch: pytest.MonkeyPatch) -> None:
    assert docs_table() in (DOCS / "viewer.md").read_text(encoding="utf-8")
    written: list[str] = []
    monkeypatch.setattr(Canvas, "text", lambda self, x, y, text, **_: written.append(text))
    help_card(KEYS)
    for key in KEYS:
        assert key.shown in written
        assert key.text in written


def test_every_key_is_whole_on_the_card(monkeypatch: pytest.MonkeyPatch) -> None:
    for key in KEYS:
        assert Canvas.length(key.shown) <= 70, key
        assert Canvas.length(key.text) <= 290, key


@given(st.data())
def test_a_slider_reaches_its_ends_and_keeps_what_it_shows(data: st.DataObject) -> None:
    p: Parameter = data.draw(st.sampled_from(list(Tuned.parameters().values())))
    share = data.draw(st.floats(0, 1))
    value = value_at(p, share)
    assert p.fault(value) is None
    assert p.fault(value_at(p, 0.0)) is None
    assert p.fault(value_at(p, 1.0)) is None
    if not p.choices and p.type is not bool:
        assert (value_at(p, 0.0), value_at(p, 1.0)) == bounds(p)
    # what a value is shown at gives about that value back
    again = value_at(p, share_of(p, value))
    assert again == value or again == pytest.approx(value, rel=0.02, abs=1e-3)


def test_cards_have_a_spot_for_each_stage_and_parameter() -> None:
    stage = Tuned()
    stages = {spot.what for spot in numbers_card(Numbers(stages=[stage, stage])).spots}
    assert stages == {("stage", "0"), ("stage", "1")}
    card = panel_card([stage])
    assert [spot.what[2] for spot in card.spots] == list(Tuned.parameters())
    spot = card.spots[2]
    assert card.spot(spot.x + 5, spot.y + 5) is spot
    assert (spot.share(spot.x), spot.share(spot.x + spot.width), spot.share(-9)) == (0.0, 1.0, 0.0)


@pytest.mark.parametrize("behind", [0, 255])
def test_text_is_legible_on_black_and_on_white(behind: int) -> None:
    """Contrast of at least 4.5 to 1, as the WCAG ask of body text."""
    image = numbers_card(Numbers(title="city", stages=[Tuned()])).image.astype(float)
    alpha = image[..., 3:] / 255
    shown = (image[..., :3] * alpha + behind * (1 - alpha)) / 255
    inside = shown[12:-12, 12:-12]
    linear = np.where(inside <= 0.04045, inside / 12.92, ((inside + 0.055) / 1.055) ** 2.4)
    light = linear @ np.array([0.2126, 0.7152, 0.0722])
    assert (light.max() + 0.05) / (np.median(light) + 0.05) > 4.5


def test_numbers_are_short() -> None:
    assert [short(v) for v in (0, 812, 9999, 12_345, 529_024, 1_234_567, 3e9)] == [
        "0", "812", "9,999", "12.3 k", "529 k", "1.2 M", "3.0 G",
    ]  # fmt: skip


def test_the_usual_pipeline_promises_to_hide_nothing_visible() -> None:
    pipeline = usual_pipeline(Registry())
    assert pipeline.stages
    assert pipeline.guarantee.value == "conservative"
    assert not pipeline.needs


def test_walking_stays_level_and_turning_stays_upright() -> None:
    ground = Mesh([[-50, -50, 0], [50, -50, 0], [50, 50, 0], [-50, 50, 0]], [[0, 1, 2], [0, 2, 3]])
    boxes = [Transform(Geode(Mesh.box((0, 0, 0), (4, 4, 6))), translation=(9 * i - 40, 8, 0)) for i in range(9)]
    walker = Walker(Scene(Group(Geode(ground), *boxes)).snapshot())
    view = View((0, 0, 1.7), (0, 10, 0.7))
    moved = walker.step(view, forward=3, right=1)
    assert moved.eye[2] == pytest.approx(1.7)
    assert moved.eye[:2] == pytest.approx((walker.pace, 3 * walker.pace))
    assert moved.forward == pytest.approx(view.forward)
    turned = walker.turn(walker.turn(view, left=90), up=400)
    assert turned.forward[2] < 1
    assert turned.axes[1] @ (0, 0, 1) > 0
    assert 0 < moved.near < moved.far
    assert moved.far > 70


class Tinted(Overlay):
    """A coloring."""

    name = "tinted"

    def colors(self, frame: Frame) -> np.ndarray:
        return np.ones((frame.snapshot.n, 4))


class Plugin:
    """Brings an overlay, and something that is none."""

    from scenegraph import hookimpl

    @staticmethod
    @hookimpl
    def scenegraph_register_overlays(register) -> None:  # type: ignore[no-untyped-def]
        register(Tinted)
        register(Tuned)
        register(Tinted)


def test_overlays_come_through_a_hook() -> None:
    registry = Registry(discover=False)
    registry.add(Plugin, name="p")
    assert registry.overlays == {"tinted": Tinted}
    assert Tinted.is_coloring()
    assert [f.message.split(",")[0].split(" which")[0] for f in registry.failures] == [
        f"registered {Tuned!r}",
        "names a overlay 'tinted'",
    ]
