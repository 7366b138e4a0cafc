"""Occlusion maps: what the map, the overlap test and the frequency analysis cost, part by part, and against OpenGL.

Times are the best of several repeats in one run, because the machine does other things too. Figures to beat: a map of
1 000 occluder quads at 512 × 256 in 10 ms, 100 ns a candidate with its projection, 10⁴ transforms in 10 ms.
"""

from __future__ import annotations

import sys
from contextlib import closing
from typing import Any

import numpy as np
import pytest

import scenegraph as sg
import scenegraph_frustum
import scenegraph_hom
from bench_tools import best_ms
from scenegraph.kernels.frequency import rect_visibility
from scenegraph.kernels.nearness import nearness_scale
from scenegraph.kernels.projection import box_screen_rectangles
from scenegraph.kernels.pyramids import map_count_pyramid, map_minimum_pyramid, map_sums
from scenegraph.kernels.rectangles import rect_area, rect_minimum
from scenegraph_hom import Hom, OcclusionMap, scan
from scenegraph_hom.catalog import make_catalog
from scenegraph_hom.overlap import hidden_by_cells, hidden_exactly
from scenegraph_hom.products import map_visibility
from scenegraph_hom.shapes import ShapeTable, occluder_shapes

SIZE = (512, 256)
KNOWN = sg.Registry(discover=False)
KNOWN.add(scenegraph_frustum)
KNOWN.add(scenegraph_hom)


def city(n: int) -> sg.Snapshot:
    """n boxes on lots of 20 m with streets between them."""
    rng = np.random.default_rng(7)
    side = int(np.ceil(np.sqrt(n)))
    lot = np.stack(np.divmod(np.arange(n), side), axis=1) * 20.0 + 10
    size = rng.uniform(8, 16, (n, 2))
    height = np.clip(rng.lognormal(np.log(20.0), 0.65, n), 6, 120)
    unit = sg.Mesh.box((-0.5, -0.5, 0), (0.5, 0.5, 1))
    scale = np.column_stack([size, height])
    places = np.column_stack([lot, np.zeros(n)])
    boxes = (sg.Transform(sg.Geode(unit), translation=p, scale=s) for p, s in zip(places, scale, strict=True))
    return sg.Scene(sg.Group(*boxes, name="city")).snapshot()


def street_views(n: int, count: int = 8) -> list[sg.View]:
    middle = round(np.sqrt(n) / 2) * 20.0
    turns = 2 * np.pi * np.arange(count) / count + 0.1
    eyes = [np.array([middle + 20 * i, middle, 1.7]) for i in range(count)]
    return [sg.View(e, e + [np.cos(a), np.sin(a), 0.02]) for e, a in zip(eyes, turns, strict=True)]


def quads(count: int, texels: float) -> tuple[ShapeTable, np.ndarray, sg.View]:
    """Planar occluders before an eye, turned at random, with sides of about so many texels; and their matrices."""
    rng = np.random.default_rng(3)
    view = sg.View((0, 0, 0), (0, 1, 0), width=1024, height=512)
    square = sg.Mesh([(-0.5, 0, -0.5), (0.5, 0, -0.5), (0.5, 0, 0.5), (-0.5, 0, 0.5)], [(0, 1, 2), (0, 2, 3)])
    depth = rng.uniform(10, 200, count)
    left, right, bottom, top = view.window
    place = np.stack([rng.uniform(left, right, count), np.ones(count), rng.uniform(bottom, top, count)]) * depth
    matrices = np.tile(np.eye(4), (count, 1, 1))
    matrices[:, :3, :3] += rng.uniform(-0.5, 0.5, (count, 3, 3))
    matrices[:, :3, :3] *= (depth * texels * (right - left) / SIZE[0])[:, None, None]
    matrices[:, :3, 3] = place.T
    return occluder_shapes([square]), matrices, view


