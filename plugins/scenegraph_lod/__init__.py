"""Levels of detail: by distance, by error in pixels, by visibility, within a budget of triangles, and under stress."""

from __future__ import annotations

from collections.abc import Callable

from scenegraph import Stage, hookimpl

from .budget import LodBudget
from .distance import LodDistance
from .error import LodError
from .stress import LodStress
from .visibility import LodVisibility

__all__ = [
    "LodBudget",
    "LodDistance",
    "LodError",
    "LodStress",
    "LodVisibility",
    "scenegraph_register_stages",
]


@hookimpl
def scenegraph_register_stages(register: Callable[[type[Stage]], None]) -> None:
    """Hand the stages to the host."""
    for stage in (LodDistance, LodError, LodVisibility, LodBudget, LodStress):
        register(stage)
