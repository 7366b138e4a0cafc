"""Which occluders the stage `hom` draws, and what these may never hide."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import scenegraph as sg
from scenegraph.meshes import tessellate
from scenegraph.scenes.shapes import icosphere
from scenegraph.testing import box_at, grid_scene, wall_scene, wall_views
from scenegraph_hom import Hom, OcclusionMap, selection


def run(scene: sg.Scene | sg.Snapshot, view: sg.View, **values: Any) -> sg.Frame:
    snapshot = scene.snapshot() if isinstance(scene, sg.Scene) else scene
    with sg.Pipeline([Hom(least=1, **values)]).open(snapshot) as pipeline:
        return pipeline.run(view)


def hidden(frame: sg.Frame) -> set[str]:
    return {g.name for g, v in zip(frame.snapshot.geodes, frame.visible, strict=True) if not v}


# Owners of declared occluders


def test_an_owner_is_not_hidden_by_its_own_occluder() -> None:
    """The promise that an occluder lies inside opaque geometry is not held against the rows of that very owner."""
    part = box_at((0, 2, 0), name="part")
    house = sg.Group(part, sg.Occluder.box((-2, -0.5, -2), (2, 0.5, 2)), name="house")
    other = box_at((0, 4, 0), name="other")
    view = sg.View((0, -12, 0), (0, 0, 0))
    scene = sg.Scene().add(house, other, box_at((3, -9, 0), 0.1, name="nearest"))
    assert hidden(run(scene, view, occluders="declared")) == {"other"}
    # but another occluder before both may hide it
    scene.add(sg.Occluder.box((-3, -4, -3), (3, -3, 3)))
    assert hidden(run(scene, view, occluders="declared")) == {"part", "other"}


def test_owned_rows_inside_a_node_are_kept_in_the_hierarchy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scenegraph.traversal.FLAT_LIMIT", 0)
    parts = [box_at((x, 3, z), 0.2, name="part") for x in np.linspace(-1, 1, 9) for z in np.linspace(-1, 1, 9)]
    house = sg.Group(*parts, sg.Occluder.box((-2, -0.5, -2), (2, 0.5, 2)), name="house")
    scene = sg.Scene().add(house, box_at((0, 5, 0), name="other"))
    assert hidden(run(scene, sg.View((0, -12, 0), (0, 0, 0)), occluders="declared")) == {"other"}


# Occluders that were fitted into drawables


def fitted_wall(parts: int) -> tuple[sg.Snapshot, sg.Geode, list[sg.Occluder]]:
    """A wall of 12 triangles a part with something behind it, and the solid that was fitted into the wall."""
    bricks = [sg.Mesh.box((-4 + 8 * i / parts, -0.5, -4), (-4 + 8 * (i + 1) / parts, 0.5, 4)) for i in range(parts)]
    wall = sg.Geode(sg.Mesh.merge(bricks), name="wall")
    solid = sg.Occluder.box((-3.9, -0.4, -3.9), (3.9, 0.4, 3.9))
    solid.outside_only = True
    return sg.Scene().add(wall, box_at((0, 4, 0), name="target")).snapshot(), wall, [solid]


def test_fitted_occluders_are_drawn_instead_of_large_meshes_only() -> None:
    view = sg.View((0, -12, 0), (0, 0, 0))
    for parts, declared in ((1, 0), (20, 1)):
        snapshot, wall, solids = fitted_wall(parts)
        stage = Hom(least=1)
        with sg.Pipeline([stage]).open(snapshot) as pipeline:
            assert len(pipeline.run(view).get(OcclusionMap).declared) == 0
            # as another pipeline might do at any time
            snapshot.adopt_occluders({wall: solids})
            frame = pipeline.run(view)
        assert hidden(frame) == {"target"}
        assert len(frame.get(OcclusionMap).declared) == declared


def test_where_a_fitted_occluder_promises_nothing_its_drawable_steps_in() -> None:
    snapshot, wall, solids = fitted_wall(20)
    snapshot.adopt_occluders({wall: solids})
    # inside the wall's box, between the solid and the wall's back
    view = sg.View((0, 0.45, 0), (0, 4, 0), near=0.01)
    for occluders in ("auto", "declared"):
        frame = run(snapshot, view, occluders=occluders)
        occlusion = frame.get(OcclusionMap)
        assert len(occlusion.declared) == 0
        assert (0 in occlusion.rows.tolist()) or occluders == "declared"
        assert hidden(frame) <= {"target"}
    # from outside the drawable is not drawn a second time
    outside = run(snapshot, sg.View((0, -12, 0), (0, 0, 0))).get(OcclusionMap)
    names_drawn = [snapshot.geodes[r].name for r in outside.rows]
    assert "wall" not in names_drawn


# Selection


def test_number_and_triangles_of_occluders_are_limited() -> None:
    snapshot = grid_scene(5).snapshot()
    view = sg.View((0, -40, 3), (0, 0, 0))
    for active, triangles, expected in ((7, 1000, 7), (100, 50, 4), (0, 1000, 0), (10, 0, 0), (10, 11, 0)):
        frame = run(snapshot, view, active=active, triangles=triangles)
        counts = frame.record.stages[0].counts
        assert counts.get("occluders", 0) == expected
        assert counts.get("occluder_triangles", 0) == 12 * expected


def test_a_large_mesh_does_not_end_the_budget() -> None:
    ball = sg.Mesh.merge([sg.Mesh.box((i, -1, -1), (i + 1, 1, 1)) for i in range(-4, 4)])
    scene = sg.Scene().add(sg.Geode(ball, name="large"), box_at((0, 5, 0), name="small"))
    frame = run(scene, sg.View((0, -12, 0), (0, 0, 0)), triangles=100)
    assert frame.record.stages[0].counts["occluders"] == 1
    frame = run(scene, sg.View((0, -12, 0), (0, 0, 0)), triangles=96)
    assert frame.record.stages[0].counts["occluder_triangles"] == 96


def test_rankings() -> None:
    """One occluder is drawn: the largest on the screen, the nearest, or the one that was visible before."""
    scene = sg.Scene().add(box_at((3, 0, 0), 0.5, name="near"), box_at((-5, 5, 0), 5.0, name="large"))
    view = sg.View((0, -6, 0), (0, 0, 0), fov=90)

    def drawn(frame: sg.Frame) -> list[str]:
        return [frame.snapshot.geodes[r].name for r in frame.get(OcclusionMap).rows]

    assert drawn(run(scene, view, active=1, ranking="size")) == ["large"]
    assert drawn(run(scene, view, active=1, ranking="distance")) == ["near"]
    assert drawn(run(scene, view, active=2, ranking="distance", reach=7.0)) == ["near"]
    snapshot = scene.snapshot()
    with sg.Pipeline([Hom(least=1, active=1, ranking="visible")]).open(snapshot) as pipeline:
        first = pipeline.run(view)
        assert drawn(first) == ["large"]
        first.visible[:] = [g.name == "near" for g in snapshot.geodes]
        assert drawn(pipeline.run(view)) == ["near"]


def test_hidden_and_coarsened_drawables_are_no_occluders() -> None:
    class Before(sg.Stage):
        name = "before"
        writes = ("visible", "level")
        hide_it: bool = sg.parameter(False, help="hide instead of coarsen")

        def run(self, frame: sg.Frame) -> None:
            wall = [g.name == "wall" for g in frame.snapshot.geodes]
            if self.hide_it:
                frame.hide(np.array(wall))
            else:
                frame.coarsen(np.array(wall), 1)

    box = sg.Mesh.box((-3, -1, -3), (3, 1, 3))
    small = sg.Mesh.box((-1, -1, -1), (1, 1, 1))
    wall = sg.Lod(sg.Geode(box), sg.Geode(small), name="wall")
    snapshot = sg.Scene().add(wall, box_at((0, 4, 0), name="target")).snapshot()
    view = sg.View((0, -12, 0), (0, 0, 0))
    for stages, expected in (
        ([Hom(least=1)], {"target"}),
        ([Before(), Hom(least=1)], set()),
        ([Before(), Hom(least=1, coarsest=True)], {"target"}),
        ([Before(hide_it=True), Hom(least=1)], {"wall"}),
    ):
        with sg.Pipeline(stages).open(snapshot) as pipeline:
            assert hidden(pipeline.run(view)) == expected


def test_solids_stand_for_the_planes_of_the_same_owner() -> None:
    scene = wall_scene()
    for occluders, count in (("auto", 1), ("declared", 2), ("meshes", 0)):
        frame = run(scene, wall_views()[0], occluders=occluders)
        assert len(frame.get(OcclusionMap).declared) == count


def test_looking_at_the_best_only_gives_the_same_as_looking_at_all() -> None:
    rng = np.random.default_rng(8)
    for _ in range(60):
        n = int(rng.integers(1, 60))
        key, seen = rng.integers(0, 9, n).astype(float), rng.random(n) < rng.choice([0, 0.3])
        costs, active = rng.integers(1, 20, n), int(rng.integers(0, 12))
        options = {"active": active, "triangles": 10**6}
        few = selection._best(key, seen, costs, among=2 * active, **options)
        assert np.array_equal(few, selection._best(key, seen, costs, among=n, **options))


# Inner shells


def round_lods(count: int = 1) -> tuple[sg.Scene, sg.Mesh]:
    """Balls of three levels in a row along y, and a small box behind the first."""
    points, faces = icosphere(1)
    coarse = sg.Mesh(points, faces, normals=points)
    levels = [tessellate(coarse, n) for n in (6, 3, 1)]
    scene = sg.Scene()
    for k in range(count):
        scene.add(sg.Transform(sg.Lod(*levels, name=f"ball {k}"), translation=(6.0 * k, 0, 0)))
    scene.add(box_at((0, 4, 0), 0.3, name="behind"))
    return scene, coarse


def test_shells_of_coarse_levels_are_drawn_instead_of_fine_ones() -> None:
    scene, coarse = round_lods()
    view = sg.View((0, -6, 0), (0, 0, 0))
    frame = run(scene, view)
    assert frame.record.stages[0].counts["occluder_triangles"] <= coarse.triangles + 12
    assert hidden(frame) == {"behind"}
    whole = run(scene, view, inner=False)
    assert whole.record.stages[0].counts["occluder_triangles"] >= 54 * coarse.triangles
    assert hidden(whole) == {"behind"}
    # what is inside closes no more than the ball does, and most of it
    ours, theirs = frame.get(OcclusionMap).covered, whole.get(OcclusionMap).covered
    assert not (ours & ~theirs).any()
    assert ours.sum() > 0.75 * theirs.sum()


def test_with_shells_a_budget_holds_what_whole_meshes_would_burst() -> None:
    scene, coarse = round_lods(5)
    view = sg.View((0, -6, 0), (0, 0, 0))
    assert hidden(run(scene, view, triangles=5 * coarse.triangles + 12)) == {"behind"}
    assert hidden(run(scene, view, triangles=5 * coarse.triangles + 12, inner=False)) == set()


@pytest.mark.parametrize("eye", [(0, 0, 0), (0, -0.999, 0), (0, -1.0001, 0)])
def test_from_inside_a_shell_hides_nothing(eye: tuple[float, float, float]) -> None:
    scene, _ = round_lods()
    scene.add(box_at((0, 0.93, 0), 0.01, name="within"))
    frame = run(scene, sg.View(eye, (0, 4, 0), near=0.01))
    assert hidden(frame) == set()


def test_in_parallel_views_shells_are_seen_from_outside() -> None:
    scene, _ = round_lods()
    assert hidden(run(scene, sg.View((0, -6, 0), (0, 0, 0), parallel_scale=3.0))) == {"behind"}
    assert hidden(run(scene, sg.View((0, 0, 0), (0, 1, 0), parallel_scale=3.0, near=0.01))) == set()


def test_an_earlier_stage_may_not_have_coarsened_the_owner_of_a_shell() -> None:
    class Coarse(sg.Stage):
        name = "coarse"
        writes = ("level",)

        def run(self, frame: sg.Frame) -> None:
            frame.coarsen(np.arange(frame.snapshot.n), 1)

    scene, _ = round_lods()
    with sg.Pipeline([Coarse(), Hom(least=1)]).open(scene.snapshot()) as pipeline:
        assert pipeline.run(sg.View((0, -6, 0), (0, 0, 0))).visible.all()
