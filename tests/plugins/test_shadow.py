"""The stage `shadow`: what it hides, and that nothing visible is among it."""

from __future__ import annotations

import dataclasses
from contextlib import closing

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

import scenegraph as sg
from scenegraph.testing import StageContract, box_at, random_views, wall_scene, wall_views
from scenegraph_shadow import Shadow, ShadowFrusta
from scenegraph_shadow import stage as stage_module
from scenegraph_shadow.catalog import Catalog
from shadow_scenes import counts, names, run, street_views, town


class TestShadow(StageContract):
    stages = (
        Shadow(),
        Shadow(occluders="planar", ranking="printed"),
        Shadow(occluders="solid", cap="depth", ranking="solid_angle"),
        Shadow(ranking="marginal", reselect=3, active=2),
        Shadow(active=0),
    )


# -- what is hidden, and what is not ---------------------------------------------------------------------------------


@pytest.mark.parametrize("kinds", ["planar", "solid", "both"])
@pytest.mark.parametrize("cap", ["faces", "depth"])
def test_wall_hides_what_is_behind_it(kinds: str, cap: str) -> None:
    (frame,) = run(Shadow(occluders=kinds, cap=cap), wall_scene().snapshot(), wall_views()[0])
    hidden = names(frame, visible=False)
    assert hidden == {n for n in names(frame, visible=True) | hidden if n.startswith("behind")}
    assert counts(frame)["active"] == 1


@pytest.mark.gl
@pytest.mark.parametrize(
    "stage",
    [
        Shadow(),
        Shadow(occluders="planar"),
        Shadow(occluders="solid", cap="depth", active=40),
        Shadow(occluders="solid", ranking="marginal"),
        Shadow(ranking="solid_angle", reselect=4),
    ],
    ids=lambda s: s.text,
)
def test_nothing_visible_is_hidden_in_a_town(stage: Shadow) -> None:
    """Held against the item buffer with 4 x 4 samples a pixel; and a good part of what is invisible is hidden."""
    from scenegraph.render.item_buffer import ItemBuffer

    snapshot = town().snapshot()
    views = (
        street_views(30) + street_views(10, parallel_scale=10.0, seed=6) + street_views(10, shift=(0.4, -0.3), seed=7)
    )
    hidden = invisible = 0
    with closing(ItemBuffer(snapshot)) as buffer:
        for frame in run(stage, snapshot, *views):
            truth = buffer.render(frame.view, supersample=4).visible
            lost = truth & ~frame.visible
            assert not lost.any(), (snapshot.names(np.flatnonzero(lost)), frame.view)
            hidden += int((~frame.visible).sum())
            invisible += int((~truth).sum())
    assert hidden > 0.1 * invisible


@given(st.integers(0, 2**32 - 1))
def test_hidden_boxes_cannot_be_reached_by_any_ray(seed: int) -> None:
    """Every ray from the eye to a point of a hidden box meets a solid first: slab by slab, in float64."""
    rng = np.random.default_rng(seed)
    low = rng.uniform(-9, 9, (12, 3)) * (1, 1, 0.3)
    high = low + rng.uniform(0.5, 5, (12, 3))
    scene = sg.Scene()
    for a, b in zip(low, high, strict=True):
        scene.add(sg.Group(sg.Geode(sg.Mesh.box(a, b)), sg.Occluder.box(a, b)))
    scene.add(*(box_at(p, 0.3) for p in rng.uniform(-12, 12, (100, 3)) * (1, 1, 0.3)))
    snapshot = scene.snapshot()
    for view in random_views(rng, 3, 12.0):
        view = dataclasses.replace(view, parallel_scale=None, near=1e-3)
        (frame,) = run(Shadow(), snapshot, view)
        eye = np.array(view.eye)
        for row in np.flatnonzero(~frame.visible)[:20]:
            points = snapshot.boxes[:3, row] + rng.uniform(-1, 1, (20, 3)) * snapshot.boxes[3:, row]
            with np.errstate(divide="ignore", invalid="ignore"):
                t = np.sort((np.stack([low, high]) - eye)[:, None] / (points - eye)[None, :, None], axis=0)
            enter, leave = np.nanmax(t[0], axis=-1), np.nanmin(t[1], axis=-1)
            in_front = (enter <= leave) & (enter > 0) & (enter < 1)
            inside_view = ((view.planes(view.eye)[:, :3] @ (points - eye).T).T + view.planes(view.eye)[:, 3] >= 0).all(
                axis=1
            )
            assert (in_front.any(axis=1) | ~inside_view).all()


