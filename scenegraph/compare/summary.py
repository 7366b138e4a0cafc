"""`summary.json`: the numbers of a run, means over frames unless the name says otherwise, times as medians.

An image that equals its reference has an SNR of +inf dB, which the file spells as `scenegraph.json_text` does.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from scenegraph.compare.metrics import decibels, share, spread
from scenegraph.compare.results import FrameResult, PipelineResult, RunResult
from scenegraph.stage import Guarantee

_HIDE_NOTHING_VISIBLE = (Guarantee.EXACT.value, Guarantee.CONSERVATIVE.value)


def summarize(run: RunResult) -> dict[str, Any]:
    """Make the content of `summary.json`."""
    base = [f.frame_ms for f in run.baseline.frames]
    opt = [f.frame_ms for f in run.opt]
    return {
        "suite": run.suite,
        "scene": run.scene,
        "machine": run.machine,
        "quick": run.quick,
        "interrupted": run.interrupted,
        "planned_frames": run.planned_frames,
        "view": {"width": run.width, "height": run.height, "truth_supersample": run.supersample},
        "pipelines": {name: _pipeline(p, base, opt) for name, p in run.pipelines.items()},
        "opt": {
            "frame_ms": spread(opt).median,
            "drawn_objects": _mean([f.objects for f in run.opt]),
            "drawn_triangles": _mean([f.triangles for f in run.opt]),
        },
        "preparation_ms": {**run.preparation, "truth_per_view": spread(run.truth_ms).median},
        "memory_bytes": run.memory,
        "notes": run.notes,
        "command": run.command,
    }


def paired_ratios(baseline: list[float], times: list[float]) -> list[float]:
    """Divide frame by frame: the load of the machine is the same for both, so this varies little."""
    return [b / t for b, t in zip(baseline, times, strict=False) if t > 0]


def _pipeline(p: PipelineResult, base: list[float], opt: list[float]) -> dict[str, Any]:
    def values(get: Callable[[FrameResult], float]) -> list[float]:
        return [get(f) for f in p.frames]

    frame = spread(values(lambda f: f.frame_ms))
    snr = decibels(values(lambda f: f.snr_db))
    psnr = decibels(values(lambda f: f.psnr_db))
    ratios = spread(paired_ratios(base, values(lambda f: f.frame_ms)))
    visible = sum(f.visible_objects for f in p.frames)
    return {
        "text": p.text,
        "draw": p.draw,
        "vtk_culler": p.vtk_culler,
        "guarantee": p.guarantee,
        "guarantees": p.guarantees,
        "claim_is_broken": p.guarantee in _HIDE_NOTHING_VISIBLE and any(f.false_hides for f in p.frames),
        "stages": [_stage(p, i) for i in range(len(p.frames[0].stages) if p.frames else 0)],
        "frames": len(p.frames),
        "drawn_objects": _mean(values(lambda f: f.drawn_objects)),
        "drawn_triangles": _mean(values(lambda f: f.drawn_triangles)),
        "cull_ms": spread(values(lambda f: f.cull_ms)).median,
        "host_ms": spread(values(lambda f: f.host_ms)).median,
        "draw_ms": spread(values(lambda f: f.draw_ms)).median,
        "apply_ms": spread(values(lambda f: f.apply_ms)).median,
        "frame_ms": frame.median,
        "frame_ms_quartiles": [frame.low, frame.high],
        "frame_ms_p95": frame.p95,
        "false_hides": _mean(values(lambda f: f.false_hides)),
        "false_hides_total": sum(f.false_hides for f in p.frames),
        "false_hides_max": max((f.false_hides for f in p.frames), default=0),
        "false_hides_of_visible": share(sum(f.false_hides for f in p.frames), visible),
        "longest_missing_streak": p.longest_streak,
        "missing_pixels": _mean(values(lambda f: f.missing_pixels)),
        "missing_pixels_p95": spread(values(lambda f: f.missing_pixels)).p95,
        "missing_pixels_max": max((f.missing_pixels for f in p.frames), default=0.0),
        "overestimate": _mean(values(lambda f: f.overestimate)),
        "overestimate_of_visible": share(sum(f.overestimate for f in p.frames), visible),
        "wrong_pixels": _mean(values(lambda f: f.wrong_pixels)),
        "wrong_pixels_max": max((f.wrong_pixels for f in p.frames), default=0),
        "snr_db_min": snr.minimum,
        "snr_db_mean_of_finite": snr.mean_of_finite,
        "snr_db_p5": snr.p5,
        "equal_frames": snr.equal_frames,
        "psnr_db_min": psnr.minimum,
        "ssim_min": min((f.ssim for f in p.frames), default=float("nan")),
        "metrics": _plugin_metrics(p),
        "level_pops": _mean(values(lambda f: f.level_pops)),
        "speedup": share(spread(base).median, frame.median),
        "speedup_quartiles": [ratios.low, ratios.high],
        "cost_vs_opt": share(frame.median, spread(opt).median),
        "open_ms": p.open_ms,
        "upload_ms": p.upload_ms,
        "first_frame_ms": p.first_frame_ms,
        "memory_bytes": p.memory_bytes,
    }


def _plugin_metrics(p: PipelineResult) -> dict[str, dict[str, float]]:
    names = p.frames[0].metrics if p.frames else {}
    return {name: spread([f.metrics[name] for f in p.frames]).to_dict() for name in names}


def _stage(p: PipelineResult, index: int) -> dict[str, Any]:
    shares = [f.stages[index] for f in p.frames]
    return {
        "name": shares[0].name,
        "ms": spread([s.ms for s in shares]).median,
        "tested": _mean([s.tested for s in shares]),
        "hidden": _mean([s.hidden for s in shares]),
        "coarsened": _mean([s.coarsened for s in shares]),
        "skipped_frames": sum(s.skipped is not None for s in shares),
    }


def _mean(values: list[float] | list[int]) -> float:
    return float(np.mean(values)) if values else float("nan")
