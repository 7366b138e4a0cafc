"""The viewer driven as a person would: a real window under Xvfb, with keys, mouse, resizing and closing by xdotool."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from driven_window import INSTALLED, PATIENCE, driven

pytestmark = [pytest.mark.gl, pytest.mark.skipif(not INSTALLED, reason="needs Xvfb and xdotool installed")]
SMALL = ("city:200", "--pipeline", "frustum | contribution", "--pipeline", "none", "--size", "900", "600")


def test_keys_mouse_resizing_and_closing(tmp_path: Path) -> None:
    with driven(tmp_path, *SMALL) as viewer:
        start = viewer.until("a first look", lambda told: told["eye"])
        once = viewer.press("w", "a step", lambda told: told["eye"] != start["eye"])
        viewer.press("w", "another step", lambda told: told["eye"] != once["eye"])
        viewer.press("x", "red wires", lambda told: told["hidden"])
        viewer.press("1", "a stage off", lambda told: told["disabled"] == ["frustum"])
        told = viewer.press("p", "the panel", lambda told: "parameter.contribution.pixels" in told["spots"])
        # from its left end to its middle
        x, y, width, height = told["spots"]["parameter.contribution.pixels"]
        viewer.drag((x + 1, y + height / 2), (x + width / 2, y + height / 2))
        told = viewer.until("a parameter", lambda told: 1 < told["parameters"]["contribution"]["pixels"] < 1000)
        viewer.keep("window-panel")
        viewer.press("k", "a picture", lambda told: len(told["saved"]) == 1)
        # a look around
        viewer.drag((450, 400), (500, 420))
        viewer.until("a turn", lambda now: now["forward"] != told["forward"])
        viewer.do("windowsize", str(viewer.window), "700", "500")
        viewer.until("another size", lambda told: told["size"] == [700, 500])
        viewer.press("k", "another picture", lambda told: len(told["saved"]) == 2)
        viewer.press("h", "the keys", lambda told: told["help"])
        viewer.keep("window-keys")
        viewer.press("Tab", "the other pipeline", lambda told: told["which"] == 1)
        viewer.press("f", "a frozen camera", lambda told: told["frozen"])
        told = viewer.press("f", "a live camera", lambda told: not told["frozen"])
        assert told["failures"] == {}
        viewer.do("key", "--window", str(viewer.window), "q")
        printed = viewer.ended()
    names = re.findall(r"wrote (\S+)", printed)
    pictures = [np.asarray(Image.open(tmp_path / name)) for name in names]
    assert [p.shape for p in pictures] == [(600, 900, 3), (500, 700, 3)]
    assert all(len(np.unique(p.reshape(-1, 3), axis=0)) > 10 for p in pictures)


def test_a_replay_can_be_stopped_and_escape_closes_the_window(tmp_path: Path) -> None:
    with driven(tmp_path, *SMALL, "--path", "street") as viewer:
        viewer.press("space", "a replay", lambda told: told["at"] > 2)
        told = viewer.press("space", "its end", lambda told: not told["replaying"])
        viewer.until("time to go by", lambda now: now["turns"] > told["turns"] + 5)
        assert viewer.told()["at"] == told["at"]
        viewer.do("key", "--window", str(viewer.window), "Escape")
        viewer.ended()


def test_the_window_manager_closes_the_window(tmp_path: Path) -> None:
    with driven(tmp_path, *SMALL, "--record", "path.json") as viewer:
        told = viewer.until("a first look", lambda told: told["eye"])
        viewer.press("w", "a step", lambda now: now["eye"] != told["eye"])
        viewer.ask_to_close()
        assert "wrote path.json" in viewer.ended()
    assert (tmp_path / "path.json").exists()


def test_a_window_that_is_destroyed_ends_the_viewer(tmp_path: Path) -> None:
    """Rudely, by another program: the X library ends the process, and nothing is left running."""
    with driven(tmp_path, *SMALL) as viewer:
        viewer.do("windowclose", str(viewer.window))
        assert viewer.process.wait(PATIENCE) == 1
        assert "Traceback" not in viewer.errors()
