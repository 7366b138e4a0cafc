"""The stage `hlod`: contract, presets, what is drawn, and what it remembers."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import scenegraph as sg
from scenegraph.meshes import hlod_of
from scenegraph.render.device import Device
from scenegraph.render.window import OffscreenWindow
from scenegraph.scenes.shapes import bumps, icosphere, vertex_normals
from scenegraph.testing import StageContract, box_at
from scenegraph_hlod import HlodCut, HlodRefinement
from scenegraph_hlod.measures import Measures
from scenegraph_hlod.stage import PRESETS
from scenegraph_hlod.walk import Rules, Walk

SIZE = (160, 120)


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SCENEGRAPH_CACHE_DIR", str(tmp_path / "cache"))


class TestContractWithoutQueries(StageContract):
    stages = (HlodRefinement(traversal="none"),)


@pytest.mark.gl
class TestContract(StageContract):
    stages = (HlodRefinement(), HlodRefinement(preset="SW-eps_q"))


def figure(seed: int, at: tuple[float, float, float], levels: int = 4) -> sg.Node:
    rng = np.random.default_rng(seed)
    points, faces = icosphere(levels)
    points = points * (1 + 0.1 * bumps(points, rng, waves=20, roughness=5.0))[:, None]
    mesh = sg.Mesh(points, faces, normals=vertex_normals(points, faces))
    return sg.Transform(sg.Geode(mesh, color=(0.8, 0.6, 0.4), name=f"figure {seed}"), translation=at)


@pytest.fixture(scope="module")
def snapshot(tmp_path_factory: pytest.TempPathFactory) -> sg.Snapshot:
    """Three bumpy balls one behind the other, and one beside them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SCENEGRAPH_CACHE_DIR", str(tmp_path_factory.mktemp("cache")))
        scene = sg.Scene(
            sg.Group(*(figure(i, (0.0, 2.5 * i, 0.0), 3) for i in range(3)), figure(3, (4.0, 1.0, 0.0), 3))
        )
        found = scene.snapshot()
        found.prepared("hlod_tree", lambda s: hlod_of(s, triangles=100))
        return found


def circle(count: int, *, reach: float = 7.0) -> list[sg.View]:
    return [
        sg.View(
            (reach * np.sin(a), -reach * np.cos(a), 1.5), (1, 1, 0), near=0.05, far=40, width=SIZE[0], height=SIZE[1]
        )
        for a in np.linspace(0, 0.6, count)
    ]


@pytest.fixture
def device() -> Iterator[Device]:
    with OffscreenWindow(*SIZE) as window:
        made = Device(window)
        yield made
        made.close()


def play(text: str, snapshot: sg.Snapshot, device: Device | None, views: list[sg.View]) -> list[sg.Frame]:
    with sg.Pipeline.parse(text).open(snapshot, device=device) as pipeline:
        return [pipeline.run(view) for view in views]


def test_presets_are_the_papers_configurations() -> None:
    for name, values in PRESETS.items():
        stage = HlodRefinement(preset=name)
        assert {k: getattr(stage, k) for k in values} == values
    with pytest.raises(sg.PipelineError, match="metric='eps' contradicts preset='SW-eps_q', which sets 'eps_q'"):
        HlodRefinement(preset="SW-eps_q", metric="eps")
    assert HlodRefinement(traversal="none").needs == ("hlod_tree",)
    assert HlodRefinement().needs == ("hlod_tree", "gl")


def test_without_queries_the_cut_is_fine_enough_everywhere_and_covers_what_is_in_view(snapshot: sg.Snapshot) -> None:
    for tau in (0.0, 0.5, 4.0, 1000.0):
        (frame,) = play(f"hlod(traversal='none', tau={tau})", snapshot, None, circle(1))
        cut = frame.get(HlodCut)
        tree = cut.tree
        assert (cut.errors[cut.nodes] <= tau).all()
        # no parent of a drawn node would have been enough
        above = tree.parent[cut.nodes]
        assert (cut.errors[above[above >= 0]] > tau).all()
        assert tree.leaves_of(cut.nodes).max() == 1
        assert frame.kept().all()
        assert frame.drawn_triangles() == int(tree.triangles[cut.nodes].sum())
    everything = snapshot.triangles[0].sum()
    assert frame.drawn_triangles() < everything


