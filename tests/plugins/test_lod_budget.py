"""Levels within a budget of triangles: never more, nearly all of it, and the largest error as small as can be."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import scenegraph as sg
from lod_scenes import chain, field, lod, run, view
from scenegraph.testing import PLACES
from scenegraph_lod import LodBudget, LodDistance, LodError

SCENE = field(400)
FULL = sum({"Lod": chain()[0][0].triangles, "Geode": 12}[type(g).__name__] for g in SCENE.snapshot().geodes)
COARSEST = 400 * chain()[-1][0].triangles + 12


class TestFrames:
    @settings(max_examples=30)
    @given(
        st.integers(COARSEST, FULL),
        st.floats(1, 170),
        st.integers(30, 4000),
        st.sampled_from((None, 3.0, 300.0)),
        st.sampled_from(PLACES),
        st.floats(0, 0.9),
    )
    def test_the_budget_is_kept_and_used(self, budget, fov, height, parallel, place, hysteresis):
        scale, offset = place
        scene = field(400, scale=scale, offset=offset)
        size = None if parallel is None else parallel * scale
        views = [view(scale, offset, fov=f, height=height, parallel_scale=size) for f in (fov, fov * 1.02, fov)]
        for frame in run(scene, views, LodBudget(triangles=budget, hysteresis=hysteresis)):
            assert 0.99 * budget <= frame.drawn_triangles() <= budget
            counts = frame.record.stages[0].counts
            assert counts["triangles_used"] == frame.drawn_triangles()
            assert counts["over_budget"] == 0

    @pytest.mark.parametrize("options", [{}, {"fov": 8.0}, {"fov": 150.0}, {"parallel_scale": 30.0}], ids=str)
    def test_more_budget_is_never_worse(self, options):
        used, worst = [], []
        for budget in np.linspace(COARSEST, FULL, 25).astype(int):
            (frame,) = run(SCENE, [view(**options)], LodBudget(triangles=int(budget)))
            used.append(frame.drawn_triangles())
            errors = frame.view.error_pixels(
                frame.snapshot.errors[frame.level, np.arange(frame.snapshot.n)], frame.snapshot.boxes
            )
            worst.append(np.nanmax(np.where(frame.level > 0, errors, 0)))
        assert used == sorted(used)
        assert worst == sorted(worst, reverse=True)

    def test_it_is_the_rule_of_errors_at_the_limit_that_fits(self):
        (by_error,) = run(SCENE, [view()], LodError(pixels=3.0))
        (by_budget,) = run(SCENE, [view()], LodBudget(triangles=by_error.drawn_triangles()))
        assert by_budget.drawn_triangles() == by_error.drawn_triangles()
        assert np.array_equal(by_budget.level, by_error.level)

    def test_too_small_a_budget_is_told(self):
        (frame,) = run(SCENE, [view()], LodBudget(triangles=COARSEST - 100))
        assert frame.drawn_triangles() == COARSEST
        assert frame.record.stages[0].counts["over_budget"] == 100
        assert (frame.level == frame.snapshot.level_count - 1).all()

    def test_hidden_rows_are_free(self):
        known = sg.Registry()
        looked = view(fov=20.0)
        with sg.Pipeline.parse("frustum | lod_budget(triangles=60000)", known).open(SCENE.snapshot()) as pipeline:
            frame = pipeline.run(looked)
        assert frame.record.stages[0].hidden > 100
        assert 59_400 <= frame.drawn_triangles() <= 60_000

    def test_what_is_coarse_already_stays_so(self):
        first = LodDistance(first=6.0, hysteresis=0.0)
        before, after = run(SCENE, [view()], first)[0], run(SCENE, [view()], first, LodBudget(triangles=20_000))[0]
        assert (after.level >= before.level).all()
        assert 19_800 <= after.drawn_triangles() <= 20_000

    def test_standins_count(self):
        class Replaces(sg.Stage):
            name = "replaces_for_tests"
            writes = ("visible", "standins")

            def run(self, frame):
                frame.replace(np.arange(50), chain()[0][0])

        (frame,) = run(SCENE, [view()], Replaces(), LodBudget(triangles=50_000))
        assert len(frame.standins) == 1
        assert 49_500 <= frame.drawn_triangles() <= 50_000

    def test_drawables_without_errors_or_place_give_way_too(self):
        nodes = [sg.Transform(lod(known=False), translation=(i, 0, 0), scale=0.1) for i in range(10)]
        nodes.append(sg.Transform(lod(), scale=(np.inf, 1, 1)))
        scene = sg.Scene(sg.Group(*nodes))
        (frame,) = run(scene, [view()], LodBudget(triangles=11 * chain()[-1][0].triangles))
        assert frame.drawn_triangles() == 11 * chain()[-1][0].triangles
        (frame,) = run(scene, [view()], LodBudget(triangles=1200 + 10 * chain()[-1][0].triangles))
        place = int(np.flatnonzero(frame.snapshot.unknown)[0])
        assert frame.level[place] == 0, "what cannot be measured gives way last"

    def test_a_budget_over_which_nothing_goes_changes_nothing(self):
        (frame,) = run(SCENE, [view()], LodBudget(triangles=FULL))
        assert not frame.level.any()
