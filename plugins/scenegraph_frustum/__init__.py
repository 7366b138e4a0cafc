"""View-frustum culling and small-feature culling: the two stages that need nothing but boxes."""

from __future__ import annotations

from collections.abc import Callable

from scenegraph import Overlay, Stage, hookimpl

from .contribution import Contribution
from .frustum import Frustum
from .overlays import Outside, Pyramid

__all__ = [
    "Contribution",
    "Frustum",
    "Outside",
    "Pyramid",
    "scenegraph_register_overlays",
    "scenegraph_register_stages",
]


@hookimpl
def scenegraph_register_stages(register: Callable[[type[Stage]], None]) -> None:
    """Hand the two stages to the host."""
    register(Frustum)
    register(Contribution)


@hookimpl
def scenegraph_register_overlays(register: Callable[[type[Overlay]], None]) -> None:
    """Hand what the viewer can show of them to the host."""
    register(Pyramid)
    register(Outside)