@pytest.mark.parametrize("texels", [15, 30, 60])
def test_map_of_a_thousand_quads(benchmark: Any, texels: int) -> None:
    """The cost follows the rows that edges cross, not the texels that they enclose."""
    table, matrices, view = quads(1000, texels)
    shapes, hollow = np.zeros(1000, np.int64), np.ones(1000, bool)
    scale = nearness_scale(10.0, 200.0, parallel=False)

    def draw(strict: bool = True) -> scan.Drawn:
        return scan.scan_map(view, table, shapes, matrices, hollow, size=SIZE, scale=scale, strict=strict)

    drawn = benchmark(draw)
    codes = drawn.codes
    benchmark.extra_info.update(
        {
            "covered part": float((codes > 0).mean()),
            "texels drawn over each": float((drawn.end - drawn.first).sum() / codes.size),
            "centers only, ms": best_ms(lambda: draw(strict=False)),
            "summed-area table, ms": best_ms(lambda: map_sums(codes > 0)),
            "pyramid of counts, ms": best_ms(lambda: map_count_pyramid(codes > 0)),
            "pyramid of least codes, ms": best_ms(lambda: map_minimum_pyramid(codes)),
        }
    )


def mapped(n: int = 100_000) -> tuple[OcclusionMap, np.ndarray]:
    """A street view's map and the boxes of 10 000 candidates in the view."""
    snapshot, view = city(n), street_views(n)[0]
    with sg.Pipeline([Hom()]).open(snapshot) as pipeline:
        occlusion = pipeline.run(view).get(OcclusionMap)
    rows = np.flatnonzero(occlusion.footprint(snapshot.boxes).testable)
    assert len(rows) >= 10_000
    return occlusion, np.ascontiguousarray(snapshot.boxes[:, rows[:: len(rows) // 10_000][:10_000]])


def test_overlap_test_per_candidate(benchmark: Any) -> None:
    """Projection, rectangle, code, and four reads of the tables, with the making of the tables."""
    occlusion, boxes = mapped()
    view, n = occlusion.view, boxes.shape[1]

    def exact() -> np.ndarray:
        return hidden_exactly(occlusion, occlusion.footprint(boxes), opacity=1.0, compared=True)

    def cells() -> np.ndarray:
        footprint = occlusion.footprint(boxes)
        return hidden_by_cells(occlusion, footprint, opacity=1.0, compared=True, descents=2)

    hidden = benchmark(exact)
    footprint = occlusion.footprint(boxes)
    cells()
    options = {"axes": view.axes, "eye": np.asarray(view.eye), "window": view.window, "near": view.near}
    few = boxes[:, :2500]
    benchmark.extra_info.update(
        {
            "ns a candidate": best_ms(exact) / n * 1e6,
            "of that projection": best_ms(lambda: box_screen_rectangles(boxes, size=SIZE, parallel=False, **options))
            / n
            * 1e6,
            "of that minima": best_ms(lambda: rect_minimum(occlusion.codes, footprint.texels)) / n * 1e6,
            "ns a candidate by the pyramid": best_ms(cells) / n * 1e6,
            "ns a candidate if there are 2 500": best_ms(
                lambda: hidden_exactly(occlusion, occlusion.footprint(few), opacity=1.0, compared=True)
            )
            / 2500
            * 1e6,
            "hidden by the exact test": int(hidden.sum()),
            "hidden by the pyramid": int(cells().sum()),
            "mean area of the rectangles, texels": float(rect_area(footprint.texels).mean()),
        }
    )


def test_level_of_visibility_of_ten_thousand(benchmark: Any) -> None:
    occlusion, boxes = mapped()
    footprint = occlusion.footprint(boxes)
    _ = occlusion.counts, occlusion.farthest_pyramid, occlusion.nearest_pyramid
    benchmark(lambda: rect_visibility(occlusion.counts, footprint.texels))
    rng = np.random.default_rng(0)
    corner = rng.integers(0, [[480], [224]], (2, 10_000))
    large = np.concatenate([corner, corner + rng.integers(9, 33, (2, 10_000))])
    benchmark.extra_info["of rectangles of 9 to 32 texels, ms"] = best_ms(
        lambda: rect_visibility(occlusion.counts, large)
    )
    benchmark.extra_info["with depths, ms"] = best_ms(
        lambda: map_visibility(occlusion, footprint.texels, footprint.codes)
    )


@pytest.mark.parametrize("n", [10_000, 100_000])
def test_street_view(benchmark: Any, n: int) -> None:
    """The whole stage with 200 occluders, by what it leaves and what it costs."""
    snapshot, views = city(n), street_views(n)
    table = [("settings", "candidates", "left", "ms")]

    def frames(text: str) -> tuple[float, float, float]:
        left, before, best = [], [], np.full(len(views), np.inf)
        with sg.Pipeline.parse(text, KNOWN).open(snapshot) as p:
            for _ in range(5):
                for i, view in enumerate(views):
                    frame = p.run(view)
                    best[i] = min(best[i], frame.record.stages[-1].ms)
                    left.append(frame.visible_count)
                    before.append(frame.visible_count + frame.record.stages[-1].hidden)
        return float(np.mean(before)), float(np.mean(left)), float(best.mean())

    for values in ("", "ranking='visible'", "ranking='distance'", "outlines=False", "test='pyramid'", "strict=False"):
        row = frames(f"frustum | hom({values})")
        table.append((values or "default", f"{row[0]:.0f}", f"{row[1]:.1f}", f"{row[2]:.2f}"))
    width = max(len(r[0]) for r in table)
    sys.stdout.write("\n" + "".join(f"  {r[0]:<{width}} {r[1]:>10} {r[2]:>8} {r[3]:>8}\n" for r in table))
    with sg.Pipeline.parse("frustum | hom", KNOWN).open(snapshot) as pipeline:
        benchmark(lambda: pipeline.run(views[0]))


@pytest.mark.parametrize("step", [1e9, 1.0, 1 / 8, 1 / 64])
def test_finer_depth_steps(benchmark: Any, step: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Why spans are cut at an eighth of their depth."""
    monkeypatch.setattr(scan, "DEPTH_STEP", step)
    snapshot, views = city(10_000), street_views(10_000)
    with sg.Pipeline.parse("frustum | hom", KNOWN).open(snapshot) as pipeline:
        benchmark(lambda: pipeline.run(views[0]))
        benchmark.extra_info["left"] = float(np.mean([pipeline.run(view).visible_count for view in views]))


@pytest.mark.gl
@pytest.mark.parametrize("level", [1, 3, 5])
def test_numpy_against_opengl(benchmark: Any, level: int) -> None:
    """Which of the two draws the map sooner depends on the triangles: 200 balls of 80 to 20 480 triangles each."""
    import trimesh

    from scenegraph.render.device import Device
    from scenegraph.render.window import OffscreenWindow

    ball = trimesh.creation.icosphere(subdivisions=level)
    mesh = sg.Mesh(ball.vertices, ball.faces)
    rng = np.random.default_rng(1)
    places = rng.uniform(-30, 30, (200, 3)) + [0, 80, 0]
    snapshot = (
        sg.Scene().add(*(sg.Transform(sg.Geode(mesh), translation=p, scale=(4, 4, 4)) for p in places)).snapshot()
    )
    view = sg.View((0, 0, 0), (0, 1, 0))
    budget = 10_000_000
    with OffscreenWindow(64, 64) as window, closing(Device(window)) as device:
        for producer in ("numpy", "gl"):
            for strict in (True, False):
                stage = Hom(producer=producer, strict=strict, triangles=budget)
                with sg.Pipeline([stage]).open(snapshot, device=device) as pipeline:
                    pipeline.run(view)
                    name = f"{producer}, {'strict' if strict else 'centers'}, ms"
                    benchmark.extra_info[name] = best_ms(lambda p=pipeline: p.run(view), 5)
        with sg.Pipeline([Hom(triangles=budget)]).open(snapshot) as pipeline:
            benchmark.pedantic(lambda: pipeline.run(view), rounds=3)
    benchmark.extra_info["triangles drawn"] = 200 * mesh.triangles


def test_catalog(benchmark: Any) -> None:
    """What opening the stage costs for a city of 10 000 buildings that share one mesh, and for one of 10 000 meshes."""
    shared = city(10_000)
    benchmark(lambda: make_catalog(shared, source="auto", largest=20_000, coarsest=False))
    boxes = [sg.Mesh.box((i, 0, 0), (i + 1, 1, 1)) for i in range(10_000)]
    own = sg.Scene().add(*map(sg.Geode, boxes)).snapshot()
    benchmark.extra_info["10 000 meshes, ms"] = best_ms(
        lambda: make_catalog(own, source="auto", largest=20_000, coarsest=False), 2
    )
