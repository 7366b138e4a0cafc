"""How often llvmpipe frees a fence of which one of its threads still holds the lock; see docs/drawing.md.

    python tests/bench/llvmpipe_fences.py

Needs Linux, a C compiler, and Mesa's llvmpipe. A library loaded before all others makes its threads release locks late,
which widens a gap of two instructions until it shows, and counts locks that are destroyed meanwhile.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack, closing
from pathlib import Path

import numpy as np

LATE = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <time.h>

#define MANY 64
static int (*unlock)(pthread_mutex_t *), (*destroy)(pthread_mutex_t *);
static pthread_mutex_t *_Atomic held[MANY];
static _Atomic long early;
static __thread int is_worker = -1;

static void report(void) { fprintf(stderr, "fences freed early: %ld\n", early); }

static void start(void) {
    if (unlock) return;
    destroy = dlsym(RTLD_NEXT, "pthread_mutex_destroy");
    unlock = dlsym(RTLD_NEXT, "pthread_mutex_unlock");
    atexit(report);
}

int pthread_mutex_destroy(pthread_mutex_t *lock) {
    start();
    for (int i = 0; i < MANY; i++) early += held[i] == lock;
    return destroy(lock);
}

int pthread_mutex_unlock(pthread_mutex_t *lock) {
    start();
    if (is_worker < 0) {
        char name[17] = {0};
        prctl(PR_GET_NAME, name);
        is_worker = !strncmp(name, "llvmpipe", 8);
    }
    if (!is_worker) return unlock(lock);
    int slot = 0;
    for (pthread_mutex_t *none = NULL; slot < MANY; slot++, none = NULL)
        if (atomic_compare_exchange_strong(&held[slot], &none, lock)) break;
    struct timespec late = {0, atol(getenv("LATE_US")) * 1000};
    nanosleep(&late, NULL);
    int result = unlock(lock);
    if (slot < MANY) held[slot] = NULL;
    return result;
}
"""


def queries(resting: int, seconds: float) -> str:
    """One query at a time in two windows, with so many names that rest."""
    import scenegraph as sg
    from scenegraph.render import query_objects
    from scenegraph.render.device import Device
    from scenegraph.render.window import OffscreenWindow

    query_objects._RESTING = resting
    wall = sg.Scene(sg.Group(sg.Geode(sg.Mesh.box((-9, 0, -7), (9, 1, 7))))).snapshot()
    view = sg.View((0, -12, 0), (0, 0, 0), near=0.1, far=200, width=320, height=240, fov=75)
    rng = np.random.default_rng(1)
    centers = rng.uniform([[-30], [-2], [-20]], [[30], [60], [20]], (3, 64))
    boxes = np.concatenate([centers, rng.uniform(0.05, 0.6, (3, 64))])
    asked, end = 0, time.monotonic() + seconds
    with ExitStack() as stack:
        windows = [stack.enter_context(OffscreenWindow(320, 240)) for _ in range(2)]
        devices = [stack.enter_context(closing(Device(window))) for window in windows]
        while time.monotonic() < end:
            for device in devices:
                with device.guard():
                    target = device.depth_target(320, 240)
                    device.draw_depth(target, view, wall)
                    for i in range(64):
                        ticket = device.queries.issue(view, boxes[:, i : i + 1], target)
                        while not device.queries.ready(ticket).all():
                            pass
                        device.queries.result(ticket)
                        asked += 1
    return f"{asked} queries"


def plots(seconds: float) -> str:
    """Two plotters without this package."""
    import pyvista as pv

    plotters = [pv.Plotter(off_screen=True, window_size=(200, 150)) for _ in range(2)]
    for plotter in plotters:
        plotter.add_mesh(pv.Sphere())
        plotter.show(auto_close=False)
    frames, end = 0, time.monotonic() + seconds
    while time.monotonic() < end:
        for plotter in plotters:
            plotter.camera.azimuth += 1
            plotter.render()
            frames += 1
            if frames % 5 == 0:
                plotter.screenshot(None, return_img=True)
    return f"{frames} frames"


def main() -> None:
    """Each program in an interpreter of its own."""
    if len(sys.argv) > 1:
        resting = int(sys.argv[1])
        print(plots(20.0) if resting < 0 else queries(resting, 20.0), flush=True)
        return
    with tempfile.TemporaryDirectory() as folder:
        source, library = Path(folder, "late.c"), Path(folder, "late.so")
        source.write_text(LATE, encoding="ascii")
        subprocess.run(["cc", "-O2", "-shared", "-fPIC", "-o", library, source, "-ldl"], check=True)
        reused = {"GLIBC_TUNABLES": "glibc.malloc.tcache_count=0:glibc.malloc.mxfast=0"}
        for title, resting, late, more in (
            ("used again at once, 0.3 ms late", 0, 300, {}),
            ("the same, freed blocks put to use at once", 0, 300, reused),
            ("resting, 0.3 ms late", 256, 300, {}),
            ("resting, freed blocks put to use at once", 256, 300, reused),
            ("PyVista alone, 1 ms late", -1, 1000, {}),
        ):
            env = os.environ | more | {"LD_PRELOAD": str(library), "LATE_US": str(late)}
            done = subprocess.run([sys.executable, __file__, str(resting)], env=env, capture_output=True, text=True)
            said = [*done.stdout.splitlines(), *(line for line in done.stderr.splitlines() if "freed early" in line)]
            print(f"{title}: {', '.join(said) or 'crashed'} (exit {done.returncode})", flush=True)


if __name__ == "__main__":
    main()
