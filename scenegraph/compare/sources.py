"""Where a suite's drawables and camera paths come from."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenegraph.compare.suite import Suite
from scenegraph.errors import SceneError, SuiteError, nearest
from scenegraph.occluder import Occluder
from scenegraph.registry import Registry
from scenegraph.scene import Scene
from scenegraph.snapshot import Snapshot
from scenegraph.view import View


@dataclass(frozen=True)
class PathView:
    """One view of a run."""

    path: str
    view: View


def build_scene(suite: Suite, registry: Registry) -> Scene:
    """Build or load the scene of a suite.

    Raises
    ------
    SceneError
        The file cannot be used, or there is nothing in it.
    """
    spec = suite.scene
    if spec.file is None:
        scene = registry.scene(str(spec.name)).build(**spec.options)
        if spec.occluders == "fitted":
            for node in list(scene.root.walk()):
                if isinstance(node, Occluder) and node.parent is not None:
                    node.parent.remove(node)
            scene.name += ", fitted occluders"
        return scene
    if spec.scatter is None:
        return Scene.load(spec.file)
    from scenegraph.scenes.scatter import build

    scene = build(count=spec.scatter, model=str(spec.file))
    scene.name = f"{spec.file.stem}, {spec.scatter} copies"
    return scene


def camera_paths(suite: Suite, snapshot: Snapshot) -> list[PathView]:
    """List the views of a run in order, each path thinned to the suite's number of frames.

    A scene without camera paths gets the usual ones, after the cameras that its file has. Any scene has the path
    "anywhere": as many random views as the suite has frames.

    Raises
    ------
    SuiteError
        The suite names paths that are not there; all of them are listed.
    SceneError
        There is no path at all.
    """
    from scenegraph.scenes.anywhere import anywhere
    from scenegraph.scenes.paths import default_paths

    scene = snapshot.scene
    if not scene.paths:
        cameras = {"cameras": list(scene.views.values())} if scene.views else {}
        scene.paths = {**cameras, **default_paths(scene, snapshot)}
    faults: list[str] = []
    views: list[PathView] = []
    for wanted in suite.paths or list(scene.paths):
        if wanted in scene.paths:
            path = scene.paths[wanted]
        elif wanted == "anywhere":
            path = anywhere(snapshot, suite.frames, up=scene.up)
        elif wanted.endswith(".json"):
            try:
                path = read_path(Path(wanted))
            except (SceneError, ValueError, OSError, TypeError) as error:
                faults.append(f"paths: {wanted}: {error}")
                continue
        else:
            cure = nearest(wanted, scene.paths)
            faults.append(f"paths: the scene {scene.name!r} has no path {wanted!r}.{cure}")
            continue
        name = Path(wanted).stem
        chosen = [path[i] for i in thinned(len(path), suite.frames)]
        views += [PathView(name, view.resized(suite.width, suite.height)) for view in chosen]
    if faults:
        raise SuiteError(faults)
    if not views:
        why = f" ({'; '.join(scene.problems)})" if scene.problems else ""
        raise SceneError(f"the scene {scene.name!r} has no camera path, and nothing of finite size to look at{why}")
    return views


def read_path(path: Path) -> list[View]:
    """Read a JSON list of views (see `View.to_dict`)."""
    values = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(values, list) or not values:
        raise ValueError("expected a list of views, each {eye, target, ...}")
    return [View.from_dict(value) for value in values]


def thinned(count: int, wanted: int) -> list[int]:
    """Choose at most `wanted` of `count` positions, evenly and with both ends."""
    if wanted >= count:
        return list(range(count))
    return [int(i) for i in np.linspace(0, count - 1, wanted).round()] if wanted > 1 else [count // 2]
