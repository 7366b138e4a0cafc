"""Pipelines along a path without drawing, plots along it, and windows of frames."""

from __future__ import annotations

import types
from typing import Any

import numpy as np
import pytest

import scenegraph as sg
from scenegraph.compare.counting import CountedRun, count_along
from scenegraph.compare.figures import path_plot
from scenegraph.compare.metrics import window_sums
from scenegraph.compare.replication import Laboratory
from scenegraph.compare.suite import suite_of
from scenegraph.testing import box_at


class Halves(sg.Stage):
    """Coarsens everything in every second frame, and hides the last row."""

    name = "halves"
    writes = ("visible", "level")

    def run(self, frame: sg.Frame) -> None:
        frame.hide([frame.snapshot.n - 1])
        frame.coarsen(np.arange(frame.snapshot.n), frame.index % 2)


def lods() -> sg.Scene:
    fine = box_at((0, 0, 0)).mesh
    coarse = sg.Mesh(fine.vertices, fine.faces[:4])
    paths = {
        name: [sg.View((x, -9, 0), (0, 0, 0), far=50.0) for x in np.linspace(-2, 2, 5)] for name in ("there", "back")
    }
    scene = sg.Scene(name="lods", paths=paths)
    return scene.add(*(sg.Transform(sg.Lod(fine, coarse), translation=(3 * k, 0, 0)) for k in range(3)))


@pytest.fixture
def known() -> sg.Registry:
    @sg.hookimpl
    def scenegraph_register_scenes(register: Any) -> None:
        register("lods", lods, "Three boxes.")

    @sg.hookimpl
    def scenegraph_register_stages(register: Any) -> None:
        register(Halves)

    plugin = types.ModuleType("toy")
    vars(plugin).update(
        scenegraph_register_scenes=scenegraph_register_scenes, scenegraph_register_stages=scenegraph_register_stages
    )
    registry = sg.Registry(discover=False)
    registry.add(plugin)
    assert registry.failures == []
    return registry


SUITE = {
    "name": "toy",
    "scene": {"name": "lods"},
    "frames": 4,
    "warmup": 1,
    "quick": {"frames": 2},
    "pipelines": [{"name": "none"}, {"name": "halves", "stages": "halves"}],
}


def test_triangles_objects_and_pops_are_counted_view_by_view(known: sg.Registry) -> None:
    seen: list[tuple[str, int]] = []
    run = count_along(suite_of(dict(SUITE), known), known, look=lambda name, at, _: seen.append((name, at)))
    assert (run.scene, run.drawables, run.triangles) == ("lods", 3, 36)
    assert run.paths == ["there"] * 4 + ["back"] * 4
    assert run.on("back") == [4, 5, 6, 7]
    assert run.pipelines["none"].triangles == [36] * 8
    halves = run.pipelines["halves"]
    assert halves.triangles == [24, 8] * 4
    assert halves.objects == [2] * 8
    # the first view of a path has none before it
    assert halves.pops == [0, 2, 2, 2, 0, 2, 2, 2]
    assert all(ms > 0 for ms in halves.cull_ms)
    assert sorted(seen) == sorted((name, at) for name in ("none", "halves") for at in range(8))


def test_what_only_drawing_can_tell_is_refused(known: sg.Registry) -> None:
    suite = SUITE | {"pipelines": [{"name": "vtk", "draw": "actors", "vtk_culler": True}]}
    with pytest.raises(sg.SuiteError, match="cannot be counted without drawing"):
        count_along(suite_of(suite, known), known)


@pytest.mark.parametrize(("quick", "views"), [(True, 4), (False, 8)])
def test_a_laboratory_counts_without_a_window(known: sg.Registry, tmp_path: Any, quick: bool, views: int) -> None:
    told: list[str] = []
    laboratory = Laboratory(known, tmp_path, lambda what, _: told.append(what), quick=quick, model=None)
    run = laboratory.count("lods", SUITE)
    assert isinstance(run, CountedRun)
    assert len(run.pipelines["none"].records) == views
    assert laboratory.results == {}
    assert all(what.startswith("lods: ") for what in told)


def test_plots_name_paths_and_series() -> None:
    drawing = path_plot(["out"] * 3 + ["in"] * 2, {"one": [1, 2, 3, 4, 5], "two": [5, np.nan, 3, 2, 1]}, "ms per frame")
    assert drawing.startswith("<svg")
    for text in ("one", "two", "out, frame", "in", "ms per frame"):
        assert text in drawing
    assert path_plot([], {}, "ms") == ""


def test_sums_over_windows() -> None:
    assert window_sums([1, 2, 3, 4], 2).tolist() == [3, 5, 7]
    assert window_sums([1, 2, 3], 1).tolist() == [1, 2, 3]
    assert window_sums([1, 2, 3], 30).tolist() == [6]
    assert window_sums([], 3).tolist() == []
