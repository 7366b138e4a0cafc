"""Shadow frusta in a city of boxes, each building its own occluder: drawn objects, milliseconds, and false hides.

The boxes and cameras are those of `shared/peers/workload.py`, beside the checkout, so that the numbers stand beside
OpenSceneGraph's planar occluders and Intel's masked occlusion culling in `shared/anchors/peers.md`. Pipelines take
turns frame by frame; the best of several repeats of each frame is averaged, because the machine does other things
too.
"""

from __future__ import annotations

import importlib.util
import sys
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import scenegraph as sg
from bench_tools import show
from scenegraph_shadow import stage as shadow_stage
from scenegraph_shadow import verdict as shadow_verdict
from scenegraph_shadow.catalog import Catalog

WORKLOAD = Path(__file__).parents[3] / "shared" / "peers" / "workload.py"
REPEATS = 15
#: OpenSceneGraph's planar occluders on the same boxes, drawn objects: K = 15, 50, 200.
OSG = {10_000: (218, 117, 89), 100_000: (1911, 760, 417)}

RANKINGS = ("area_angle", "printed", "solid_angle", "marginal")
SETTINGS = (
    *(f"active={k}, ranking={ranking}" for k in (15, 30, 50) for ranking in RANKINGS),
    "active=15, cap=depth",
    "active=15, reselect=4",
    "active=15, ranking=marginal, reselect=4",
    "active=200",
)


def workload() -> Any:
    """The module that makes the boxes."""
    if not WORKLOAD.is_file():
        pytest.skip(f"{WORKLOAD} is not there")
    spec = importlib.util.spec_from_file_location("workload", WORKLOAD)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.dont_write_bytecode, before = True, sys.dont_write_bytecode
    try:
        spec.loader.exec_module(module)
    finally:
        sys.dont_write_bytecode = before
    return module


def city(n: int) -> tuple[sg.Snapshot, list[sg.View]]:
    """The boxes, each in a group of its own with itself as occluder, and the 64 cameras along the path."""
    low, high, eyes, targets = workload().city(n)
    low, high = low.astype(np.float32).astype(float), high.astype(np.float32).astype(float)
    root = sg.Group(name="city")
    for a, b in zip(low, high, strict=True):
        root.add(sg.Group(sg.Geode(sg.Mesh.box(a, b)), sg.Occluder.box(a, b)))
    return sg.Scene(root).snapshot(), [sg.View(e, t) for e, t in zip(eyes, targets, strict=True)]


@pytest.mark.gl
@pytest.mark.parametrize("n", [10_000, 100_000])
def test_city_of_the_peers(benchmark: Any, n: int) -> None:
    """Every ranking at 15, 30 and 50 active occluders; truth from the item buffer with 4 x 4 samples a pixel."""
    from scenegraph.render.item_buffer import ItemBuffer

    snapshot, views = city(n)
    with closing(ItemBuffer(snapshot)) as buffer:
        truth = [buffer.render(view, supersample=4).visible for view in views]
    texts = ["frustum", *(f"frustum | shadow({s})" for s in SETTINGS)]
    pipelines = [sg.Pipeline.parse(text).open(snapshot) for text in texts]
    best = np.full((len(texts), len(views)), np.inf)
    shadow, drawn, lost = best.copy(), np.zeros(best.shape), np.zeros(len(texts), int)
    for repeat in range(REPEATS):
        for i, view in enumerate(views):
            for p, pipeline in enumerate(pipelines):
                # a view computes its axes once: a new one each time, as in life
                frame = pipeline.run(sg.View(view.eye, view.target))
                best[p, i] = min(best[p, i], frame.record.cull_ms)
                shadow[p, i] = min(shadow[p, i], frame.record.stages[-1].ms)
                drawn[p, i] = frame.visible_count
                if repeat == 0:
                    lost[p] += int((truth[i] & ~frame.visible).sum())
    seen = np.mean([t.sum() for t in truth])
    show(
        f"city of {n} boxes, 64 street views, {seen:.1f} visible; OSG draws {OSG[n]} with 15, 50, 200 planar occluders",
        [
            (text, f"{d.mean():8.1f} drawn {b.mean():7.3f} ms, shadow {s.mean():6.3f} ms, {m} false hides")
            for text, d, b, s, m in zip(texts, drawn, best, shadow, lost, strict=True)
        ],
    )
    assert not lost.any()
    assert drawn[1].mean() < OSG[n][0]
    benchmark.extra_info["drawn"], benchmark.extra_info["cull_ms"] = float(drawn[1].mean()), float(best[1].mean())
    benchmark.pedantic(pipelines[1].run, args=(views[0],), rounds=20)


def test_flat_against_hierarchical(benchmark: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Identical results; the crossover sets `FLAT_LIMIT`, and how many occluders go first sets `CHUNKS`."""
    rows = []
    for n in (1_000, 10_000, 100_000):
        snapshot, views = city(n)
        pipeline = sg.Pipeline.parse("frustum | shadow").open(snapshot)
        times, results, candidates = [], [], 0.0
        for limit, chunks in ((10**9, ()), (10**9, (4,)), (10**9, (4, 8)), (0, (4,))):
            monkeypatch.setattr(shadow_stage, "FLAT_LIMIT", limit)
            monkeypatch.setattr(shadow_verdict, "CHUNKS", chunks)
            best = np.full(len(views), np.inf)
            for _ in range(7):
                for i, view in enumerate(views):
                    record = pipeline.run(view).record.stages
                    best[i] = min(best[i], record[1].ms)
                    candidates = snapshot.n - record[0].hidden
            times.append(best.mean())
            results.append([pipeline.run(view).visible for view in views])
        for other in results[1:]:
            assert all(np.array_equal(a, b) for a, b in zip(results[0], other, strict=True))
        rows.append(
            (
                f"{n:7d} boxes, about {candidates} in the view",
                "flat {:6.3f} ms, first 4 {:6.3f} ms, first 4 and 8 {:6.3f} ms, tree {:6.3f} ms".format(*times),
            )
        )
    show("stage `shadow` alone", rows)
    benchmark.pedantic(pipeline.run, args=(views[0],), rounds=5)


def test_moving_occluders(benchmark: Any) -> None:
    """What the stage pays when one in a hundred occluders moves every frame."""
    unit, place = sg.Mesh.box((-5, -5, 0), (5, 5, 10)), np.random.default_rng(3).uniform(0, 2000, (10_000, 2))
    root = sg.Group()
    for x, y in place:
        root.add(sg.Transform(sg.Geode(unit), sg.Occluder.box((-5, -5, 0), (5, 5, 10)), translation=(x, y, 0)))
    snapshot = sg.Scene(root).snapshot()
    catalog = Catalog(snapshot, "both")
    moving = [node for node in root.children[::100] if isinstance(node, sg.Transform)]
    lift = np.zeros((4, 4))
    lift[2, 3] = 0.1
    sync, measure = [], []
    for _ in range(15):
        for node in moving:
            node.matrix = node.matrix + lift
        start = time.perf_counter()
        snapshot.sync()
        middle = time.perf_counter()
        catalog.refresh()
        sync.append(middle - start)
        measure.append(time.perf_counter() - middle)
    rows = [
        ("snapshot.sync()", f"{min(sync) * 1e3:7.3f} ms"),
        ("measuring the moved occluders", f"{min(measure) * 1e3:7.3f} ms"),
    ]
    show("10 000 occluders, 100 of them moved", rows)
    benchmark.pedantic(catalog.refresh, rounds=5)
