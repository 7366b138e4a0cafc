"""The report's plots: matplotlib drawings as inline SVG whose colors are the page's CSS variables.

A plot is drawn with stand-in colors, which `_svg` replaces by `var(--...)`; so one drawing serves the light and
the dark page, and text takes the page's font.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from io import StringIO
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

from scenegraph.compare.metrics import spread
from scenegraph.compare.results import FrameResult, RunResult
from scenegraph.compare.text import short

# Stand-ins of the page's colors; the template defines what they are by day and by night.
_NAMES = {"ink": "#fe0100", "soft": "#fe0101", "line": "#fe0102", "page": "#fe0103", "alarm": "#fe0104"}
_SERIES, _STAGES = 7, 5
_NAMES |= {f"series-{i}": f"#fe02{i:02x}" for i in range(_SERIES)}
_NAMES |= {f"stage-{i}": f"#fe03{i:02x}" for i in range(_STAGES)}
_DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1.5, 1.2)), (0, (6, 1.5, 1.5, 1.5)))
_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "scenegraph",
    "font.size": 9.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.spines.left": False,
    "axes.edgecolor": _NAMES["line"],
    "axes.labelcolor": _NAMES["soft"],
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.grid.axis": "y",
    "grid.color": _NAMES["line"],
    "grid.linewidth": 0.7,
    "text.color": _NAMES["ink"],
    "xtick.color": _NAMES["soft"],
    "ytick.color": _NAMES["soft"],
    "xtick.major.size": 0,
    "ytick.major.size": 0,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "legend.frameon": False,
}
Series = tuple[str, Sequence[float], str, Any]


def plots(run: RunResult) -> dict[str, str]:
    """Draw all plots of a run: SVG by name. Empty where nothing was finished."""
    if not run.finished_frames:
        return {}
    with matplotlib.rc_context(_STYLE):
        return {
            "times": _path_plot(run, lambda f: f.frame_ms, [f.frame_ms for f in run.opt], "ms per frame"),
            "triangles": _path_plot(
                run, lambda f: f.drawn_triangles, [f.triangles for f in run.opt], "triangles drawn"
            ),
            "stages": _stage_plot(run),
            "opt": _opt_plot(run),
            "false_hides": _false_hide_plot(run),
        }


def series_color(run: RunResult, name: str) -> int:
    """Give a pipeline its color of the page; the baseline has 0, a gray."""
    index = list(run.pipelines).index(name)
    return 0 if index == 0 else 1 + (index - 1) % (_SERIES - 1)


def _path_plot(run: RunResult, get: Callable[[FrameResult], float], opt: Sequence[float], unit: str) -> str:
    """Values of every frame, and of OPT."""
    series: list[Series] = [("OPT", opt, _NAMES["ink"], (0, (1, 2)))]
    for index, (name, p) in enumerate(run.pipelines.items()):
        color = _NAMES[f"series-{series_color(run, name)}"]
        series.append((name, [float(get(f)) for f in p.frames], color, _DASHES[index % len(_DASHES)]))
    paths = [f.path for f in run.baseline.frames]
    return _lines(paths, series, unit, max(len(paths), run.finished_frames))


def path_plot(paths: Sequence[str], series: Mapping[str, Sequence[float]], unit: str) -> str:
    """Draw values along camera paths: SVG for the page.

    Parameters
    ----------
    paths : sequence of str
        Name of the path that each view belongs to; empty for a single one.
    series : mapping of str to sequence of float
        One value per view; NaN where there is none.
    unit : str
    """
    count = max((len(values) for values in series.values()), default=0)
    if not count:
        return ""
    lines: list[Series] = []
    for index, (name, values) in enumerate(series.items()):
        color = _NAMES[f"series-{0 if index == 0 else 1 + (index - 1) % (_SERIES - 1)}"]
        lines.append((name, list(values), color, _DASHES[index % len(_DASHES)]))
    with matplotlib.rc_context(_STYLE):
        return _lines(list(paths) or [""] * count, lines, unit, count)


def _lines(paths: Sequence[str], series: Sequence[Series], unit: str, count: int) -> str:
    """Lines along the path, each named at its right end, so that color is never the only key."""
    figure, axes = _figure(7.6, 3.1)
    figure.subplots_adjust(right=0.97 - _text_width([name for name, *_ in series]))
    highest = float(np.nanmax(np.concatenate([np.asarray(values, float) for _, values, _, _ in series])))
    lowest = float(np.nanmin(np.concatenate([np.asarray(values, float) for _, values, _, _ in series])))
    logarithmic = lowest > 0 and highest > 15 * lowest
    for _, values, color, dash in series:
        marker = "o" if len(values) <= 24 else ""
        axes.plot(range(len(values)), values, color=color, ls=dash, lw=1.6, marker=marker, ms=2.6)
    if logarithmic:
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_minor_locator(NullLocator())
    else:
        axes.set_ylim(0, highest * 1.06 or 1.0)
    axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _p: short(v)))
    axes.set_title(unit + (", logarithmic" if logarithmic else ""), loc="left", fontsize=9.5, color=_NAMES["soft"])
    _frame_axis(paths, axes, count)
    _name_at_end(axes, series)
    return _svg(figure, f"{unit} along the camera path")


def _stage_plot(run: RunResult) -> str:
    """Stacked bars of what culling costs: the median of each stage, then the host's share."""
    shown = [p for p in run.pipelines.values() if p.frames and p.frames[0].stages]
    if not shown:
        return ""
    stage_names = list(dict.fromkeys(s.name for p in shown for s in p.frames[0].stages))
    figure, axes = _figure(7.6, 0.5 + 0.42 * len(shown), top=0.05)
    longest = 0.0
    for row, p in enumerate(shown):
        left = 0.0
        parts = [(s.name, spread([f.stages[i].ms for f in p.frames]).median) for i, s in enumerate(p.frames[0].stages)]
        parts.append(("host", spread([f.host_ms for f in p.frames]).median))
        for name, ms in parts:
            color = "line" if name == "host" else f"stage-{stage_names.index(name) % _STAGES}"
            axes.barh(row, ms, left=left, height=0.5, color=_NAMES[color], edgecolor=_NAMES["page"], lw=1)
            left += ms
        label = f"{short(left)} ms: " + ", ".join(f"{n} {short(ms)}" for n, ms in parts)
        _beside(axes, left, row, label)
        longest = max(longest, left)
    axes.set_xlim(0, longest * 2.6 or 1.0)
    _rows(axes, [p.name for p in shown])
    return _svg(figure, "Median culling time per stage")