@pytest.mark.gl
@pytest.mark.parametrize("text", ["hlod", *(f"hlod(preset='{name}')" for name in PRESETS)])
def test_no_leaf_is_drawn_twice_and_nothing_visible_is_lost(text: str, snapshot: sg.Snapshot, device: Device) -> None:
    for frame in play(text, snapshot, device, circle(4)):
        cut = frame.get(HlodCut)
        assert cut.tree.leaves_of(cut.nodes).max(initial=0) == 1
        names = [snapshot.geodes[r].name for r in np.flatnonzero(frame.kept())]
        assert "figure 0" in names
        assert "figure 3" in names
        share = cut.share[cut.share == cut.share]
        assert ((share >= 0) & (share <= 1)).all()


@pytest.mark.gl
def test_in_a_still_view_coherent_and_waiting_traversals_draw_the_same(snapshot: sg.Snapshot, device: Device) -> None:
    """Where the metric is the error alone, what was drawn too much in the first frames is gone."""
    still = circle(1) * 6
    waiting = play("hlod(preset='SW-eps', tau=0.5)", snapshot, device, still)
    coherent = play("hlod(preset='CHLOD-eps', tau=0.5)", snapshot, device, still)
    waited, found = (set(f[-1].get(HlodCut).nodes.tolist()) for f in (waiting, coherent))
    # with the nodes of one chunk drawn together, a few more or fewer may be hidden
    assert len(waited ^ found) <= 0.1 * len(waited)


@pytest.mark.gl
def test_visibility_makes_the_cut_coarser_never_finer(snapshot: sg.Snapshot, device: Device) -> None:
    views = circle(4)
    for kind in ("SW", "CHLOD"):
        plain = play(f"hlod(preset='{kind}-eps', tau=1.5)", snapshot, device, views)
        seen = play(f"hlod(preset='{kind}-eps_q', tau=1.5)", snapshot, device, views)
        counts = np.array([[f.drawn_objects for f in frames] for frames in (plain, seen)])
        assert counts[1].sum() < counts[0].sum()


@pytest.mark.gl
def test_only_the_coherent_metric_refines_what_it_has_drawn(snapshot: sg.Snapshot, device: Device) -> None:
    views = circle(6)
    for name, may in (("CHLOD-eps", False), ("SW-eps", False), ("SW-eps_q", False), ("CHLOD-eps_q", True)):
        frames = play(f"hlod(preset='{name}', tau=0.3)", snapshot, device, views)
        rarn = sum(f.record.stages[0].counts["rarn"] for f in frames)
        assert may or rarn == 0
        assert frames[0].record.stages[0].counts["rarn"] == 0, "nothing is predicted in the first frame"


@pytest.mark.gl
def test_eye_inside_the_scene_keeps_what_is_around_it(snapshot: sg.Snapshot, device: Device) -> None:
    """Boxes around the eye and across the near plane are visible without being asked."""
    views = [sg.View((0, -0.5, 0), (0, 5, 0), near=0.01, far=40, width=SIZE[0], height=SIZE[1])] * 2
    for frame in play("hlod", snapshot, device, views):
        cut = frame.get(HlodCut)
        around = (np.abs(cut.tree.boxes[:3].T - frame.view.eye) < cut.tree.boxes[3:].T).all(axis=1)
        assert around[0]
        assert cut.visible[around & cut.visited].all()


