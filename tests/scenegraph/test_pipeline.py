"""Stage declarations, registry, pipeline text, checks, records, skipping and logs."""

from __future__ import annotations

import csv
import time
import types
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

import scenegraph as sg
from scenegraph.skipping import Worth
from scenegraph.testing import HideRows, grid_scene
from strict_json import parsed

VIEW = sg.View((0, -40, 0), (0, 0, 0))


class Map:
    """A product."""


class Maker(sg.Stage):
    """Makes a map."""

    name = "maker"
    writes = (Map,)
    size: int = sg.parameter(512, minimum=1, maximum=8192, unit="px", help="width of the map")

    def run(self, frame: sg.Frame) -> None:
        frame.put(Map())


class User(sg.Stage):
    """Uses a map."""

    name = "user"
    reads = (Map,)
    guarantee = sg.Guarantee.CONSERVATIVE
    opacity: float = sg.parameter(1.0, minimum=0.0, maximum=1.0, help="how full is full")
    order: Literal["near", "large"] = sg.parameter("near", help="which first")
    strict: bool = sg.parameter(True, help="no errors")

    def run(self, frame: sg.Frame) -> None:
        frame.get(Map)
        frame.hide([0])
        frame.count(tested=5, queries=2, looked=1.5)


def module(**hooks: object) -> types.ModuleType:
    made = types.ModuleType("plugin_of_the_test")
    vars(made).update(hooks)
    return made


def plugin(*stages: type) -> types.ModuleType:
    @sg.hookimpl
    def scenegraph_register_stages(register: object) -> None:
        for stage in stages:
            register(stage)  # type: ignore[operator]

    return module(scenegraph_register_stages=scenegraph_register_stages)


@pytest.fixture
def known() -> sg.Registry:
    registry = sg.Registry(discover=False)
    registry.add(plugin(Maker, User), name="maps")
    assert registry.failures == []
    return registry


# -- text form ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "again"),
    [
        ("", "none"),
        ("none", "none"),
        ("maker", "maker"),
        (" maker |user ( opacity = 0.5 )", "maker | user(opacity=0.5)"),
        ("maker(size=512) | user(order='large', strict=False)", "maker | user(order='large', strict=False)"),
        ("maker | user(order=large, opacity=1)", "maker | user(order='large')"),
    ],
)
def test_text_parses_and_prints(known: sg.Registry, text: str, again: str) -> None:
    pipeline = sg.Pipeline.parse(text, known)
    assert pipeline.text == again
    assert sg.Pipeline.parse(pipeline.text, known).text == again


@pytest.mark.parametrize(
    ("text", "faults"),
    [
        ("maker | usr", ["there is no stage 'usr'. Did you mean 'user'?"]),
        ("maker(sise=3)", ["stage 'maker' has no parameter 'sise'. Did you mean 'size'?"]),
        ("maker(size=0)", ["stage 'maker': size=0 is below its minimum 1 px"]),
        ("maker(size=9000)", ["stage 'maker': size=9000 is above its maximum 8192 px"]),
        ("maker(size=2.5)", ["stage 'maker': size=2.5 is not int"]),
        ("maker(size=True)", ["stage 'maker': size=True is not int"]),
        ("maker|user(opacity='full')", ["stage 'user': opacity='full' is not a number"]),
        ("maker|user(order=nearest)", ["stage 'user': order='nearest'; Did you mean 'near'?"]),
        ("user", ["stage 'user' reads Map, which no stage before it puts; put maker before it"]),
        ("maker | maker", ["stage 'maker' stands twice in the pipeline; keep one"]),
        ("maker(512)", ["stage 'maker': give parameters by name, as in maker(key=value)"]),
        ("maker(size=1+2)", ["stage 'maker': the value of size is not a number, text or truth value"]),
        ("'maker'", ["\"'maker'\" is not a stage; write name or name(key=value, ...)"]),
        ("usr | maker(sise=1, size=0)", ["there is no stage", "has no parameter 'sise'", "below its minimum"]),
    ],
)
def test_every_fault_is_reported_at_once(known: sg.Registry, text: str, faults: list[str]) -> None:
    with pytest.raises(sg.PipelineError) as caught:
        sg.Pipeline.parse(text, known)
    assert len(caught.value.faults) == len(faults)
    for fault, found in zip(faults, caught.value.faults, strict=True):
        assert fault in found


