"""The command line: answers at once, one sentence for what is wrong, exit codes that scripts can rely on."""

from __future__ import annotations

import csv
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import trimesh
from typer.testing import CliRunner

import scenegraph.render.probe
from scenegraph import GLError
from scenegraph.cli import app
from scenegraph.compare.suite import builtin_suites
from scenegraph.render.probe import GLReport
from strict_json import parsed

NO_GL = GLReport(
    ok=False,
    message="OpenGL does not work here; on Debian or Ubuntu install it with: apt-get install libegl1",
    debian_packages=("libegl1",),
    tried=(("vtkEGLRenderWindow", "ended by SIGSEGV"),),
)


def run(*arguments: str, code: int = 0) -> tuple[str, str]:
    """Run the command line in this process; standard output and error."""
    result = CliRunner().invoke(app, list(arguments))
    assert result.exit_code == code, (result.output, result.exception)
    return result.stdout, result.stderr


def program(*arguments: str, **options: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "scenegraph", *arguments], capture_output=True, text=True, **options)


@pytest.fixture
def boxes(tmp_path: Path) -> str:
    """A model file with 30 boxes."""
    scene = trimesh.Scene()
    for i in range(30):
        scene.add_geometry(
            trimesh.creation.box(), transform=trimesh.transformations.translation_matrix((3 * i, i % 5, 0))
        )
    path = tmp_path / "boxes.glb"
    scene.export(path)
    return str(path)


