"""What stages may need of a snapshot before their first frame, and the host knows how to make."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import pluggy

from ..progress import Progress

if TYPE_CHECKING:
    from ..snapshot import Snapshot
    from .hlod_tree import Hlod
    from .levels import SceneLevels
    from .placing import SceneOccluders

# The marker that `scenegraph.hookimpl` is; importing it from there would import the whole host.
_hookimpl = pluggy.HookimplMarker("scenegraph")


@_hookimpl
def scenegraph_register_preparations(register: Callable[[str, Callable[..., Any], str], None]) -> None:
    """Register the host's own preparations."""
    register("levels", levels, "Levels of detail declared in the graph; for drawables without, made from their meshes.")
    register("occluders", occluders, "Occluders declared in the graph; where there are none, fitted into its meshes.")
    register("hlod_tree", hlod_tree, "A tree of simplified meshes over all drawables that can be merged.")
    register("hlod_tree_levels", hlod_tree_levels, "The same, with three levels of detail within each node.")


def occluders(snapshot: Snapshot, progress: Progress) -> SceneOccluders | None:
    """Fit occluders into the most promising meshes, unless the graph declares some.

    Returns
    -------
    SceneOccluders or None
        What was fitted; None where there was no need.
    """
    if len(snapshot.occluders):
        return None
    from .placing import occluders_for

    found = occluders_for(snapshot, progress=progress)
    snapshot.adopt_occluders({entry.node: entry.occluders for entry in found.placed})
    return found


def hlod_tree(snapshot: Snapshot, progress: Progress) -> Hlod:
    """Build an HLOD tree over the whole scene, or read it from the cache."""
    from .hlod import hlod_of

    return hlod_of(snapshot, progress=progress)


def hlod_tree_levels(snapshot: Snapshot, progress: Progress) -> Hlod:
    """As `hlod_tree`, for refinement within nodes."""
    from .hlod import hlod_of

    return hlod_of(snapshot, levels=3, progress=progress)


def levels(snapshot: Snapshot, progress: Progress) -> SceneLevels:
    """Make coarser levels for drawables that have none, and let the snapshot adopt them; the graph stays as it is.

    Returns
    -------
    SceneLevels
        What was made, and what was left out.
    """
    from .levels import levels_for

    made = levels_for(snapshot, progress=progress)
    snapshot.adopt_levels(made.chains)
    return made