def test_a_text_that_is_no_pipeline_says_where(known: sg.Registry) -> None:
    with pytest.raises(sg.PipelineError, match=r"cannot read 'maker \| \(' near column 9"):
        sg.Pipeline.parse("maker | (", known)


# -- registry -------------------------------------------------------------------------------------------------------


def test_name_clash_keeps_the_first_and_names_both_plugins(known: sg.Registry) -> None:
    other = type("Other", (Maker,), {"name": "user", "__doc__": "Another."})
    known.add(plugin(other), name="late")
    assert known.stages["user"] is User
    (failure,) = known.failures
    assert (failure.name, "plugin 'maps' already has one" in failure.message) == ("late", True)


@pytest.mark.parametrize(
    ("thing", "message"),
    [
        (int, "not a subclass of scenegraph.Stage"),
        (type("Nameless", (Maker,), {"name": ""}), "use a lower-case identifier"),
        (type("Lazy", (sg.Stage,), {"name": "lazy"}), "does not define run"),
        (type("Odd", (Maker,), {"name": "odd", "guarantee": "safe"}), "guarantee is 'safe'"),
        (
            type("Bad", (Maker,), {"name": "bad", "__annotations__": {"size": list}, "size": sg.parameter(3)}),
            "bool, int",
        ),
    ],
)
def test_a_bad_stage_is_a_failure_not_an_exception(known: sg.Registry, thing: type, message: str) -> None:
    known.add(plugin(thing), name="broken")
    assert message in known.failures[-1].message
    assert set(known.stages) == {"maker", "user"}


def test_a_raising_hook_and_a_misspelt_hook_are_failures(known: sg.Registry) -> None:
    @sg.hookimpl
    def scenegraph_register_scenes(register: object) -> None:
        raise RuntimeError("boom")

    @sg.hookimpl
    def scenegraph_register_stagse(register: object) -> None:
        pass

    known.add(module(scenegraph_register_scenes=scenegraph_register_scenes), name="raising")
    known.add(module(scenegraph_register_stagse=scenegraph_register_stagse), name="misspelt")
    assert [f.name for f in known.failures] == ["raising", "misspelt"]
    assert "boom" in known.failures[0].message
    assert "stagse" in known.failures[1].message


def test_installed_plugins_are_found() -> None:
    found = sg.registry()
    assert found.failures == []
    assert {"frustum", "contribution"} <= set(found.stages)


def test_needs_are_prepared_once_and_unknown_ones_are_faults(known: sg.Registry) -> None:
    needy = type("Needy", (Maker,), {"name": "needy", "needs": ("numbers",), "writes": (Map,)})
    with pytest.raises(sg.PipelineError, match="needs 'numbers', which no plugin prepares; there are: none"):
        sg.Pipeline([needy()], preparations=known).check()
    built = []

    def build(snapshot: sg.Snapshot, progress: object) -> int:
        built.append(snapshot.n)
        return 7

    @sg.hookimpl
    def scenegraph_register_preparations(register: object) -> None:
        register("numbers", build, "Numbers.")  # type: ignore[operator]

    known.add(module(scenegraph_register_preparations=scenegraph_register_preparations), name="numbers")
    snapshot = grid_scene(2).snapshot()
    for _ in range(2):
        sg.Pipeline([needy()], preparations=known).open(snapshot)
    assert built == [8]


def test_gl_stages_refuse_to_open_without_a_device(known: sg.Registry) -> None:
    needy = type("Needy", (Maker,), {"name": "needy", "needs": ("gl",)})
    with pytest.raises(sg.PipelineError, match="stage needy needs OpenGL"):
        sg.Pipeline([needy()], preparations=known).open(grid_scene(1).snapshot())


# -- running --------------------------------------------------------------------------------------------------------