def test_objects_across_the_border_of_the_screen() -> None:
    """A wall that ends beyond the screen hides what ends beyond it, too: the border is no side of the shadow."""
    wall = sg.Group(box_at((0, 0, 0), (8, 1, 60), name="wall"), sg.Occluder.box((-4, -0.5, -30), (4, 0.5, 30)))
    # reaches out of the shadow where nobody looks
    scene = sg.Scene().add(
        wall, box_at((0, 6, 0), (0.5, 0.5, 80), name="pole"), box_at((-20, 6, 0), 0.5, name="beside")
    )
    scene.add(box_at((9, 6, 0), (8, 0.5, 0.5), name="half beside"))
    for view, expected in (
        (sg.View((0, -12, 0), (0, 0, 0), fov=70.0), {"pole"}),
        (sg.View((0, -12, 0), (0, 0, 0), fov=14.0, width=100, height=100), {"pole", "half beside", "beside"}),
    ):
        (frame,) = run(Shadow(), scene.snapshot(), view)
        assert names(frame, visible=False) == expected
        assert counts(frame)["active"] == 1


@given(st.integers(0, 2**32 - 1))
def test_occluders_beyond_a_corner_of_the_screen(seed: int) -> None:
    """Near a corner all edges but one may lie beyond one side each: what is left must not hide the whole view."""
    rng = np.random.default_rng(seed)
    view = sg.View((0, 0, 0), (0, 1, 0), fov=50.0, width=160, height=120, near=1e-3, far=200.0)
    _, right, _, top = view.window
    scene = sg.Scene()
    for depth in rng.uniform(3, 20, 6):
        x, z = depth * rng.uniform(0.8, 1.6, 2) * (right, top) * rng.choice([-1, 1], 2)
        sides = rng.standard_normal((8, 3)) * depth * 0.3
        scene.add(sg.Occluder.solid(sides + (x, depth, z)))
    points = rng.uniform(-1, 1, (200, 3)) * (right, 0, top) + (0, 1, 0)
    points *= rng.uniform(30, 100, (200, 1))
    scene.add(*(sg.Geode(sg.Mesh.box(p - 1e-3, p + 1e-3)) for p in points))
    snapshot = scene.snapshot()
    for cap in ("faces", "depth"):
        (frame,) = run(Shadow(cap=cap, active=50), snapshot, view)
        for row in np.flatnonzero(~frame.visible):
            way = snapshot.boxes[:3, row]
            planes = [ConvexHull(snapshot.occluders.points_of(o)).equations for o in range(len(snapshot.occluders))]
            assert any(_ray_meets(way, p) for p in planes), row


def _ray_meets(way: np.ndarray, planes: np.ndarray) -> bool:  # type: ignore[type-arg]
    """Whether the ray from the origin to a point passes through a convex solid, give or take a hair."""
    along, level = planes[:, :3] @ way, planes[:, 3] - 2e-3
    with np.errstate(divide="ignore", invalid="ignore"):
        at = -level / along
    enter = at[along < 0].max(initial=0.0)
    leave = at[along > 0].min(initial=1.0)
    return bool(enter <= leave)


def test_drawables_of_the_owner_are_never_hidden() -> None:
    """Even where the proxy is too large, and whatever else is in the group."""
    house = sg.Group(
        box_at((0, 0, 0), (4, 1, 4), name="front"),
        box_at((0, 3, 0), 0.5, name="own"),
        sg.Occluder.box((-3, -1, -3), (3, 1, 3)),
    )
    scene = sg.Scene().add(house, box_at((0, 5, 0), 0.5, name="other"))
    for limit in (0, 10**9):
        stage_module.FLAT_LIMIT, before = limit, stage_module.FLAT_LIMIT
        try:
            (frame,) = run(Shadow(), scene.snapshot(), sg.View((0, -12, 0), (0, 0, 0)))
        finally:
            stage_module.FLAT_LIMIT = before
        assert names(frame, visible=False) == {"other"}


