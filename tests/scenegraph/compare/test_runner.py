"""A whole comparison on a scene whose truth is known: what is counted, what is written, and how it ends."""

from __future__ import annotations

import csv
import math
import re
from pathlib import Path

import numpy as np
import pytest

from scenegraph import (
    Frame,
    Geode,
    Group,
    Guarantee,
    Mesh,
    Registry,
    Scene,
    SceneError,
    Stage,
    Transform,
    View,
    hookimpl,
    parameter,
)
from scenegraph.compare.command import run_command
from scenegraph.render.item_buffer import ExactVisibleSet
from strict_json import parsed

SIZE = (96, 64)
#: What summary.json promises of every pipeline.
PROMISED = {
    "stages", "frames", "drawn_objects", "drawn_triangles", "cull_ms", "draw_ms", "frame_ms",
    "false_hides", "missing_pixels_max", "overestimate", "snr_db_min", "speedup",
}  # fmt: skip


class Liar(Stage):
    """Hides the row named `front` in frames 2 and 3, though it is visible, and always what stands behind."""

    name = "liar"
    bound = "two frames"

    def run(self, frame: Frame) -> None:
        """Hide by name."""
        names = np.array([name.rpartition("/")[2] for name in frame.snapshot.names(range(frame.snapshot.n))])
        frame.count(tested=len(names))
        frame.hide(np.flatnonzero(names == "behind"))
        if frame.index in (2, 3):
            frame.hide(np.flatnonzero(names == "front"))


class Pretender(Liar):
    """Hides as the liar does and claims not to."""

    name = "pretender"
    guarantee = Guarantee.CONSERVATIVE


class Breaker(Stage):
    """Behaves as Ctrl-C in one frame."""

    name = "breaker"
    at: int = parameter(2, minimum=0, maximum=99, help="frame in which it strikes")

    def run(self, frame: Frame) -> None:
        """Strike."""
        if frame.index == self.at:
            raise KeyboardInterrupt


def stage_set() -> Scene:
    """A front box that hides the one behind it, one beside them, and one out of sight."""
    box = Mesh.box((-1, -1, -1), (1, 1, 1))
    places = {"front": (0, 6, 0), "behind": (0, 14, 0), "beside": (4, 9, 0), "away": (0, -20, 0)}
    root = Group(
        *[Transform(Geode(box, name=name, color=(0.5, 0.1, 0.1)), translation=place) for name, place in places.items()]
    )
    views = [View((0.05 * i, 0, 0), (0.05 * i, 1, 0), near=0.1, far=100) for i in range(5)]
    return Scene(root, name="stage set", paths={"sideways": views})


def empty() -> Scene:
    """Nothing."""
    return Scene(Group(), name="empty")


def drawn_share(frame: Frame, truth: ExactVisibleSet, image: np.ndarray, reference: np.ndarray) -> float:
    """Share of the drawables that were drawn."""
    assert image.shape == reference.shape == (*truth.ids.shape, 3)
    return float(frame.visible.mean())


def broken(*_: object) -> float:
    """Raise."""
    raise ZeroDivisionError("on purpose")


class Plugin:
    @hookimpl
    def scenegraph_register_metrics(self, register: object) -> None:
        register("drawn_share", drawn_share, "Share of the drawables that were drawn.")
        register("broken", broken, "Raises.")

    @hookimpl
    def scenegraph_register_stages(self, register: object) -> None:
        register(Liar)
        register(Pretender)
        register(Breaker)

    @hookimpl
    def scenegraph_register_scenes(self, register: object) -> None:
        register("stage_set", stage_set, "Four boxes.")
        register("empty", empty, "Nothing.")


@pytest.fixture(scope="module")
def known() -> Registry:
    registry = Registry()
    registry.add(Plugin(), name="tests")
    assert not registry.failures
    return registry


