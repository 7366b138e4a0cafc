"""Camera paths as they are recorded and replayed: JSON lists of views, which suites take as paths."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from ..errors import SceneError, nearest
from ..json_text import json_text
from ..scene import Scene
from ..scenes.paths import default_paths
from ..snapshot import Snapshot
from ..view import View


class Recorder:
    """Collects views; standing still is recorded once."""

    def __init__(self) -> None:
        self.views: list[View] = []

    def add(self, view: View) -> None:
        """Take a view."""
        if not self.views or self.views[-1] != view:
            self.views.append(view)

    def write(self, path: Path) -> None:
        """Write a JSON list of views.

        Raises
        ------
        SceneError
            The file cannot be written.
        """
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json_text([view.to_dict() for view in self.views], indent=1) + "\n", encoding="utf-8")
        except OSError as error:
            raise SceneError(f"cannot write the camera path to {str(path)!r} ({error.strerror or error})") from error


def read_path(path: Path) -> list[View]:
    """Views of a JSON file.

    Raises
    ------
    SceneError
        There is no such file, or it is not a list of views.
    """
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(values, list) or not values:
            raise SceneError("expected a list of views, each {eye, target, ...}")
        return [View.from_dict(value) for value in values]
    except (OSError, ValueError, TypeError, SceneError) as error:
        raise SceneError(f"cannot read the camera path {str(path)!r}: {error}") from error


def find_path(scene: Scene, snapshot: Snapshot, name: str | None) -> Sequence[View]:
    """A path of a scene by name, or from a JSON file; without a name the scene's first, or a usual one.

    Raises
    ------
    SceneError
        There is no such path.
    """
    if name is not None and name.endswith(".json"):
        return read_path(Path(name))
    if not scene.paths:
        scene.paths = default_paths(scene, snapshot)
    if name is None:
        return next(iter(scene.paths.values()), [])
    if name not in scene.paths:
        raise SceneError(f"the scene {scene.name!r} has no camera path {name!r}.{nearest(name, scene.paths)}")
    return scene.paths[name]
