"""The probe: what works here, asked once, and never at the price of a crash."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from scenegraph import GLError
from scenegraph.render import probe as module
from scenegraph.render.probe import REPORT_VARIABLE, GLReport, probe, require_gl


@pytest.fixture
def unprobed(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """As in a process that has not probed yet and has inherited nothing."""
    monkeypatch.setattr(module, "_reports", {})
    monkeypatch.delenv(REPORT_VARIABLE, raising=False)
    monkeypatch.setenv(module.WINDOW_VARIABLE, os.environ.get(module.WINDOW_VARIABLE, ""))
    return monkeypatch


def run(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    env = {k: v for k, v in os.environ.items() if k not in (REPORT_VARIABLE, module.WINDOW_VARIABLE, "DISPLAY")}
    return subprocess.run(
        [sys.executable, "-c", code], env=env | environment, capture_output=True, text=True, timeout=120, check=False
    )


@pytest.mark.gl
def test_reports_what_works_here() -> None:
    report = require_gl()
    assert report.ok
    assert report.window_class.endswith("RenderWindow")
    assert report.renderer
    assert report.version
    assert report.message
    assert report.debian_packages == ()
    assert report.apt_line == ""
    assert report.tried[-1][1] == "works"
    if report.moderngl_ok:
        assert report.version_code >= 330
        assert report.limits["GL_MAX_TEXTURE_SIZE"] >= 1024


def test_survives_json() -> None:
    report = GLReport(ok=False, debian_packages=("libegl1",), tried=(("a", "b"),), limits={"x": 1}, message="no")
    assert GLReport.from_dict(json.loads(json.dumps(report.to_dict()))) == report


@pytest.mark.gl
def test_is_asked_once_per_process_and_children_inherit_it(unprobed: pytest.MonkeyPatch) -> None:
    calls = []
    original = module._try_one

    def counted(window_class: str) -> object:
        calls.append(window_class)
        return original(window_class)

    unprobed.setattr(module, "_try_one", counted)
    first = probe()
    asked = len(calls)
    assert asked >= 1
    assert probe() is first
    unprobed.setattr(module, "_reports", {})
    assert probe() == first
    assert len(calls) == asked
    # another driver is another question
    unprobed.setattr(module, "_reports", {})
    unprobed.setenv("LIBGL_ALWAYS_SOFTWARE", "true")
    assert probe().ok
    assert len(calls) > asked


def test_a_machine_without_a_driver_gets_an_apt_line_and_no_crash() -> None:
    if sys.platform != "linux":
        pytest.skip("hides the drivers by a variable of libglvnd")
    code = "from scenegraph.render.probe import *; r = probe(); print(r.to_dict()); require_gl()"
    done = run(code, __EGL_VENDOR_LIBRARY_FILENAMES="/nonexistent")
    assert done.returncode == 1, done.stderr
    assert "GLError" in done.stderr
    assert "apt-get install --no-install-recommends lib" in done.stderr
    assert "'ok': False" in done.stdout


def test_a_failure_names_both_ways_out(unprobed: pytest.MonkeyPatch) -> None:
    unprobed.setattr(module, "_try_one", lambda name: (None, "ended by SIGSEGV"))
    unprobed.setattr(module, "_is_linux", lambda: True)
    unprobed.setattr(module, "_can_load", lambda library: False)
    report = probe()
    assert not report.ok
    assert report.debian_packages == ("libegl1", "libgl1-mesa-dri")
    with pytest.raises(GLError, match=r"libegl1 libgl1-mesa-dri \(or libosmesa6\)") as caught:
        require_gl()
    assert "SIGSEGV" in str(caught.value)
    assert REPORT_VARIABLE not in os.environ


@pytest.mark.gl
def test_command_line() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "scenegraph.render.probe", "--json"],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert GLReport.from_dict(json.loads(done.stdout)).ok


def test_imports_no_vtk_into_this_process() -> None:
    code = "import sys; from scenegraph.render.probe import probe; probe(); print('vtkmodules' in sys.modules)"
    done = run(code)
    assert done.stdout.strip() == "False", done.stderr