def test_records_add_up_to_the_cull_time_and_tell_what_happened(known: sg.Registry) -> None:
    with sg.Pipeline.parse("maker | user", known).open(grid_scene(3).snapshot()) as pipeline:
        record = pipeline.run(VIEW).record
    assert [s.name for s in record.stages] == ["maker", "user"]
    assert np.isclose(sum(s.ms for s in record.stages) + record.host_ms, record.cull_ms)
    assert record.host_ms >= 0
    user = record.stages[1]
    assert (user.tested, user.queries, user.hidden, user.counts) == (5, 2, 1, {"looked": 1.5})
    assert (user.triangles_before, user.triangles_after) == (27 * 12, 26 * 12)
    assert (record.visible, record.triangles) == (26, 26 * 12)


def test_hidden_by_names_the_stage_and_previous_is_the_frame_before(known: sg.Registry) -> None:
    with sg.Pipeline([HideRows(), Maker(), User()], preparations=known).open(grid_scene(2).snapshot()) as pipeline:
        first = pipeline.run(VIEW)
        second = pipeline.run(VIEW)
        other = pipeline.run(VIEW, view_name="right")
    assert first.hidden_by().tolist() == [0, -1, -1, 0, -1, -1, 0, -1]
    assert second.previous is first
    assert first.previous is None
    assert other.previous is None
    assert [first.index, second.index] == [0, 1]


def test_skips_say_why(known: sg.Registry) -> None:
    picky = type("Picky", (User,), {"name": "picky", "reads": (), "skip": lambda self, frame: "not today"})
    shy = type("Shy", (HideRows,), {"name": "shy", "minimum_candidates": 100})
    off = type("Off", (HideRows,), {"name": "off"})
    pipeline = sg.Pipeline([picky(), shy(), off()], preparations=known)
    pipeline.disabled.add("off")
    frame = pipeline.open(grid_scene(2).snapshot()).run(VIEW)
    assert [s.skipped for s in frame.record.stages] == ["not today", "only 8 candidates left", "switched off"]
    assert frame.visible.all()


def test_structural_edits_reopen_the_stages(known: sg.Registry) -> None:
    opened: list[int] = []
    stage = type("Opener", (HideRows,), {"name": "opener", "open": lambda self, s, p: opened.append(s.n)})
    scene = grid_scene(2)
    snapshot = scene.snapshot()
    pipeline = sg.Pipeline([stage()], preparations=known).open(snapshot)
    pipeline.run(VIEW)
    scene.root.remove(scene.root.children[0])
    snapshot.sync()
    assert pipeline.run(VIEW).visible.shape == (7,)
    assert opened == [8, 7]


def test_guarantee_of_a_pipeline_is_its_weakest() -> None:
    assert sg.Pipeline([]).guarantee is sg.Guarantee.CONSERVATIVE
    assert sg.Pipeline([User()]).guarantee is sg.Guarantee.CONSERVATIVE
    assert sg.Pipeline([User(), HideRows()]).guarantee is sg.Guarantee.APPROXIMATE


def test_several_views_of_one_frame(known: sg.Registry) -> None:
    with sg.Pipeline.parse("maker | user", known).open(grid_scene(2).snapshot()) as pipeline:
        walls = [VIEW.moved(target=t) for t in ((0, 0, 0), (40, -40, 0), (-40, -40, 0))]
        for number in range(2):
            frames = pipeline.run_views(walls)
            assert [f.index for f in frames] == [number] * 3
            assert all((f.previous is not None) == (number > 0) for f in frames)


def test_run_before_open_and_after_close() -> None:
    pipeline = sg.Pipeline([])
    with pytest.raises(sg.PipelineError, match="before open"):
        pipeline.run(VIEW)


# -- does it pay ----------------------------------------------------------------------------------------------------


def test_a_stage_that_does_not_pay_pauses_ever_longer_and_comes_back_when_it_does() -> None:
    worth = Worth()
    worth.drawn(objects=100, triangles=1000, ms=10.0)
    lazy = play(worth, range(300), ms=0.2, hidden=1)
    assert lazy[:3] == [0, 1, 2]
    assert np.diff(lazy[2:]).tolist() == [5, 9, 17, 33, 65, 65, 65]
    assert "saves 0.05 ms" in str(worth.skip("stage", lazy[-1] + 2))
    busy = play(worth, range(400, 500), ms=0.2, hidden=1000)
    assert len(busy) > 95


