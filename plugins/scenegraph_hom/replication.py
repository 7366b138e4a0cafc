"""Figures 3.1, 4.6, 4.7, 4.9 and 4.10 of Kristmann 2022, measured here.

Triangles are counted at the thesis' tessellation, level 20, of which 294 and 588 million make a frame; nothing of that
is drawn. Frame times and pictures are measured at a lower ceiling, because drawing hundreds of millions of triangles
takes a GPU of the thesis' kind: the scenes, the views, the occluders and the maps are the same, and the levels that a
drawable may have are fewer.

What has no counterpart here: the milliseconds of a GTX 1070 Ti, the survey among five people, and the sizes of the
thesis' scenes, which it does not print.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from scenegraph.compare.metrics import window_sums
from scenegraph.compare.replication import Cell, CountedRun, Laboratory, Plot, Replication

from .holes import holes_cells

#: Tessellation of what is drawn, and views per path of it.
DRAWN_CEILING, DRAWN_FRAMES = 2, 16
#: Frames over which no pipeline may be slower than frustum culling alone.
WINDOW = 30
SIZE = (1024, 768)


@dataclass(frozen=True)
class _Scene:
    name: str
    triangles: int
    times: str
    counts: str
    #: The path on which all or most of the scene is seen from outside, and its name in the tables.
    outside: str
    #: Occluders that are drawn: where little is covered, few pay.
    active: int
    #: Nearest points closer than this make occluders in the thesis' way.
    reach: float


_SCENES = (
    _Scene("bunnies-5001", 294_058_800, "Figure 4.6", "Figure 4.7", "orbit", 2000, 46.0),
    _Scene("bunnies-10001", 588_058_800, "Figure 4.9", "Figure 4.10", "approach", 1000, 100.0),
)
#: Left of the dense scene in Figure 4.4.
_LEFT = 132_872_418


def replicate(laboratory: Laboratory) -> Replication:
    """Count both walks at full tessellation, draw them at a lower one, and look through the holes of Figure 3.1."""
    found = Replication(
        "kristmann2022",
        "Occluder Frequency Analysis for Evaluating the Level of Visibility of Partly Occluded Objects "
        "(Kristmann 2022, on Zhang et al. 1997)",
    )
    model = "" if laboratory.model is None else str(laboratory.model)
    found.remarks.append(
        f"The bunny of 98 triangles is made of {laboratory.model.name} by edge collapse."
        if laboratory.model is not None
        else "The bunny of 98 triangles is a stand-in; give --model a file of the Stanford bunny for the real one."
    )
    for scene in _SCENES:
        counted = laboratory.count(scene.name, _counted_suite(scene, model))
        _report_counts(found, scene, counted)
        drawn = laboratory.run(scene.name, _drawn_suite(scene, model))
        _report_times(found, scene, drawn["pipelines"], laboratory)
        _report_computed(found, scene, counted, laboratory)
    cells, remarks = holes_cells(laboratory, model)
    found.cells += cells
    found.remarks += remarks
    return found


def _pipelines(scene: _Scene) -> dict[str, str]:
    size = f"width=1024, height=512, active={scene.active}, triangles=400000"
    # by default, what is hidden is proved to be
    ours = f"hom({size}, outlines=False)"
    printed = (
        f"hom({size}, ranking='distance', reach={scene.reach}, depth='distance', test='pyramid', strict=False, "
        "coarsest=True)"
    )
    return {
        "frustum": "frustum",
        "HOM": f"frustum | {ours}",
        "HOM+LV": f"frustum | {ours} | lod_visibility",
        "HOM as printed": f"frustum | {printed}",
        "HOM+LV as printed": f"frustum | {printed} | lod_visibility",
    }


def _suite(scene: _Scene, model: str, what: str) -> dict[str, Any]:
    return {
        "name": f"kristmann2022 {scene.name}, {what}",
        "summary": "Occlusion maps with and without the level of visibility, against frustum culling.",
        "scene": {"name": scene.name, "options": {"model": model}},
        "width": SIZE[0],
        "height": SIZE[1],
    }


def _counted_suite(scene: _Scene, model: str) -> dict[str, Any]:
    suite = _suite(scene, model, "counted")
    suite["scene"]["options"]["ceiling"] = 20
    return suite | {
        "frames": 50,
        "pipelines": [{"name": name, "stages": text} for name, text in _pipelines(scene).items()],
        "warmup": 1,
        "quick": {"frames": 10},
    }


def _drawn_suite(scene: _Scene, model: str) -> dict[str, Any]:
    suite = _suite(scene, model, f"drawn at tessellation level {DRAWN_CEILING}")
    suite["scene"]["options"]["ceiling"] = DRAWN_CEILING
    stages = _pipelines(scene)
    pipelines = [
        {"name": "frustum", "stages": stages["frustum"]},
        # the same once more: what differs is noise
        {"name": "frustum, again", "stages": stages["frustum"]},
        {"name": "HOM", "stages": stages["HOM"]},
        # skips itself where it does not pay, which the thesis' does not
        {"name": "HOM+LV", "stages": stages["HOM+LV"], "adaptive": True},
    ]
    return suite | {
        "frames": DRAWN_FRAMES,
        "pipelines": pipelines,
        # as many frames as a stage is on trial
        "warmup": 3,
        "quick": {"frames": 4, "seconds": 60},
    }


def _report_counts(found: Replication, scene: _Scene, run: CountedRun) -> None:
    table = f"{scene.counts}, triangles counted at tessellation level 20"
    found.cells.append(Cell(table, scene.name, "whole scene", "Triangles", "", scene.triangles, run.triangles))
    whole = run.triangles
    outside = run.on(scene.outside)
    rest = [i for i, path in enumerate(run.paths) if path != scene.outside]
    base = np.array(run.pipelines["HOM"].triangles, float)
    for name, path in run.pipelines.items():
        triangles = np.array(path.triangles, float)
        for part, views in ((f"outside ({scene.outside})", outside), ("inside", rest)):
            left = 100 * triangles[views].mean() / whole
            found.cells.append(Cell(table, scene.name, name, f"Left, {part}", "%", None, left))
        if name == "HOM+LV":
            beyond = 100 * (1 - triangles[outside] / base[outside])
            paper = 30.0 if scene is _SCENES[0] else None
            found.cells.append(
                Cell(table, scene.name, name, "Removed beyond HOM, outside, mean", "%", None, beyond.mean())
            )
            found.cells.append(
                Cell(table, scene.name, name, "Removed beyond HOM, outside, most", "%", paper, beyond.max())
            )
        if name.startswith("HOM+LV") and scene is _SCENES[0]:
            found.cells.append(
                Cell(table, scene.name, name, "Triangles, a view of the front", "", _LEFT, triangles[outside[0]])
            )
        found.cells.append(Cell(table, scene.name, name, "Culling", "ms", None, float(np.median(path.cull_ms))))
        found.cells.append(Cell(table, scene.name, name, "Level pops a frame", "", None, float(np.mean(path.pops))))
    found.plots.append(
        Plot(
            f"{scene.counts}: triangles left, {scene.name}",
            "% of the scene's triangles",
            {name: [100 * t / whole for t in path.triangles] for name, path in run.pipelines.items()},
            f"Of {whole:,} triangles at tessellation level 20, counted.".replace(",", " "),
            run.paths,
        )
    )
    mean = float((1 - np.array(run.pipelines["HOM+LV"].triangles)[outside] / base[outside]).mean())
    found.remarks.append(
        f"{scene.name}: outside, the level of visibility removes {mean:.1%} of the triangles that HOM leaves"
        f"{' (aim: 30 %)' if scene is _SCENES[0] else ''}."
    )


def _report_times(found: Replication, scene: _Scene, pipelines: dict[str, Any], laboratory: Laboratory) -> None:
    table = f"{scene.times}, drawn at tessellation level {DRAWN_CEILING}"
    results = laboratory.results[scene.name].pipelines
    times = {name: [f.frame_ms for f in result.frames] for name, result in results.items()}
    window = WINDOW if not laboratory.quick else max(1, len(times["frustum"]) // 2)
    base = window_sums(times["frustum"], window)
    for name, result in pipelines.items():
        values = {
            ("Frame", "ms"): result["frame_ms"],
            (f"Slowest {window} frames to frustum alone", "×"): float(
                (window_sums(times[name], window) / base).max(initial=0.0)
            ),
            ("False hides", ""): result["false_hides_total"],
            ("SNR, worst", "dB"): result["snr_db_min"],
            ("SSIM, worst", ""): min(f.ssim for f in results[name].frames),
            ("Level pops a frame", ""): float(np.mean([f.level_pops for f in results[name].frames])),
        }
        for (column, unit), value in values.items():
            if value is not None:
                found.cells.append(Cell(table, scene.name, name, column, unit, None, value))
    found.plots.append(
        Plot(
            f"{scene.times}: frame time, {scene.name}",
            "ms per frame",
            times,
            f"Culling and drawing on this machine, tessellated up to level {DRAWN_CEILING} instead of 20.",
            [f.path for f in results["frustum"].frames],
        )
    )
    worst = {name: float((window_sums(times[name], window) / base).max(initial=0.0)) for name in times}
    for name in ("HOM", "HOM+LV"):
        verdict = "never slower than" if worst[name] <= 1.0 else "at worst slower than"
        found.remarks.append(
            f"{scene.name}: {name} is {verdict} frustum culling alone over {window} frames "
            f"(at most {worst[name]:.2f} × its time, where a second run of frustum culling takes at most "
            f"{worst['frustum, again']:.2f} ×; drawn at level {DRAWN_CEILING})."
        )


def _report_computed(found: Replication, scene: _Scene, counted: CountedRun, laboratory: Laboratory) -> None:
    """What a frame would take at level 20: culling as measured there, and triangles at what they cost when drawn."""
    frames = laboratory.results[scene.name].pipelines["frustum"].frames
    rate = sum(f.draw_ms for f in frames) / max(sum(f.drawn_triangles for f in frames), 1)
    times = {
        name: np.array(path.cull_ms) + rate * np.array(path.triangles, float)
        for name, path in counted.pipelines.items()
    }
    window = min(WINDOW, len(counted.views))
    base = window_sums(times["frustum"].tolist(), window)
    table = f"{scene.times}, computed for tessellation level 20 at the rate of level {DRAWN_CEILING}"
    for name, values in times.items():
        slowest = float((window_sums(values.tolist(), window) / base).max(initial=0.0))
        found.cells.append(Cell(table, scene.name, name, "Frame", "ms", None, float(np.median(values))))
        found.cells.append(
            Cell(table, scene.name, name, f"Slowest {window} frames to frustum alone", "×", None, slowest)
        )
    share = float(np.median(counted.pipelines["HOM+LV"].cull_ms) / np.median(times["HOM+LV"]))
    found.remarks.append(
        f"{scene.name}: at level 20 and {1e6 * rate:.0f} ms per million triangles, culling would be {share:.2%} of a "
        "frame of HOM+LV."
    )
