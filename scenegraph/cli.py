"""The command line. Commands import what they need when they run: answering `--help` must not load VTK.

Exit codes: 0 done, 1 finished with findings that the user asked to be failed on, 2 bad input, 130 interrupted.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable
from functools import wraps
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ParamSpec

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from scenegraph.errors import ScenegraphError
from scenegraph.json_text import json_text

if TYPE_CHECKING:
    from scenegraph.registry import Entry, Registry
    from scenegraph.stage import Stage

app = typer.Typer(
    name="scenegraph",
    help="A workbench for visibility culling: compare culling methods by speed and by what they get wrong.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]


def main() -> None:
    """Run the command line."""
    app()


P = ParamSpec("P")


def _answered(command: Callable[P, None]) -> Callable[P, None]:
    """Turn what went wrong into one sentence on stderr and an exit code."""

    @wraps(command)
    def answered(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            command(*args, **kwargs)
        except ScenegraphError as error:
            print(f"scenegraph: {error}", file=sys.stderr)
            raise typer.Exit(2) from None
        except KeyboardInterrupt:
            print("scenegraph: interrupted", file=sys.stderr)
            raise typer.Exit(130) from None

    return answered


def _version(wanted: bool) -> None:
    if wanted:
        try:
            print(f"scenegraph {version('scenegraph-culling')}")
        except PackageNotFoundError:
            print("scenegraph, run from a folder where it is not installed")
        raise typer.Exit


@app.callback()
def _options(
    _show_version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    pass


@app.command()
@_answered
def compare(
    suite: Annotated[
        str,
        typer.Argument(
            metavar="[SUITE]",
            help="A built-in suite (see `scenegraph scenes`), a .toml file, a scene, or a model file.",
        ),
    ] = "city",
    quick: Annotated[bool, typer.Option("--quick", help="Few frames: an answer within a minute or so.")] = False,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for report.html, frames.csv, summary.json and trace.json [default: results/SUITE]"),
    ] = None,
    json_file: Annotated[
        str | None, typer.Option("--json", metavar="FILE", help="Also write the summary here; - is stdout.")
    ] = None,
    scatter: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Draw N copies of a model file, spread in a cube.")
    ] = None,
    frames: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Views per camera path, instead of the suite's.")
    ] = None,
    path: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="A camera path instead of the suite's; anywhere = random views; repeatable."),
    ] = None,
    pipeline: Annotated[
        list[str] | None,
        typer.Option(metavar="TEXT", help="Another pipeline, as 'frustum | ...' or 'NAME=...'; repeatable."),
    ] = None,
    fail_on_false_hides: Annotated[
        bool, typer.Option("--fail-on-false-hides", help="Exit with 1 if any pipeline hid something visible.")
    ] = False,
) -> None:
    """Run pipelines side by side on a scene, and report their speed and their errors."""
    from scenegraph.compare.command import run_command

    code = run_command(
        suite,
        quick=quick,
        out=out,
        json_file=json_file,
        scatter=scatter,
        frames=frames,
        paths=path,
        pipelines=pipeline or [],
        fail_on_false_hides=fail_on_false_hides,
    )
    if code:
        raise typer.Exit(code)


@app.command()
@_answered
def replicate(
    paper: Annotated[str, typer.Argument(help="A paper; `scenegraph scenes` lists those whose methods are installed.")],
    quick: Annotated[bool, typer.Option("--quick", help="Few frames.")] = False,
    model: Annotated[Path | None, typer.Option(help="A model file, for papers whose scenes are made of one.")] = None,
    json_file: Annotated[
        str | None, typer.Option("--json", metavar="FILE", help="Also write the numbers here; - is stdout.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the report [default: results/PAPER]")] = None,
) -> None:
    """Print a paper's tables beside the numbers measured here."""
    from scenegraph.compare.replication import replicate as run

    run(paper, quick=quick, model=model, json_file=json_file, out=out)


