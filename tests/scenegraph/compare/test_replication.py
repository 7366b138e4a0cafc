"""Replications: a paper's numbers beside ours, through the same door as a plugin's."""

from __future__ import annotations

import types
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenegraph import Group, Registry, Scene, ScenegraphError, View, hookimpl
from scenegraph.compare.replication import (
    Cell,
    Laboratory,
    Picture,
    Plot,
    Replication,
    likeness,
    number,
    replicate,
    tables_of,
)
from scenegraph.testing import box_at
from strict_json import parsed

#: A suite, but for its pipelines.
TOY: dict[str, Any] = {"name": "toy", "scene": {"name": "two"}, "width": 64, "height": 48, "frames": 3}


def small_scene() -> Scene:
    """Two boxes, one before the other."""
    path = [View((x, -9, 0), (0, 0, 0), width=64, height=48, far=50.0) for x in (-1.0, 0.0, 1.0)]
    return Scene(Group(box_at((0, 0, 0), 2.0), box_at((0, 5, 0)), name="two"), name="two", paths={"across": path})


def measured(laboratory: Laboratory) -> Replication:
    """Run one suite and lay one number beside the paper's, and one of our own."""
    suite = TOY | {"quick": {"frames": 2}, "pipelines": [{"name": "none"}]}
    result = laboratory.run("two", suite)["pipelines"]["none"]
    cells = [
        Cell("Table 1", "two", "none", "Triangles", "", 20.0, result["drawn_triangles"]),
        Cell("Table 1", "two", "none", "Frames", "", None, result["frames"]),
        Cell("Table 1", "two", "none", "SNR", "dB", None, result["snr_db_min"]),
    ]
    plots = [Plot("Figure 1", "ms", {"none": [1.0, float("nan"), 2.0]})]
    return Replication("toy2000", "A toy", cells, plots, remarks=["Nothing is as it was."])


@pytest.fixture
def known() -> Registry:
    @hookimpl
    def scenegraph_register_scenes(register: Any) -> None:
        register("two", small_scene, "Two boxes.")

    @hookimpl
    def scenegraph_register_replications(register: Any) -> None:
        register("toy2000", measured, "A toy.")

    plugin = types.ModuleType("toy")
    vars(plugin).update(
        scenegraph_register_scenes=scenegraph_register_scenes,
        scenegraph_register_replications=scenegraph_register_replications,
    )
    registry = Registry(discover=False)
    registry.add(plugin)
    assert registry.failures == []
    return registry


@pytest.mark.gl
@pytest.mark.parametrize(("quick", "frames"), [(True, 2), (False, 3)])
def test_tables_report_and_json_hold_the_same_numbers(
    known: Registry, tmp_path: Path, capsys: pytest.CaptureFixture[str], quick: bool, frames: int
) -> None:
    replicate("toy2000", quick=quick, json_file=str(tmp_path / "found.json"), out=tmp_path / "out", known=known)
    found = parsed(tmp_path / "found.json")
    assert found["paper"] == "toy2000"
    assert [(c["paper"], c["measured"]) for c in found["cells"]] == [(20.0, 24.0)]
    assert [(c["column"], c["measured"]) for c in found["added"]] == [("Frames", frames), ("SNR", "Infinity")]
    assert found["plots"][0]["series"] == {"none": [1, None, 2]}
    assert parsed(tmp_path / "out" / "replication.json") == found
    assert found["runs"]["two"]["pipelines"]["none"]["frames"] == frames
    page = (tmp_path / "out" / "replication.html").read_text()
    for text in ("Table 1: two", "Nothing is as it was.", "two/report.html", "<svg"):
        assert text in page
    assert (tmp_path / "out" / "two" / "report.html").exists()
    printed = capsys.readouterr().out
    assert "Table 1: two" in printed
    assert "24" in printed
    assert "∞" in printed


