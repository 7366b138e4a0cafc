"""`scenegraph view`: from the arguments to a window, a picture or a table."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from ..errors import GLError, SceneError, ScenegraphError
from ..pipeline import Pipeline
from ..registry import Registry, registry
from ..scene import Scene
from ..snapshot import Snapshot
from ..stage import Guarantee
from ..view import View
from .recording import find_path

#: Endings of movies that Pillow writes; others are handed to imageio.
_PILLOW = {".gif": "GIF", ".webp": "WEBP", ".png": "PNG"}


def run_view(
    source: str,
    *,
    pipelines: Sequence[str] = (),
    path: str | None = None,
    record: Path | None = None,
    benchmark: bool = False,
    movie: Path | None = None,
    picture: Path | None = None,
    off_screen: bool = False,
    web: bool = False,
    port: int = 0,
    size: tuple[int, int] = (1280, 720),
    known: Registry | None = None,
) -> None:
    """Look at a scene.

    Parameters
    ----------
    source : str
        A scene or a model file.
    pipelines : sequence of str
        A and B. By default all installed stages that promise to hide nothing visible, and nothing culled.
    path : str, optional
        A camera path of the scene, or a JSON file.
    record : Path, optional
        Where the camera path of this session goes.
    benchmark : bool
        Replay the path with every pipeline, print the table, and stop.
    movie, picture : Path, optional
        Write a movie of the replay, or a picture of its first view, and stop.
    off_screen : bool
        Open no window.
    web : bool
        Show it in a browser on this machine instead.
    port : int
        Where; 0 for any that is free.

    Raises
    ------
    ScenegraphError
        Bad input, or there is no OpenGL.
    """
    known = known or registry()
    scene = find_scene(source, known)
    snapshot = scene.snapshot()
    if not snapshot.n:
        raise SceneError(f"the scene {scene.name!r} has no drawables; add a mesh with at least one triangle")
    made = parsed(pipelines, known)
    views = find_path(scene, snapshot, path)
    off_screen = off_screen or movie is not None or picture is not None
    if off_screen or benchmark or web:
        from ..render.probe import require_gl

        require_gl()
    else:
        _require_display()
    if web and not (off_screen or benchmark):
        from .web import WebViewer, WebWindow

        WebViewer(WebWindow(snapshot, made, known, path=views, size=size, record=record)).run(port)
        return
    from .window import ViewerWindow

    window = ViewerWindow(
        snapshot, made, known, path=views, size=size, off_screen=off_screen or benchmark, record=record
    )
    if benchmark:
        show_benchmark(measured(window, views), snapshot)
    elif movie is not None:
        write_movie(window, views, movie)
    elif picture is not None:
        _replay(window, views[:1])
        _save(window.image(), picture)
        window.saved.append(picture)
    elif off_screen:
        _replay(window, views)
    else:
        window.run()
    window.close()
    for saved in window.saved:
        sys.stdout.write(f"wrote {saved}\n")


def find_scene(source: str, known: Registry) -> Scene:
    """A built-in scene, or a file."""
    if source in known.scenes:
        scene: Scene = known.scenes[source].build()
        return scene
    if Path(source).exists():
        return Scene.load(source)
    try:
        known.scene(source)
    except SceneError as error:
        raise SceneError(f"{error} Nor is there a file of that name.") from None
    raise AssertionError


def parsed(texts: Sequence[str], known: Registry) -> list[Pipeline]:
    """Pipelines A and B.

    Raises
    ------
    PipelineError
        All that is wrong with them.
    """
    if not texts:
        return [usual_pipeline(known), Pipeline(name="none", preparations=known)]
    made = [Pipeline.parse(text, known) for text in texts]
    return made if len(made) > 1 else [*made, Pipeline(name="none", preparations=known)]


def usual_pipeline(known: Registry) -> Pipeline:
    """All stages that promise, as they are by default, not to change the picture, and that need nothing prepared."""
    safe = (Guarantee.EXACT, Guarantee.CONSERVATIVE)
    made = [stage() for stage in known.stages.values()]
    stages = [s for s in made if s.guarantee in safe and not s.needs and not {"level", "standins"} & set(s.writes)]
    while (pipeline := Pipeline(stages, preparations=known)).faults():
        stages.pop()
    return pipeline


def _require_display() -> None:
    import os

    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise GLError("there is no display to open a window on; use --picture, --movie or --benchmark, or run xvfb-run")
    # what draws off screen may have been chosen in this environment, and cannot open a window
    os.environ.pop("VTK_DEFAULT_OPENGL_WINDOW", None)


def _replay(window: Any, views: Sequence[View]) -> None:
    window.plotter.show(auto_close=False)
    for view in views:
        window.session.view = view.resized(*window.window.GetSize())
        window.render()


def measured(window: Any, views: Sequence[View]) -> dict[str, list[dict[str, Any]]]:
    """Every pipeline on every view, one view after the other; the first round warms up.

    Returns
    -------
    dict
        Per pipeline, per view: ms, cull_ms, drawn, triangles and the records of its stages.
    """
    session = window.session
    window.plotter.show(auto_close=False)
    names = {i: p.text for i, p in enumerate(session.pipelines)}
    found: dict[str, list[dict[str, Any]]] = {name: [] for name in names.values()}
    whole = next((i for i, p in enumerate(session.pipelines) if not p.stages), None)
    for index in names:
        _choose(session, index)
        session.view = views[0].resized(*window.window.GetSize())
        session.picture()
    for view in views:
        for index, name in names.items():
            _choose(session, index)
            session.view = view.resized(*window.window.GetSize())
            # opening a pipeline is no part of a frame
            session.driver.decide(session.view)
            start = perf_counter()
            session.picture(whole=index == whole)
            ms = 1e3 * (perf_counter() - start)
            record = session.driver.frame.record if index != whole else None
            found[name].append(
                {
                    "ms": ms,
                    "cull_ms": record.cull_ms if record else 0.0,
                    "drawn": record.visible if record else session.snapshot.n,
                    "triangles": record.triangles if record else int(session.snapshot.triangles[0].sum()),
                    "stages": [(r.name, r.ms, r.hidden) for r in record.stages] if record else [],
                }
            )
    return found


def _choose(session: Any, index: int) -> None:
    if session.which != index:
        session.which = index
        session.driver.use(session.pipeline)


def show_benchmark(found: dict[str, list[dict[str, Any]]], snapshot: Snapshot) -> None:
    """Print medians, and means of counts."""
    from statistics import mean, median

    table = Table(box=None, padding=(0, 2, 0, 0))
    for heading in ("pipeline", "frame", "cull", "drawn", "triangles", "faster", "stages"):
        table.add_column(heading, header_style="dim", justify="left" if heading in ("pipeline", "stages") else "right")
    slow = median(f["ms"] for f in list(found.values())[-1])
    for name, frames in found.items():
        ms = median(f["ms"] for f in frames)
        stages = [
            f"{frames[0]['stages'][i][0]} {median(f['stages'][i][1] for f in frames):.2f} ms"
            f" -{mean(f['stages'][i][2] for f in frames):,.0f}"
            for i in range(len(frames[0]["stages"]))
        ]
        table.add_row(
            Text(name, "bold"),
            f"{ms:.1f} ms",
            f"{median(f['cull_ms'] for f in frames):.2f} ms",
            f"{mean(f['drawn'] for f in frames):,.0f}",
            f"{mean(f['triangles'] for f in frames):,.0f}",
            f"{slow / ms:.1f}×",
            Text("\n".join(stages), "dim"),
        )
    console = Console(width=None if sys.stdout.isatty() else 132, highlight=False)
    count = len(next(iter(found.values())))
    console.print(f"{snapshot.scene.name}: {snapshot.n:,} objects, {count} views; faster than the last line")
    console.print(table)


def write_movie(window: Any, views: Sequence[View], path: Path) -> None:
    """Replay the path into a file.

    Raises
    ------
    ScenegraphError
        The kind of file needs imageio, which is not installed.
    """
    from PIL import Image

    window.plotter.show(auto_close=False)
    frames = []
    for view in views:
        window.session.view = view.resized(*window.window.GetSize())
        frames.append(window.image())
    if not frames:
        raise SceneError("there is no camera path to make a movie of; name one with --path")
    kind = _PILLOW.get(path.suffix.lower())
    if kind is not None:
        first, *rest = (Image.fromarray(frame) for frame in frames)
        first.save(path, kind, save_all=True, append_images=rest, duration=66, loop=0)
    else:
        try:
            from importlib import import_module

            import_module("imageio.v3").imwrite(path, frames, fps=15)
        except ImportError:
            raise ScenegraphError(
                f"{path.suffix} movies need imageio: pip install imageio imageio-ffmpeg; or write a .gif or .webp"
            ) from None
    window.saved.append(path)


def _save(image: Any, path: Path) -> None:
    from PIL import Image

    Image.fromarray(image).save(path)
