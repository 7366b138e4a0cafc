"""Coherent refinement of trees of simplified meshes (HLOD) through occlusion queries."""

from __future__ import annotations

from collections.abc import Callable

from scenegraph import Stage, hookimpl

from .cut import HlodCut
from .stage import HlodRefinement

__all__ = ["HlodCut", "HlodRefinement", "scenegraph_register_stages"]


@hookimpl
def scenegraph_register_stages(register: Callable[[type[Stage]], None]) -> None:
    """Hand the stage to the host."""
    register(HlodRefinement)
