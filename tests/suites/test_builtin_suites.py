"""The built-in suites on small versions of their scenes, and real files: what must hold whatever the timing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from data_files import require_data
from scenegraph import registry
from scenegraph.compare.command import run_command, write_run
from scenegraph.compare.runner import run_suite
from scenegraph.compare.suite import find_suite
from scenegraph.log import FrameLog
from strict_json import parsed

SMALL = {"city": {"buildings": 60}, "olympia": {"trees": 40}, "scatter": {"count": 60}}
EXACT = ("none", "vtk-default", "frustum")


def judge(summary: dict[str, Any]) -> None:
    """Hold what the usual pipelines promise on any scene against a summary."""
    pipelines = summary["pipelines"]
    assert list(pipelines)[:4] == [*EXACT, "frustum+contribution"]
    for name in pipelines.keys() - {"frustum+contribution"}:
        found = pipelines[name]
        assert found["false_hides_total"] == 0, name
        assert found["wrong_pixels_max"] == 0, name
        assert float(found["snr_db_min"]) == np.inf, name
    drawn = {name: p["drawn_objects"] for name, p in pipelines.items()}
    assert drawn["none"] == summary["scene"]["drawables"]
    assert drawn["none"] >= drawn["frustum"] >= drawn["frustum+contribution"]
    assert drawn["frustum"] >= summary["opt"]["drawn_objects"] > 0
    assert pipelines["none"]["speedup"] == 1
    assert not any(p["claim_is_broken"] for p in pipelines.values())
    for found in pipelines.values():
        assert found["cull_ms"] >= 0
        assert found["frame_ms"] >= found["draw_ms"] > 0 or found["frames"] > 1
        assert [s["name"] for s in found["stages"]] == list(found["guarantees"])


@pytest.mark.gl
@pytest.mark.parametrize("name", SMALL)
def test_small(name: str, tmp_path: Path) -> None:
    suite = find_suite(name, registry())
    scene = suite.scene.model_copy(update={"options": SMALL[name]})
    suite = suite.model_copy(update={"scene": scene, "frames": 3, "width": 320, "height": 180})
    with FrameLog() as log:
        run = run_suite(suite, registry(), log=log)
    summary = write_run(run, tmp_path)
    assert summary["pipelines"]["frustum"]["frames"] == 3 * (len(suite.paths) or 2)
    judge(summary)
    judge(parsed(tmp_path / "summary.json"))


@pytest.mark.gl
@pytest.mark.slow
def test_same_pictures_and_counts_every_time(tmp_path: Path) -> None:
    """Everything but the times is a function of the suite."""
    found = []
    for folder in (tmp_path / "a", tmp_path / "b"):
        assert run_command("scatter", frames=2, out=folder) == 0
        pipelines = parsed(folder / "summary.json")["pipelines"]
        timed = {"stages", "cost_vs_opt", *(k for k in pipelines["none"] if "_ms" in k or "speedup" in k)}
        found.append({name: {k: p[k] for k in p.keys() - timed} for name, p in pipelines.items()})
    assert found[0] == found[1]


@pytest.mark.gl
@pytest.mark.data
@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "scatter", "paths"),
    [
        ("scenes/virtual_city.glb", None, {"orbit", "walk"}),
        ("city/delft_3dfier.obj", None, {"orbit", "walk"}),
        ("meshes/bunny_res4.ply", 1000, {"orbit", "enter"}),
    ],
)
def test_real_files(file: str, scatter: int | None, paths: set[str], tmp_path: Path) -> None:
    assert run_command(str(require_data() / file), quick=True, scatter=scatter, frames=3, out=tmp_path) == 0
    judge(parsed(tmp_path / "summary.json"))
    frames = (tmp_path / "frames.csv").read_text()
    assert all(f",{path}," in frames for path in paths)
