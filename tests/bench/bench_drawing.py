"""What it costs to draw a new visible set every frame: one actor per row, merged batches, and VTK's glyph mapper.

The choices that `scenegraph.render` makes rest on these numbers: merged batches rather than actors at any number of
rows, and actors for meshes of `HEAVY_TRIANGLES` and more. Methods take turns frame by frame, so that their ratios hold
on a machine that does other things, too.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from scenegraph import Geode, Group, Mesh, Scene, Snapshot, Transform, View
from scenegraph.render.drawing import Drawing
from scenegraph.render.geometry import HEAVY_TRIANGLES, Geometry
from scenegraph.render.item_buffer import ItemBuffer
from scenegraph.render.window import OffscreenWindow

pytestmark = pytest.mark.gl
FRAMES = 7
VIEW = View(eye=(0.0, 0.0, 0.0), target=(1.0, 0.2, 0.1), near=1.0, far=2000.0, width=1280, height=720)


def sphere(triangles: int) -> Mesh:
    """A closed ball of about so many triangles."""
    rings = max(2, round((triangles / 4) ** 0.5))
    segments = max(3, round(triangles / (2 * (rings - 1)))) if rings > 2 else max(3, triangles // 2)
    angle = np.linspace(0, np.pi, rings + 1)
    turn = np.arange(segments) * 2 * np.pi / segments
    middle = np.stack(
        [
            np.outer(np.sin(angle[1:-1]), np.cos(turn)),
            np.outer(np.sin(angle[1:-1]), np.sin(turn)),
            np.repeat(np.cos(angle[1:-1])[:, None], segments, axis=1),
        ],
        axis=-1,
    ).reshape(-1, 3)
    points = np.vstack([[0, 0, 1], middle, [0, 0, -1]])
    last = len(points) - 1
    i, j = np.arange(segments), (np.arange(segments) + 1) % segments
    faces = [np.stack([np.zeros_like(i), 1 + i, 1 + j], axis=1)]
    for ring in range(rings - 2):
        a, b = 1 + ring * segments, 1 + (ring + 1) * segments
        faces += [np.stack([a + i, b + i, b + j], axis=1), np.stack([a + i, b + j, a + j], axis=1)]
    faces.append(np.stack([np.full_like(i, last), last - segments + j, last - segments + i], axis=1))
    return Mesh(points, np.concatenate(faces))


def scattered(n: int, mesh: Mesh) -> Snapshot:
    """Copies of a mesh in a cube around the origin."""
    rng = np.random.default_rng(0)
    group = Group()
    for place, size, color in zip(
        rng.uniform(-500, 500, (n, 3)), rng.uniform(0.5, 4, n), rng.uniform(0.3, 1, (n, 3)), strict=True
    ):
        group.add(Transform(Geode(mesh, color=color.tolist()), translation=place, scale=size))
    return Scene(Group(group)).snapshot()


@contextmanager
def drawn(snapshot: Snapshot, mode: Any, heavy: int = HEAVY_TRIANGLES) -> Iterator[Callable[[NDArray[np.bool_]], None]]:
    """A function that draws rows by a `Drawing`."""
    with OffscreenWindow(VIEW.width, VIEW.height) as window:
        drawing = Drawing(snapshot, window.renderer, mode=mode, heavy=heavy)

        def draw(rows: NDArray[np.bool_]) -> None:
            drawing.show(rows)
            window.draw(VIEW)

        yield draw


@contextmanager
def glyphs(snapshot: Snapshot) -> Iterator[Callable[[NDArray[np.bool_]], None]]:
    """A function that draws rows by VTK's glyph mapper with a new array of points."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkPolyData
    from vtkmodules.vtkRenderingCore import vtkActor, vtkGlyph3DMapper

    from scenegraph.render.actors import Surface

    mesh = snapshot.meshes[0]
    surface = Surface(mesh.vertices.astype(np.float32), mesh.faces.reshape(-1))
    world = snapshot.transforms[snapshot.transform_index]
    places, sizes = world[:, :3, 3].astype(np.float32), np.ascontiguousarray(world[:, 0, 0], np.float32)
    colors = np.rint(snapshot.colors * 255).astype(np.uint8)
    with OffscreenWindow(VIEW.width, VIEW.height) as window:
        mapper = vtkGlyph3DMapper()
        mapper.SetSourceData(surface.data)
        mapper.SetScaleArray("size")
        mapper.SetScaleModeToScaleByMagnitude()
        mapper.SetColorModeToDirectScalars()
        actor = vtkActor()
        actor.SetMapper(mapper)
        window.renderer.AddActor(actor)

        def draw(rows: NDArray[np.bool_]) -> None:
            data, points = vtkPolyData(), vtkPoints()
            points.SetData(numpy_to_vtk(places[rows]))
            data.SetPoints(points)
            size, color = numpy_to_vtk(sizes[rows]), numpy_to_vtk(colors[rows])
            size.SetName("size")
            data.GetPointData().AddArray(size)
            data.GetPointData().SetScalars(color)
            mapper.SetInputData(data)
            window.draw(VIEW)

        yield draw


