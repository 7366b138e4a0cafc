"""Hierarchical occlusion maps, and the level of visibility from the frequencies of what covers them."""

from __future__ import annotations

from collections.abc import Callable

from scenegraph import Stage, hookimpl

from .figures import plot_block
from .hom import Hom
from .products import Block, Footprint, OcclusionMap

__all__ = [
    "Block",
    "Footprint",
    "Hom",
    "OcclusionMap",
    "plot_block",
    "scenegraph_register_stages",
]


@hookimpl
def scenegraph_register_stages(register: Callable[[type[Stage]], None]) -> None:
    """Hand the stage to the host."""
    register(Hom)
