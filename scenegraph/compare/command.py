"""`scenegraph compare`: from the argument to the files in the output folder."""

from __future__ import annotations

import shlex
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich import progress as bars
from rich.console import Console

from scenegraph.compare.results import RunResult
from scenegraph.compare.suite import Suite, add_pipelines, find_suite
from scenegraph.errors import ScenegraphError
from scenegraph.json_text import json_text
from scenegraph.progress import Progress
from scenegraph.registry import Registry, registry

INTERRUPTED, FINDINGS = 130, 1


def run_command(
    argument: str,
    *,
    quick: bool = False,
    out: Path | None = None,
    json_file: str | None = None,
    scatter: int | None = None,
    frames: int | None = None,
    paths: list[str] | None = None,
    pipelines: list[str] | None = None,
    fail_on_false_hides: bool = False,
    known: Registry | None = None,
) -> int:
    """Run a comparison and write its files.

    Parameters
    ----------
    argument : str
        A built-in suite, a TOML file, a scene, or a model file.
    quick : bool
    out : Path, optional
        Folder for the files; `results/SUITE` without.
    json_file : str, optional
        Where the summary goes as well; "-" is stdout, and the table then goes to stderr.
    scatter, frames : int, optional
        Copies of a model file; views per path.
    paths : list of str, optional
        Camera paths instead of the suite's.
    pipelines : list of str, optional
        More pipelines, as text.
    fail_on_false_hides : bool
    known : Registry, optional

    Returns
    -------
    int
        Exit code: 0, 1 for findings, 130 when interrupted.

    Raises
    ------
    ScenegraphError
        Bad input; nothing was drawn.
    """
    known = known or registry()
    suite = prepared_suite(
        argument, known, quick=quick, scatter=scatter, frames=frames, paths=paths, pipelines=pipelines or []
    )
    folder = writable_folder(out or Path("results") / suite.name.replace("/", "-").replace(" ", "-"))
    if json_file not in (None, "-"):
        writable_folder(Path(str(json_file)).parent)
    console = Console(stderr=json_file == "-", width=None if sys.stdout.isatty() else 132, highlight=False)
    run = _run(suite, known, folder, quick)
    run.command = shlex.join(["scenegraph", *sys.argv[1:]])
    summary = write_run(run, folder, json_file)
    _show(run, summary, folder, console)
    if run.interrupted:
        return INTERRUPTED
    wrong = [name for name, p in summary["pipelines"].items() if p["false_hides_total"]]
    if fail_on_false_hides and wrong:
        sys.stderr.write(f"scenegraph: hid what is visible: {', '.join(wrong)}\n")
        return FINDINGS
    return 0


def prepared_suite(
    argument: str,
    known: Registry,
    *,
    quick: bool = False,
    scatter: int | None = None,
    frames: int | None = None,
    paths: list[str] | None = None,
    pipelines: list[str],
) -> Suite:
    """Find the suite that an argument means, and change what the options say."""
    suite = find_suite(argument, known, scatter=scatter)
    if pipelines:
        suite = add_pipelines(suite, pipelines, known)
    if quick:
        suite = suite.quicker()
    changes = {"frames": frames, "paths": paths}
    return suite.model_copy(update={key: value for key, value in changes.items() if value})


def writable_folder(folder: Path) -> Path:
    """Make a folder, and make sure now rather than after the work that files can be written into it.

    Raises
    ------
    ScenegraphError
        They cannot.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError as error:
        reason = error.strerror or str(error)
        raise ScenegraphError(
            f"cannot write to the folder {str(folder)!r} ({reason}); choose another one with --out"
        ) from error


def _run(suite: Suite, known: Registry, folder: Path, quick: bool) -> RunResult:
    from scenegraph.compare.judge import IN_LOG
    from scenegraph.compare.runner import run_suite
    from scenegraph.log import FrameLog

    with FrameLog(stream=folder / "frames.csv", extra=(*IN_LOG, *known.metrics)) as log, progress_bar() as tell:
        run = run_suite(suite, known, log=log, quick=quick, tell=tell)
        log.write_trace(folder / "trace.json")
    return run


def write_run(run: RunResult, folder: Path, json_file: str | None = None) -> dict[str, Any]:
    """Write `summary.json` and `report.html` of a run, and return the summary.

    Parameters
    ----------
    run : RunResult
    folder : Path
    json_file : str, optional
        Where the summary goes as well; "-" is stdout.
    """
    from scenegraph.compare.report import render_report
    from scenegraph.compare.summary import summarize

    summary = summarize(run)
    text = json_text(summary, indent=2) + "\n"
    (folder / "summary.json").write_text(text, encoding="utf-8")
    if json_file == "-":
        sys.stdout.write(text)
    elif json_file is not None:
        Path(json_file).write_text(text, encoding="utf-8")
    (folder / "report.html").write_text(render_report(run, summary), encoding="utf-8")
    return summary


def _show(run: RunResult, summary: dict[str, Any], folder: Path, console: Console) -> None:
    from scenegraph.compare.table import comparison_table

    for problem in run.scene["problems"]:
        console.print(problem, style="dim", markup=False)
    if run.finished_frames:
        console.print(comparison_table(run, summary))
    for note in run.notes:
        console.print(note, style="dim", markup=False)
    if run.interrupted:
        console.print(f"Interrupted after {run.finished_frames} of {run.planned_frames} views.")
    console.print(f"Report: {folder / 'report.html'}", soft_wrap=True, markup=False)


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """Show how far the work is, on stderr if that is a terminal."""
    columns = (
        bars.SpinnerColumn(),
        bars.TextColumn("{task.description}"),
        bars.BarColumn(bar_width=30),
        bars.TextColumn("{task.percentage:>3.0f} %"),
        bars.TimeElapsedColumn(),
    )
    console = Console(stderr=True)
    with bars.Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("starting", total=1.0)
        yield lambda what, share: bar.update(task, description=what, completed=share)
