"""Run a suite: every pipeline on every view, one view after the other, judged against the truth of that view.

On a shared machine only ratios can be trusted. So the pipelines take turns on each view in one process, in turning
order, and what is not timed (truth, image comparison, garbage collection) happens between the timed parts.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter

import numpy as np

from scenegraph.compare.arena import Arena
from scenegraph.compare.machine import describe_machine, peak_memory
from scenegraph.compare.results import RunResult
from scenegraph.compare.sources import PathView, build_scene, camera_paths, thinned
from scenegraph.compare.suite import Suite
from scenegraph.errors import SceneError
from scenegraph.log import FrameLog
from scenegraph.progress import Progress, silent
from scenegraph.registry import Registry
from scenegraph.snapshot import Snapshot


def run_suite(
    suite: Suite, registry: Registry, *, log: FrameLog, quick: bool = False, tell: Progress = silent
) -> RunResult:
    """Run a suite.

    Parameters
    ----------
    suite : Suite
    registry : Registry
    log : FrameLog
        Gets every frame as soon as all pipelines have finished its view.
    quick : bool
        Recorded in the result; the caller has already shortened the suite.
    tell : callable, optional
        Called with what is being done, and the share of the views that is done.

    Returns
    -------
    RunResult
        As far as it came: Ctrl-C while views are being drawn ends the run early, and `interrupted` says so.

    Raises
    ------
    ScenegraphError
        The scene cannot be built or has no such path, or there is no OpenGL.
    """
    from scenegraph.render.probe import require_gl

    gl = require_gl()
    laps: dict[str, float] = {}
    tell("building the scene", 0.0)
    with _lap(laps, "load or build the scene"):
        scene = build_scene(suite, registry)
    with _lap(laps, "snapshot"):
        snapshot = scene.snapshot()
    if not snapshot.n:
        raise SceneError(f"the scene {scene.name!r} has no drawables; add a mesh with at least one triangle")
    with _lap(laps, "camera paths"):
        views = camera_paths(suite, snapshot)
    run = RunResult(
        suite=suite.name,
        summary=suite.summary,
        quick=quick,
        scene={
            "name": scene.name,
            "drawables": snapshot.n,
            "triangles": int(snapshot.triangles[0].sum(dtype=np.int64)),
            "distinct_meshes": len(snapshot.meshes),
            "problems": list(scene.problems),
        },
        machine=describe_machine(gl),
        preparation=laps,
        pipelines={},
        planned_frames=len(views),
        width=suite.width,
        height=suite.height,
        supersample=suite.supersample,
        memory=_memory(snapshot),
    )
    with Arena(suite, registry, snapshot, run) as arena:
        with _lap(laps, "open pipelines and windows"):
            arena.open(tell)
        with _lap(laps, "warm-up"):
            seconds = _warm_up(arena, views[0], suite, tell)
        first = run.baseline
        made = first.open_ms + first.upload_ms + first.first_frame_ms
        laps["from the scene's source to the first frame"] = laps["load or build the scene"] + laps["snapshot"] + made
        chosen = _affordable(run, views, suite.seconds, seconds)
        with _lap(laps, "all views"), _collected_between_frames() as collect:
            try:
                for index, view in enumerate(chosen):
                    tell(f"{view.path}, view {index + 1} of {len(chosen)}", index / len(chosen))
                    arena.draw(view, index, log)
                    collect()
            except KeyboardInterrupt:
                run.interrupted = True
                run.trim()
        tell("looking from above", 1.0)
        with _lap(laps, "pictures from above"):
            arena.finish()
    run.memory["whole process, at its peak"] = peak_memory()
    return run


def _warm_up(arena: Arena, view: PathView, suite: Suite, tell: Progress) -> float:
    """Draw the first view without keeping its numbers; the seconds of the last, quickest round."""
    seconds = spent = 0.0
    for i in range(suite.warmup):
        tell(f"warming up, {i + 1} of {suite.warmup}", 0.0)
        start = perf_counter()
        arena.warm_up(view)
        seconds = perf_counter() - start
        spent += seconds
        if suite.seconds is not None and spent > suite.seconds / 2:
            break
    return seconds


def _affordable(run: RunResult, views: list[PathView], limit: float | None, each: float) -> list[PathView]:
    """Drop views, evenly, until the rest fits into the time limit; one stays in any case."""
    if limit is None or not each or len(views) * each <= limit:
        return views
    affordable = max(int(limit / each), 1)
    if affordable < len(views):
        run.notes.append(
            f"{affordable} of {len(views)} views drawn: one takes {each:.1f} s with all pipelines, "
            f"and the suite allows {limit:g} s."
        )
        run.planned_frames = affordable
    return [views[i] for i in thinned(len(views), affordable)]


def _memory(snapshot: Snapshot) -> dict[str, int]:
    """Bytes of the snapshot's arrays; occluders apart, because they do not grow with the drawables."""
    sizes = snapshot.memory()
    occluders = sizes.pop("occluders")
    rows = sum(sizes.values())
    return {"snapshot": rows, "snapshot, per drawable": round(rows / snapshot.n), "occluders": occluders}


@contextmanager
def _lap(laps: dict[str, float], name: str) -> Iterator[None]:
    start = perf_counter()
    yield
    laps[name] = 1e3 * (perf_counter() - start)


@contextmanager
def _collected_between_frames() -> Iterator[Callable[[], int]]:
    """Keep Python's garbage collector out of the timed parts; the caller collects between views."""
    gc.collect()
    # What lives now lives to the end: collections between views need not look at it.
    gc.freeze()
    gc.disable()
    try:
        yield gc.collect
    finally:
        gc.enable()
        gc.unfreeze()
