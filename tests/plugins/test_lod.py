"""Levels by distance, by error and by visibility: what they promise, and what they remember."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import scenegraph as sg
from lod_scenes import PutsVisibility, chain, field, lod, run, view
from scenegraph.testing import PLACES, StageContract, box_at, wall_scene
from scenegraph_lod import LodBudget, LodDistance, LodError, LodStress, LodVisibility


class TestContract(StageContract):
    stages = (
        LodDistance(),
        LodDistance(first=0.5, ratio=1.2, hysteresis=0.0),
        LodError(),
        LodError(pixels=50.0, hysteresis=0.5),
        LodBudget(triangles=100),
        LodBudget(triangles=0, hysteresis=0.0),
        LodStress(clock="triangles"),
        LodStress(milliseconds=0.01, group=True),
    )


class TestVisibilityContract(StageContract):
    stages = (LodVisibility(), LodVisibility(rule="combined", pixels=2.0))
    before = (PutsVisibility.of(-1.0, 0.0, 0.9, 1.0, np.nan),)


def ratio_of(frame: sg.Frame) -> np.ndarray:
    """Largest error in pixels of what each row is drawn as, worked out from the corners of its box."""
    snapshot, looked = frame.snapshot, frame.view
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    out = []
    for row, level in enumerate(frame.level):
        corners = snapshot.boxes[:3, row] + signs * snapshot.boxes[3:, row]
        depth = max(((corners - looked.eye) @ looked.forward).min(), looked.near)
        pixels = looked.height / (2 * np.tan(np.radians(looked.fov) / 2)) / depth
        if looked.parallel_scale is not None:
            pixels = looked.height / (2 * looked.parallel_scale)
        out.append(snapshot.errors[level, row] * pixels)
    return np.array(out)


class TestError:
    @settings(max_examples=25)
    @given(
        st.floats(0.1, 20),
        st.floats(0.5, 170),
        st.integers(50, 4000),
        st.sampled_from((None, 3.0, 30.0)),
        st.sampled_from(PLACES),
        st.floats(0, 0.9),
    )
    def test_no_error_is_larger_than_the_limit(self, pixels, fov, height, parallel, place, hysteresis):
        scale, offset = place
        scene = field(20, scale=scale, offset=offset)
        size = None if parallel is None else parallel * scale
        views = [view(scale, offset, fov=f, height=height, parallel_scale=size) for f in (fov, fov * 1.01)]
        for frame in run(scene, views, LodError(pixels=pixels, hysteresis=hysteresis)):
            seen = ratio_of(frame)
            tolerance = 1 + 1e-5 + (0.05 if offset / scale > 1e5 else 0)
            assert (np.nan_to_num(seen) <= pixels * tolerance).all()

    def test_and_no_coarser_level_would_be_within(self):
        (frame,) = run(field(), [view()], LodError(pixels=2.0))
        rows = np.flatnonzero(~np.isnan(frame.snapshot.errors[1]))
        level = np.minimum(frame.level + 1, 7)
        frame.level = level.astype(np.uint8)
        more = ratio_of(frame)[rows]
        assert ((more > 2.0) | (level[rows] == 7)).all()
        assert len(np.unique(level)) > 4, "all kinds of levels"

    @pytest.mark.parametrize(("scale", "offset"), PLACES)
    def test_levels_do_not_depend_on_scale_and_place(self, scale, offset):
        (here,) = run(field(), [view()], LodError())
        (there,) = run(field(scale=scale, offset=offset), [view(scale, offset)], LodError())
        assert (here.level == there.level).mean() > (0.9 if offset > 1e9 else 0.99)

    def test_a_finer_picture_asks_for_finer_levels(self):
        frames = [
            run(field(), [view(**options)], LodError(pixels=2.0))[0].level
            for options in ({}, {"height": 1920, "width": 2560}, {"fov": 20.0}, {"parallel_scale": 5.0})
        ]
        assert all((finer <= frames[0]).all() for finer in frames[1:3])
        assert len(np.unique(frames[3])) < len(np.unique(frames[0])), "no perspective: one size, one level"

    def test_the_eye_in_a_drawable_sees_it_in_full(self):
        scene = sg.Scene(sg.Group(lod("inside"), sg.Transform(lod("far"), translation=(0, 500, 0))))
        (frame,) = run(scene, [sg.View((0, 0.1, 0), (0, 1, 0))], LodError(pixels=1.0))
        level = dict(zip([g.name for g in frame.snapshot.geodes], frame.level.tolist(), strict=True))
        assert level["inside"] == 0
        assert level["far"] == 7

    def test_unknown_errors_count_as_the_size_of_the_box(self):
        scene = sg.Scene(sg.Group(lod("unknown", known=False)))
        far = np.ptp(chain()[0][0].bounds, axis=0)
        pixels = float(np.linalg.norm(far)) * 480 / (2 * np.tan(np.radians(30))) / (100 - far[1] / 2)
        for limit, expected in ((0.98 * pixels, 0), (1.02 * pixels, 7)):
            looked = sg.View((0, -100, 0), (0, 0, 0), width=640, height=480)
            (frame,) = run(scene, [looked], LodError(pixels=limit))
            assert frame.level.tolist() == [expected]

    def test_boxes_that_are_not_numbers_stay_fine(self):
        broken = sg.Transform(lod("broken"), scale=(np.inf, 1, 1))
        (frame,) = run(sg.Scene(sg.Group(broken)), [view()], LodError(pixels=1000.0))
        assert frame.level.tolist() == [0]


class TestDistance:
    def test_levels_begin_where_they_should(self):
        size = float(np.linalg.norm(np.ptp(chain()[0][0].bounds, axis=0)))
        edge = float(chain()[0][0].bounds[1, 1])
        scene = sg.Scene(sg.Group(lod()))
        for level in range(1, 6):
            for part, expected in ((0.999, level - 1), (1.001, level)):
                far = 10 * 2 ** (level - 1) * size * part + edge
                (frame,) = run(scene, [sg.View((0, far, 0), (0, 0, 0))], LodDistance(first=10.0))
                assert frame.level.tolist() == [expected]

    def test_zooming_and_size_count(self):
        scene = sg.Scene(sg.Group(lod(), sg.Transform(lod(), translation=(0, 0, 20), scale=8.0)))
        wide, narrow = run(
            scene, [sg.View((0, -100, 0), (0, 0, 0), fov=f) for f in (60, 10)], LodDistance(hysteresis=0.0)
        )
        assert wide.level[0] > narrow.level[0]
        assert wide.level[0] > wide.level[1]

    def test_turning_on_the_spot_changes_nothing(self):
        eye = np.array([0, -30, 3])
        views = [sg.View(eye, eye + (np.cos(a), np.sin(a), 0)) for a in np.linspace(0, 6, 12)]
        frames = run(field(), views, LodDistance())
        assert all(np.array_equal(f.level, frames[0].level) for f in frames)

    def test_parallel_views_go_by_their_scale(self):
        scene = sg.Scene(sg.Group(lod(), sg.Transform(lod(), translation=(0, 900, 0))))
        coarse, fine = (
            run(scene, [sg.View((0, -9, 0), (0, 0, 0), parallel_scale=s)], LodDistance())[0].level.tolist()
            for s in (500.0, 2.0)
        )
        assert coarse[0] == coarse[1] > 0
        assert fine == [0, 0]

    def test_extremes(self):
        for stage in (LodDistance(first=0.0), LodDistance(first=1e6), LodDistance(ratio=1.01)):
            (frame,) = run(field(), [view()], stage)
            assert (frame.level < frame.snapshot.level_count).all()


class TestVisibility:
    def test_the_example_of_the_thesis(self):
        levels = [sg.Mesh.box((0, 0, 0), (1, 1, 1 + i / 100)) for i in range(20)]
        scene = sg.Scene(sg.Group(sg.Lod(*levels)))
        (frame,) = run(scene, [view()], PutsVisibility.of(641 / 1024), LodVisibility())
        assert 20 - frame.level[0] == 4, "tessellation level 4"

    @pytest.mark.parametrize(("value", "level"), [(-1.0, 0), (-7.0, 0), (np.nan, 0), (0.0, 4), (0.999, 7), (1.0, 7)])
    def test_linear(self, value, level):
        scene = sg.Scene(sg.Group(lod()))
        (frame,) = run(scene, [view()], PutsVisibility.of(value), LodVisibility())
        assert frame.level.tolist() == [level]

    def test_combined_is_the_rule_of_errors_where_nothing_covers(self):
        (error,) = run(field(), [view()], LodError(pixels=2.0))
        (free,) = run(field(), [view()], PutsVisibility.of(-1.0), LodVisibility(rule="combined", pixels=2.0))
        (half,) = run(field(), [view()], PutsVisibility.of(0.0), LodVisibility(rule="combined", pixels=2.0))
        (twice,) = run(field(), [view()], LodError(pixels=4.0))
        assert np.array_equal(free.level, error.level)
        assert np.array_equal(half.level, twice.level)

    def test_combined_is_coarsest_where_all_is_covered(self):
        (frame,) = run(field(), [view()], PutsVisibility.of(1.0), LodVisibility(rule="combined"))
        assert (frame.level == frame.snapshot.level_count - 1).all()

    def test_behind_a_wall_with_holes(self):
        behind = [sg.Transform(lod(f"ball {x}"), translation=(x, 6, 0), scale=0.5) for x in (-9, 0, 9)]
        slats = [box_at((x, 0, 0), (0.5, 0.2, 8), name="slat") for x in np.arange(-3, 3.1, 0.7)]
        scene = sg.Scene(sg.Group(*behind, *slats))
        known = sg.Registry()
        with sg.Pipeline.parse("hom(least=1) | lod_visibility", known).open(scene.snapshot()) as pipeline:
            frame = pipeline.run(sg.View((0, -10, 0), (0, 0, 0), fov=90))
        level = dict(zip([g.name for g in frame.snapshot.geodes], frame.level.tolist(), strict=True))
        assert level["ball 0"] >= 2 > level["ball -9"] == level["ball 9"] == 0


def back_and_forth(count: int, step: float) -> list[sg.View]:
    eyes = np.tile([-1, 1], count // 2 + 1)[:count] * step
    return [view().moved(eye=np.array(view().eye) + (0, e, 0)) for e in eyes]


STAGES = {
    "distance": lambda h: [LodDistance(hysteresis=h)],
    "error": lambda h: [LodError(hysteresis=h)],
    "combined": lambda h: [PutsVisibility.of(0.3, -1), LodVisibility(rule="combined", hysteresis=h)],
    "budget": lambda h: [LodBudget(triangles=9000, hysteresis=h)],
}


class TestMemory:
    @pytest.mark.parametrize("name", STAGES)
    def test_a_trembling_camera_makes_nothing_pop(self, name):
        pops = {}
        for hysteresis in (0.0, 0.3):
            frames = run(field(400), back_and_forth(12, 0.2), *STAGES[name](hysteresis))
            records = [next(s for s in f.record.stages if s.name.startswith("lod")) for f in frames]
            pops[hysteresis] = sum(r.counts["pops"] for r in records[2:])
            for a, b, record in zip(frames, frames[1:], records[1:], strict=False):
                assert (a.level != b.level).sum() == record.counts["pops"]
        assert pops[0.0] >= 10
        assert pops[0.3] <= 0.02 * pops[0.0]

    def test_linear_visibility_holds_too(self):
        class Trembling(PutsVisibility):
            def run(self, frame):
                frame.put(sg.LevelOfVisibility.of(np.full(frame.snapshot.n, 1 / 7 + 0.02 * (-1) ** frame.index)))

        for hysteresis, total in ((0.0, 5), (0.2, 1)):
            frames = run(sg.Scene(sg.Group(lod())), [view()] * 6, Trembling(), LodVisibility(hysteresis=hysteresis))
            assert sum(f.record.stages[1].counts["pops"] for f in frames) == total

    def test_views_have_memories_of_their_own(self):
        near, far = view(), view().moved(eye=(0, -300, 4))
        alone = run(field(), [near] * 3, LodError(hysteresis=0.9))[-1]
        with sg.Pipeline([LodError(hysteresis=0.9)]).open(field().snapshot()) as pipeline:
            for _ in range(3):
                left, _ = pipeline.run_views([near, far])
        assert np.array_equal(left.level, alone.level)

    def test_it_survives_new_rows_and_another_order(self):
        # nearer first: with the memory, levels stay finer than the rule asks for
        scene = field(60)
        near, far = (view().moved(eye=(0, y, 4)) for y in (-45, -47))
        with sg.Pipeline([LodError(hysteresis=0.5)]).open(scene.snapshot()) as pipeline:
            first = pipeline.run(near)
            before = dict(zip(first.snapshot.keys.tolist(), first.level.tolist(), strict=True))
            scene.root.children[0].add(*(sg.Transform(lod(), translation=(30, i, 0)) for i in range(-20, 20)))
            pipeline_snapshot = first.snapshot
            pipeline_snapshot.sync()
            second = pipeline.run(far)
        assert second.snapshot.n == first.level.size + 40
        stayed = [
            before[k] == level
            for k, level in zip(second.snapshot.keys.tolist(), second.level, strict=True)
            if k in before
        ]
        assert len(stayed) == len(before)
        assert np.mean(stayed) > 0.95
        (fresh,) = run(scene, [far], LodError(hysteresis=0.5))
        assert not np.array_equal(fresh.level, second.level), "without memory, some would have popped"

    def test_hidden_drawables_are_forgotten(self):
        near, far, away = view(), view().moved(eye=(0, -50, 4)), view().moved(target=(0, -99, 4))
        direct = run(field(), [near, far], LodError(hysteresis=0.6))[-1]
        known = sg.Registry()
        with sg.Pipeline.parse("frustum | lod_error(hysteresis=0.6)", known).open(field().snapshot()) as pipeline:
            for looked in (near, away, far):
                frame = pipeline.run(looked)
        (fresh,) = run(field(), [far], LodError(hysteresis=0.6))
        rows = frame.visible
        assert np.array_equal(frame.level[rows], fresh.level[rows])
        assert not np.array_equal(direct.level[rows], fresh.level[rows])

    @pytest.mark.parametrize("name", STAGES)
    def test_a_replay_is_the_same_bit_for_bit(self, name):
        views = [view().moved(eye=(3 * i, -45 + 2 * i, 4)) for i in range(8)]
        pipeline = sg.Pipeline(STAGES[name](0.4))
        snapshot = field().snapshot()
        runs = []
        for _ in range(2):
            pipeline.open(snapshot)
            runs.append([pipeline.run(v).level.copy() for v in views])
            pipeline.close()
        for a, b in zip(*runs, strict=True):
            assert np.array_equal(a, b)

    def test_earlier_stages_are_only_made_coarser(self):
        (frame,) = run(field(), [view()], LodDistance(first=1.0), LodError(pixels=0.01))
        (alone,) = run(field(), [view()], LodDistance(first=1.0))
        assert (frame.level >= alone.level).all()


def test_scenes_without_levels_are_skipped():
    (frame,) = run(wall_scene(), [view()], LodError())
    assert frame.record.stages[0].skipped == "no drawable has levels"


def test_any_scene_gets_levels(tmp_path, monkeypatch):
    from level_shapes import ball

    monkeypatch.setenv("SCENEGRAPH_CACHE_DIR", str(tmp_path))
    scene = sg.Scene(sg.Group(sg.Geode(ball(8, 0.1), name="plain")))
    (frame,) = run(scene, [sg.View((0, -200, 0), (0, 0, 0))], LodError())
    assert frame.level[0] > 0
    assert frame.record.stages[0].triangles_after < frame.record.stages[0].triangles_before


def test_moving_a_scale_moves_the_error():
    scene = sg.Scene(sg.Group(sg.Transform(lod(), name="t")))
    with sg.Pipeline([LodError(pixels=2.0, hysteresis=0.0)]).open(scene.snapshot()) as pipeline:
        small = pipeline.run(view())
        scene.root.find("t").matrix = np.diag([30.0, 30.0, 30.0, 1.0])
        small.snapshot.sync()
        large = pipeline.run(view())
    assert large.level[0] < small.level[0]


@pytest.mark.gl
@pytest.mark.parametrize("pixels", [1.0, 4.0, 12.0])
def test_nothing_in_the_picture_moves_farther_than_the_limit(pixels):
    """The outlines of what is drawn, against those of the finest levels."""
    from scipy.ndimage import distance_transform_edt

    from scenegraph.render.drawing import Drawing
    from scenegraph.render.window import OffscreenWindow

    snapshot, looked = field(60).snapshot(), view(fov=50.0)
    covered = []
    with OffscreenWindow(looked.width, looked.height, (0.0, 0.0, 1.0)) as window:
        drawing = Drawing(snapshot, window.renderer)
        for stages in ([], [LodError(pixels=pixels)]):
            (frame,) = run(snapshot, [looked], *stages)
            drawing.apply(frame)
            window.draw(looked)
            covered.append((window.image()[..., :3] != (0, 0, 255)).any(axis=2))
    assert frame.drawn_triangles() < 0.6 * frame.record.stages[0].triangles_before
    fine, coarse = covered
    assert fine.mean() > 0.02
    away = np.where(fine, distance_transform_edt(fine), distance_transform_edt(~fine))[fine != coarse]
    assert len(away) > 0
    # pixels are in or out by their centers, on either side of the outline
    assert away.max() <= pixels + 1.5
    if pixels > 4:
        assert away.max() > 2, "it does move"
