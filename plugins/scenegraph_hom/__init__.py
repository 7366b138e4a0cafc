"""Hierarchical occlusion maps, and the level of visibility from the frequencies of what covers them."""

from __future__ import annotations

from collections.abc import Callable

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
