"""Replications: the numbers of a paper beside the numbers measured here.

A plugin registers one with `scenegraph_register_replications`; it says which suites to run and which number of the
paper each measured number stands beside. The host knows no paper by name.
"""

from __future__ import annotations

import math
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from scenegraph.compare.command import progress_bar, writable_folder
from scenegraph.compare.counting import CountedRun, count_along
from scenegraph.compare.results import RunResult
from scenegraph.compare.suite import suite_of
from scenegraph.errors import ScenegraphError, nearest
from scenegraph.json_text import json_text
from scenegraph.log import FrameLog
from scenegraph.progress import Progress
from scenegraph.registry import Registry, registry

if TYPE_CHECKING:
    from scenegraph.compare.playing import Played
    from scenegraph.frame import Frame


__all__ = ["Cell", "CountedRun", "Laboratory", "Picture", "Plot", "Replication", "likeness", "replicate"]


@dataclass(frozen=True)
class Cell:
    """One number of a paper's table, and its counterpart.

    Attributes
    ----------
    table, scene, row, column, unit : str
        Where the number stands, in the paper's words.
    paper : float or None
        None for what the paper does not have: rows that we add.
    measured : float
    """

    table: str
    scene: str
    row: str
    column: str
    unit: str
    paper: float | None
    measured: float


@dataclass(frozen=True)
class Plot:
    """One of a paper's figures, measured here: values along camera paths.

    Attributes
    ----------
    title : str
    unit : str
        Of all values.
    series : mapping of str to sequence of float
        One value per frame, by name of the pipeline; NaN where there is none.
    caption : str
    paths : sequence of str
        Name of the path that each frame belongs to; empty if there is but one.
    """

    title: str
    unit: str
    series: Mapping[str, Sequence[float]]
    caption: str = ""
    paths: Sequence[str] = ()


@dataclass(frozen=True)
class Picture:
    """One of a paper's pictures, drawn here.

    Attributes
    ----------
    title, caption : str
    image : (h, w, 3) uint8
    """

    title: str
    caption: str
    image: NDArray[np.uint8]


@dataclass
class Replication:
    """What a replication brings home.

    Attributes
    ----------
    paper, title : str
        The name on the command line; the paper.
    cells : list of Cell
    plots : list of Plot
        Shown above the plots of the runs.
    remarks : list of str
        What must be known to read the numbers: what was changed, what has no counterpart, and why.
    runs : dict
        Summary of each suite that was run, by scene; see `scenegraph.compare.summary`.
    plots : list of Plot
    pictures : list of Picture
        Written as files beside the report, and shown in it.
    """

    paper: str
    title: str
    cells: list[Cell] = field(default_factory=list)
    plots: list[Plot] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    runs: dict[str, dict[str, Any]] = field(default_factory=dict)
    pictures: list[Picture] = field(default_factory=list)


class Laboratory:
    """What a replication works with.

    Attributes
    ----------
    known : Registry
    quick : bool
        Few frames are wanted.
    model : Path or None
        A model file that the user has given.
    folder : Path
        Where files may be written.
    results : dict of str to RunResult
        Every frame of the suites that were run, by scene.
    """

    def __init__(self, known: Registry, folder: Path, tell: Progress, *, quick: bool, model: Path | None) -> None:
        self.known = known
        self.folder = folder
        self.quick = quick
        self.model = model
        self.results: dict[str, RunResult] = {}
        self.summaries: dict[str, dict[str, Any]] = {}
        self._tell = tell

    def run(self, scene: str, suite: Mapping[str, Any]) -> dict[str, Any]:
        """Run a suite, given as the table that a TOML file would hold, and return its summary.

        Its report, frames and trace are written to a folder named after the scene.
        """
        from scenegraph.compare.command import write_run
        from scenegraph.compare.judge import IN_LOG
        from scenegraph.compare.runner import run_suite

        checked = suite_of(dict(suite), self.known)
        if self.quick:
            checked = checked.quicker()
        folder = writable_folder(self.folder / scene)

        with FrameLog(stream=folder / "frames.csv", extra=(*IN_LOG, *self.known.metrics)) as log:
            run = run_suite(
                checked,
                self.known,
                log=log,
                quick=self.quick,
                tell=lambda what, share: self._tell(f"{scene}: {what}", share),
            )
            log.write_trace(folder / "trace.json")
        run.command = shlex.join(["scenegraph", *sys.argv[1:]])
        self.results[scene] = run
        self.summaries[scene] = write_run(run, folder)
        if run.interrupted:
            raise KeyboardInterrupt
        return self.summaries[scene]

    def play(
        self, scene: str, suite: Mapping[str, Any], *, pictures: Sequence[float] = (), every: int = 1
    ) -> tuple[dict[str, Played], dict[int, NDArray[np.uint8]]]:
        """Play a suite's paths with all its pipelines, without truth; see `scenegraph.compare.playing.play`.

        Its frames are written to `played.csv` in a folder named after the scene.
        """
        from scenegraph.compare.playing import play

        checked = suite_of(dict(suite), self.known)
        if self.quick:
            checked = checked.quicker()
        folder = writable_folder(self.folder / scene)
        with FrameLog(stream=folder / "played.csv", extra=("draw_ms",)) as log:
            return play(
                checked,
                self.known,
                pictures=pictures,
                every=every,
                log=log,
                tell=lambda what, share: self._tell(f"{scene}: {what}", share),
            )

    def count(
        self,
        scene: str,
        suite: Mapping[str, Any],
        *,
        look: Callable[[str, int, Frame], None] | None = None,
    ) -> CountedRun:
        """Run the pipelines of a suite and draw nothing: for scenes that are too large to be drawn.

        Parameters
        ----------
        scene : str
        suite : mapping
            As for `run`.
        look : callable, optional
            Called with the pipeline's name, the number of the view and the frame.
        """
        checked = suite_of(dict(suite), self.known)
        if self.quick:
            checked = checked.quicker()
        return count_along(
            checked, self.known, tell=lambda what, share: self._tell(f"{scene}: {what}", share), look=look
        )