def test_another_occluder_may_hide_what_an_owner_may_not() -> None:
    house = sg.Group(box_at((0, 3, 0), 0.5, name="own"), sg.Occluder.box((-3, 0, -3), (3, 1, 3)))
    wall = sg.Group(box_at((0, -2, 0), (10, 1, 10), name="wall"), sg.Occluder.box((-5, -2.5, -5), (5, -1.5, 5)))
    scene = sg.Scene().add(house, wall)
    stage = Shadow(active=1)
    (frame,) = run(stage, scene.snapshot(), sg.View((0, -12, 0), (0, 0, 0)))
    assert names(frame, visible=False) == {"own"}


@pytest.mark.parametrize("cap", ["faces", "depth"])
def test_coincident_proxies_do_not_hide_each_other(cap: str) -> None:
    """Two equal houses in one place, as double geometry in a model: the occluder of each must not hide the other."""
    scene = sg.Scene()
    for i in range(2):
        square = [(-2, -2, 0), (2, -2, 0), (2, -2, 4), (-2, -2, 4)]
        scene.add(
            sg.Group(
                box_at((0, 0, 2), 4, name=f"house {i}"),
                sg.Occluder.box((-2, -2, 0), (2, 2, 4)),
                sg.Occluder.planar(square),
            )
        )
    for eye in ((0, -9, 2), (7, -9, 5), (2, -9, 2), (2, -9, 4)):
        (frame,) = run(Shadow(cap=cap), scene.snapshot(), sg.View(eye, (0, 0, 2)))
        assert frame.visible.all()


def test_hierarchical_equals_flat(monkeypatch: pytest.MonkeyPatch) -> None:
    snapshot = town(400).snapshot()
    for stage in (Shadow(), Shadow(active=40, cap="depth"), Shadow(occluders="planar")):
        results = []
        for limit, few in ((10**9, 64), (0, 64), (0, 0)):
            monkeypatch.setattr("scenegraph_shadow.stage.FLAT_LIMIT", limit)
            monkeypatch.setattr("scenegraph_shadow.verdict.FEW_NODES", few)
            results.append([f.visible for f in run(stage, snapshot, *street_views(12))])
        assert np.array_equal(results[0], results[1])
        assert np.array_equal(results[0], results[2])
        assert not np.all(results[0])


def test_single_and_double_precision_give_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    snapshot = town(300).snapshot()
    views = street_views(12)
    plain = [f.visible for f in run(Shadow(), snapshot, *views)]
    monkeypatch.setattr("scenegraph.kernels.shadow_frusta.ROUNDING", 1e6)
    frames = run(Shadow(), snapshot, *views)
    # with a margin so large nearly everything is left to float64, whose own tolerance is still tiny
    assert sum(counts(f).get("undecided", 0) for f in frames) > 1000
    assert np.array_equal(plain, [f.visible for f in frames])


# -- scale, shift, motion ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("scale", "shift"), [(1e-6, 0.0), (1e6, 0.0), (1.0, 1e7), (2.0**-30, 0.0), (1e-3, 1e4)])
@pytest.mark.parametrize("ranking", ["area_angle", "solid_angle", "marginal"])
def test_scale_and_shift_give_the_same_result(scale: float, shift: float, ranking: str) -> None:
    views = street_views(10)
    answers = []
    for s, t in ((1.0, 0.0), (scale, shift)):
        root = town(150).root
        nodes = list(root)
        for node in nodes:
            root.remove(node)
        scene = sg.Scene(sg.Group(sg.Transform(*nodes, scale=s, translation=(t, t, t))))
        moved = [
            dataclasses.replace(
                v, eye=np.array(v.eye) * s + t, target=np.array(v.target) * s + t, near=v.near * s, far=v.far * s
            )
            for v in views
        ]
        snapshot = scene.snapshot()
        frames = run(Shadow(ranking=ranking), snapshot, *moved)
        answers.append([f.visible[np.argsort(snapshot.keys)] for f in frames])
    assert np.array_equal(*answers)
    assert not np.all(answers[0])


