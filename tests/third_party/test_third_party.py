"""A plugin in its own distribution, as a stranger would publish it: installed from a folder, used by name only."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
SUITE = """
frames = 1
width = 64
height = 48
warmup = 0

[scene]
name = "city"
options = { buildings = 20 }

[[pipelines]]
name = "none"

[[pipelines]]
name = "near"
stages = "frustum | distance(limit=60.0)"
"""


def installed(distribution: str, target: Path) -> dict[str, str]:
    """Install a distribution of this folder into a folder of its own; return the environment that sees it."""
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-input"]
    options = ["--no-deps", "--no-build-isolation", "--no-index", "--no-cache-dir", "--target", str(target)]
    done = subprocess.run([*pip, *options, str(HERE / distribution)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return {**os.environ, "PYTHONPATH": str(target), "COLUMNS": "200", "NO_COLOR": "1"}


def scenegraph(*arguments: str, env: dict[str, str]) -> subprocess.CompletedProcess[str]:
    return python("-m", "scenegraph", *arguments, env=env)


def python(*arguments: str, env: dict[str, str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=False, env=env)


@pytest.fixture(scope="module")
def with_distance(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    return installed("scenegraph_distance", tmp_path_factory.mktemp("distance"))


@pytest.fixture(scope="module")
def with_broken(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    return installed("scenegraph_broken", tmp_path_factory.mktemp("broken"))


def test_plugin_fits_in_25_lines():
    text = (HERE / "scenegraph_distance" / "scenegraph_distance.py").read_text()
    assert len(text.splitlines()) <= 25


def test_stage_is_listed_with_its_guarantee_and_parameter(with_distance):
    done = scenegraph("stages", "--json", env=with_distance)
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    (stage,) = (s for s in answer["stages"] if s["name"] == "distance")
    assert stage["guarantee"] == "aggressive"
    (limit,) = stage["parameters"]
    assert (limit["name"], limit["default"], limit["minimum"]) == ("limit", 500.0, 0.0)
    assert not answer["failures"]


def test_stage_is_unknown_without_the_plugin():
    done = scenegraph("stages", "--json", env=dict(os.environ))
    assert "distance" not in {s["name"] for s in json.loads(done.stdout)["stages"]}


def test_stage_works_in_a_pipeline_text(with_distance):
    program = """
from scenegraph import Geode, Mesh, Pipeline, Scene, Transform, View
box = Mesh.box((-1, -1, -1), (1, 1, 1))
scene = Scene().add(*(Transform(Geode(box), translation=(0, y, 0)) for y in (10, 50, 90, -30)))
with Pipeline.parse("frustum | distance(limit=60)") as pipeline:
    frame = pipeline.open(scene.snapshot()).run(View((0, 0, 0), (0, 1, 0), far=1000))
depth = frame.snapshot.boxes[1]
print(sorted(depth[frame.visible].round().astype(int).tolist()), [s.hidden for s in frame.record.stages])
"""
    done = python("-c", program, env=with_distance)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split("\n")[0] == "[10, 50] [1, 1]"


def test_a_value_out_of_range_is_refused_like_any_other(with_distance):
    program = "from scenegraph import Pipeline; Pipeline.parse('distance(limit=-1)')"
    done = python("-c", program, env=with_distance)
    assert done.returncode == 1
    assert "limit=-1 is below its minimum 0" in done.stderr


@pytest.mark.gl
def test_stage_works_in_a_suite(with_distance, tmp_path):
    suite = tmp_path / "near.toml"
    suite.write_text(SUITE)
    summary = tmp_path / "summary.json"
    done = scenegraph(
        "compare", str(suite), "--quick", "--out", str(tmp_path / "out"), "--json", str(summary), env=with_distance
    )
    assert done.returncode == 0, done.stderr
    pipelines = json.loads(summary.read_text())["pipelines"]
    frustum, distance = pipelines["near"]["stages"]
    assert (frustum["name"], distance["name"]) == ("frustum", "distance")
    assert distance["tested"] >= 0
    assert pipelines["near"]["drawn_objects"] < pipelines["none"]["drawn_objects"]


def test_broken_plugin_is_reported_and_breaks_nothing(with_broken):
    done = scenegraph("stages", "--json", env=with_broken)
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert {"frustum", "contribution"} <= {s["name"] for s in answer["stages"]}
    (failure,) = answer["failures"]
    assert failure["name"] == "broken"
    assert "needs a scenegraph of the year 1999" in failure["message"]


@pytest.mark.parametrize("command", ["stages", "doctor"])
def test_broken_plugin_is_shown_to_people(with_broken, command):
    done = scenegraph(command, env=with_broken)
    assert done.returncode == 0, done.stderr
    assert "broken" in done.stdout + done.stderr
    assert "year 1999" in done.stdout + done.stderr
