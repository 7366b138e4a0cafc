"""The stage `shadow`: which occluders it chooses, and when."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import scenegraph as sg
from scenegraph.kernels.solid_angles import angle_solid_triangles
from scenegraph.testing import box_at
from scenegraph_shadow import Shadow, ShadowFrusta
from scenegraph_shadow.catalog import Catalog, contained
from scenegraph_shadow.frusta import Shapes, Topology
from scenegraph_shadow.ranking import Scores
from shadow_scenes import counts, run, street_views, town

# -- ranking -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("measure", ["area_angle", "printed", "image"])
@pytest.mark.parametrize("options", [{}, {"parallel_scale": 20.0}], ids=str)
def test_best_of_blocks_are_the_best_of_all(measure: str, options: dict[str, Any]) -> None:
    snapshot = town(300).snapshot()
    table = snapshot.occluders
    catalog = Catalog(snapshot, "both")
    for view in street_views(12, **options):
        planes = view.planes(view.eye)
        expected = []
        for i in range(len(table)):
            points = table.points_of(i)
            center = points.mean(axis=0)
            way = center - view.eye
            radius = np.linalg.norm(points - center, axis=1).max()
            if (planes[:, :3] @ way + planes[:, 3] < -radius).any():
                continue
            distance = 1.0 if options else np.linalg.norm(way)
            toward = view.forward if options else way
            area = table.areas[table.face_first[i] : table.face_first[i + 1]]
            if measure == "image":
                score = area.sum() * (0.5 if table.solid[i] else 1.0) / distance**2
            elif table.solid[i]:
                volume = ConvexHull(points).volume
                score = (
                    volume / distance**3 if measure == "printed" and not options else volume ** (2 / 3) / distance**2
                )
            else:
                score = abs(area[0] * table.normals[table.face_first[i]] @ toward) / distance ** (
                    2 if measure == "printed" else 3
                )
            expected.append((-score, i))
        expected.sort()
        if not expected:
            continue
        for count in (1, 7, 60):
            found, least = Scores(catalog, view, measure).best(planes, count)
            wanted = [-s for s, _ in expected[:count]]
            values = {i: -s for s, i in expected}
            assert [values[i] for i in found] == pytest.approx(wanted, rel=1e-6)
            assert least == pytest.approx(wanted[-1], rel=1e-6)
            for hint in (0.0, least, least * 2, least / 2, 1e300):
                assert Scores(catalog, view, measure).best(planes, count, hint)[0].tolist() == found.tolist()


def test_equal_scores_are_ordered_by_number() -> None:
    """Four equal walls around the eye, all in view of an orthographic camera; OpenSceneGraph would drop three."""
    scene = sg.Scene()
    for x, y in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        scene.add(
            sg.Group(
                sg.Occluder.box((x * 5 - 1, y * 5 - 1, 0), (x * 5 + 1, y * 5 + 1, 2)), box_at((x * 5, y * 5, 1), 2)
            )
        )
        scene.add(box_at((x * 5, y * 5, -3), 0.5, name=f"under {x} {y}"))
    view = sg.View((0, 0, 50), (0, 0, 0), up=(0, 1, 0))
    for ranking in ("area_angle", "printed", "solid_angle"):
        (frame,) = run(Shadow(ranking=ranking, active=4), scene.snapshot(), view)
        assert frame.get(ShadowFrusta).ids.tolist() == [0, 1, 2, 3]
        assert frame.visible_count == 4


@pytest.mark.parametrize("options", [{}, {"parallel_scale": 9.0}], ids=str)
def test_solid_angles_are_exact(options: dict[str, Any]) -> None:
    """Shapes of different build at once; each against the triangles of its image's outline, seen from its middle."""
    rng = np.random.default_rng(2)
    angle = np.arange(9) * 2 * np.pi / 9
    drum = np.concatenate([np.column_stack([np.cos(angle), np.sin(angle), 0 * angle + z]) for z in (0, 3)])
    shapes = [drum + (3, 20, 0), rng.standard_normal((12, 3)) + (-4, 15, 1), drum[:9] @ np.diag([2, 1, 1]) + (0, 30, 2)]
    nodes = [sg.Occluder.solid(p) for p in shapes[:2]] + [sg.Occluder.planar(shapes[2])]
    table = sg.Scene().add(sg.Occluder.box((-9, 9, 0), (-8, 12, 1)), *nodes).snapshot().occluders
    view = sg.View((0.3, -4, 7), (0, 20, 0), **options)
    found = Shapes(table, Topology(table), np.zeros(len(table.areas)), np.arange(4), view).solid_angles()
    for number, value in enumerate(found):
        points = (table.points_of(number) - view.eye) @ view.axes.T
        image = points[:, :2] if options else points[:, :2] / -points[:, 2:]
        hull = ConvexHull(image)
        if options:
            assert value == pytest.approx(hull.volume, rel=1e-12)
            continue
        ring = np.insert(image[hull.vertices], 2, -1, axis=1).T
        middle = np.repeat(ring.mean(axis=1, keepdims=True), ring.shape[1], axis=1)
        assert value == pytest.approx(angle_solid_triangles(middle, ring, np.roll(ring, -1, axis=1)).sum(), rel=1e-12)


