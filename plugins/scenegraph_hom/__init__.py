"""Hierarchical occlusion maps, and the level of visibility from the frequencies of what covers them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from scenegraph import Overlay, Stage, hookimpl

from .figures import plot_block
from .hom import Hom
from .overlays import ByVisibility, MapInset
from .products import Block, Footprint, OcclusionMap

__all__ = [
    "Block",
    "Footprint",
    "Hom",
    "OcclusionMap",
    "plot_block",
    "scenegraph_register_overlays",
    "scenegraph_register_replications",
    "scenegraph_register_stages",
]


@hookimpl
def scenegraph_register_stages(register: Callable[[type[Stage]], None]) -> None:
    """Hand the stage to the host."""
    register(Hom)


@hookimpl
def scenegraph_register_overlays(register: Callable[[type[Overlay]], None]) -> None:
    """Hand the viewer what it can show of the stage."""
    register(ByVisibility)
    register(MapInset)


@hookimpl
def scenegraph_register_replications(register: Callable[[str, Callable[..., Any], str], None]) -> None:
    """Hand the thesis' figures to the host; what draws and measures is imported when they are run."""

    def replicate(laboratory: Any) -> Any:
        from .replication import replicate as run

        return run(laboratory)

    register("kristmann2022", replicate, "Occlusion maps, level of visibility: Figures 3.1, 4.6, 4.7, 4.9, 4.10.")