@pytest.fixture
def no_gl(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse() -> GLReport:
        raise GLError(NO_GL.message)

    monkeypatch.setattr(scenegraph.render.probe, "probe", lambda: NO_GL)
    monkeypatch.setattr(scenegraph.render.probe, "require_gl", refuse)


def test_version() -> None:
    out, _ = run("--version")
    assert re.fullmatch(r"scenegraph \d+\.\d+\.\d+\n", out)


def test_help_names_the_commands() -> None:
    out, _ = run("--help")
    assert all(command in out for command in ("compare", "stages", "scenes", "doctor"))


@pytest.mark.parametrize("command", ["stages", "scenes"])
def test_lists_answer_without_what_is_slow_to_import(command: str) -> None:
    code = f"""
import sys
from scenegraph.cli import app
app([{command!r}], standalone_mode=False)
print(sorted({{"vtk", "vtkmodules", "pyvista", "matplotlib", "trimesh", "moderngl", "scipy.stats"}} & set(sys.modules)))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_stages_as_table_and_json() -> None:
    table, _ = run("stages")
    answer = parsed(run("stages", "--json")[0])
    assert answer["failures"] == []
    stages = {s["name"]: s for s in answer["stages"]}
    assert stages["frustum"]["guarantee"] == "conservative"
    assert not stages["frustum"]["guarantee_depends_on_parameters"]
    assert stages["contribution"]["guarantee_depends_on_parameters"]
    (pixels,) = stages["contribution"]["parameters"]
    assert {"name": "pixels", "type": "float", "default": 0.0, "minimum": 0.0, "unit": "px"}.items() <= pixels.items()
    for stage in stages.values():
        assert stage["name"] in table
        assert all(p["name"] in table for p in stage["parameters"])


def test_scenes_as_table_and_json() -> None:
    table, _ = run("scenes")
    answer = parsed(run("scenes", "--json")[0])
    assert {s["name"] for s in answer["suites"]} == set(builtin_suites())
    assert {"city", "olympia", "scatter"} <= {s["name"] for s in answer["scenes"]}
    for scene in answer["scenes"]:
        assert scene["name"] in table
        assert scene["summary"]
    assert all(s["summary"] for s in answer["suites"])


def test_doctor_as_table_and_json() -> None:
    answer = parsed(run("doctor", "--json")[0])
    assert set(answer) == {"python", "packages", "gl", "plugins", "cures"}
    assert {"numpy", "vtk", "typer"} <= {p["name"] for p in answer["packages"] if p["version"]}
    assert "frustum" in answer["plugins"]["stages"]
    table, _ = run("doctor")
    assert answer["python"]["version"] in table
    assert ("Everything is in place." in table) == (not answer["cures"])


def test_doctor_without_gl_names_the_cure(no_gl: None) -> None:
    out, _ = run("doctor")
    assert "apt-get install libegl1" in out
    assert "ended by SIGSEGV" in out
    cures = parsed(run("doctor", "--json")[0])["cures"]
    assert any("libegl1" in cure for cure in cures)


def test_compare_without_gl_is_one_sentence(no_gl: None, boxes: str, tmp_path: Path) -> None:
    _, err = run("compare", boxes, "--out", str(tmp_path / "out"), code=2)
    assert err == f"scenegraph: {NO_GL.message}\n"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["citty"], r"suite: 'citty' is no suite, scene or file\. Did you mean 'city'\?"),
        (["gone.toml"], r"suite: cannot read gone\.toml: .*"),
        (["city", "--pipeline", "frustrum"], r"suite: pipelines\[5\]\.stages: .*Did you mean 'frustum'\?"),
        (["city", "--pipeline", "contribution(pixels=-1)"], r"suite: .*pixels=-1 is below its minimum 0 px"),
        (["city", "--scatter", "5"], r"suite: --scatter copies a model file, and 'city' is none"),
        (["{tmp}/empty.ply"], r".*empty\.ply is empty \(0 bytes\).*"),
        (["{tmp}/text.ply"], r".*text\.ply.*"),
        (["{tmp}"], r".* is a folder.*"),
        (["{tmp}/model.xyzzy"], r".*model\.xyzzy: files that end in \.xyzzy cannot be read.*"),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_2(arguments: list[str], sentence: str, tmp_path: Path) -> None:
    (tmp_path / "empty.ply").touch()
    (tmp_path / "text.ply").write_text("this is no model")
    (tmp_path / "model.xyzzy").write_text("neither is this")
    filled = [a.format(tmp=tmp_path) for a in arguments]
    _, err = run("compare", *filled, "--out", str(tmp_path / "out"), code=2)
    assert re.fullmatch(f"scenegraph: {sentence}\n", err), err


def test_every_fault_of_a_suite_is_on_stderr(tmp_path: Path) -> None:
    suite = tmp_path / "bad.toml"
    suite.write_text('frames = 0\n[scene]\nname = "citty"\n[[pipelines]]\nname = "a"\nstages = "frustrum"\n')
    _, err = run("compare", str(suite), code=2)
    assert err.startswith("scenegraph: suite:\n  - line 1, frames: is 0;")
    assert err.count("\n  - ") == 3
    assert "line 3, scene.name" in err
    assert "line 6, pipelines[0].stages" in err


def test_unwritable_folder_is_refused_before_any_work(boxes: str, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    start = time.perf_counter()
    _, err = run("compare", boxes, "--out", str(tmp_path / "file" / "out"), code=2)
    assert time.perf_counter() - start < 5
    assert re.fullmatch(r"scenegraph: cannot write to the folder '.*' \(.*\); choose another one with --out\n", err)
    _, err = run("compare", boxes, "--out", str(tmp_path), "--json", str(tmp_path / "file" / "x.json"), code=2)
    assert "cannot write" in err


def test_wrong_option_is_exit_code_2() -> None:
    run("compare", "--frames", "0", code=2)
    run("compare", "--nonsense", code=2)
    run("conquer", code=2)


@pytest.mark.gl
def test_model_file_with_default_pipelines_and_paths(boxes: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    stdout, _ = run("compare", boxes, "--quick", "--frames", "2", "--out", str(out), "--json", str(tmp_path / "s.json"))
    assert "30 drawables" in stdout
    assert "frustum+contribution" in stdout
    assert str(out / "report.html") in stdout
    assert {f.name for f in out.iterdir()} == {"report.html", "frames.csv", "summary.json", "trace.json"}
    pipelines = parsed(tmp_path / "s.json")["pipelines"]
    assert pipelines["frustum"]["false_hides"] == 0
    assert pipelines["frustum"]["snr_db_min"] == "Infinity"


@pytest.mark.gl
def test_scattered_model(boxes: str, tmp_path: Path) -> None:
    run("compare", boxes, "--scatter", "7", "--frames", "2", "--out", str(tmp_path / "out"))
    summary = parsed(tmp_path / "out" / "summary.json")
    assert summary["scene"]["drawables"] == 7


@pytest.mark.gl
def test_exit_code_1_is_for_findings(boxes: str, tmp_path: Path) -> None:
    common = ["compare", boxes, "--frames", "2", "--out", str(tmp_path / "out"), "--fail-on-false-hides"]
    done = program(*common, "--pipeline", "all=contribution(pixels=9999)")
    assert done.returncode == 1, done.stderr
    assert "hid what is visible" in done.stderr
    assert "all" in done.stderr.splitlines()[-1]


@pytest.mark.gl
def test_ctrl_c_leaves_the_finished_frames(boxes: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    child = subprocess.Popen(
        [sys.executable, "-m", "scenegraph", "compare", boxes, "--frames", "400", "--out", str(out)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "COLUMNS": "150"},
    )
    try:
        until = time.monotonic() + 120
        while time.monotonic() < until and child.poll() is None:
            if (out / "frames.csv").is_file() and (out / "frames.csv").read_text().count("\n") > 20:
                break
            time.sleep(0.02)
        child.send_signal(signal.SIGINT)
        stdout, stderr = child.communicate(timeout=120)
    finally:
        child.kill()
    assert child.returncode == 130, stderr
    assert "Interrupted after" in stdout
    assert "Traceback" not in stderr
    with (out / "frames.csv").open(newline="") as file:
        rows = [r for r in csv.DictReader(file) if r["stage"] == "*"]
    summary = parsed(out / "summary.json")
    assert summary["interrupted"]
    for name, pipeline in summary["pipelines"].items():
        assert 0 < pipeline["frames"] == sum(r["pipeline"] == name for r in rows) < summary["planned_frames"]
    assert "<b>Interrupted.</b>" in (out / "report.html").read_text()