@pytest.mark.gl
def test_rows_hidden_before_stay_hidden_and_others_are_not_covered(device: Device) -> None:
    wall = sg.Mesh.box((-6, -4, -4), (6, -3.9, 4), color=(1, 0, 0, 0.5))
    scene = sg.Scene(sg.Group(figure(0, (0, 0, 0), 2), figure(1, (0, 30, 0), 2), sg.Geode(wall, name="glass")))
    snapshot = scene.snapshot()
    view = sg.View((0, -10, 0), (0, 0, 0), near=0.1, far=20, width=SIZE[0], height=SIZE[1])
    (frame,) = play("frustum | hlod(traversal='none')", snapshot, None, [view])
    names = {snapshot.geodes[r].name for r in np.flatnonzero(frame.kept())}
    assert names == {"figure 0", "glass"}
    glass = next(r for r in range(3) if snapshot.geodes[r].name == "glass")
    assert frame.visible[glass]


@pytest.mark.gl
def test_scenes_that_have_moved_are_left_alone(device: Device) -> None:
    move = sg.Transform(box_at((0, 0, 0), name="box"))
    snapshot = sg.Scene().add(move, box_at((0, 5, 0))).snapshot()
    view = sg.View((0, -10, 0), (0, 0, 0), width=SIZE[0], height=SIZE[1])
    with sg.Pipeline.parse("hlod").open(snapshot, device=device) as pipeline:
        assert pipeline.run(view).standins
        move.matrix = np.eye(4) + np.eye(4, k=3)
        snapshot.sync()
        frame = pipeline.run(view)
        assert not frame.standins
        assert "moved" in str(frame.record.stages[0].skipped)


@pytest.mark.gl
def test_each_view_has_a_memory_of_its_own(snapshot: sg.Snapshot, device: Device) -> None:
    here, there = circle(2)
    with sg.Pipeline.parse("hlod(tau=0.3)").open(snapshot, device=device) as pipeline:
        alone = [pipeline.run(here, view_name="a") for _ in range(3)][-1]
    with sg.Pipeline.parse("hlod(tau=0.3)").open(snapshot, device=device) as pipeline:
        for _ in range(3):
            mixed = pipeline.run(here, view_name="a")
            pipeline.run(there, view_name="b")
    assert np.array_equal(alone.get(HlodCut).nodes, mixed.get(HlodCut).nodes)


@pytest.mark.gl
def test_within_nodes_the_coarsest_level_that_is_fine_enough_is_drawn(device: Device) -> None:
    snapshot = sg.Scene(sg.Group(figure(0, (0, 0, 0), 3), figure(1, (0, 2.5, 0), 3))).snapshot()
    snapshot.prepared("hlod_tree_levels", lambda s: hlod_of(s, triangles=400, levels=3))
    for text in ("hlod(within=True, traversal='none', tau=0.3)", "hlod(within=True, tau=0.3)"):
        frame = play(text, snapshot, device, circle(3))[-1]
        cut, (standin,) = frame.get(HlodCut), frame.standins
        tree = cut.tree
        level = np.argmax(tree.level_mesh[:, cut.nodes] == standin.chosen, axis=0)
        assert (tree.level_mesh[level, cut.nodes] == standin.chosen).all()
        assert level.max() > 0
        share = np.nan_to_num(cut.share[cut.nodes], nan=1.0)
        pixels = frame.view.error_pixels(tree.level_errors[level, cut.nodes], tree.boxes[:, cut.nodes]) * share
        assert (pixels[level > 0] <= 0.3 * (1 + 1e-9)).all()
        assert frame.drawn_triangles() < tree.triangles[cut.nodes].sum()