def test_active_is_the_most_that_is_used() -> None:
    snapshot = town().snapshot()
    for active in (1, 3, 10):
        for frame in run(Shadow(active=active), snapshot, *street_views(5)):
            assert counts(frame)["active"] == len(frame.get(ShadowFrusta)) <= active


def test_more_active_occluders_hide_more() -> None:
    snapshot = town(400, spread=60.0).snapshot()
    views = street_views(20, spread=60.0)
    drawn = [sum(f.visible_count for f in run(Shadow(active=n), snapshot, *views)) for n in (0, 1, 4, 16, 64)]
    assert drawn == sorted(drawn, reverse=True)
    assert len(set(drawn)) == len(drawn)


def test_marginal_ranking_does_not_choose_twice_the_same_part_of_the_screen() -> None:
    """Two large walls one almost behind the other and a smaller one beside: by size alone it would be the two."""
    scene = sg.Scene()
    for i, (low, high) in enumerate((((-4, 0, -3), (4, 1, 3)), ((-6.3, 3, -4), (4, 4, 4)), ((7, 0, -3), (12, 1, 3)))):
        scene.add(sg.Group(sg.Occluder.box(low, high), name=str(i)))
    scene.add(box_at((0, 50, 0)))
    view = sg.View((0, -12, 0), (0, 0, 0), fov=80.0)
    chosen = {}
    for ranking in ("solid_angle", "marginal"):
        (frame,) = run(Shadow(ranking=ranking, active=2), scene.snapshot(), view)
        chosen[ranking] = frame.get(ShadowFrusta).ids.tolist()
    assert chosen == {"solid_angle": [1, 0], "marginal": [0, 2]}


def test_occluders_in_the_shadow_of_others_are_dropped() -> None:
    scene = sg.Scene().add(
        sg.Group(sg.Occluder.box((-5, 0, -5), (5, 1, 5), name="near")),
        sg.Group(sg.Occluder.box((-3, 5, -3), (3, 90, 3), name="behind")),
        sg.Group(sg.Occluder.planar([(-3, 4, -3), (3, 4, -3), (3, 4, 3), (-3, 4, 3)], name="behind, too")),
        box_at((0, 100, 0)),
    )
    (frame,) = run(Shadow(), scene.snapshot(), sg.View((0, -12, 0), (0, 0, 0)))
    assert frame.get(ShadowFrusta).ids.tolist() == [0]
    assert counts(frame)["covered"] == 2
    assert frame.visible_count == 0


@pytest.mark.parametrize("owned", [True, False])
def test_facades_of_a_solid_are_dropped_for_it(owned: bool) -> None:
    """They lie in its faces, neither hides the other strictly, and the facade is ranked first."""
    square = [(-2, -2, 0), (2, -2, 0), (2, -2, 4), (-2, -2, 4)]
    facade, solid = sg.Occluder.planar(square), sg.Occluder.box((-2, -2, 0), (2, 2, 4))
    door = box_at((0, 0, 1), 0.5)
    house = [sg.Group(facade, solid, door)] if owned else [sg.Group(facade), sg.Group(solid, door)]
    scene = sg.Scene().add(*house, box_at((0, 9, 2)))
    (frame,) = run(Shadow(), scene.snapshot(), sg.View((3, -12, 2), (0, 0, 2)))
    assert frame.get(ShadowFrusta).ids.tolist() == [1]
    assert counts(frame)["covered"] == (0 if owned else 1)