def test_unknown_papers_and_missing_models_get_one_sentence(known: Registry, tmp_path: Path) -> None:
    with pytest.raises(ScenegraphError, match=r"there is no replication 'toy200'\. Did you mean 'toy2000'"):
        replicate("toy200", known=known)
    with pytest.raises(ScenegraphError, match="there is no model file"):
        replicate("toy2000", model=tmp_path / "none.ply", known=known)


def test_tables_keep_the_order_of_the_cells_and_leave_gaps() -> None:
    cells = [
        Cell("T", "s", "b", "x", "ms", 1.0, 2.0),
        Cell("T", "s", "a", "y", "", 3.0, 4.0),
        Cell("U", "s", "a", "x", "ms", None, 6.0),
    ]
    first, second = tables_of(Replication("p", "t", cells))
    assert first.columns == (("x", "ms"), ("y", ""))
    assert [(row, [c and c.measured for c in found]) for row, found in first.rows] == [
        ("b", [2.0, None]),
        ("a", [None, 4.0]),
    ]
    assert second.title == "U: s"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (float("nan"), "–"),
        (float("inf"), "∞"),
        (float("-inf"), "−∞"),
        (73096.9, "73 097"),
        (0.5, "0.5"),
        (12.345, "12.3"),
        (0, "0"),
    ],
)
def test_numbers_are_short(value: float | None, text: str) -> None:
    assert number(value) == text


def played(laboratory: Laboratory) -> Replication:
    """Play a path, and bring home a plot and a picture."""
    suite = TOY | {"pipelines": [{"name": "none"}, {"name": "other"}]}
    found, whole = laboratory.play("two", suite, pictures=(0.0, 1.0), every=2)
    assert sorted(whole) == [0, 2]
    for one in found.values():
        assert [r.index for r in one.records] == [0, 1, 2]
        assert one.drawn_objects == [2, 2, 2]
        # frames in between are culled and not drawn
        assert [ms == ms for ms in one.draw_ms] == [True, False, True]
        assert len(one.frame_ms) == 2
        assert one.counted("nobody", "nothing") == [0, 0, 0]
        for index, picture in one.pictures.items():
            assert np.array_equal(picture, whole[index])
    plot = Plot("Figure 1", "objects", {name: [float(n) for n in one.drawn_objects] for name, one in found.items()})
    return Replication("toy2001", "A toy", [], plots=[plot], pictures=[Picture("Figure 2", "Two boxes.", whole[0])])


@pytest.mark.gl
def test_paths_are_played_and_plots_and_pictures_shown(known: Registry, tmp_path: Path) -> None:
    @hookimpl
    def scenegraph_register_replications(register: Any) -> None:
        register("toy2001", played, "A toy.")

    plugin = types.ModuleType("more")
    vars(plugin).update(scenegraph_register_replications=scenegraph_register_replications)
    known.add(plugin)
    replicate("toy2001", json_file=str(tmp_path / "found.json"), out=tmp_path / "out", known=known)
    found = parsed(tmp_path / "found.json")
    assert found["plots"][0]["series"] == {"none": [2, 2, 2], "other": [2, 2, 2]}
    page = (tmp_path / "out" / "replication.html").read_text()
    for text in ("Figure 1", "<svg", "Figure 2", "Two boxes.", "data:image/png"):
        assert text in page
    assert (tmp_path / "out" / "picture-1.png").exists()
    lines = (tmp_path / "out" / "two" / "played.csv").read_text().splitlines()
    assert len(lines) == 1 + 2 * 3


def test_likeness_of_pictures() -> None:
    one = np.random.default_rng(0).integers(0, 255, (32, 32, 3)).astype(np.uint8)
    other = np.clip(one.astype(int) + 9, 0, 255).astype(np.uint8)
    same, near = likeness(one, one), likeness(other, one)
    assert same["SNR"] == float("inf")
    assert same["SSIM"] == 1
    assert 10 < near["SNR"] < 40
    assert 0.5 < near["SSIM"] < 1
    pytest.importorskip("flip_evaluator", reason="needs the extra 'quality'")
    assert same["FLIP"] == 0
    assert 0 < near["FLIP"] < 0.5
