"""Queries in VTK's context, as a guest: pictures stay what they are, nothing leaks, and what is lost is lost safely."""

from __future__ import annotations

import gc
import json
import os
import resource
import shutil
import subprocess
import sys
from contextlib import ExitStack, closing
from ctypes.util import find_library
from typing import Any

import numpy as np
import pytest
import pyvista

import scenegraph as sg
from drawn_scenes import town, town_views
from scenegraph.render.device import TARGETS, Device
from scenegraph.render.driver import Driver
from scenegraph.render.item_buffer import ItemBuffer
from scenegraph.render.window import OffscreenWindow
from scenegraph.testing import wall_scene, wall_views
from scenegraph_query import Query

pytestmark = pytest.mark.gl
pytest.importorskip("moderngl")

TRAVERSALS = ["batched", "coherent", "stop_and_wait"]


def balls(**options: Any) -> pyvista.Plotter:
    """A plotter of the user's own: a wall, balls before and behind it, one of them translucent, and a text."""
    plotter = pyvista.Plotter(off_screen=True, window_size=(320, 240), **options)
    for number in range(plotter.renderers.shape[1]):
        plotter.subplot(0, number)
        plotter.add_mesh(pyvista.Cube(x_length=0.5, y_length=8, z_length=8), color="gray")
        for i in range(32):
            place = (4.0 if i % 4 else -3.0, (i % 8 - 3.5) * 1.2, (i // 8 - 1.5) * 1.2)
            ball = pyvista.Sphere(radius=0.4, center=place, theta_resolution=10, phi_resolution=8)
            plotter.add_mesh(ball, color="tan", opacity=0.5 if i == 0 else 1.0)
        plotter.add_text("balls", font_size=8)
        plotter.camera_position = [(-20, 3, 2), (0, 0, 0), (0, 0, 1)]
    return plotter


@pytest.mark.parametrize(("options", "samples"), [({}, 8), ({"shape": (1, 2)}, 0)], ids=["multisampled", "subplots"])
def test_a_plotter_of_the_user_shows_the_same_picture(options: dict[str, Any], samples: int) -> None:
    plotter = balls(**options)
    if samples:
        plotter.enable_anti_aliasing("msaa", multi_samples=samples)
    plotter.show(auto_close=False)

    def pictures() -> list[Any]:
        out = []
        for azimuth in (5, 40, 0):
            for renderer in plotter.renderers:
                renderer.camera.azimuth = azimuth
            plotter.render()
            out.append(plotter.screenshot(return_img=True))
        return out

    plain = pictures()
    for traversal in TRAVERSALS:
        text = f"frustum | query(least=1, traversal={traversal})"
        drivers = [Driver(renderer, sg.Pipeline.parse(text)) for renderer in plotter.renderers]
        assert all(np.array_equal(a, b) for a, b in zip(pictures(), plain, strict=True))
        for driver in drivers:
            assert not driver.off_because
            assert driver.frame is not None
            assert driver.frame.record.visible < driver.snapshot.n * 0.7
            driver.detach()
    assert all(np.array_equal(a, b) for a, b in zip(pictures(), plain, strict=True))
    plotter.close()


def test_a_window_that_is_resized() -> None:
    snapshot = town().snapshot()
    pipeline = sg.Pipeline([Query(least=1)])
    with OffscreenWindow(200, 100) as window, closing(Device(window)) as device, closing(ItemBuffer(snapshot)) as truth:
        pipeline.open(snapshot, device=device)
        for i in range(2 * TARGETS):
            view = town_views()["above"].resized(200 + 16 * i, 100 + 9 * i)
            window.draw(view)
            assert not (truth.render(view).visible & ~pipeline.run(view).visible).any()
        assert len(device._targets) == TARGETS


def test_two_windows_do_not_mix_their_queries() -> None:
    snapshot, view = wall_scene().snapshot(), wall_views()[0]
    with OffscreenWindow(320, 240) as one, OffscreenWindow(320, 240) as other, ExitStack() as stack:
        first, second = (stack.enter_context(closing(Device(window))) for window in (one, other))
        with first.guard():
            target = first.depth_target(320, 240)
            first.draw_depth(target, view, snapshot)
            ticket = first.queries.issue(view, snapshot.boxes, target)
        with second.guard():
            empty = second.depth_target(320, 240)
            empty.clear()
            free = second.queries.count(view, snapshot.boxes, empty)
            # a ticket of the first window, shown to the second
            assert (second.queries.result(ticket)[~ticket.unknown] == 320 * 240).all()
        with first.guard():
            again = first.queries.result(first.queries.issue(view, snapshot.boxes, target))
        assert (again <= free).all()
        assert (again < free).any()


def test_a_lost_context_begins_anew() -> None:
    snapshot, view = wall_scene().snapshot(), wall_views()[0]
    pipeline = sg.Pipeline([Query(least=1, traversal="coherent")])
    with OffscreenWindow(320, 240) as window, closing(Device(window)) as device:
        before = pipeline.open(snapshot, device=device).run(view).visible
        with device.guard():
            ticket = device.queries.issue(view, snapshot.boxes, device.depth_target(320, 240))
        window.render_window.Finalize()
        window.render_window.Render()
        with device.guard():
            assert (device.queries.result(ticket) == 320 * 240).all()
        assert np.array_equal(pipeline.run(view).visible, before)


def test_a_window_closed_in_the_middle_of_a_frame_is_named() -> None:
    snapshot, view = wall_scene().snapshot(), wall_views()[0]
    window = OffscreenWindow(320, 240)
    device = Device(window)

    class Close(sg.Stage):
        """Closes the window."""

        name = "close_for_tests"
        needs = ("gl",)

        def run(self, frame: sg.Frame) -> None:
            with frame.device.guard():
                target = frame.device.depth_target(320, 240)
                ticket = frame.device.queries.issue(frame.view, frame.snapshot.boxes, target)
                window.close()
                assert (frame.device.queries.result(ticket) == 320 * 240).all()
                frame.device.queries.count(frame.view, frame.snapshot.boxes, target)

    pipeline = sg.Pipeline([Close()]).open(snapshot, device=device)
    with pytest.raises(sg.GLError, match="window of these occlusion queries is closed"):
        pipeline.run(view)
    pipeline.close()
    device.close()


def next_names(device: Device) -> dict[str, int]:
    """The names that OpenGL would give to new objects: higher ones if some were left behind."""
    gl: Any = device.gl
    with device.guard():
        made = {
            "buffer": gl.buffer(reserve=4),
            "texture": gl.texture((1, 1), 1),
            "array": gl.vertex_array(device.queries._boxes._programs["plain"], []),  # type: ignore[union-attr]
        }
        made["frame buffer"] = gl.framebuffer([made["texture"]])
        names = {kind: thing.glo for kind, thing in made.items()}
        for thing in made.values():
            thing.release()
    objects = device.queries.objects
    names["query"] = objects.made if objects is not None else 0
    return names


def kilobytes() -> int:
    """Of memory that this process has in use now."""
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * resource.getpagesize() // 1024


def leaked(frames: int) -> int:
    """Run so many frames of all traversals on a moving camera; the growth of memory in kilobytes over most of them."""
    snapshot = wall_scene().snapshot()
    views = [view.resized(96, 64) for view in wall_views()]
    with OffscreenWindow(96, 64) as window, closing(Device(window)) as device:
        pipelines = [sg.Pipeline([Query(least=1, traversal=t)]).open(snapshot, device=device) for t in TRAVERSALS]

        def run(count: int) -> None:
            for i in range(count):
                pipelines[i % 3].run(views[i // 3 % 3])

        run(60 + frames // 10)
        gc.collect()
        names, memory = next_names(device), kilobytes()
        run(frames)
        gc.collect()
        # Mesa gives no name twice: one more each is what asking for them has cost
        after = next_names(device)
        assert after.pop("query") == names.pop("query")
        assert all(after[kind] <= name + 1 for kind, name in names.items())
        grown = kilobytes() - memory
        for pipeline in pipelines:
            pipeline.close()
    return grown


def test_a_few_hundred_frames_leave_nothing_behind() -> None:
    assert leaked(300) < 4_000


@pytest.mark.slow
def test_ten_thousand_frames_leave_nothing_behind() -> None:
    assert leaked(10_000) < 4_000


PROGRAM = """
import json
import numpy as np
from contextlib import ExitStack, closing
from ctypes.util import find_library
import scenegraph as sg
from scenegraph.render.device import Device
from scenegraph.render.drawing import Drawing
from scenegraph.render.window import OffscreenWindow
from scenegraph.testing import wall_scene, wall_views
from scenegraph_query import Query

snapshot, view = wall_scene().snapshot(), wall_views()[0]
with OffscreenWindow(320, 240) as window, closing(Device(window)) as device:
    window.render_window.SetOffScreenRendering(False)
    Drawing(snapshot, window.renderer)
    window.draw(view)
    image = window.image()
    with device.guard():
        target = device.depth_target(320, 240)
        device.draw_depth(target, view, snapshot)
        counted = device.queries.count(view, snapshot.boxes, target)
        asked = device.queries.result(device.queries.issue(view, snapshot.boxes, target))
    kept = []
    for traversal in ("batched", "coherent", "stop_and_wait"):
        with sg.Pipeline([Query(least=1, traversal=traversal)]).open(snapshot, device=device) as pipeline:
            kept.append([pipeline.run(view).record.visible for _ in range(3)][-1])
    window.draw(view)
    print(json.dumps({
        "window": window.render_window.GetClassName(), "fallback": device.queries.fallback,
        "agree": bool((counted == asked).all()), "hidden": int((counted == 0).sum()), "kept": kept,
        "same": bool((window.image() == image).all()), "error": device.gl.error,
    }))
"""


XVFB = ["xvfb-run", "-a", "-s", "-screen 0 640x480x24"]


@pytest.mark.parametrize(
    ("kind", "before"),
    [
        pytest.param(
            "vtkXOpenGLRenderWindow", XVFB, marks=pytest.mark.skipif(not shutil.which(XVFB[0]), reason=XVFB[0])
        ),
        pytest.param(
            "vtkOSOpenGLRenderWindow", [], marks=pytest.mark.skipif(not find_library("OSMesa"), reason="no libosmesa6")
        ),
    ],
)
def test_in_windows_of_other_kinds(kind: str, before: list[str]) -> None:
    env = {**os.environ, "VTK_DEFAULT_OPENGL_WINDOW": kind}
    command = [*before, sys.executable, "-c", PROGRAM]
    done = subprocess.run(command, env=env, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.strip().splitlines()[-1])
    assert found.pop("hidden") > 3
    kept = found.pop("kept")
    assert kept[0] == kept[1] == kept[2] < 20
    assert found == {"window": kind, "fallback": "", "agree": True, "same": True, "error": "GL_NO_ERROR"}