def test_printed_ranking_depends_on_the_unit_and_the_default_does_not() -> None:
    """A wide polygon against a bulky solid: by (3) as printed the winner changes from meters to millimeters."""

    def first(ranking: str, scale: float) -> int:
        scene = sg.Scene().add(
            sg.Transform(
                sg.Occluder.planar([(-3, 0, -1), (-1, 0, -1), (-1, 0, 1), (-3, 0, 1)]),
                sg.Occluder.box((1, 0, -1), (3, 2, 1)),
                box_at((0, 30, 0)),
                scale=scale,
            )
        )
        view = sg.View((0, -9 * scale, 0), (0, 0, 0), near=0.1 * scale, far=100 * scale)
        (frame,) = run(Shadow(ranking=ranking), scene.snapshot(), view)
        return int(frame.get(ShadowFrusta).ids[0])

    assert first("printed", 1e-3) != first("printed", 1e3)
    assert first("area_angle", 1e-3) == first("area_angle", 1.0) == first("area_angle", 1e3)


def test_moving_occluders_are_followed() -> None:
    """Geometry is never stale: after each move the result is that of a new stage on a new snapshot."""
    gate = sg.Transform(box_at((0, 0, 0), (6, 1, 6), name="gate"), sg.Occluder.box((-3, -0.5, -3), (3, 0.5, 3)))
    scene = sg.Scene().add(gate, *(box_at((x, 5, 0), 0.5, name=str(x)) for x in range(-8, 9)))
    snapshot = scene.snapshot()
    view = sg.View((0, -12, 0), (0, 0, 0), fov=80.0)
    seen = []
    with sg.Pipeline([Shadow(reselect=4)]).open(snapshot) as pipeline:
        for step in range(12):
            gate.matrix = sg.Transform(translation=(step - 6, 0, 0), rotation=(5.0 * step, (0, 0, 1))).matrix
            snapshot.sync()
            visible = pipeline.run(view).visible
            fresh = run(Shadow(), sg.Snapshot(scene), view)[0].visible
            assert np.array_equal(visible[np.argsort(snapshot.keys)], fresh[np.argsort(sg.Snapshot(scene).keys)])
            seen.append(visible.tolist())
    assert len({tuple(s) for s in seen}) > 6


def test_catalog_measures_only_what_has_moved(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = town(120)
    snapshot = scene.snapshot()
    catalog = Catalog(snapshot, "both")
    measured: list[int] = []
    plain = Catalog._measure
    monkeypatch.setattr(
        Catalog, "_measure", lambda self, table, place: (measured.append(len(place)), plain(self, table, place))[1]
    )
    assert not catalog.refresh()
    house = scene.root.children[7]
    assert isinstance(house, sg.Transform)
    house.matrix = sg.Transform(translation=(100, 0, 0), rotation=(45, (0, 0, 1)), scale=3.0).matrix
    snapshot.sync()
    assert catalog.refresh()
    assert measured == [3]
    fresh = Catalog(snapshot, "both")
    order, other = np.argsort(catalog.ids, axis=None), np.argsort(fresh.ids, axis=None)
    for name in ("radius", "bulk", "image"):
        assert np.allclose(getattr(catalog, name).reshape(-1)[order], getattr(fresh, name).reshape(-1)[other])
    assert np.allclose(catalog.center.reshape(3, -1)[:, order], fresh.center.reshape(3, -1)[:, other], equal_nan=True)
    assert np.allclose(catalog.warp, fresh.warp)
    center, radius = catalog.center, catalog.radius
    far = np.sqrt(((center - catalog.block_center[:, :, None]) ** 2).sum(axis=0)) + radius
    assert not (far > catalog.block_radius[:, None]).any()