def test_polygons_in_a_solid_of_the_same_owner_are_not_even_ranked() -> None:
    """Under a turned and mirrored transform far away, too. Others stay: beside it, of another owner, cutting it."""
    corners = np.array([(-2, -2, 0), (2, -2, 0), (2, -2, 4), (-2, -2, 4)])
    inside = [corners, corners * (0.5, 0, 0.5), corners[[0, 1, 2]], corners * (1, -1, 1)]
    beyond = [corners + (0, -0.01, 0), corners * (1.01, 1, 1), corners * (3, 0, 3), corners + (9, 0, 0)]
    group = sg.Transform(
        sg.Occluder.box((-2, -2, 0), (2, 2, 4)),
        *(sg.Occluder.planar(p) for p in (*inside, *beyond)),
        translation=(1e7, -1e7, 0),
        rotation=(33, (1, 2, 3)),
        scale=(-1, 2, 1),
    )
    scene = sg.Scene().add(group, sg.Group(sg.Occluder.planar(corners)), box_at((0, 9, 2)))
    table = scene.snapshot().occluders
    assert contained(table).tolist() == [1, 2, 3, 4]
    assert len(Catalog(scene.snapshot(), "both", drop_contained=True)) == len(table) - 4
    assert len(Catalog(scene.snapshot(), "planar", drop_contained=True)) == len(table) - 1


@pytest.mark.parametrize("kinds", ["solid", "both"])
def test_with_their_facades_solids_hide_as_much_as_alone(kinds: str) -> None:
    """Facades would take the places of better occluders, being ranked higher than the solids they belong to."""
    snapshot = town(400, spread=60.0).snapshot()
    drawn = [f.visible_count for f in run(Shadow(occluders=kinds), snapshot, *street_views(12, spread=60.0))]
    alone = [f.visible_count for f in run(Shadow(occluders="solid"), snapshot, *street_views(12, spread=60.0))]
    assert drawn == alone


# -- several views and frames ------------------------------------------------------------------------------------------


def test_walls_of_a_cave_share_one_ranking() -> None:
    """Four views from one eye: what one has scored is not scored again, and each gets what it would get alone."""
    snapshot = town(600, spread=80.0).snapshot()
    walls = [sg.View((0, 0, 2), (np.cos(a), np.sin(a), 2), fov=60.0) for a in np.arange(4) * np.pi / 2]
    with sg.Pipeline([Shadow()]).open(snapshot) as pipeline:
        together = pipeline.run_views(walls)
        again = pipeline.run_views(walls)
    alone = [run(Shadow(), snapshot, wall)[0] for wall in walls]
    for a, b in zip(together, alone, strict=True):
        assert np.array_equal(a.visible, b.visible)
        assert a.get(ShadowFrusta).ids.tolist() == b.get(ShadowFrusta).ids.tolist()
    scored = [sum(counts(f)["scored"] for f in frames) for frames in (together, again, alone)]
    assert scored[1] == 0
    assert scored[0] < 0.8 * scored[2]


def test_reselect_ranks_every_k_frames_per_view() -> None:
    snapshot = town().snapshot()
    views = street_views(2)
    with sg.Pipeline([Shadow(reselect=3)]).open(snapshot) as pipeline:
        chosen = []
        for i in range(7):
            view = views[0].moved(eye=np.array(views[0].eye) + 0.01 * i)
            chosen.append(pipeline.run_views([view, views[1]])[0].get(ShadowFrusta).chosen_at)
    assert chosen == [0, 0, 0, 3, 3, 3, 6]


def test_reselect_uses_the_geometry_of_the_frame() -> None:
    """Only the choice is old: rows are made anew from the eye and the vertices of this frame."""
    snapshot = town().snapshot()
    view = street_views(1)[0]
    with sg.Pipeline([Shadow(reselect=10)]).open(snapshot) as pipeline:
        first = pipeline.run(view).get(ShadowFrusta)
        second = pipeline.run(view.moved(eye=np.array(view.eye) + 0.05)).get(ShadowFrusta)
    assert second.chosen_at == first.chosen_at
    assert not np.array_equal(first.rows, second.rows)
    assert np.allclose(second.eye - first.eye, 0.05)


def test_a_view_that_turns_away_is_ranked_at_once() -> None:
    snapshot = town(400).snapshot()
    here = sg.View((0, 0, 2), (1, 0, 2), near=0.05, far=300)
    there = here.moved(target=(-1, 0, 2))
    with sg.Pipeline([Shadow(reselect=100)]).open(snapshot) as pipeline:
        frames = [pipeline.run(v) for v in (here, there, there)]
    assert [f.get(ShadowFrusta).chosen_at for f in frames] == [0, 1, 1]
