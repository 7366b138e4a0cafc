"""The comparison as a table on the terminal."""

from __future__ import annotations

from typing import Any

from rich.table import Table
from rich.text import Text

from scenegraph.compare.results import RunResult
from scenegraph.compare.text import counted, decibel, short

_COLUMNS = (
    "frame ms",
    "speedup",
    "× OPT",
    "cull ms",
    "draw ms",
    "drawables",
    "triangles",
    "false hides",
    "missing px",
    "overestimate",
    "SNR dB",
)


def comparison_table(run: RunResult, summary: dict[str, Any]) -> Table:
    """Lay the summary out: one row per pipeline, and OPT."""
    scene, views = summary["scene"], run.finished_frames
    table = Table(
        title=(
            f"{run.suite}: {counted(scene['drawables'], 'drawable')}, {counted(scene['triangles'], 'triangle')}, "
            f"{counted(views, 'view')} of {run.width} x {run.height}"
        ),
        caption="times: medians; counts: means per view; missing px: worst view; SNR: worst view",
        title_justify="left",
        caption_justify="left",
        title_style="bold",
        caption_style="dim",
        box=None,
        padding=(0, 1, 0, 0),
    )
    table.add_column("pipeline", header_style="dim", no_wrap=True)
    for name in _COLUMNS:
        table.add_column(name, justify="right", header_style="dim")
    for name, p in summary["pipelines"].items():
        table.add_row(
            Text(name, "bold"),
            short(p["frame_ms"]),
            short(p["speedup"]),
            short(p["cost_vs_opt"]),
            "in draw" if p["vtk_culler"] else short(p["cull_ms"]),
            short(p["draw_ms"]),
            short(p["drawn_objects"]),
            short(p["drawn_triangles"]),
            Text(short(p["false_hides"]), "bold red" if p["false_hides_total"] else "green"),
            short(p["missing_pixels_max"]),
            short(p["overestimate"]),
            decibel(p["snr_db_min"]),
        )
    opt = summary["opt"]
    ms = short(opt["frame_ms"])
    drawn = short(opt["drawn_objects"]), short(opt["drawn_triangles"])
    table.add_row("OPT", ms, "", "1", "0", ms, *drawn, "0", "0", "0", "", style="dim")
    return table
