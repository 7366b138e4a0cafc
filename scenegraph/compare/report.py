"""`report.html`: a self-contained page that says what was compared, what came out, and how it looks."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jinja2
import numpy as np
from PIL import Image as Picture

from scenegraph.compare.figures import path_plot, plots, series_color
from scenegraph.compare.metrics import Image, share
from scenegraph.compare.overhead import frustum_overlay
from scenegraph.compare.results import Pictures, RunResult, Shot
from scenegraph.compare.text import decibel, duration, percent, short, size

if TYPE_CHECKING:
    from scenegraph.compare.replication import Replication

_ALARM, _CHANGED = (213, 94, 0), (0, 114, 178)
_WIDE = 960


def render_report(run: RunResult, summary: dict[str, Any]) -> str:
    """Make the page.

    Parameters
    ----------
    run : RunResult
    summary : dict
        What `summarize` made of it.

    Returns
    -------
    str
        HTML that loads nothing: plots are inline SVG, pictures are embedded PNG.
    """
    return (
        _environment()
        .get_template("report.html")
        .render(
            run=run,
            summary=summary,
            findings=findings(run, summary),
            plots=plots(run),
            metrics=list(next(iter(summary["pipelines"].values()))["metrics"]),
            colors={name: series_color(run, name) for name in run.pipelines},
            slowest=max((p["frame_ms"] for p in summary["pipelines"].values()), default=0.0),
            pictures=_pictures(run.pictures) if run.pictures else {},
            overlay=_overlay(run.pictures),
        )
    )


def render_replication(found: Replication, runs: Mapping[str, RunResult]) -> str:
    """Make the page of a replication: the paper's tables beside ours, and the plots of every run.

    Parameters
    ----------
    found : Replication
    runs : mapping of str to RunResult
        By scene.
    """
    from scenegraph.compare.replication import number, tables_of

    return (
        _environment()
        .get_template("replication.html")
        .render(
            found=found,
            tables=tables_of(found),
            number=number,
            figures=[(p, path_plot(p.paths, p.series, p.unit)) for p in found.plots],
            runs=runs,
            plots={scene: plots(run) for scene, run in runs.items()},
            pictures=[(picture.title, picture.caption, _png(picture.image)) for picture in found.pictures],
        )
    )


def write_picture(image: Image, path: Path) -> None:
    """Write (h, w, 3) bytes as a PNG file."""
    Picture.fromarray(image).save(path)


def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("scenegraph.compare", "templates"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters |= {"short": short, "percent": percent, "decibel": decibel, "duration": duration, "size": size}
    return environment


def findings(run: RunResult, summary: dict[str, Any]) -> list[str]:
    """Say in a sentence per pipeline what it gained over the first, and what that cost in truth."""
    base = summary["pipelines"][run.baseline.name]
    sentences = []
    for name, p in summary["pipelines"].items():
        if name == run.baseline.name or not p["frames"]:
            continue
        part = percent(p["drawn_triangles"] / base["drawn_triangles"]) if base["drawn_triangles"] else "none"
        if 0.97 < p["speedup"] < 1.03:
            faster = f"takes the time of {run.baseline.name}"
        elif p["speedup"] > 1:
            faster = f"is {short(p['speedup'])} × as fast as {run.baseline.name}"
        else:
            faster = f"takes {short(share(1.0, p['speedup']))} × the time of {run.baseline.name}"
        if p["false_hides_total"]:
            claim = f"though it claims to be {p['guarantee']}, " if p["claim_is_broken"] else ""
            truth = (
                f"{claim}it hid {p['false_hides_total']} visible drawables over {p['frames']} frames "
                f"({percent(p['false_hides_of_visible'])} of the visible), at most "
                f"{short(p['missing_pixels_max'])} pixels in a frame; "
                f"SNR at worst {decibel(p['snr_db_min'])} dB"
            )
        else:
            truth = "it hid nothing that is visible"
        sentences.append(f"{name} draws {part} of the triangles and {faster}; {truth}.")
    return sentences


def difference(shot: Shot, reference: Image) -> Image:
    """Show where a frame is wrong, on a faded reference.

    Orange: pixels of falsely hidden drawables, widened by 3 pixels so that single ones can be seen. Blue:
    other pixels that differ.
    """
    gray = reference.astype(float) @ (0.299, 0.587, 0.114)
    faded = np.repeat((205 + 0.18 * gray)[..., None], 3, axis=2).astype(np.uint8)
    faded[shot.wrong] = _CHANGED
    faded[_widened(shot.missing, 3)] = _ALARM
    return faded


def _widened(mask: np.ndarray[Any, np.dtype[np.bool_]], radius: int) -> np.ndarray[Any, np.dtype[np.bool_]]:
    from scipy.ndimage import maximum_filter

    wide: np.ndarray[Any, np.dtype[np.bool_]] = maximum_filter(mask, size=2 * radius + 1)
    return wide


def _pictures(pictures: Pictures) -> dict[str, dict[str, str]]:
    return {
        name: {
            "frame": _png(shot.image),
            "difference": _png(difference(shot, pictures.reference), colors=64),
            "overhead": _png(pictures.overhead[name]) if name in pictures.overhead else "",
        }
        for name, shot in pictures.shots.items()
    }


def _overlay(pictures: Pictures | None) -> str:
    if pictures is None or pictures.overhead_view is None:
        return ""
    return frustum_overlay(pictures.view, pictures.overhead_view, pictures.reach)


def _png(image: Image, colors: int = 0) -> str:
    picture = Picture.fromarray(image)
    if picture.width > _WIDE:
        size = (_WIDE, max(round(picture.height * _WIDE / picture.width), 1))
        picture = picture.resize(size, Picture.Resampling.LANCZOS)
    if colors:
        picture = picture.quantize(colors)
    data = io.BytesIO()
    picture.save(data, "PNG", compress_level=5)
    return "data:image/png;base64," + base64.b64encode(data.getvalue()).decode()
