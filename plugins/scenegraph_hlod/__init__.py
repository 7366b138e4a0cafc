"""Coherent refinement of trees of simplified meshes (HLOD) through occlusion queries."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from scenegraph import Overlay, Stage, hookimpl

from .cut import HlodCut
from .overlays import HlodBoxes
from .stage import HlodRefinement

__all__ = [
    "HlodCut",
    "HlodRefinement",
    "scenegraph_register_overlays",
    "scenegraph_register_replications",
    "scenegraph_register_stages",
]


@hookimpl
def scenegraph_register_stages(register: Callable[[type[Stage]], None]) -> None:
    """Hand the stage to the host."""
    register(HlodRefinement)


@hookimpl
def scenegraph_register_overlays(register: Callable[[type[Overlay]], None]) -> None:
    """Hand the viewer what it can show of the stage."""
    register(HlodBoxes)


@hookimpl
def scenegraph_register_replications(register: Callable[[str, Callable[..., Any], str], None]) -> None:
    """Hand the paper's table to the host; what draws and measures is imported when it is run."""

    def replicate(laboratory: Any) -> Any:
        from .replication import replicate as run

        return run(laboratory)

    register("charalambos", replicate, "Coherent HLOD refinement by occlusion queries: Table 1, Figures 2 to 10.")