def test_boxes_are_colored_from_blue_to_red_by_correction(snapshot: sg.Snapshot) -> None:
    from scenegraph_hlod.overlays import HlodBoxes, box_edges, correction_color, correction_steps

    assert [correction_color(i) for i in (0, 3, 6)] == [(0, 0.05, 1), (1, 0.05, 1), (1, 0.05, 0)]
    (frame,) = play("hlod(traversal='none', tau=2)", snapshot, None, circle(1))
    cut = frame.get(HlodCut)
    (lines,) = HlodBoxes().lines(frame)
    assert lines.color == (0, 0.05, 1)
    assert len(lines.ends) == 12 * len(cut.nodes)
    assert np.allclose(np.ptp(lines.ends[:12].reshape(-1, 3), axis=0), 2 * cut.tree.boxes[3:, cut.nodes[0]])
    assert len(np.unique(np.sort(box_edges(np.array([[0.0, 0, 0, 1, 2, 3]]).T), axis=1), axis=0)) == 12
    cut.share[cut.nodes] = np.linspace(1, 0, len(cut.nodes))
    steps = correction_steps(cut)
    assert (steps[0], steps[-1]) == (0, 6)
    assert (np.diff(steps) >= 0).all()
    assert HlodBoxes().lines(sg.Frame(snapshot, circle(1)[0])) == []


@pytest.mark.gl
def test_trimming_takes_nothing_out_of_the_picture(snapshot: sg.Snapshot, device: Device) -> None:
    views = circle(6)
    whole = play("hlod(trim=False, tau=0.3)", snapshot, device, views)
    trimmed = play("hlod(tau=0.3)", snapshot, device, views)
    more = fewer = 0
    for a, b in zip(whole, trimmed, strict=True):
        assert set(b.get(HlodCut).nodes.tolist()) <= set(a.get(HlodCut).nodes.tolist())
        more, fewer = more + a.drawn_objects, fewer + b.drawn_objects
    assert fewer <= more


class Answers:
    """Who answers whatever a test says."""

    def __init__(self, samples: dict[int, int], default: int) -> None:
        self.samples, self.default = samples, default
        self.asked: list[int] = []
        self.drawn: list[int] = []

    def draw(self, nodes: np.ndarray) -> None:
        self.drawn += nodes.tolist()

    def issue(self, nodes: np.ndarray) -> np.ndarray:
        self.asked += nodes.tolist()
        return nodes

    def result(self, ticket: np.ndarray) -> np.ndarray:
        return np.array([self.samples.get(int(n), self.default) for n in ticket], np.int64)


def walked(snapshot: sg.Snapshot, answers: Answers, before: HlodCut | None, **changes: object) -> tuple[Walk, HlodCut]:
    tree = snapshot.prepared("hlod_tree", hlod_of)
    frame = sg.Frame(snapshot, circle(1)[0])
    settings = {
        "threshold": 0.3,
        "by_visibility": True,
        "predictor": "queue",
        "waits": False,
        "chunk": 4,
        "lag": 1,
        "trims": False,
    }
    walk = Walk(Measures(tree, frame, "projected"), answers, Rules(**(settings | changes)), before)
    return walk, walk.run(0)


def test_algorithm_refines_in_the_first_frame_by_what_is_measured(snapshot: sg.Snapshot) -> None:
    everything, nothing = Answers({}, 10**9), Answers({}, 0)
    walk, cut = walked(snapshot, everything, None)
    assert (walk.rarn, walk.trimmed) == (0, 0)
    assert everything.drawn
    assert sorted(everything.drawn) == cut.nodes.tolist()
    assert sorted(everything.asked) == np.flatnonzero(cut.visited).tolist()
    assert (cut.tree.leaves_of(cut.nodes) <= 1).all()
    assert cut.visible[cut.nodes].all()
    assert cut.visible[0]
    _, none = walked(snapshot, nothing, None)
    assert nothing.asked == [0]
    assert not len(none.nodes)