@pytest.mark.parametrize(("ms", "pause"), [(0.06, 4), (1.05, 10), (5.05, 50), (500.0, 256)])
def test_trials_cost_no_more_than_a_hundredth_of_the_frames(ms: float, pause: int) -> None:
    worth = Worth()
    worth.drawn(objects=100, triangles=1000, ms=10.0)
    ran = play(worth, range(60 if pause < 60 else 300), ms=ms, hidden=1)
    assert ran[3] - ran[2] - 1 == pause


def play(worth: Worth, frames: range, *, ms: float, hidden: int) -> list[int]:
    """The frames in which a stage is not skipped that costs so much."""
    ran = []
    for index in frames:
        if worth.skip("stage", index) is None:
            ran.append(index)
            worth.ran(sg.StageRecord("stage", ms=ms, hidden=hidden))
    return ran


def test_nothing_is_skipped_before_drawing_was_measured() -> None:
    worth = Worth()
    for index in range(10):
        worth.ran(sg.StageRecord("stage", ms=5.0))
        assert worth.skip("stage", index) is None


@dataclass
class Hint:
    """What `Hints` puts and `Listens` reads."""


class Hints(sg.Stage):
    """Saves nothing by itself, and is slow."""

    name = "hints"
    writes = (Hint,)

    def run(self, frame: sg.Frame) -> None:
        time.sleep(0.002)
        frame.put(Hint())


class Listens(sg.Stage):
    """Hides most, if there is a hint."""

    name = "listens"
    reads = (Hint,)
    hides: bool = sg.parameter(True)

    def run(self, frame: sg.Frame) -> None:
        frame.get(Hint)
        if self.hides:
            frame.hide(np.arange(frame.snapshot.n - 1))


def adaptive(hides: bool) -> list[sg.FrameRecord]:
    with sg.Pipeline([Hints(), Listens(hides=hides)], adaptive=True).open(grid_scene(5).snapshot()) as pipeline:
        pipeline.worth.drawn(objects=25, triangles=300, ms=1000.0)
        return [pipeline.run(VIEW).record for _ in range(12)]


def test_a_stage_gets_credit_for_those_that_read_what_it_puts() -> None:
    assert all(r.skipped is None for record in adaptive(hides=True) for r in record.stages)


def test_without_its_product_a_reader_is_skipped_and_says_so() -> None:
    last = adaptive(hides=False)[-1].stages
    assert "saves 0.00 ms" in str(last[0].skipped)
    assert last[1].skipped == "no stage has put Hint into this frame"


# -- logs -----------------------------------------------------------------------------------------------------------


def test_logs_stream_and_agree(known: sg.Registry, tmp_path: Path) -> None:
    with (
        sg.Pipeline.parse("maker | user", known).open(grid_scene(2).snapshot()) as pipeline,
        sg.FrameLog(tmp_path / "stream.csv") as log,
    ):
        for number in range(3):
            log.append("a", pipeline.run(VIEW).record, draw_ms=1.5, snr_db=float("inf"))
            rows = list(csv.DictReader((tmp_path / "stream.csv").read_text().splitlines()))
            assert len(rows) == 3 * (number + 1)
        log.write_csv(tmp_path / "all.csv")
        log.write_jsonl(tmp_path / "all.jsonl")
        log.write_trace(tmp_path / "trace.json")
    assert (tmp_path / "all.csv").read_text() == (tmp_path / "stream.csv").read_text()
    assert [r["stage"] for r in rows[:3]] == ["*", "maker", "user"]
    lines = [parsed(line) for line in (tmp_path / "all.jsonl").read_text().splitlines()]
    assert [line["index"] for line in lines] == [0, 1, 2]
    assert [line["snr_db"] for line in lines] == ["Infinity"] * 3
    events = parsed(tmp_path / "trace.json")["traceEvents"]
    frames = [e for e in events if e["name"].startswith("frame ")]
    assert len(frames) == 3
    for frame in frames:
        inner = [e for e in events if e["ph"] == "X" and frame["ts"] <= e["ts"] < frame["ts"] + frame["dur"]]
        assert {e["name"] for e in inner} == {frame["name"], "cull", "maker", "user", "draw"}
    assert frames[0]["args"]["snr_db"] == "Infinity"
