"""Occlusion queries: ask the GPU whether anything of a box would be seen, in three orders of asking."""

from __future__ import annotations

from collections.abc import Callable

from scenegraph import Overlay, Stage, hookimpl

from .history import QueryHistory
from .overlays import Asked, ByAge
from .query import Query

__all__ = ["Query", "QueryHistory", "scenegraph_register_overlays", "scenegraph_register_stages"]


@hookimpl
def scenegraph_register_stages(register: Callable[[type[Stage]], None]) -> None:
    """Hand the stage to the host."""
    register(Query)


@hookimpl
def scenegraph_register_overlays(register: Callable[[type[Overlay]], None]) -> None:
    """Let the viewer show what was asked, and how old answers are."""
    register(Asked)
    register(ByAge)