def test_what_was_visible_is_drawn_without_waiting_and_asked_only_where_refinement_stops(snapshot: sg.Snapshot) -> None:
    _, first = walked(snapshot, Answers({}, 10**9), None, by_visibility=False)
    again = Answers({}, 10**9)
    _, second = walked(snapshot, again, first, by_visibility=False)
    assert np.array_equal(first.nodes, second.nodes)
    assert sorted(again.asked) == second.nodes.tolist()
    assert sorted(again.drawn) == second.nodes.tolist()
    # hidden now: still drawn in this frame, unless it is trimmed, and no longer visible for the next
    gone = {int(n): 0 for n in second.nodes[:3]}
    _, third = walked(snapshot, Answers(gone, 10**9), second, by_visibility=False)
    assert np.array_equal(third.nodes, second.nodes)
    assert not third.visible[second.nodes[:3]].any()
    walk, trimmed = walked(snapshot, Answers(gone, 10**9), second, by_visibility=False, trims=True)
    assert walk.trimmed == 3
    assert np.array_equal(trimmed.nodes, second.nodes[3:])


def test_predictions_that_were_too_coarse_are_counted_and_put_right(snapshot: sg.Snapshot) -> None:
    """The temporal predictor says what was measured last; all of a sudden everything is in full view."""
    _, dim = walked(snapshot, Answers({}, 1), None, predictor="temporal")
    bright = Answers({}, 10**9)
    walk, cut = walked(snapshot, bright, dim, predictor="temporal")
    assert walk.rarn > 0
    assert len(cut.nodes) > len(dim.nodes)
    assert (cut.tree.leaves_of(cut.nodes) <= 1).all()
    errors = walk.measures.errors
    assert ((errors[cut.nodes] <= 0.3) | cut.tree.is_leaf[cut.nodes]).all()
    # and the frame after predicts it right
    walk, _ = walked(snapshot, Answers({}, 10**9), cut, predictor="temporal")
    assert walk.rarn == 0


def test_the_first_frame_and_late_places_in_the_queue_have_a_defined_prediction(snapshot: sg.Snapshot) -> None:
    walk, cut = walked(snapshot, Answers({}, 10**9), None)
    nodes = np.flatnonzero(walk.measures.counts)[:5]
    assert (walk._predicted(nodes) == 1).all(), "S = 0 in the first frame"
    walk.last_scheduled = 2
    walk.place[nodes] = [0, 1, 2, 3, 50]
    assert walk._predicted(nodes).tolist() == [1, 0.5, 0, 0, 0]
    assert cut.scheduled == walk.scheduled > 0


def test_the_place_in_the_queue_is_read_in_two_ways(snapshot: sg.Snapshot) -> None:
    places = {}
    for predictor in ("queue", "rank"):
        walk, _ = walked(snapshot, Answers({}, 0), None, predictor=predictor)
        near_first = np.argsort(walk.measures.distance, kind="stable")
        walk.scheduled, walk._queue = 100, near_first[[2, 6, 8]]
        new = near_first[[9, 7, 0]]
        walk._schedule(new)
        places[predictor] = walk.place[new].tolist()
        assert walk.scheduled == 103
    # what was scheduled before it; and those that wait before it, and came with it
    assert places == {"queue": [102, 101, 100], "rank": [5, 3, 0]}


def test_visibility_is_clamped_and_known_where_nothing_can_be_asked(snapshot: sg.Snapshot) -> None:
    tree = snapshot.prepared("hlod_tree", hlod_of)
    inside = sg.Frame(snapshot, sg.View((0, 0, 0), (0, 5, 0), near=0.01, far=40, width=SIZE[0], height=SIZE[1]))
    for alpha in ("projected", "cube"):
        measures = Measures(tree, inside, alpha)
        assert not measures.counts[0], "the eye is in the root's box"
        assert measures.visibility(np.array([0, 0]), np.array([1, 0])).tolist() == [1.0, 0.0]
        nodes = np.flatnonzero(measures.counts)
        for samples in (1, 10**9):
            share = measures.visibility(nodes, np.full(len(nodes), samples))
            assert ((share > 0) & (share <= 1)).all()
    far = sg.Frame(snapshot, sg.View((0, -1e5, 0), (0, 0, 0), far=1e6, width=SIZE[0], height=SIZE[1]))
    measures = Measures(tree, far, "projected")
    assert (measures.visibility(np.arange(len(tree)), np.ones(len(tree), np.int64)) == 1).all(), "below a pixel"