@app.command()
@_answered
def view(
    source: Annotated[str, typer.Argument(metavar="SCENE-or-FILE", help="A built-in scene, or a model file.")],
    pipeline: Annotated[
        list[str] | None,
        typer.Option(metavar="TEXT", help="What culls; given twice, Tab switches between the two."),
    ] = None,
    path: Annotated[
        str | None, typer.Option(metavar="NAME", help="A camera path of the scene, or a .json file of views.")
    ] = None,
    record: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the camera path of this session.")] = None,
    benchmark: Annotated[
        bool, typer.Option("--benchmark", help="Replay the path with every pipeline, print the table, and stop.")
    ] = False,
    movie: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a movie of the path (.gif, .webp, .mp4), and stop.")
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a picture of the first view, and stop.")
    ] = None,
    off_screen: Annotated[
        bool, typer.Option("--off-screen", help="Open no window: replay the path, and stop.")
    ] = False,
    web: Annotated[
        bool, typer.Option("--web", help="Show it in a browser on this machine; needs the extra 'web'.")
    ] = False,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Of --web; 0 takes any that is free.")] = 0,
    size: Annotated[tuple[int, int], typer.Option(metavar="WIDTH HEIGHT", help="Of the window.")] = (1280, 720),
) -> None:
    """Walk through a scene and see what every stage hides and costs; h lists the keys."""
    from scenegraph.viewer.command import run_view

    run_view(
        source,
        pipelines=pipeline or [],
        path=path,
        record=record,
        benchmark=benchmark,
        movie=movie,
        picture=picture,
        off_screen=off_screen,
        web=web,
        port=port,
        size=size,
    )


@app.command()
@_answered
def stages(as_json: AsJson = False) -> None:
    """List the culling stages that are installed, with what they guarantee and their parameters."""
    from scenegraph.registry import Registry

    registry = Registry()
    if as_json:
        found = [_stage(stage) for stage in registry.stages.values()]
        _print_json({"stages": found, "failures": _failures(registry)})
        return
    console = _console()
    table = Table(box=None, padding=(0, 2, 1, 0), title_justify="left")
    for heading in ("stage", "guarantee", "what it does"):
        table.add_column(heading, header_style="dim")
    for stage in map(_stage, registry.stages.values()):
        text = Text(stage["summary"])
        if stage["bound"]:
            text.append(f"\nBound: {stage['bound']}", "dim")
        for p in stage["parameters"]:
            text.append(f"\n{p['name']}={p['default']!r}{_range(p)}", "cyan")
            text.append(f"  {p['help']}", "dim")
        guarantee = Text(stage["guarantee"])
        if stage["guarantee_depends_on_parameters"]:
            guarantee.append("\nunless set otherwise", "dim")
        table.add_row(Text(stage["name"], "bold"), guarantee, text)
    console.print(table)
    _print_failures(registry)


@app.command()
@_answered
def scenes(as_json: AsJson = False) -> None:
    """List the scenes and suites that are built in."""
    import tomllib

    from scenegraph.compare.suite import builtin_suites
    from scenegraph.registry import Registry

    registry = Registry()
    suites = {name: tomllib.loads(text).get("summary", "") for name, text in builtin_suites().items()}
    if as_json:
        found = [{"name": s.name, "summary": s.summary, "options": _defaults(s)} for s in registry.scenes.values()]
        listed = [{"name": name, "summary": summary} for name, summary in suites.items()]
        papers = [{"name": p.name, "summary": p.summary} for p in registry.replications.values()]
        _print_json({"scenes": found, "suites": listed, "replications": papers, "failures": _failures(registry)})
        return
    console = _console()
    table = Table(box=None, padding=(0, 2, 1, 0))
    for heading in ("scene", "what it is"):
        table.add_column(heading, header_style="dim")
    for scene in registry.scenes.values():
        text = Text(scene.summary)
        if options := _defaults(scene):
            text.append("\n" + ", ".join(f"{k}={v!r}" for k, v in options.items()), "dim")
        table.add_row(Text(scene.name, "bold"), text)
    console.print(table)
    table = Table(box=None, padding=(0, 2, 0, 0))
    for heading in ("suite", "what it asks"):
        table.add_column(heading, header_style="dim")
    for name, summary in suites.items():
        table.add_row(Text(name, "bold"), summary)
    console.print(table)
    if registry.replications:
        table = Table(box=None, padding=(1, 2, 0, 0))
        for heading in ("paper to replicate", "what it measures"):
            table.add_column(heading, header_style="dim")
        for paper in registry.replications.values():
            table.add_row(Text(paper.name, "bold"), paper.summary)
        console.print(table)
    _print_failures(registry)


