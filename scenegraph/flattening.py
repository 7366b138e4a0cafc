"""The walk over a scene graph that finds its drawables and what they inherit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .nodes import Geode, Group, Lod, Node, Switch, Transform
from .occluder import Occluder


@dataclass(frozen=True)
class Flattened:
    """Drawables in depth-first order, and what is above them. Children that a `Switch` has turned off are left out.

    Attributes
    ----------
    drawables : list of Geode or Lod
    group : (n,) int64
        Index into `groups` of the innermost group around each drawable.
    transform : (n,) int32
        Index into `transforms` of the innermost transform.
    never_cull : (n,) bool
        The drawable, or a group around it, must not be hidden.
    groups : list of Group
    group_parent : (g,) int64
        Index of the group around each group; -1 for the root.
    group_first, group_end : list of int
        The drawables below a group are ``drawables[first:end]``.
    transforms : list of Transform or None
        Parents come before their children. The first stands for the world and is None.
    transform_parent : (t,) int32
        -1 for the world.
    occluders : list of (Occluder, int)
        Each with the index of its transform.
    """

    drawables: list[Geode | Lod]
    group: NDArray[np.int64]
    transform: NDArray[np.int32]
    never_cull: NDArray[np.bool_]
    groups: list[Group]
    group_parent: NDArray[np.int64]
    group_first: list[int]
    group_end: list[int]
    transforms: list[Transform | None]
    transform_parent: NDArray[np.int32]
    occluders: list[tuple[Occluder, int]]


def flattened(root: Group) -> Flattened:
    """Walk through a graph, once and without recursion: a graph may be deeper than Python's stack."""
    drawables: list[Geode | Lod] = []
    row_group: list[int] = []
    row_transform: list[int] = []
    row_keep: list[bool] = []
    groups: list[Group] = []
    group_parent: list[int] = []
    group_first: list[int] = []
    group_end: list[int] = []
    transforms: list[Transform | None] = [None]
    transform_parent: list[int] = [-1]
    occluders: list[tuple[Occluder, int]] = []
    # None ends the group whose number is beside it
    stack: list[tuple[Node | None, int, int, bool]] = [(root, -1, 0, False)]
    while stack:
        node, group, transform, keep = stack.pop()
        if node is None:
            group_end[group] = len(drawables)
            continue
        keep = keep or node._never_cull
        if isinstance(node, Group):
            if isinstance(node, Transform):
                transforms.append(node)
                transform_parent.append(transform)
                transform = len(transforms) - 1
            groups.append(node)
            group_parent.append(group)
            group_first.append(len(drawables))
            group_end.append(-1)
            group = len(groups) - 1
            stack.append((None, group, 0, False))
            below = node.active_children() if isinstance(node, Switch) else node._children
            stack.extend((child, group, transform, keep) for child in reversed(below))
        elif isinstance(node, (Geode, Lod)):
            drawables.append(node)
            row_group.append(group)
            row_transform.append(transform)
            row_keep.append(keep)
        elif isinstance(node, Occluder):
            occluders.append((node, transform))
    return Flattened(
        drawables=drawables,
        group=np.array(row_group, np.int64),
        transform=np.array(row_transform, np.int32),
        never_cull=np.array(row_keep, bool),
        groups=groups,
        group_parent=np.array(group_parent, np.int64),
        group_first=group_first,
        group_end=group_end,
        transforms=transforms,
        transform_parent=np.array(transform_parent, np.int32),
        occluders=occluders,
    )
