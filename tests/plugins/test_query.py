"""The stage `query`: nothing visible is hidden in any order of asking, and all orders end on the same."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from typing import Any, ClassVar

import numpy as np
import pytest

import scenegraph as sg
import scenegraph_frustum
import scenegraph_query
from drawn_scenes import FAR, town, town_views
from scenegraph.render.device import Device
from scenegraph.render.item_buffer import ItemBuffer
from scenegraph.render.window import OffscreenWindow
from scenegraph.testing import StageContract, grid_scene, random_views, wall_scene, wall_views
from scenegraph_query import Query, QueryHistory
from scenegraph_query.coherent import multiqueries
from scenegraph_query.history import row_phases

pytestmark = pytest.mark.gl
pytest.importorskip("moderngl")

KNOWN = sg.Registry(discover=False)
KNOWN.add(scenegraph_frustum)
KNOWN.add(scenegraph_query)

#: Every order of asking, each in the ways that change what is asked.
WAYS: list[dict[str, Any]] = [
    {},
    {"period": 1},
    {"traversal": "stop_and_wait"},
    {"traversal": "stop_and_wait", "retest": False},
    {"traversal": "coherent"},
    {"traversal": "coherent", "period": 1, "batch": 3, "retest": False},
    {"traversal": "coherent", "schedule": "2004"},
    {"traversal": "coherent", "schedule": "2004", "retest": False},
    {"traversal": "coherent", "latency": 0},
]


class TestQuery(StageContract):
    stages: ClassVar[Sequence[sg.Stage]] = [
        Query(least=1),
        Query(least=1, traversal="stop_and_wait"),
        Query(least=1, traversal="coherent"),
        Query(least=1, traversal="coherent", schedule="2004", retest=False),
        Query(least=1, threshold=10),
    ]
    # as many samples as the stage asks with: what a finer picture shows between them is not promised
    supersample = 1


class TestSupersampled(StageContract):
    stages: ClassVar[Sequence[sg.Stage]] = [Query(least=1, supersample=4), Query(least=1, supersample=3)]
    supersample = 4

    def pytest_generate_tests(self, metafunc: pytest.Metafunc) -> None:
        if "stage" in metafunc.fixturenames:
            metafunc.parametrize("stage", self.stages[:1], ids=["supersample=4"])

    # frame buffers of 30720 x 17280 do not exist: the stage says so, and the small ones are the same test
    test_extreme_views = None  # type: ignore[assignment]


@contextmanager
def opened(snapshot: sg.Snapshot, *stages: sg.Stage, size: tuple[int, int] = (160, 120)) -> Iterator[sg.Pipeline]:
    pipeline = sg.Pipeline(stages, preparations=KNOWN)
    with OffscreenWindow(*size) as window, closing(Device(window)) as device, closing(pipeline):
        yield pipeline.open(snapshot, device=device)


def still_and_moving(size: int = 3) -> tuple[sg.Scene, list[sg.View]]:
    """A dense town and a walk through it, with a jump in the middle."""
    views = [
        sg.View(
            (6 + 0.2 * i, -95 + 4 * i, 2), (6.5, 60 * (-1) ** (i // 9), 4), near=0.1, far=1000, width=320, height=180
        )
        for i in range(18)
    ]
    return town(), views


@pytest.mark.parametrize("way", WAYS, ids=str)
def test_nothing_visible_is_missing_while_the_camera_moves(way: dict[str, Any]) -> None:
    scene, views = still_and_moving()
    snapshot = scene.snapshot()
    hidden = 0
    with closing(ItemBuffer(snapshot)) as truth, opened(snapshot, Query(least=1, **way)) as pipeline:
        for view in views:
            frame = pipeline.run(view)
            lost = truth.render(view).visible & ~frame.visible
            assert not lost.any(), snapshot.names(np.flatnonzero(lost))
            hidden += snapshot.n - frame.record.visible
    assert hidden > 0.7 * len(views) * snapshot.n


@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.0), FAR], ids=["here", "far"])
@pytest.mark.parametrize("view_name", town_views())
def test_all_orders_of_asking_end_on_the_same(view_name: str, offset: tuple[float, float, float]) -> None:
    snapshot, view = town(offset).snapshot(), town_views(offset)[view_name].resized(320, 180)
    with closing(ItemBuffer(snapshot)) as truth:
        exact = truth.render(view).visible
    ends = []
    for way in WAYS:
        if way.get("retest", True):
            with opened(snapshot, Query(least=1, **way)) as pipeline:
                # the first frame knows nothing of the last, the second does, the others ask again in turn
                ends += [pipeline.run(view).visible for _ in range(7)]
    for visible in ends:
        assert not (exact & ~visible).any()
        assert np.array_equal(visible, ends[0])


def test_without_asking_again_the_order_decides() -> None:
    snapshot, view = town().snapshot(), town_views()["above"].resized(320, 180)
    kept = {}
    for retest in (False, True):
        with opened(snapshot, Query(least=1, traversal="stop_and_wait", retest=retest)) as pipeline:
            kept[retest] = pipeline.run(view).visible
    assert (kept[False] | kept[True] == kept[False]).all()


def test_a_threshold_is_a_bound() -> None:
    snapshot, view = town(translucent=False).snapshot(), town_views()["above"].resized(320, 180)
    with closing(ItemBuffer(snapshot)) as truth:
        pixels = truth.render(view).pixels
    for traversal in ("batched", "coherent", "stop_and_wait"):
        stage = Query(least=1, threshold=25, traversal=traversal)
        assert stage.guarantee is sg.Guarantee.AGGRESSIVE
        with opened(snapshot, stage) as pipeline:
            for _ in range(3):
                frame = pipeline.run(view)
                assert pixels[~frame.visible].max() <= 25
        assert (pixels[~frame.visible] > 0).any()


def test_what_was_visible_is_asked_in_turn() -> None:
    snapshot, view = town().snapshot(), town_views()["above"].resized(320, 180)
    with opened(snapshot, Query(least=1, period=4)) as pipeline:
        frames = [pipeline.run(view) for _ in range(9)]
    queries = [frame.record.stages[0].queries for frame in frames]
    assert max(queries[1:]) < queries[0]
    oldest = [frame.record.stages[0].counts["oldest_answer"] for frame in frames]
    assert oldest[0] == 0
    assert max(oldest) == 3
    for frame in frames:
        ages = frame.get(QueryHistory).ages()
        assert (ages[frame.visible & ~snapshot.protected] >= 0).all()
        assert (ages[~frame.visible] == -1).all()


def test_phases_are_even_and_always_the_same() -> None:
    phases = row_phases(10_000, 5)
    assert np.array_equal(phases[:50], row_phases(50, 5))
    assert np.bincount(phases, minlength=5).min() > 1800
    assert phases[:8].tolist() == [0, 0, 4, 4, 2, 0, 3, 0]


@pytest.mark.parametrize("way", [{}, {"traversal": "coherent"}], ids=str)
def test_a_run_replays(way: dict[str, Any]) -> None:
    scene, views = still_and_moving()
    runs = []
    for _ in range(2):
        with opened(scene.snapshot(), Query(least=1, **way)) as pipeline:
            runs.append([pipeline.run(view).visible for view in views])
    assert all(np.array_equal(a, b) for a, b in zip(*runs, strict=True))


def test_history_does_not_reach_beyond_the_frustum() -> None:
    snapshot = grid_scene(6).snapshot()
    here = sg.View((0, -20, 0), (0, 0, 0), width=160, height=120)
    away = sg.View((0, -20, 0), (0, -40, 0), width=160, height=120)
    with opened(snapshot, Query(least=1)) as pipeline:
        seen = pipeline.run(here).get(QueryHistory)
        assert seen.visible.any()
        assert (seen.hidden_for > 0).any()
        nothing = pipeline.run(away).get(QueryHistory)
        assert not nothing.visible.any()
        assert not nothing.hidden_for.any()
        assert (nothing.asked_at == -1).all()
        again = pipeline.run(here)
        assert again.record.stages[0].counts["assumed"] == 0
        assert np.array_equal(again.visible, seen.visible)


def test_views_have_histories_of_their_own() -> None:
    scene, views = still_and_moving()
    snapshot = scene.snapshot()
    with closing(ItemBuffer(snapshot)) as truth, opened(snapshot, Query(least=1)) as pipeline:
        for _ in range(3):
            for frame, view in zip(pipeline.run_views(views[::6]), views[::6], strict=True):
                assert not (truth.render(view).visible & ~frame.visible).any()
        assert all(f.record.stages[0].counts["assumed"] > 0 for f in pipeline.run_views(views[::6]))


def test_moved_and_added_drawables_are_found() -> None:
    scene, view = wall_scene(), wall_views()[0]
    snapshot = scene.snapshot()
    with opened(snapshot, Query(least=1)) as pipeline:
        pipeline.run(view)
        behind = next(g for g in snapshot.geodes if g.name == "behind 0 0")
        assert not pipeline.run(view).visible[snapshot.geodes.index(behind)]
        place = scene.root.children[0]
        wall = next(child for child in place.children if child.name == "wall group")  # type: ignore[attr-defined]
        place.remove(wall)  # type: ignore[attr-defined]
        snapshot.sync()
        assert pipeline.run(view).visible[snapshot.geodes.index(behind)]


def test_coarsened_and_translucent_drawables_hide_nothing() -> None:
    wall, box = sg.Mesh.box((-5, 0, -5), (5, 1, 5)), sg.Mesh.box((-1, 5, -1), (1, 6, 1))
    view = sg.View((0, -10, 0), (0, 0, 0), width=160, height=120)

    class Coarsen(sg.Stage):
        """Coarsens all."""

        name = "coarsen_for_tests"
        writes = ("level",)

        def run(self, frame: sg.Frame) -> None:
            frame.coarsen(np.ones(frame.snapshot.n, bool), 1)

    solid = sg.Scene(sg.Group(sg.Geode(wall), sg.Geode(box))).snapshot()
    glass = sg.Scene(sg.Group(sg.Geode(wall, color=(1, 1, 1, 0.5)), sg.Geode(box))).snapshot()
    levels = sg.Scene(sg.Group(sg.Lod(wall, box, errors=(0, 1)), sg.Geode(box))).snapshot()
    for way in WAYS:
        stage = Query(least=1, **way)
        kept = []
        for snapshot, stages in ((solid, [stage]), (glass, [stage]), (levels, [Coarsen(), stage])):
            with opened(snapshot, *stages) as pipeline:
                kept.append([int(pipeline.run(view).visible.sum()) for _ in range(2)])
        # what is asked about together in the first frame is asked before anything is drawn
        assert [both[1] for both in kept] == [1, 2, 2]


def test_few_candidates_and_huge_buffers_are_skipped() -> None:
    snapshot = wall_scene().snapshot()
    with opened(snapshot, Query()) as pipeline:
        assert pipeline.run(wall_views()[0]).record.stages[0].skipped == f"only {snapshot.n} candidates left"
    with opened(snapshot, Query(least=1, supersample=8)) as pipeline:
        frame = pipeline.run(wall_views(width=7680, height=4320)[0])
        assert frame.record.stages[0].skipped == "a query buffer of 61440x34560 samples is too large for this OpenGL"
        assert frame.visible.all()


# -- what can go wrong ------------------------------------------------------------------------------------------------


class Liar:
    """Query objects that answer late, never, or with garbage."""

    def __init__(self, real: Any, fault: str) -> None:
        self.real, self.fault, self.polls = real, fault, 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self.real, name)

    def is_available(self, name: int) -> bool:
        self.polls += 1
        return self.fault != "never" and (self.fault != "late" or self.polls % 4 == 0)

    def value(self, name: int) -> Any:
        right = self.real.value(name)
        return {"negative": -right - 1, "huge": 2**31, "not a number": float("nan"), "text": "x"}.get(self.fault, right)


@pytest.mark.parametrize("fault", ["late", "never", "negative", "huge", "not a number", "text"])
@pytest.mark.parametrize("traversal", ["stop_and_wait", "coherent"])
def test_faulty_query_objects_lose_nothing(traversal: str, fault: str) -> None:
    scene, views = still_and_moving()
    snapshot = scene.snapshot()
    with closing(ItemBuffer(snapshot)) as truth, opened(snapshot, Query(least=1, traversal=traversal)) as pipeline:
        pipeline.run(views[0])
        queries = pipeline._device.queries
        queries.objects, queries.patience = Liar(queries.objects, fault), 0.0 if fault == "never" else 1.0
        for view in views[1::3]:
            frame = pipeline.run(view)
            assert not (truth.render(view).visible & ~frame.visible).any()
            assert (frame.record.stages[0].counts["distrusted"] > 0) == (fault != "late")
            if fault == "late":
                assert frame.record.visible < snapshot.n / 2


@pytest.mark.parametrize(
    "answer",
    [lambda k: np.zeros(k, np.uint32), lambda k: np.full(k, -1), lambda k: np.full(k, np.nan), lambda k: np.zeros(3)],
    ids=["zeros", "negative", "not numbers", "wrong length"],
)
def test_faulty_batches_lose_nothing(answer: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, views = still_and_moving()
    snapshot = scene.snapshot()
    with closing(ItemBuffer(snapshot)) as truth, opened(snapshot, Query(least=1)) as pipeline:
        pipeline.run(views[0])
        queries = pipeline._device.queries
        monkeypatch.setattr(queries, "read_counts", lambda corners, *_: answer(len(corners)))
        for view in views[1::4]:
            frame = pipeline.run(view)
            assert not (truth.render(view).visible & ~frame.visible).any()
            assert frame.record.stages[0].counts["distrusted"] > 0


def test_without_shader_storage_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Device, "version_code", 330)
    snapshot, view = town().snapshot(), town_views()["above"].resized(320, 180)
    with opened(snapshot, Query(least=1)) as pipeline:
        one_by_one = pipeline.run(view)
    monkeypatch.undo()
    assert one_by_one.record.stages[0].counts["one_by_one"] == 1
    with opened(snapshot, Query(least=1)) as pipeline:
        frame = pipeline.run(view)
    assert frame.record.stages[0].counts["one_by_one"] == 0
    assert np.array_equal(frame.visible, one_by_one.visible)


def test_multiqueries_join_what_has_been_hidden_for_long() -> None:
    assert multiqueries(np.zeros(0)).tolist() == [0]
    assert multiqueries(np.array([0.99] * 4)).tolist() == [0, 4]
    assert multiqueries(np.array([0.3] * 3)).tolist() == [0, 1, 2, 3]
    first = multiqueries(np.array([0.99] * 30 + [0.4] * 2))
    assert first[0] == 0
    assert first[-1] == 32
    assert (np.diff(first) >= 1).all()
    assert np.diff(first)[0] > 4
    assert np.diff(first)[-2:].tolist() == [1, 1]


def test_random_views_of_a_grid() -> None:
    snapshot, views = grid_scene(8).snapshot(), random_views(np.random.default_rng(5), 10, 10.0)
    with closing(ItemBuffer(snapshot)) as truth:
        exact = [truth.render(view).visible for view in views]
    for way in WAYS:
        with opened(snapshot, Query(least=1, **way)) as pipeline:
            for view, visible in zip(views, exact, strict=True):
                assert not (visible & ~pipeline.run(view).visible).any()


def algorithms_1_to_4(device: Device, snapshot: sg.Snapshot, view: sg.View, was: np.ndarray, latency: int) -> list[int]:
    """The numbers of nodes, and of rows after them, in the order in which CHC gets answers; written down naively."""
    tree, m = snapshot.tree, len(snapshot.tree)
    boxes = np.concatenate([tree.boxes, snapshot.boxes], axis=1)
    planes = view.planes()

    def children(node: int) -> list[int]:
        below = [*range(tree.child_first[node], tree.child_end[node])]
        return below or [m + row for row in range(tree.first[node], tree.end[node])]

    def was_visible(node: int) -> bool:
        return bool(was[node - m]) if node >= m else bool(was[tree.first[node] : tree.end[node]].any())

    def inside(node: int) -> bool:
        if node < m:
            return any(inside(child) for child in children(node))
        low = planes[:, :3] @ boxes[:3, node] + np.abs(planes[:, :3]) @ boxes[3:, node] + planes[:, 3]
        return bool((low >= 0).all())

    def distance(node: int) -> float:
        return float(np.linalg.norm(np.maximum(np.abs(boxes[:3, node] - view.eye) - boxes[3:, node], 0)))

    answers: list[int] = []
    waiting: list[tuple[int, Any, int]] = []
    ahead = [(0.0, 0)]
    turn = 0
    with device.guard():
        target = device.depth_target(view.width, view.height)
        target.clear()

        def traverse(node: int) -> None:
            if node >= m:
                device.draw_depth(target, view, snapshot, np.array([node - m]), clear=False)
            else:
                ahead.extend((distance(child), child) for child in children(node))

        while ahead or waiting:
            while waiting and (not ahead or turn - waiting[0][2] >= latency):
                node, ticket, _ = waiting.pop(0)
                answers.append(node)
                if device.queries.result(ticket)[0] > 0 and not was_visible(node):
                    traverse(node)
            if ahead:
                ahead.sort()
                _, node = ahead.pop(0)
                if not inside(node):
                    continue
                turn += 1
                if not was_visible(node) or node >= m:
                    ticket = device.queries.issue(view, boxes[:, node : node + 1], target)
                    waiting.append((node, ticket, turn))
                if was_visible(node):
                    traverse(node)
    return answers


@pytest.mark.parametrize("latency", [1, 8])
def test_chc_asks_what_the_algorithms_ask(latency: int) -> None:
    snapshot, (first, *_, last) = grid_scene(6).snapshot(), wall_views()
    boxes = np.concatenate([snapshot.tree.boxes, snapshot.boxes], axis=1)
    stage = Query(least=1, traversal="coherent", schedule="2004", retest=False, latency=latency, margin=0.0)
    with opened(snapshot, stage) as pipeline:
        was = np.zeros(snapshot.n, bool)
        for view in (first, first, last):
            history = pipeline.run(view).get(QueryHistory)
            expected = algorithms_1_to_4(pipeline._device, snapshot, view, was, latency)
            assert np.array_equal(history.asked_boxes, boxes[:, expected])
            was = history.visible
    assert len(expected) > 50