def in_turns(methods: dict[str, Callable[[NDArray[np.bool_]], None]], n: int, share: float) -> dict[str, float]:
    """Median milliseconds of a frame with a new random set of rows, for each method."""
    rng = np.random.default_rng(1)
    times: dict[str, list[float]] = {name: [] for name in methods}
    for frame in range(FRAMES + 1):
        rows = rng.random(n) < share
        for name, draw in methods.items():
            start = time.perf_counter()
            draw(rows)
            if frame:
                times[name].append(1e3 * (time.perf_counter() - start))
    return {name: statistics.median(values) for name, values in times.items()}


@pytest.mark.parametrize("share", [0.1, 0.5, 1.0])
@pytest.mark.parametrize(("n", "triangles"), [(100, 12), (1000, 12), (1000, 96), (10_000, 12), (10_000, 96)])
def test_new_visible_set_every_frame(benchmark: Any, n: int, triangles: int, share: float) -> None:
    snapshot = scattered(n, sphere(triangles))
    with drawn(snapshot, "actors") as a, drawn(snapshot, "batches") as b, glyphs(snapshot) as g:
        found = in_turns({"actors": a, "batches": b, "glyphs": g}, n, share)
        rows = np.random.default_rng(2).random(n) < share
        benchmark.pedantic(b, args=(rows,), rounds=3)
    benchmark.extra_info.update({k: round(v, 2) for k, v in found.items()})
    benchmark.extra_info["actors/batches"] = round(found["actors"] / found["batches"], 2)
    benchmark.extra_info["glyphs/batches"] = round(found["glyphs"] / found["batches"], 2)
    assert found["batches"] < 1.2 * found["actors"]


@pytest.mark.parametrize("triangles", [200, 500, 1000, 2000, 5000])
def test_where_one_more_draw_call_is_as_cheap_as_a_copy(benchmark: Any, triangles: int) -> None:
    snapshot = scattered(500, sphere(triangles))
    with drawn(snapshot, "batches", heavy=1) as a, drawn(snapshot, "batches", heavy=1 << 30) as b:
        found = in_turns({"instances": a, "merged": b}, 500, 0.5)
        benchmark.pedantic(b, args=(np.ones(500, bool),), rounds=3)
    merged, instanced = Geometry(snapshot, heavy=1 << 30).nbytes, Geometry(snapshot, heavy=1).nbytes
    benchmark.extra_info.update({k: round(v, 2) for k, v in found.items()})
    benchmark.extra_info["MB merged"] = round(merged / 1e6, 1)
    benchmark.extra_info["MB instanced"] = round(instanced / 1e6, 1)


@pytest.mark.parametrize(("n", "triangles"), [(1000, 96), (10_000, 96)])
def test_exact_visible_set(benchmark: Any, n: int, triangles: int) -> None:
    buffer = ItemBuffer(scattered(n, sphere(triangles)))
    buffer.render(VIEW)
    truth = benchmark.pedantic(buffer.render, args=(VIEW,), rounds=5)
    benchmark.extra_info["visible"] = int(truth.visible.sum())
    buffer.close()
