"""Coherent refinement of trees of simplified meshes (HLOD) through occlusion queries."""

from __future__ import annotations

from collections.abc import Callable

from scenegraph import Overlay, Stage, hookimpl

from .cut import HlodCut
from .overlays import HlodBoxes
from .stage import HlodRefinement

__all__ = ["HlodCut", "HlodRefinement", "scenegraph_register_overlays", "scenegraph_register_stages"]


@hookimpl
def scenegraph_register_stages(register: Callable[[type[Stage]], None]) -> None:
    """Hand the stage to the host."""
    register(HlodRefinement)


@hookimpl
def scenegraph_register_overlays(register: Callable[[type[Overlay]], None]) -> None:
    """Hand the viewer what it can show of the stage."""
    register(HlodBoxes)
