"""A user's own plot: `frustum | shadow` against a plain plotter of the same actors, and against OPT.

OPT draws exactly what is visible, without deciding anything: what is left of it is the cost of pixels. The plotters
take turns view by view, with and without multisampling; `enable` is timed once its modules are imported.

    python -m pytest tests/bench/bench_plotter.py -o python_files='bench_*.py' -q -s
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from data_files import DATA
from scenegraph import Registry, Scene, Snapshot, View
from scenegraph.compare.metrics import snr_db
from scenegraph.render.item_buffer import ItemBuffer

pytestmark = pytest.mark.gl
pv = pytest.importorskip("pyvista")
SIZE = (1280, 720)


def filled(snapshot: Snapshot) -> tuple[Any, list[Any]]:
    """A plotter with an actor per row, in the way of a user: `add_mesh`, and a place for each."""
    plotter = pv.Plotter(off_screen=True, window_size=SIZE)
    known: dict[int, Any] = {}
    actors = []
    for row in range(snapshot.n):
        mesh = snapshot.meshes[snapshot.level_meshes[row, 0]]
        if id(mesh) not in known:
            known[id(mesh)] = pv.PolyData.from_regular_faces(mesh.vertices.astype(np.float32), mesh.faces)
            if mesh.vertex_colors is not None:
                known[id(mesh)].point_data["rgba"] = mesh.vertex_colors
        color = snapshot.colors[row]
        look = {"color": color[:3].tolist()} if mesh.vertex_colors is None else {"scalars": "rgba", "rgb": True}
        actor = plotter.add_mesh(
            known[id(mesh)], opacity=float(color[3]), show_scalar_bar=False, render=False, reset_camera=False, **look
        )
        actor.user_matrix = snapshot.transforms[snapshot.transform_index[row]]
        actors.append(actor)
    plotter.show(auto_close=False)
    return plotter, actors


def around(snapshot: Snapshot) -> list[View]:
    """Three views from within the bounds of a model, at a fifth of its height."""
    low = (snapshot.boxes[:3] - snapshot.boxes[3:]).min(axis=1)
    size = (snapshot.boxes[:3] + snapshot.boxes[3:]).max(axis=1) - low
    up = int(np.argmax(np.abs(snapshot.scene.up)))
    share = np.full(3, 0.5)
    views = []
    for x, y in ((0.3, 0.3), (0.5, 0.6), (0.7, 0.4)):
        eye = share.copy()
        eye[[a for a in range(3) if a != up]] = x, y
        eye[up] = 0.2
        target = 1 - eye
        target[up] = 0.2
        views.append(
            View(low + eye * size, low + target * size, up=snapshot.scene.up, width=SIZE[0], height=SIZE[1],
                 near=1e-3 * float(size.max()), far=2 * float(np.linalg.norm(size)))
        )  # fmt: skip
    return views


def city(**options: Any) -> tuple[Snapshot, list[View]]:
    scene = Registry().scene("city").build(**options)
    return scene.snapshot(), [v.resized(*SIZE) for v in scene.paths["street"][::24]]


def model(name: str) -> tuple[Snapshot, list[View]]:
    path = DATA / name
    if not path.exists():
        pytest.skip(f"{path} is missing")
    snapshot = Scene.load(path).snapshot()
    return snapshot, around(snapshot)


SCENES: dict[str, Callable[[], tuple[Snapshot, list[View]]]] = {
    "city, 10 000 buildings as boxes": lambda: city(buildings=10_000, detail=0),
    "city": city,
    "duplex_building": lambda: model("scenes/duplex_building.glb"),
    "delft": lambda: model("city/delft_3dfier.obj"),
    "virtual_city": lambda: model("scenes/virtual_city.glb"),
}


@pytest.mark.parametrize("name", SCENES)
def test_interactive_frame(benchmark: Any, name: str) -> None:
    snapshot, views = SCENES[name]()
    plotter, actors = filled(snapshot)
    window, camera = plotter.render_window, plotter.renderer.GetActiveCamera()
    plotter.scenegraph.enable("frustum", background=False)
    enabling = {}
    for batches in (False, True):
        plotter.scenegraph.disable()
        start = time.perf_counter()
        plotter.scenegraph.enable("frustum | shadow", background=False, batches=batches)
        enabling[batches] = time.perf_counter() - start
    (driver,) = plotter.scenegraph.drivers
    window.Render()
    truth = ItemBuffer(snapshot)

    def frame() -> float:
        start = time.perf_counter()
        window.Render()
        window.WaitForCompletion()
        return 1e3 * (time.perf_counter() - start)

    info = benchmark.extra_info
    info["actors"] = snapshot.n
    info["s to enable per 10 000 actors"] = enabling[False] * 1e4 / snapshot.n
    info["s to enable with batches"] = enabling[True] * 1e4 / snapshot.n
    for samples in (4, 0):
        if not samples:
            plotter.disable_anti_aliasing()
        window.SetMultiSamples(samples)
        times: dict[str, list[float]] = {"plain": [], "culled": [], "one by one": [], "opt": []}
        drawn, differs = [], 0
        for view in views:
            view.to_vtk(camera)
            visible = truth.render(view).visible
            for kind, found in times.items():
                driver.paused = kind in ("plain", "opt")
                driver._subject._together = kind == "culled"  # type: ignore[union-attr]
                if kind == "opt":
                    for actor, seen in zip(actors, visible.tolist(), strict=True):
                        actor.SetVisibility(seen)
                frame()
                found.append(min(frame(), frame()))
                if kind == "plain":
                    wanted = plotter.screenshot(return_img=True)
                elif kind == "culled":
                    drawn.append(driver.frame.visible_count)
                    differs += int((plotter.screenshot(return_img=True) != wanted).any(axis=2).sum())
                if kind == "opt":
                    for actor in actors:
                        actor.VisibilityOn()
        what = f"{samples} samples: " if samples else "no multisampling: "
        for kind, found in times.items():
            info[what + kind + " ms"] = statistics.median(found)
        info[what + "drawn"] = str(drawn)
        info[what + "pixels that differ"] = differs
        for kind in ("culled", "one by one", "opt"):
            ratios = [a / b for a, b in zip(times["plain"], times[kind], strict=True)]
            info[what + f"plain / {kind}"] = statistics.median(ratios)
    benchmark.pedantic(frame, rounds=1)
    truth.close()
    plotter.close()


def test_levels_of_heavy_meshes(benchmark: Any) -> None:
    """Scans in a user's plot: all drawn, in the frustum only, and at levels within some pixels of the finest."""
    folder = DATA / "meshes"
    if not folder.exists():
        pytest.skip(f"{folder} is missing")
    scene = Registry().scene("inspection").build(depth="high", model=str(folder))
    views = [v.resized(*SIZE) for v in scene.paths["inspection"][::60]]
    plotter, _ = filled(scene.snapshot())
    camera, window = plotter.renderer.GetActiveCamera(), plotter.render_window
    info = benchmark.extra_info
    pictures, plain = [], []
    for text in ("", "frustum", *(f"frustum | lod_error(pixels={p})" for p in (1, 2, 4))):
        if text:
            start = time.perf_counter()
            plotter.scenegraph.enable(text, background=False)
            window.Render()
            info[f"{text}: s to enable"] = time.perf_counter() - start
        times, decibels, triangles = [], [], []
        for i, view in enumerate(views):
            view.to_vtk(camera)
            window.Render()
            start = time.perf_counter()
            window.Render()
            window.WaitForCompletion()
            times.append(1e3 * (time.perf_counter() - start))
            picture = np.array(plotter.screenshot(return_img=True))[..., :3]
            if text:
                (driver,) = plotter.scenegraph.drivers
                decibels.append(snr_db(picture, pictures[i]))
                triangles.append(driver.frame.record.triangles)
            else:
                pictures.append(picture)
        plain = plain or times
        info[f"{text or 'plain'}: ms"] = statistics.median(times)
        if text:
            info[f"{text}: plain / this, median and worst"] = (
                f"{statistics.median(a / b for a, b in zip(plain, times, strict=True)):.1f}, "
                f"{min(a / b for a, b in zip(plain, times, strict=True)):.1f}"
            )
            info[f"{text}: triangles"] = statistics.median(triangles)
            info[f"{text}: worst SNR, dB"] = min(decibels)
            plotter.scenegraph.disable()
    benchmark.pedantic(window.Render, rounds=1)
    plotter.close()
