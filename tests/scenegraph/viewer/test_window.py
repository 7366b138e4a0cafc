"""The viewer driven as a person would: a real window under Xvfb, with keys, mouse, resizing and closing by xdotool."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

pytestmark = [
    pytest.mark.gl,
    pytest.mark.skipif(
        not (shutil.which("xvfb-run") and shutil.which("xdotool")), reason="needs xvfb-run and xdotool installed"
    ),
]

PROGRAM = """
import json, sys
from scenegraph import Registry, Pipeline
from scenegraph.viewer.window import ViewerWindow

registry = Registry()
scene = registry.scene("city").build(buildings=200)
window = ViewerWindow(
    scene.snapshot(), [Pipeline.parse("frustum | contribution"), Pipeline.parse("none")], registry,
    path=scene.paths["street"], size=(900, 600),
)
window.run()
session = window.session
print(json.dumps({
    "help": window.show_help, "panel": window.show_panel, "frozen": session.frozen, "hidden": session.show_hidden,
    "disabled": sorted(session.pipelines[0].disabled), "which": session.which, "saved": [str(p) for p in window.saved],
    "pixels": session.pipelines[0].stages[1].pixels, "failures": session.driver.failures, "at": window.at,
}))
"""

SCRIPT = """
"$0" -c "$1" > out.json 2> err.txt &
viewer=$!
for i in $(seq 300); do
    window=$(xdotool search --name 'scenegraph - ' 2>/dev/null | head -1)
    [ -n "$window" ] && break
    kill -0 $viewer 2>/dev/null || { cat err.txt >&2; exit 3; }
    sleep 0.3
done
sleep 3
xdotool windowfocus $window
xdotool mousemove --window $window 450 300
press() { for key in "$@"; do xdotool key --window $window $key; sleep 0.8; done; }
drag() { xdotool mousemove --window $window $1 $2; sleep 0.3; xdotool mousedown 1; sleep 0.3
         xdotool mousemove --window $window $3 $4; sleep 0.6; xdotool mouseup 1; sleep 0.6; }
"""


def drive(folder: Path, *lines: str) -> dict[str, Any]:
    """Run the viewer and a script of keys; what it says of itself at the end."""
    script = SCRIPT + "\n".join(lines) + "\nwait $viewer\n"
    env = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "VTK_DEFAULT_OPENGL_WINDOW")}
    command = ["xvfb-run", "-a", "-s", "-screen 0 1200x800x24", "bash", "-c", script, sys.executable, PROGRAM]
    done = subprocess.run(command, cwd=folder, env=env, timeout=240, check=False)
    errors = (folder / "err.txt").read_text()
    assert done.returncode == 0, errors
    assert "Traceback" not in errors
    found: dict[str, Any] = json.loads((folder / "out.json").read_text())
    return found


def test_keys_mouse_resizing_and_closing(tmp_path: Path) -> None:
    found = drive(
        tmp_path,
        "press w w p x 1 k",
        # the only slider of the panel, from its left end to its middle
        "drag 632 83 750 83",
        # a look around
        "drag 450 400 500 420",
        "xdotool windowsize $window 700 500; sleep 1.5",
        "press k h Tab f f q",
    )
    assert found["help"]
    assert found["panel"]
    assert found["hidden"]
    assert found["disabled"] == ["frustum"]
    assert found["which"] == 1
    assert not found["frozen"]
    assert 1 < found["pixels"] < 1000
    assert found["failures"] == {}
    pictures = [np.asarray(Image.open(tmp_path / name)) for name in found["saved"]]
    assert [p.shape for p in pictures] == [(600, 900, 3), (500, 700, 3)]
    assert all(len(np.unique(p.reshape(-1, 3), axis=0)) > 10 for p in pictures)


def test_a_replay_can_be_stopped_and_escape_closes_the_window(tmp_path: Path) -> None:
    start = time.monotonic()
    found = drive(tmp_path, "press space", "sleep 2", "press space", "press Escape")
    assert found["at"] > 2
    assert time.monotonic() - start < 240
