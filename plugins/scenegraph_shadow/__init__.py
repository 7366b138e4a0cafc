"""Shadow-frustum culling with planar and convex solid occluders."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from scenegraph import Overlay, Stage, hookimpl

from .frusta import ShadowFrusta
from .overlays import ByOccluder, Shadows
from .stage import Shadow

__all__ = [
    "Shadow",
    "ShadowFrusta",
    "scenegraph_register_overlays",
    "scenegraph_register_replications",
    "scenegraph_register_stages",
]


@hookimpl
def scenegraph_register_stages(register: Callable[[type[Stage]], None]) -> None:
    """Hand the stage to the host."""
    register(Shadow)


@hookimpl
def scenegraph_register_overlays(register: Callable[[type[Overlay]], None]) -> None:
    """Hand the viewer what it can show of the stage."""
    register(ByOccluder)
    register(Shadows)


@hookimpl
def scenegraph_register_replications(register: Callable[[str, Callable[..., Any], str], None]) -> None:
    """Hand the paper's tables to the host; what draws and measures is imported when they are run."""

    def replicate(laboratory: Any) -> Any:
        from .replication import replicate as run

        return run(laboratory)

    register("papaioannou2006", replicate, "Planar and convex solid occluders: Tables 1 and 2, Figures 5 and 6.")