@app.command()
@_answered
def doctor(as_json: AsJson = False) -> None:
    """Say what works here, what is missing, and how to get it."""
    from scenegraph.doctor import examine, show

    findings = examine()
    if as_json:
        _print_json(findings)
    else:
        show(findings, _console())


@app.command()
@_answered
def occluders(
    source: Annotated[str, typer.Argument(metavar="SCENE-or-FILE", help="A built-in scene, or a model file.")],
    as_json: AsJson = False,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write the occluders: .json, or a model (.glb, .obj, .ply, .stl)."),
    ] = None,
    shape: Annotated[str, typer.Option(help="polytope, or box: simpler, and covers less.")] = "polytope",
    openings: Annotated[
        str, typer.Option(help="Open meshes to look into as if they were closed: none, outward or any.")
    ] = "none",
    per_mesh: Annotated[int, typer.Option(metavar="N", help="Most occluders of a mesh.")] = 8,
    meshes: Annotated[int, typer.Option(min=1, metavar="N", help="How many meshes are looked at.")] = 64,
    cells: Annotated[int, typer.Option(metavar="N", help="Resolution of the search along each axis.")] = 48,
    memory: Annotated[bool, typer.Option("--memory", help="Measure the memory, too, which takes longer.")] = False,
    fresh: Annotated[bool, typer.Option("--fresh", help="Do not read what was fitted before from the disk.")] = False,
) -> None:
    """Fit occluders into meshes that have none, and say how much of their silhouettes these cover."""
    from scenegraph.meshes.command import run
    from scenegraph.registry import Registry
    from scenegraph.viewer.command import find_scene

    run(
        find_scene(source, Registry()),
        as_json=as_json,
        out=out,
        shape=shape,
        openings=openings,
        max_occluders=per_mesh,
        max_meshes=meshes,
        cells=cells,
        trace_memory=memory,
        refresh=fresh,
    )


# What the tables are made of


def _stage(stage: type[Stage]) -> dict[str, Any]:
    usual = stage()
    return {
        "name": stage.name,
        "summary": stage.summary(),
        "guarantee": usual.guarantee.value,
        "guarantee_depends_on_parameters": isinstance(inspect.getattr_static(stage, "guarantee"), property),
        "bound": usual.bound,
        "reads": [kind.__name__ for kind in stage.reads],
        "writes": [what if isinstance(what, str) else what.__name__ for what in stage.writes],
        "needs": list(stage.needs),
        "parameters": [
            {
                "name": p.name,
                "type": p.type.__name__,
                "default": p.default,
                "minimum": p.minimum,
                "maximum": p.maximum,
                "unit": p.unit,
                "choices": list(p.choices),
                "help": p.help,
            }
            for p in stage.parameters().values()
        ],
        "module": stage.__module__,
    }


def _range(p: dict[str, Any]) -> str:
    """Say what values a parameter may have."""
    if p["choices"]:
        return " (" + ", ".join(p["choices"]) + ")"
    low, high = p["minimum"], p["maximum"]
    if low is None and high is None:
        return f" {p['unit']}" if p["unit"] else ""
    bounds = f"{'…' if low is None else f'{low:g}'} to {'…' if high is None else f'{high:g}'}"
    return f" ({' '.join(filter(None, (bounds, p['unit'])))})"


def _defaults(scene: Entry[Any]) -> dict[str, Any]:
    plain = bool | int | float | str
    return {name: o.default for name, o in scene.options.items() if isinstance(o.default, plain)}


def _failures(registry: Registry) -> list[dict[str, str]]:
    return [{"name": f.name, "message": f.message} for f in registry.failures]


def _print_failures(registry: Registry) -> None:
    for failure in registry.failures:
        print(f"scenegraph: the plugin {failure.name} {failure.message}", file=sys.stderr)


def _print_json(value: Any) -> None:
    print(json_text(value, indent=2))


def _console() -> Console:
    return Console(width=None if sys.stdout.isatty() else 110, highlight=False)