def _opt_plot(run: RunResult) -> str:
    """Bars of the frame time, culling and drawing, against the time of drawing only what is visible."""
    figure, axes = _figure(7.6, 0.75 + 0.42 * len(run.pipelines))
    opt = spread([f.frame_ms for f in run.opt])
    right = opt.median
    for row, (name, p) in enumerate(run.pipelines.items()):
        cull = spread([f.cull_ms for f in p.frames]).median
        frame = spread([f.frame_ms for f in p.frames])
        color = _NAMES[f"series-{series_color(run, name)}"]
        axes.barh(row, frame.median, height=0.5, color=color, alpha=0.55, lw=0)
        axes.barh(row, min(cull, frame.median), height=0.5, color=color, lw=0)
        axes.plot([frame.low, frame.high], [row, row], color=_NAMES["ink"], lw=1.1, solid_capstyle="butt")
        times = f"{short(frame.median)} ms, {short(frame.median / opt.median)} × OPT" if opt.median else ""
        _beside(axes, max(frame.median, frame.high), row, times)
        right = max(right, frame.median, frame.high)
    axes.axvline(opt.median, color=_NAMES["ink"], lw=1.1, ls=(0, (1, 2)))
    axes.text(opt.median, -0.68, f"OPT {short(opt.median)} ms", ha="left", va="bottom", fontsize=9)
    axes.set_xlim(0, right * 1.3 or 1.0)
    _rows(axes, list(run.pipelines))
    return _svg(figure, "Median frame time against drawing exactly the visible set")


