"""What the parts of HLOD refinement cost: areas of boxes, cuts without queries, and walks with them.

    pytest tests/bench/bench_hlod.py --benchmark-only -q

The figures stand in for scans; a tree of 327 680 triangles takes seconds to build, once.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from itertools import cycle

import numpy as np
import pytest

import scenegraph as sg
from scenegraph.kernels.areas import box_pixel_area
from scenegraph.meshes import hlod_of
from scenegraph.render.device import Device
from scenegraph.render.window import OffscreenWindow
from scenegraph.scenes.inspection import build

SIZE = (640, 480)


@pytest.fixture(scope="module")
def scene() -> sg.Scene:
    return build(depth="high", detail=5)


@pytest.fixture(scope="module")
def snapshot(scene: sg.Scene) -> sg.Snapshot:
    made = scene.snapshot()
    made.prepared("hlod_tree", hlod_of)
    return made


@pytest.fixture(scope="module")
def device() -> Iterator[Device]:
    with OffscreenWindow(*SIZE) as window, closing(Device(window)) as made:
        yield made


@pytest.mark.parametrize("count", [100, 1000, 10_000])
def test_area_of_boxes(benchmark, count: int) -> None:
    rng = np.random.default_rng(0)
    boxes = np.concatenate([rng.uniform(-10, 10, (3, count)), rng.uniform(0.1, 1, (3, count))])
    view = sg.View((0, -40, 5), (0, 0, 0), width=SIZE[0], height=SIZE[1])
    options = {"axes": view.axes, "eye": np.asarray(view.eye), "window": view.window, "size": SIZE}
    found = benchmark(box_pixel_area, boxes, near=view.near, parallel=False, **options)
    assert np.isfinite(found).all()


@pytest.mark.gl
@pytest.mark.parametrize(
    "text",
    ["hlod(traversal='none')", "hlod", "hlod(chunk=1)", "hlod(chunk=64)"]
    + [f"hlod(preset='{p}')" for p in ("CHLOD-eps_q", "CHLOD-eps", "SW-eps_q", "SW-eps")],
)
def test_walk(benchmark, scene: sg.Scene, snapshot: sg.Snapshot, device: Device, text: str) -> None:
    """One frame of the stage; the camera goes on along its path."""
    views = cycle(v.resized(*SIZE) for v in scene.paths["inspection"])
    with sg.Pipeline.parse(text).open(snapshot, device=device) as pipeline:
        pipeline.run(next(views))
        frame = benchmark(lambda: pipeline.run(next(views)))
    assert frame.drawn_objects


@pytest.mark.gl
@pytest.mark.parametrize("nodes", [1, 16, 256])
def test_depth_of_nodes(benchmark, scene: sg.Scene, snapshot: sg.Snapshot, device: Device, nodes: int) -> None:
    tree = snapshot.prepared("hlod_tree", hlod_of)
    view = scene.paths["inspection"][0].resized(*SIZE)
    chosen = np.flatnonzero(tree.is_leaf)[:nodes]

    def draw() -> None:
        with device.guard():
            target = device.depth_target(*SIZE)
            device.draw_depth_of(target, view, tree.table, chosen, clear=True)
            device.gl.finish()

    benchmark(draw)
