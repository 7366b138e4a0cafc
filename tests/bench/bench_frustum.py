"""Frustum culling: nanoseconds per box, flat against hierarchical, and beside VTK, OpenSceneGraph and Panda3D.

Boxes as in a city of lots of 20 m with streets between them; the eye walks the streets. Each table is measured in one
run, the methods taking turns; the best of several repeats is shown, because the machine does other things too.
"""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import scenegraph as sg
from bench_tools import show
from scenegraph import traversal
from scenegraph.kernels.boxes import box_outside
from scenegraph_frustum import Frustum

PEERS = Path(__file__).parents[3] / "shared" / "peers"


def city_boxes(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest corners (n, 3) of buildings on a square of lots."""
    rng = np.random.default_rng(7)
    side = int(np.ceil(np.sqrt(n)))
    lot = np.stack(np.divmod(np.arange(n), side), axis=1) * 20.0
    size = rng.uniform(8, 16, (n, 2))
    low = lot + 10 - size / 2
    height = np.clip(rng.lognormal(np.log(20.0), 0.65, n), 6, 120)
    return np.column_stack([low, np.zeros(n)]), np.column_stack([low + size, height])


def city(n: int) -> sg.Snapshot:
    """One box drawable a building, all below one flat group: the hierarchy is the host's own."""
    unit = sg.Mesh.box((0, 0, 0), (1, 1, 1))
    low, high = city_boxes(n)
    root = sg.Group(name="city")
    for a, b in zip(low, high, strict=True):
        root.add(sg.Transform(sg.Geode(unit), translation=a, scale=b - a))
    return sg.Scene(root).snapshot()


def street_views(n: int, count: int = 16) -> list[sg.View]:
    """Eyes in the streets at the middle of the city, looking around."""
    middle = round(np.sqrt(n) / 2) * 20.0
    turns = 2 * np.pi * np.arange(count) / count + 0.1
    return [
        sg.View((middle + 20 * i, middle, 1.7), (middle + 20 * i + np.cos(a), middle + np.sin(a), 1.7))
        for i, a in enumerate(turns)
    ]


def best_ms(work: Callable[[sg.View], Any], views: list[sg.View], repeats: int = 7) -> float:
    """Mean over views of the best time of each."""
    best = np.full(len(views), np.inf)
    for _ in range(repeats):
        for i, view in enumerate(views):
            start = time.perf_counter()
            work(view)
            best[i] = min(best[i], time.perf_counter() - start)
    return float(best.mean() * 1e3)


@pytest.mark.parametrize("n", [1_000, 10_000, 100_000])
def test_flat_test_per_box(benchmark: Any, n: int) -> None:
    snapshot, views = city(n), street_views(n)
    planes = [v.planes(snapshot.origin) for v in views]
    kernel = best_ms(lambda v: box_outside(snapshot.packed, v, radius=snapshot.radius), planes)  # type: ignore[arg-type]
    pipeline = sg.Pipeline([Frustum()]).open(snapshot)
    frame = best_ms(pipeline.run, views)
    kept = np.mean([pipeline.run(v).visible_count for v in views])
    show(
        f"{n} boxes, {kept:.0f} kept",
        [
            ("six planes, all boxes", f"{kernel:8.3f} ms  {kernel * 1e6 / n:6.2f} ns/box"),
            ("whole frame of `frustum`", f"{frame:8.3f} ms  {frame * 1e6 / n:6.2f} ns/box"),
        ],
    )
    benchmark.extra_info["ns_per_box"] = kernel * 1e6 / n
    benchmark.pedantic(lambda: box_outside(snapshot.packed, planes[0], radius=snapshot.radius), rounds=20)


def test_flat_against_hierarchical_up_to_a_million(benchmark: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Identical results; the crossover sets `traversal.FLAT_LIMIT`."""
    rows = []
    for n in (10_000, 30_000, 100_000, 300_000, 1_000_000):
        snapshot, views = city(n), street_views(n, 8)
        pipeline = sg.Pipeline([Frustum()]).open(snapshot)
        times, results = [], []
        for limit in (1 << 60, 0):
            monkeypatch.setattr(traversal, "FLAT_LIMIT", limit)
            times.append(best_ms(pipeline.run, views, 5))
            results.append([pipeline.run(v).visible for v in views])
        assert all(np.array_equal(a, b) for a, b in zip(*results, strict=True))
        kept = np.mean([r.sum() for r in results[0]])
        rows.append((f"{n:9d} boxes", f"flat {times[0]:7.3f} ms   tree {times[1]:7.3f} ms   kept {kept:8.0f}"))
    show("whole frame of `frustum`", rows)
    benchmark.pedantic(pipeline.run, args=(views[0],), rounds=5)


def test_sync_after_moving_one_in_a_hundred(benchmark: Any) -> None:
    snapshot = city(100_000)
    moving = list(snapshot.scene.root.children[::100])
    up = np.zeros((4, 4))
    up[2, 3] = 1.0

    def move() -> None:
        for node in moving:
            node.matrix = node.matrix + up  # type: ignore[attr-defined]

    move()
    snapshot.sync()
    best = np.inf
    for _ in range(7):
        move()
        start = time.perf_counter()
        snapshot.sync()
        best = min(best, time.perf_counter() - start)
    start = time.perf_counter()
    fresh = sg.Snapshot(snapshot.scene)
    build = time.perf_counter() - start
    assert np.array_equal(np.sort(fresh.boxes, axis=1), np.sort(snapshot.boxes, axis=1))
    rows = [
        ("sync() of 1 000 moved transforms", f"{best * 1e3:8.2f} ms"),
        ("a new snapshot instead", f"{build * 1e3:8.0f} ms"),
        ("memory of the snapshot", f"{snapshot.nbytes / snapshot.n:8.0f} bytes a drawable"),
    ]
    show("100 000 drawables, each below a transform of its own", rows)
    benchmark.pedantic(snapshot.sync, setup=move, rounds=5)


@pytest.mark.gl
def test_against_vtks_own_culler(benchmark: Any) -> None:
    """Runs `vtkFrustumCoverageCuller::Cull` of the installed library on actors of the same boxes, nothing drawn."""
    from scenegraph.render.probe import require_gl

    require_gl()
    n = 10_000
    cull = vtk_cull(n)
    snapshot, views = city(n), street_views(n)
    pipeline = sg.Pipeline([Frustum()]).open(snapshot)
    ours, theirs = best_ms(pipeline.run, views), best_ms(cull, views, 3)
    kept = np.mean([pipeline.run(v).visible_count for v in views]), np.mean([cull(v) for v in views])
    show(
        f"{n} box drawables: frustum culling alone",
        [
            ("frustum (whole frame)", f"{ours:8.3f} ms  kept {kept[0]:6.0f}"),
            ("vtkFrustumCoverageCuller", f"{theirs:8.3f} ms  kept {kept[1]:6.0f}"),
            ("ratio", f"{theirs / ours:8.1f}"),
        ],
    )
    benchmark.extra_info["times_faster_than_vtk"] = theirs / ours
    benchmark.pedantic(pipeline.run, args=(views[0],), rounds=20)


def vtk_cull(n: int) -> Callable[[sg.View], int]:
    """A function that culls n actors by VTK and returns how many are left.

    vtkCuller::Cull takes an array of props, which VTK's Python does not wrap: call the library's function on the
    actors' addresses, as vtkRenderer::AllocateTime does.
    """
    import ctypes

    import vtkmodules
    from vtkmodules.vtkFiltersSources import vtkCubeSource
    from vtkmodules.vtkRenderingCore import (
        vtkActor,
        vtkFrustumCoverageCuller,
        vtkPolyDataMapper,
        vtkRenderer,
        vtkRenderWindow,
    )

    def address(thing: Any) -> int:
        return int(thing.__this__.split("_")[1], 16)

    libraries = sorted(Path(vtkmodules.__path__[0]).glob("libvtkRenderingCore*.so*"))
    if not libraries:
        pytest.skip("the VTK library was not found where this benchmark knows to look")
    function = ctypes.CDLL(str(libraries[0]))._ZN24vtkFrustumCoverageCuller4CullEP11vtkRendererPP7vtkPropRiS5_
    function.restype, function.argtypes = ctypes.c_double, [ctypes.c_void_p] * 5
    source, mapper = vtkCubeSource(), vtkPolyDataMapper()
    source.Update()
    mapper.SetInputData(source.GetOutput())
    renderer, window, culler = vtkRenderer(), vtkRenderWindow(), vtkFrustumCoverageCuller()
    window.SetOffScreenRendering(1)
    window.SetSize(1280, 720)
    window.AddRenderer(renderer)
    actors = []
    for low, high in zip(*city_boxes(n), strict=True):
        actor = vtkActor()
        actor.SetMapper(mapper)
        actor.SetPosition((low + high) / 2)
        actor.SetScale(high - low)
        actors.append(actor)
    addresses = np.array([address(a) for a in actors], np.uint64)

    def cull(view: sg.View) -> int:
        # `actors`, `window` and `mapper` must live as long as their addresses are used
        view.to_vtk(renderer.GetActiveCamera())
        props, count, initialized = addresses.copy(), ctypes.c_int(len(actors)), ctypes.c_int(0)
        function(
            address(culler),
            address(renderer),
            props.ctypes.data,
            ctypes.addressof(count),
            ctypes.addressof(initialized),
        )
        assert window is not None
        return count.value

    return cull


@pytest.mark.parametrize(("module", "present"), [("c_osg", "osg/Node"), ("b_panda", "panda3d")])
def test_beside_other_engines(benchmark: Any, module: str, present: str, tmp_path: Path) -> None:
    """Runs the peer's own measurement on the peers' city of 10 000 boxes, and ours on the same boxes and cameras."""
    if not PEERS.is_dir():
        pytest.skip("the peer scripts are not beside the checkout")
    found = (
        any(Path(folder, present).exists() for folder in ("/usr/include", "/usr/local/include")) and shutil.which("g++")
        if module == "c_osg"
        else importlib.util.find_spec(present)
    )
    if not found:
        pytest.skip(f"{module[2:]} is not installed")
    env = os.environ | {f"PEERS_{k}": str(tmp_path / k.lower()) for k in ("DATA", "BUILD", "RESULTS")}
    run = f"import sys; sys.path.insert(0, {str(PEERS)!r}); import workload as W; W.SIZES = (10000,); import {module}; "
    done = subprocess.run(
        [sys.executable, "-c", run + f"{module}.main()"], env=env, capture_output=True, text=True, timeout=900
    )
    assert done.returncode == 0, done.stderr[-2000:]
    (results,) = (tmp_path / "results").glob("*.jsonl")
    records = [json.loads(line) for line in results.read_text().splitlines()]
    snapshot, views = peers_city()
    pipeline = sg.Pipeline([Frustum()]).open(snapshot)
    ours = best_ms(pipeline.run, views)
    kept = np.mean([pipeline.run(v).visible_count for v in views])
    rows = [("frustum", f"{ours:8.3f} ms  kept {kept:6.0f}")]
    for r in records:
        if r["workload"] == "city":
            value = f"{r['ms_min_median']:8.3f} ms  kept {r.get('survivors', float('nan')):6.0f}"
            rows.append((f"{module[2:]} {r['variant']}", value))
    show("the peers' city of 10 000 boxes, 64 street views", rows)
    benchmark.pedantic(pipeline.run, args=(views[0],), rounds=20)


def peers_city() -> tuple[sg.Snapshot, list[sg.View]]:
    """The boxes and cameras of the peer scripts."""
    spec = importlib.util.spec_from_file_location("peers_workload", PEERS / "workload.py")
    assert spec is not None
    assert spec.loader is not None
    workload = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(workload)
    low, high, eyes, targets = workload.city(10_000)
    unit = sg.Mesh.box((0, 0, 0), (1, 1, 1))
    boxes = [
        sg.Transform(sg.Geode(unit), translation=a, scale=b - a)
        for a, b in zip(low.astype(np.float32), high.astype(np.float32), strict=True)
    ]
    views = [sg.View(e, t, near=0.1, far=5000.0) for e, t in zip(eyes, targets, strict=True)]
    return sg.Scene(sg.Group(*boxes)).snapshot(), views