def suite_file(folder: Path, *pipelines: tuple[str, str], scene: str = "stage_set", more: str = "") -> str:
    parts = [f'frames = 5\nwidth = {SIZE[0]}\nheight = {SIZE[1]}\n{more}\n[scene]\nname = "{scene}"\n']
    parts += [f'[[pipelines]]\nname = "{name}"\nstages = "{stages}"\n' for name, stages in pipelines]
    path = folder / "suite.toml"
    path.write_text("\n".join(parts))
    return str(path)


@pytest.fixture(scope="module")
def finished(known: Registry, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("finished")
    text = suite_file(folder, ("none", ""), ("frustum", "frustum"), ("wrong", "frustum | liar"))
    with Path(text).open("a") as file:
        file.write('[[pipelines]]\nname = "vtk"\ndraw = "actors"\nvtk_culler = true\n')
    assert run_command(text, out=folder / "out", json_file=str(folder / "copy.json"), known=known) == 0
    return folder / "out"


@pytest.fixture(scope="module")
def summary(finished: Path) -> dict[str, object]:
    return parsed(finished / "summary.json")


@pytest.mark.gl
class TestWhole:
    def test_summary_keeps_the_contract(self, summary: dict[str, object], finished: Path) -> None:
        assert {"suite", "scene", "machine", "pipelines"} <= set(summary)
        assert {"name": "stage set", "drawables": 4, "triangles": 48}.items() <= summary["scene"].items()
        assert list(summary["pipelines"]) == ["none", "frustum", "wrong", "vtk"]
        for pipeline in summary["pipelines"].values():
            assert set(pipeline) >= PROMISED
            assert pipeline["frames"] == 5
        assert parsed(finished.parent / "copy.json") == summary

    def test_what_hides_nothing_is_the_measure(self, summary: dict[str, object]) -> None:
        none = summary["pipelines"]["none"]
        assert (none["drawn_objects"], none["drawn_triangles"], none["speedup"]) == (4, 48, 1)
        assert (none["false_hides"], none["overestimate"], none["snr_db_min"]) == (0, 2, "Infinity")
        assert none["stages"] == []

    @pytest.mark.parametrize("name", ["frustum", "vtk"])
    def test_conservative_pipelines_change_no_pixel(self, name: str, summary: dict[str, object]) -> None:
        found = summary["pipelines"][name]
        assert (found["drawn_objects"], found["overestimate"], found["false_hides"]) == (3, 1, 0)
        assert float(found["snr_db_min"]) == float(found["snr_db_p5"]) == float(found["psnr_db_min"]) == math.inf
        assert found["snr_db_mean_of_finite"] is None, "nothing finite to average"
        assert found["equal_frames"] == 5
        assert found["wrong_pixels_max"] == found["missing_pixels_max"] == 0
        assert found["ssim_min"] == 1

    def test_false_hides_are_counted_in_drawables_pixels_and_frames(self, summary: dict[str, object]) -> None:
        wrong = summary["pipelines"]["wrong"]
        assert wrong["false_hides_total"] == 2
        assert wrong["false_hides"] == pytest.approx(2 / 5)
        assert wrong["longest_missing_streak"] == 2
        assert wrong["overestimate"] == 0
        assert wrong["equal_frames"] == 3
        assert 0 < wrong["snr_db_min"] < 40
        # the front box is 2 wide at 5 from the eye: 2 / (2 · 5 · tan 30°) of the height of 64, squared
        edge = 2 / (2 * 5 * math.tan(math.radians(30))) * SIZE[1]
        assert wrong["missing_pixels_max"] == pytest.approx(edge**2, rel=0.1)
        # what stood behind it, here hidden too, does not fill the hole
        assert wrong["wrong_pixels_max"] == pytest.approx(wrong["missing_pixels_max"], rel=0.05)

    def test_stages_add_up_to_the_cull_time(self, summary: dict[str, object], finished: Path) -> None:
        names = [stage["name"] for stage in summary["pipelines"]["wrong"]["stages"]]
        assert names == ["frustum", "liar"]
        assert summary["pipelines"]["wrong"]["stages"][1]["hidden"] == pytest.approx(1 + 2 / 5)
        rows = read_csv(finished)
        for frame in range(5):
            mine = [r for r in rows if r["pipeline"] == "wrong" and r["frame"] == str(frame)]
            whole = next(r for r in mine if r["stage"] == "*")
            parts = sum(float(r["ms"]) for r in mine if r["stage"] != "*") + float(whole["host_ms"])
            assert parts == pytest.approx(float(whole["cull_ms"]), abs=1e-3)

    def test_frames_table(self, finished: Path, summary: dict[str, object]) -> None:
        rows = [r for r in read_csv(finished) if r["stage"] == "*"]
        assert len(rows) == 4 * 5
        assert {r["path"] for r in rows} == {"sideways"}
        wrong = [r for r in rows if r["pipeline"] == "wrong"]
        assert [int(r["false_hides"]) for r in wrong] == [0, 0, 1, 1, 0]
        assert max(float(r["missing_pixels"]) for r in wrong) == summary["pipelines"]["wrong"]["missing_pixels_max"]
        decibels = np.array([float(r["snr_db"]) for r in wrong])
        finite = decibels[np.isfinite(decibels)]
        assert (len(finite), (decibels == np.inf).sum()) == (2, 3)
        assert summary["pipelines"]["wrong"]["snr_db_mean_of_finite"] == pytest.approx(finite.mean(), abs=1e-3)

    def test_metrics_of_plugins_are_measured(self, summary: dict[str, object], finished: Path) -> None:
        found = summary["pipelines"]["frustum"]["metrics"]
        assert found["drawn_share"]["mean"] == found["drawn_share"]["worst"] == 0.75
        assert found["broken"]["mean"] is None
        assert summary["notes"] == [
            "The metric broken failed and counts as not a number (ZeroDivisionError: on purpose)."
        ]
        rows = [r for r in read_csv(finished) if r["stage"] == "*" and r["pipeline"] == "frustum"]
        assert {r["drawn_share"] for r in rows} == {"0.75"}
        assert "drawn_share" in (finished / "report.html").read_text()

    def test_trace_is_one_track_per_pipeline(self, finished: Path) -> None:
        events = parsed(finished / "trace.json")["traceEvents"]
        tracks = {e["args"]["name"] for e in events if e["ph"] == "M"}
        assert tracks == {"none", "frustum", "wrong", "vtk"}
        assert sum(e["name"] == "draw" for e in events) == 4 * 5

    def test_report_loads_nothing_and_says_what_was_found(self, finished: Path) -> None:
        page = (finished / "report.html").read_text()
        outside = re.findall(r"""(?:src|href)\s*=\s*["'](?!data:|#)([^"']*)|url\((?!#)([^)]*)\)|@import""", page)
        assert not outside
        assert "<script" not in page
        assert page.count("data:image/png;base64,") == 4 * 3
        assert "wrong draws" in page
        assert "it hid 2 visible drawables over 5 frames" in page
        assert "frustum draws 75 % of the triangles" in page
        assert "the view in which most pixels are missing" in page
        assert page.count("<svg") == page.count("</svg>") == 5 + 2 * 4


def read_csv(folder: Path) -> list[dict[str, str]]:
    with (folder / "frames.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.gl
def test_an_interrupted_run_leaves_its_finished_frames(known: Registry, tmp_path: Path) -> None:
    text = suite_file(tmp_path, ("none", ""), ("stopped", "breaker(at=3)"))
    assert run_command(text, out=tmp_path / "out", known=known) == 130
    rows = [r for r in read_csv(tmp_path / "out") if r["stage"] == "*"]
    assert sorted((r["pipeline"], r["frame"]) for r in rows) == [
        (name, str(i)) for name in ("none", "stopped") for i in range(3)
    ]
    summary = parsed(tmp_path / "out" / "summary.json")
    assert summary["interrupted"]
    assert [p["frames"] for p in summary["pipelines"].values()] == [3, 3]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "<b>Interrupted.</b> 3 of 5 views were finished" in page


@pytest.mark.gl
def test_interrupted_before_the_first_view_was_finished(known: Registry, tmp_path: Path) -> None:
    text = suite_file(tmp_path, ("none", ""), ("stopped", "breaker(at=0)"), more="warmup = 0")
    assert run_command(text, out=tmp_path / "out", known=known) == 130
    assert not read_csv(tmp_path / "out")
    assert "<b>Interrupted.</b> 0 of 5 views" in (tmp_path / "out" / "report.html").read_text()


@pytest.mark.gl
def test_false_hides_can_fail_the_run(known: Registry, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = suite_file(tmp_path, ("none", ""), ("frustum", "frustum"))
    assert run_command(text, out=tmp_path / "a", fail_on_false_hides=True, known=known) == 0
    text = suite_file(tmp_path, ("none", ""), ("wrong", "liar"))
    assert run_command(text, out=tmp_path / "b", fail_on_false_hides=True, known=known) == 1
    assert "hid what is visible: wrong" in capsys.readouterr().err


@pytest.mark.gl
def test_a_broken_claim_is_said(known: Registry, tmp_path: Path) -> None:
    text = suite_file(tmp_path, ("none", ""), ("pretender", "pretender"), ("liar", "liar"))
    assert run_command(text, out=tmp_path / "out", known=known) == 0
    found = parsed(tmp_path / "out" / "summary.json")["pipelines"]
    assert {name: p["claim_is_broken"] for name, p in found.items()} == {
        "none": False,
        "pretender": True,
        "liar": False,
    }
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.count("though it claims to be conservative, it hid 2 visible drawables") == 1


@pytest.mark.gl
def test_without_a_pipeline_that_hides_nothing(known: Registry, tmp_path: Path) -> None:
    """The reference is then drawn apart from the comparison."""
    text = suite_file(tmp_path, ("wrong", "liar"), more="supersample = 2")
    assert run_command(text, out=tmp_path / "out", known=known) == 0
    wrong = parsed(tmp_path / "out" / "summary.json")["pipelines"]["wrong"]
    assert (wrong["equal_frames"], wrong["false_hides_total"]) == (3, 2)
    assert wrong["wrong_pixels_max"] == pytest.approx(wrong["missing_pixels_max"], rel=0.05)


@pytest.mark.gl
def test_summary_on_stdout_is_only_the_summary(
    known: Registry, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = suite_file(tmp_path, ("none", ""))
    assert run_command(text, out=tmp_path / "out", json_file="-", frames=2, known=known) == 0
    assert parsed(capsys.readouterr().out)["pipelines"]["none"]["frames"] == 2


@pytest.mark.gl
def test_time_limit_drops_views_and_says_so(known: Registry, tmp_path: Path) -> None:
    text = suite_file(tmp_path, ("none", ""), more="seconds = 1e-6")
    assert run_command(text, out=tmp_path / "out", known=known) == 0
    summary = parsed(tmp_path / "out" / "summary.json")
    assert summary["pipelines"]["none"]["frames"] == 1
    assert "1 of 5 views drawn" in summary["notes"][0]


@pytest.mark.gl
def test_empty_scene(known: Registry, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="has no drawables"):
        run_command(suite_file(tmp_path, ("none", ""), scene="empty"), out=tmp_path / "out", known=known)


@pytest.mark.gl
def test_unknown_path(known: Registry, tmp_path: Path) -> None:
    text = suite_file(tmp_path, ("none", ""), more='paths = ["sidewys"]')
    with pytest.raises(Exception, match=r"no path 'sidewys'\. Did you mean 'sideways'"):
        run_command(text, out=tmp_path / "out", known=known)
