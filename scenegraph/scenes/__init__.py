"""Built-in procedural scenes and camera paths. Importing this package builds nothing."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pluggy

from .paths import closest, default_paths, enter, orbit, walk

__all__ = ["closest", "default_paths", "enter", "orbit", "scenegraph_register_scenes", "walk"]

# The marker that `scenegraph.hookimpl` is; importing it from there would import the whole host.
_hookimpl = pluggy.HookimplMarker("scenegraph")


@_hookimpl
def scenegraph_register_scenes(register: Callable[[str, Callable[..., Any], str], None]) -> None:
    """Register the built-in scenes."""
    from . import bunnies, city, foliage, inspection, olympia, scatter

    scenes: dict[str, Callable[..., Any]] = {
        "city": city.build,
        "olympia": olympia.build,
        "scatter": scatter.build,
        "bunnies-5001": bunnies.dense,
        "bunnies-10001": bunnies.sparse,
        "foliage": foliage.build,
        "inspection": inspection.build,
    }
    for name, build in scenes.items():
        register(name, build, (build.__doc__ or "").partition("\n")[0])