def _false_hide_plot(run: RunResult) -> str:
    """One strip per pipeline: a bar wherever something visible was hidden, higher for more drawables."""
    figure, axes = _figure(7.6, 0.55 + 0.42 * len(run.pipelines), top=0.05)
    most = max((f.false_hides for p in run.pipelines.values() for f in p.frames), default=0)
    for row, p in enumerate(run.pipelines.values()):
        counts = np.array([f.false_hides for f in p.frames], float)
        axes.axhline(row + 0.32, color=_NAMES["line"], lw=0.7)
        heights = -0.62 * counts / most if most else counts
        axes.bar(range(len(counts)), heights, bottom=row + 0.32, width=0.55, color=_NAMES["alarm"], lw=0)
        total, worst = int(counts.sum()), int(counts.max(initial=0))
        text = f"{total} in all, at most {worst} in a frame" if total else "no false hides"
        axes.text(1.012, row + 0.1, text, transform=axes.get_yaxis_transform(), fontsize=9, color=_NAMES["soft"])
    _rows(axes, list(run.pipelines))
    _frame_axis([f.path for f in run.baseline.frames], axes, run.finished_frames)
    figure.subplots_adjust(right=0.72)
    return _svg(figure, "Falsely hidden drawables in each frame")


# Shared parts


def _figure(width: float, height: float, top: float = 0.3) -> tuple[Figure, Axes]:
    """Make a figure of a size in inches, with room for a line of text above where `top` says so."""
    figure = Figure(figsize=(width, height))
    axes = figure.add_subplot()
    figure.subplots_adjust(left=0.075, right=0.83, top=1 - top / height, bottom=0.42 / height)
    return figure, axes


def _frame_axis(paths: Sequence[str], axes: Axes, count: int) -> None:
    axes.set_xlim(-0.5, count - 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(8, integer=True))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda v, _p: f"{v:.0f}"))
    axes.grid(False, axis="x")
    starts = [i for i, path in enumerate(paths) if i == 0 or path != paths[i - 1]]
    for start in starts:
        if start:
            axes.axvline(start - 0.5, color=_NAMES["line"], lw=0.8)
        name = paths[start]
        axes.annotate(
            f"{name}, frame" if start == 0 else name,
            (start - 0.5, 0),
            xycoords=("data", "axes fraction"),
            xytext=(2, -24),
            textcoords="offset points",
            fontsize=9,
            color=_NAMES["soft"],
        )


def _beside(axes: Axes, x: float, row: int, text: str) -> None:
    axes.annotate(
        text, (x, row), xytext=(7, 0), textcoords="offset points", va="center", fontsize=9, color=_NAMES["soft"]
    )


def _text_width(texts: Iterable[str]) -> float:
    """Share of the figure's width that the longest of some texts takes, in a page font that may be a wide one."""
    return min(0.0105 * max(map(len, texts)), 0.4)


def _rows(axes: Axes, names: Sequence[str]) -> None:
    axes.set_yticks(range(len(names)), names)
    axes.tick_params(axis="y", colors=_NAMES["ink"])
    axes.set_ylim(len(names) - 0.4, -0.65)
    axes.grid(False)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda v, at: f"{short(v)} ms" if at == 0 else short(v)))
    axes.xaxis.set_major_locator(MaxNLocator(6))
    axes.figure.subplots_adjust(left=0.02 + _text_width(names), right=0.98)


def _name_at_end(axes: Axes, series: Sequence[Series]) -> None:
    """Write each line's name beside its last point, pushed apart where they would overlap."""
    axes.figure.canvas.draw()
    to_pixels = axes.transData.transform
    ends = sorted((to_pixels((0, max(v[-1], 1e-12)))[1], n, c) for n, v, c, _ in series if len(v))
    gap, low, high = 13.0, axes.bbox.y0, axes.bbox.y1
    heights = [y for y, _, _ in ends]
    for i in range(1, len(heights)):
        heights[i] = max(heights[i], heights[i - 1] + gap)
    for i in range(len(heights) - 1, -1, -1):
        limit = high if i == len(heights) - 1 else heights[i + 1] - gap
        heights[i] = min(heights[i], limit)
    for y, (_, name, color) in zip(heights, ends, strict=True):
        at = (y - low) / (high - low)
        axes.text(1.012, at, name, transform=axes.transAxes, va="center", fontsize=9, color=color)


def _svg(figure: Figure, label: str) -> str:
    text = StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :]
    for name, color in _NAMES.items():
        svg = svg.replace(color, f"var(--{name})")
    # Its size is the page's business; the shape is in the view box.
    svg = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", svg, count=1)
    svg = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", svg, count=1)
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    return svg.replace("<svg", f'<svg role="img" aria-label="{label}"', 1)
