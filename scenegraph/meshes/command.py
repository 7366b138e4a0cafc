"""`scenegraph occluders`: fit occluders to a model, and say how good they are."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import BarColumn, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bar
from rich.table import Table
from rich.text import Text

from ..errors import ScenegraphError
from ..json_text import json_text
from ..nodes import Node, Transform
from .placing import MeshOccluders, SceneOccluders, occluders_for

if TYPE_CHECKING:
    from ..scene import Scene

#: How many meshes a remark names.
_NAMED = 4

#: File name endings for `--out`.
FORMATS = (".json", ".glb", ".gltf", ".obj", ".ply", ".stl")


def run(
    scene: Scene, *, as_json: bool = False, out: Path | None = None, console: Console | None = None, **settings: Any
) -> SceneOccluders:
    """Fit occluders to a scene, print a table or JSON, and write them to a file if asked.

    Parameters
    ----------
    scene : Scene
        Stays as it is.
    as_json : bool
        Print JSON instead of a table.
    out : Path, optional
        Where the occluders go: as data (`.json`), or as a model to look at (the other `FORMATS`), in world coordinates.
    console : Console, optional
        For the table.
    **settings
        For `scenegraph.meshes.occluders_for`.

    Raises
    ------
    ScenegraphError
        A setting out of bounds, or a file that cannot be written.
    """
    if out is not None and out.suffix.lower() not in FORMATS:
        raise ScenegraphError(f"{out}: occluders are written as one of {', '.join(FORMATS)}")
    with _bar() as progress:
        found = occluders_for(scene, progress=progress, **settings)
    if out is not None:
        _write(found, out)
    if as_json:
        sys.stdout.write(json_text(_plain(scene, found), indent=2) + "\n")
        return found
    console = console or Console(width=None if sys.stdout.isatty() else 132, highlight=False)
    console.print(_table(found))
    for remark in _remarks(found):
        console.print(Text(remark, "dim"))
    left = f"; {found.meshes_left} meshes that promise less were not looked at" if found.meshes_left else ""
    console.print(f"{len(found)} occluders for {len(found.placed)} drawables{left}.")
    if out is not None:
        console.print(f"Written: {out}", soft_wrap=True)
    return found


def _plain(scene: Scene, found: SceneOccluders) -> dict[str, Any]:
    meshes = [
        {
            "mesh": m.mesh.name,
            "triangles": m.mesh.triangles,
            "drawables": m.drawables,
            "area": m.area,
            "placed": m.placed,
            "left_out": m.notes,
            **m.fitted.summary(),
        }
        for m in found.meshes
    ]
    return {
        "scene": scene.name,
        "occluders": len(found),
        "drawables": len(found.placed),
        "meshes": meshes,
        "meshes_left": found.meshes_left,
    }


def _table(found: SceneOccluders) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0))
    table.add_column("mesh", header_style="dim", max_width=28, no_wrap=True)
    for heading in ("drawables", "triangles"):
        table.add_column(heading, header_style="dim", justify="right")
    table.add_column("closed", header_style="dim")
    measured = any(m.fitted.peak_bytes for m in found.meshes)
    for heading in ("solids", "polygons", "silhouette", "by solids", "volume", "s", *(["MB"] if measured else [])):
        table.add_column(heading, header_style="dim", justify="right")
    for m in found.meshes:
        f = m.fitted
        table.add_row(
            Text(m.mesh.name or "-", "bold"),
            str(m.drawables),
            str(m.mesh.triangles),
            _closed(m),
            str(len(f.solids)),
            str(len(f.polygons)),
            f"{f.coverage:.0%}" if f.occluders else "-",
            f"{f.solid_coverage:.0%}" if f.solids else "-",
            "-" if np.isnan(f.volume_share) else f"{f.volume_share:.0%}",
            "cached" if f.is_cached else f"{f.seconds:.1f}",
            *([f"{(f.peak_bytes or 0) / 1e6:.0f}"] if measured else []),
        )
    return table


def _remarks(found: SceneOccluders) -> Iterator[str]:
    """Each remark once, with the meshes that it is about; those that differ in numbers only count as one."""
    about: dict[str, list[str]] = {}
    for m in found.meshes:
        for note in {re.sub(r" \(.*\)|\d+ ", "", note) for note in (*m.fitted.notes, *m.notes)}:
            about.setdefault(note, []).append(m.mesh.name or "-")
    for note, names in about.items():
        more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
        yield f"{note}: {', '.join(names[:_NAMED])}{more}"


def _closed(m: MeshOccluders) -> str:
    f = m.fitted
    if not f.closed_shells and not f.open_shells:
        return "-"
    if not f.open_shells:
        return "yes"
    part = f"{f.closed_shells} of {f.closed_shells + f.open_shells}" if f.closed_shells else "no"
    return f"{part}, covered" if f.is_covered else part


def _write(found: SceneOccluders, out: Path) -> None:
    try:
        if out.suffix.lower() == ".json":
            out.write_text(json_text({"occluders": list(_data(found))}) + "\n", encoding="utf-8")
        else:
            _model(found).export(str(out))
    except OSError as error:
        raise ScenegraphError(
            f"cannot write {str(out)!r} ({error.strerror or error}); choose another place with --out"
        ) from error


def _data(found: SceneOccluders) -> Iterator[dict[str, Any]]:
    for entry in found.placed:
        world = _world(entry.node)
        for occluder in entry.occluders:
            yield {
                "owner": entry.node.path(),
                "name": occluder.name,
                "kind": occluder.kind,
                "two_sided": occluder.two_sided,
                "vertices": _applied(world, occluder.vertices).tolist(),
                "faces": [list(face) for face in occluder.faces],
            }


def _model(found: SceneOccluders) -> Any:
    import trimesh

    scene = trimesh.Scene()
    for entry in found.placed:
        world = _world(entry.node)
        for occluder in entry.occluders:
            fans = [(f[0], f[i], f[i + 1]) for f in occluder.faces for i in range(1, len(f) - 1)]
            mesh = trimesh.Trimesh(_applied(world, occluder.vertices), np.array(fans), process=False)
            scene.add_geometry(mesh, node_name=f"{entry.node.path()}: {occluder.name}")
    return scene


def _world(node: Node) -> NDArray[np.float64]:
    matrix = np.eye(4)
    above: Node | None = node.parent
    while above is not None:
        if isinstance(above, Transform):
            matrix = above.matrix @ matrix
        above = above.parent
    return matrix


def _applied(matrix: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])


@contextmanager
def _bar() -> Iterator[Any]:
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(bar_width=30),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
    )
    console = Console(stderr=True)
    with Bar(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("starting", total=1.0)
        yield lambda what, share: bar.update(task, description=what, completed=share)