def likeness(image: NDArray[np.uint8], reference: NDArray[np.uint8]) -> dict[str, float]:
    """How like two pictures are: "SNR" in dB, "SSIM", and "FLIP" where the extra `quality` is installed.

    Parameters
    ----------
    image, reference : (h, w, 3) uint8
    """
    from scenegraph.compare import metrics

    found = {"SNR": metrics.snr_db(image, reference)}
    found["SSIM"] = 1.0 if np.array_equal(image, reference) else metrics.ssim(image, reference)
    try:
        from importlib import import_module

        flip = import_module("flip_evaluator")
    except ImportError:
        return found
    first, second = (p.astype(np.float32) / 255 for p in (reference, image))
    found["FLIP"] = float(flip.evaluate(first, second, "LDR")[1])
    return found


def replicate(
    paper: str,
    *,
    quick: bool = False,
    model: Path | None = None,
    json_file: str | None = None,
    out: Path | None = None,
    known: Registry | None = None,
) -> None:
    """Run the replication of a paper, print its tables, and write `replication.html` and `replication.json`.

    Raises
    ------
    ScenegraphError
        No such replication, a model that cannot be read, or a folder that cannot be written.
    """
    known = known or registry()
    if paper not in known.replications:
        raise ScenegraphError(f"there is no replication {paper!r}.{nearest(paper, known.replications)}")
    if model is not None and not model.exists():
        raise ScenegraphError(f"there is no model file {str(model)!r}")
    folder = writable_folder(out or Path("results") / paper)
    if json_file not in (None, "-"):
        writable_folder(Path(str(json_file)).parent)
    with progress_bar() as tell:
        laboratory = Laboratory(known, folder, tell, quick=quick, model=model)
        found: Replication = known.replications[paper].build(laboratory)
    found.runs = laboratory.summaries
    text = json_text(as_json(found), indent=2) + "\n"
    (folder / "replication.json").write_text(text, encoding="utf-8")
    if json_file == "-":
        sys.stdout.write(text)
    elif json_file is not None:
        Path(json_file).write_text(text, encoding="utf-8")
    from scenegraph.compare.report import render_replication, write_picture

    for number, picture in enumerate(found.pictures, 1):
        write_picture(picture.image, folder / f"picture-{number}.png")
    (folder / "replication.html").write_text(render_replication(found, laboratory.results), encoding="utf-8")
    console = Console(stderr=json_file == "-", width=None if sys.stdout.isatty() else 132, highlight=False)
    for table in tables_of(found):
        console.print(_rich_table(table))
    for remark in found.remarks:
        console.print(f"[dim]{remark}[/dim]")
    console.print(f"Report: {folder / 'replication.html'}", soft_wrap=True)


def as_json(found: Replication) -> dict[str, Any]:
    """The content of `--json`: cells with a counterpart, our own rows apart, plots, and the summaries of the runs."""
    cells = [asdict(c) for c in found.cells if c.paper is not None]
    added = [asdict(c) for c in found.cells if c.paper is None]
    plots = [asdict(p) for p in found.plots]
    return {
        "paper": found.paper,
        "cells": cells,
        "added": added,
        "plots": plots,
        "remarks": found.remarks,
        "runs": found.runs,
    }


@dataclass(frozen=True)
class PaperTable:
    """One table as it is shown: a line per row, and for each column the paper's number and ours."""

    title: str
    columns: tuple[tuple[str, str], ...]
    rows: tuple[tuple[str, tuple[Cell | None, ...]], ...]


def tables_of(found: Replication) -> list[PaperTable]:
    """The cells as tables, in the order in which they were given."""
    tables = []
    for title, scene in dict.fromkeys((c.table, c.scene) for c in found.cells):
        cells = [c for c in found.cells if (c.table, c.scene) == (title, scene)]
        columns = tuple(dict.fromkeys((c.column, c.unit) for c in cells))
        by_place = {(c.row, c.column, c.unit): c for c in cells}
        rows = tuple(
            (row, tuple(by_place.get((row, *column)) for column in columns))
            for row in dict.fromkeys(c.row for c in cells)
        )
        tables.append(PaperTable(f"{title}: {scene}", columns, rows))
    return tables


def number(value: float | None) -> str:
    """A number as short as a table wants it."""
    if value is None or value != value:
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    return f"{value:,.0f}".replace(",", " ") if abs(value) >= 1000 else f"{value:.3g}"


def _rich_table(table: PaperTable) -> Table:
    shown = Table(title=table.title, title_justify="left", box=None, padding=(0, 2, 0, 0))
    shown.add_column("")
    for column, unit in table.columns:
        name = f"{column}, {unit}" if unit else column
        shown.add_column(f"{name}\npaper", justify="right", header_style="dim")
        shown.add_column("\nhere", justify="right")
    for row, cells in table.rows:
        values = [(number(c.paper), number(c.measured)) if c else ("–", "–") for c in cells]
        shown.add_row(row, *(text for pair in values for text in pair))
    return shown
