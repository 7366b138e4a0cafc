"""The code in the docs is run, and the README shows the plugin that the tests install."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path

import pytest

from scenegraph import Registry
from scenegraph.compare.suite import parse_suite

ROOT = Path(__file__).parent.parent
PLUGIN = ROOT / "tests" / "third_party" / "scenegraph_distance"


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def test_plugin_page_runs_as_it_reads(monkeypatch):
    """All Python blocks of the page, in order, in one namespace; the printed text is the one that the page shows."""
    monkeypatch.syspath_prepend(str(PLUGIN))
    printed = io.StringIO()
    names: dict[str, object] = {}
    with contextlib.redirect_stdout(printed):
        for block in blocks(ROOT / "docs" / "plugin.md", "python"):
            exec(compile(block, "docs/plugin.md", "exec"), names)
    assert [printed.getvalue()] == blocks(ROOT / "docs" / "plugin.md", "text")
    assert_left_half_works(names)


def assert_left_half_works(names):
    """The second stage of the page agrees with its own description, asked flat and down the tree."""
    scene, view = names["scene"], names["View"]((9, 0, 0), (0, 0, 0))
    scene.add(*(names["Transform"](names["Geode"](names["box"]), translation=(x, 0, 0)) for x in (-5, -0.5, 0.5, 5)))
    with names["Pipeline"]([names["LeftHalf"]()]) as pipeline:
        frame = pipeline.open(scene.snapshot()).run(view)
    left = frame.snapshot.boxes[0] - frame.snapshot.boxes[3] <= 0
    assert (frame.visible == left).all()
    assert 0 < left.sum() < len(left)


def test_plugin_page_and_readme_show_the_files_of_the_tested_plugin():
    module = (PLUGIN / "scenegraph_distance.py").read_text(encoding="utf-8")
    assert module in blocks(ROOT / "README.md", "python")
    assert "scenegraph_distance/scenegraph_distance.py" in (ROOT / "docs" / "plugin.md").read_text(encoding="utf-8")
    (toml,) = blocks(ROOT / "docs" / "plugin.md", "toml")
    project = (PLUGIN / "pyproject.toml").read_text(encoding="utf-8")
    assert all(line in project.splitlines() for line in toml.splitlines())


@pytest.mark.parametrize("block", blocks(ROOT / "docs" / "suites.md", "toml"))
def test_suite_in_the_docs_is_valid(block):
    assert len(parse_suite(block, Registry()).pipelines) == block.count("[[pipelines]]")
