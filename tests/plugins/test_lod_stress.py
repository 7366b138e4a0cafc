"""The stress filter: it holds a frame time, keeps still within its band, and protects what is large."""

from __future__ import annotations

import numpy as np
import pytest

import scenegraph as sg
from lod_scenes import field, lod, view
from scenegraph_lod import LodError, LodStress

SNAPSHOT = field(400).snapshot()


def drive(stage: LodStress, costs: list[float], views: list[sg.View] | None = None) -> list[sg.Frame]:
    """Frames of which each takes so many nanoseconds per triangle."""
    frames = []
    with sg.Pipeline([stage]).open(SNAPSHOT) as pipeline:
        for i, cost in enumerate(costs):
            frame = pipeline.run(view() if views is None else views[i])
            frame.record.cull_ms = 0.0
            frame.record.draw_ms = frame.record.triangles * cost * 1e-6
            frames.append(frame)
    return frames


def count(frame: sg.Frame, name: str) -> float:
    return frame.record.stages[0].counts[name]


def time(frame: sg.Frame) -> float:
    assert frame.record.draw_ms is not None
    return frame.record.draw_ms


class TestFilter:
    def test_it_holds_the_time(self):
        full = sum(m.triangles for m in [SNAPSHOT.meshes[i] for i in SNAPSHOT.mesh_index])
        frames = drive(LodStress(milliseconds=1.0, protect=1e5, gain=0.1), [5e6 / full] * 80)
        assert time(frames[0]) > 1.5
        assert all(time(f) <= 1.0 for f in frames[60:])
        assert all(time(f) >= 0.5 for f in frames[60:])
        assert sum(count(f, "pops") for f in frames[60:]) == 0, "within the band nothing moves"

    def test_it_calms_down(self):
        slow, fast = [60.0] * 30, [0.01] * 20
        frames = drive(LodStress(milliseconds=1.0, gain=1.0), slow + fast)
        assert count(frames[29], "stress") > 1
        stress = [count(f, "stress") for f in frames[30:]]
        assert stress == sorted(stress, reverse=True)
        assert stress[-1] == 0
        rule = sg.Pipeline([LodError()]).open(SNAPSHOT).run(view())
        frames = drive(LodStress(milliseconds=1e4, low=1.0), [10.0] * 3)
        assert count(frames[-1], "stress") == 0
        assert np.array_equal(frames[0].level, rule.level)

    def test_it_has_a_cap(self):
        frames = drive(LodStress(milliseconds=0.01, most=2.5, gain=5.0), [1e4] * 10)
        assert max(count(f, "stress") for f in frames) == 2.5

    def test_within_the_band_nothing_changes(self):
        stage = LodStress(milliseconds=1.0, low=0.0, high=1.0, gain=1.0)
        frames = drive(stage, [1e4] * 3 + [1e-6] * 10)
        assert len({count(f, "stress") for f in frames[4:]}) == 1

    def test_large_drawables_are_protected(self):
        scene = sg.Scene(
            sg.Group(
                sg.Transform(lod("large"), scale=8.0), sg.Transform(lod("small"), translation=(0, 0, 20), scale=0.3)
            )
        )
        stage = LodStress(milliseconds=0.01, gain=5.0, protect=200.0, pixels=0.5)
        with sg.Pipeline([stage]).open(scene.snapshot()) as pipeline:
            for _ in range(5):
                frame = pipeline.run(view())
                frame.record.draw_ms = 1e3
        calm = sg.Pipeline([LodError(pixels=0.5)]).open(scene.snapshot()).run(view())
        level = dict(zip([g.name for g in frame.snapshot.geodes], frame.level.tolist(), strict=True))
        free = dict(zip([g.name for g in calm.snapshot.geodes], calm.level.tolist(), strict=True))
        assert level["large"] == free["large"]
        assert level["small"] > free["small"]
        assert count(frame, "protected") == 1

    def test_without_a_time_nothing_is_stressed(self):
        with sg.Pipeline([LodStress(milliseconds=0.01)]).open(SNAPSHOT) as pipeline:
            frames = [pipeline.run(view()) for _ in range(3)]
        assert [count(f, "stress") for f in frames] == [0, 0, 0]
        assert "load" not in frames[-1].record.stages[0].counts

    def test_a_group_shares_the_largest_stress(self):
        for group, expected in ((False, [True, False]), (True, [True, True])):
            with sg.Pipeline([LodStress(milliseconds=1.0, group=group)]).open(SNAPSHOT) as pipeline:
                for _ in range(4):
                    frames = pipeline.run_views([view(), view()])
                    frames[0].record.draw_ms, frames[1].record.draw_ms = 10.0, 0.0
            assert [count(f, "stress") > 0 for f in frames] == expected

    def test_a_band_upside_down_is_refused(self):
        with pytest.raises(sg.PipelineError, match="above high"):
            LodStress(low=2.0, high=1.0)


class TestClock:
    def test_by_triangles_a_run_repeats_itself(self):
        views = [view().moved(eye=(2 * i, -45, 4)) for i in range(20)]
        stage = LodStress(milliseconds=0.5, clock="triangles", nanoseconds=30.0)
        runs = []
        for _ in range(2):
            with sg.Pipeline([stage]).open(SNAPSHOT) as pipeline:
                runs.append([pipeline.run(v) for v in views])
        assert all(np.array_equal(a.level, b.level) for a, b in zip(*runs, strict=True))
        assert count(runs[0][-1], "stress") > 0

    def test_stress_survives_an_edit_and_not_a_new_start(self):
        scene = field(50)
        stage = LodStress(milliseconds=0.01, clock="triangles")
        pipeline = sg.Pipeline([stage]).open(scene.snapshot())
        for _ in range(4):
            frame = pipeline.run(view())
        before = count(frame, "stress")
        scene.root.children[0].add(sg.Transform(lod(), translation=(1, 1, 9)))
        frame.snapshot.sync()
        assert count(pipeline.run(view()), "stress") == before > 0
        pipeline.open(frame.snapshot)
        assert count(pipeline.run(view()), "stress") == 0
        pipeline.close()


@pytest.mark.gl
def test_those_who_draw_tell_the_time():
    import pyvista as pv

    from scenegraph.render.driver import Driver

    plotter = pv.Plotter(off_screen=True, window_size=(80, 60))
    plotter.add_mesh(pv.Sphere())
    driver = Driver(plotter, sg.Pipeline.parse("frustum", sg.Registry()))
    plotter.show(auto_close=False)
    plotter.render()
    assert driver.frame is not None
    assert driver.frame.record.draw_ms is not None
    assert driver.frame.record.draw_ms > 0
    driver.detach()
    plotter.close()
