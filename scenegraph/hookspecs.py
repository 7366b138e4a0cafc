"""The hooks through which a plugin hands classes and functions to the host, once."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import pluggy

if TYPE_CHECKING:
    from .overlay import Overlay
    from .stage import Stage

hookspec = pluggy.HookspecMarker("scenegraph")
hookimpl = pluggy.HookimplMarker("scenegraph")


@hookspec
def scenegraph_register_stages(register: Callable[[type[Stage]], None]) -> None:
    """Register stage classes: ``register(MyStage)`` for each."""


@hookspec
def scenegraph_register_scenes(register: Callable[..., None]) -> None:
    """Register scenes: ``register(name, build, summary)``; ``build(**options)`` returns a `Scene`."""


@hookspec
def scenegraph_register_metrics(register: Callable[[str, Callable[..., Any], str], None]) -> None:
    """Register metrics: ``register(name, function, summary)``; the function compares a frame with the truth."""


@hookspec
def scenegraph_register_preparations(register: Callable[[str, Callable[..., Any], str], None]) -> None:
    """Register preparations: ``register(name, build, summary)``; ``build(snapshot, progress)`` makes it."""


@hookspec
def scenegraph_register_replications(register: Callable[[str, Callable[..., Any], str], None]) -> None:
    """Register replications of papers: ``register(name, replicate, summary)``; ``replicate(laboratory)`` makes one."""


@hookspec
def scenegraph_register_overlays(register: Callable[[type[Overlay]], None]) -> None:
    """Register what the viewer can show: ``register(MyOverlay)`` for each."""
