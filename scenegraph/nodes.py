"""The retained scene graph, in Performer's vocabulary: plain Python objects that a user edits.

No array is visible here. `Snapshot` flattens the graph for the stages; an edit marks what it touched, and
`Snapshot.sync()` refreshes only that.
"""

from __future__ import annotations

import itertools
import weakref
from collections.abc import Iterable, Iterator, Sequence
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import SceneError
from .mesh import Color, Mesh, as_color

_serials = itertools.count(1)

#: Edits that a snapshot must hear of: a moved transform, a new color, or anything that changes which rows there are.
Change = Literal["moved", "color", "structure"]


class Listener(Protocol):
    """What hears of edits below a node; held weakly."""

    def _hear(self, change: Change, source: Node) -> None: ...


class Node:
    """Anything in the graph. A node has at most one parent; share meshes, not nodes.

    Parameters
    ----------
    name : str, optional
    never_cull : bool, default False
        Drawables below this node are never hidden by any stage.
    """

    def __init__(self, *, name: str = "", never_cull: bool = False) -> None:
        self.name = name
        self._never_cull = bool(never_cull)
        self._parent: Group | None = None
        #: Unique for the life of the process; snapshots use it as the stable key of a drawable.
        self.serial = next(_serials)
        self._listeners: weakref.WeakSet[Listener] | None = None

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name!r}>"

    @property
    def parent(self) -> Group | None:
        """The group that holds this node, or None."""
        return self._parent

    @property
    def never_cull(self) -> bool:
        """Whether drawables below this node are exempt from hiding."""
        return self._never_cull

    @never_cull.setter
    def never_cull(self, value: bool) -> None:
        self._never_cull = bool(value)
        self._tell("structure")

    def path(self) -> str:
        """Names from the root down, joined by '/'."""
        parts: list[str] = []
        node: Node | None = self
        while node is not None:
            parts.append(node.name or type(node).__name__)
            node = node._parent
        return "/" + "/".join(reversed(parts))

    def walk(self) -> Iterator[Node]:
        """Yield the node and all below it, depth first."""
        stack: list[Node] = [self]
        while stack:
            node = stack.pop()
            yield node
            if isinstance(node, Group):
                stack.extend(reversed(node.children))

    def find(self, name: str) -> Node:
        """First node of this name, depth first.

        Raises
        ------
        SceneError
            If there is none.
        """
        for node in self.walk():
            if node.name == name:
                return node
        raise SceneError(f"no node is named {name!r} below {self.path()}")

    def _listen(self, listener: Listener) -> None:
        if self._listeners is None:
            self._listeners = weakref.WeakSet()
        self._listeners.add(listener)

    def _unlisten(self, listener: Listener) -> None:
        if self._listeners is not None:
            self._listeners.discard(listener)

    def _tell(self, change: Change) -> None:
        node: Node | None = self
        while node is not None:
            for listener in node._listeners or ():
                listener._hear(change, self)
            node = node._parent


class Group(Node):
    """A node with children; its bounding box encloses theirs.

    Parameters
    ----------
    *children : Node
    name, never_cull
        As for every node.
    """

    def __init__(self, *children: Node, name: str = "", never_cull: bool = False) -> None:
        super().__init__(name=name, never_cull=never_cull)
        self._children: list[Node] = []
        self.add(*children)

    @property
    def children(self) -> tuple[Node, ...]:
        """The children, in order."""
        return tuple(self._children)

    def __iter__(self) -> Iterator[Node]:
        return iter(self.children)

    def __len__(self) -> int:
        return len(self._children)

    def add(self, *nodes: Node) -> Group:
        """Append nodes and return this group.

        Raises
        ------
        SceneError
            If one already has a parent, is not a node, or is this group or one of its ancestors.
        """
        for node in nodes:
            if not isinstance(node, Node):
                raise SceneError(f"{node!r} is not a scene-graph node; wrap a mesh in Geode(mesh)")
            if node._parent is not None:
                raise SceneError(
                    f"{node!r} already has the parent {node._parent.path()}; remove it there first, "
                    "or make a second Geode that shares its mesh"
                )
            if isinstance(node, Group):
                ancestor: Node | None = self
                while ancestor is not None:
                    if ancestor is node:
                        raise SceneError(f"{node!r} cannot be put below itself")
                    ancestor = ancestor._parent
            node._parent = self
            self._children.append(node)
        if nodes:
            self._tell("structure")
        return self

    def remove(self, node: Node) -> None:
        """Take a child out.

        Raises
        ------
        SceneError
            If it is not a child of this group.
        """
        if node._parent is not self:
            raise SceneError(f"{node!r} is not a child of {self.path()}")
        self._tell("structure")
        self._children.remove(node)
        node._parent = None


def rotation_matrix(angle: float, axis: Sequence[float]) -> NDArray[np.float64]:
    """(3, 3) rotation by `angle` degrees about `axis`."""
    x, y, z = np.asarray(axis, np.float64) / np.linalg.norm(axis)
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) * c + (1 - c) * np.outer((x, y, z), (x, y, z)) + s * k)


class Transform(Group):
    """A group in a coordinate frame of its own; moving it is cheap.

    Parameters
    ----------
    *children : Node
    matrix : (4, 4) float, optional
        Affine, applied to column vectors. Excludes the three below.
    translation : 3 floats, optional
    scale : float or 3 floats, optional
    rotation : (angle in degrees, axis of 3 floats), optional
        The parts are applied in the order scale, rotation, translation.
    """

    def __init__(
        self,
        *children: Node,
        matrix: ArrayLike | None = None,
        translation: ArrayLike | None = None,
        scale: ArrayLike | None = None,
        rotation: tuple[float, Sequence[float]] | None = None,
        name: str = "",
        never_cull: bool = False,
    ) -> None:
        super().__init__(*children, name=name, never_cull=never_cull)
        if matrix is not None and not (translation is None and scale is None and rotation is None):
            raise SceneError(f"{self!r}: give a matrix, or translation/scale/rotation, not both")
        if matrix is None:
            matrix = np.eye(4)
            if rotation is not None:
                matrix[:3, :3] = rotation_matrix(*rotation)
            if scale is not None:
                with np.errstate(invalid="ignore"):
                    matrix[:3, :3] *= np.broadcast_to(np.asarray(scale, np.float64), (3,))
            if translation is not None:
                matrix[:3, 3] = translation
        self._matrix = self._checked(matrix)

    def _checked(self, matrix: ArrayLike) -> NDArray[np.float64]:
        m = np.array(matrix, np.float64)
        if m.shape != (4, 4):
            raise SceneError(f"{self!r}: matrix has shape {m.shape}, expected (4, 4)")
        if m[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
            raise SceneError(f"{self!r}: the last row of the matrix is {m[3].tolist()}, expected [0, 0, 0, 1]")
        m.flags.writeable = False
        return m

    @property
    def matrix(self) -> NDArray[np.float64]:
        """(4, 4) local-to-parent matrix, read-only; assign a new one to move the subtree."""
        return self._matrix

    @matrix.setter
    def matrix(self, value: ArrayLike) -> None:
        self._matrix = self._checked(value)
        self._tell("moved")

    @property
    def is_singular(self) -> bool:
        """Whether the matrix flattens or is not finite."""
        linear = self._matrix[:3, :3]
        size = np.linalg.norm(linear, axis=0)
        with np.errstate(all="ignore"):
            volume = abs(np.linalg.det(linear / size))
        return not (np.isfinite(self._matrix).all() and volume > 1e-12)


class Switch(Group):
    """A group that shows some of its children.

    Parameters
    ----------
    *children : Node
    active : "all", "none", an index, or a set of indices
    """

    def __init__(
        self, *children: Node, active: str | int | Iterable[int] = "all", name: str = "", never_cull: bool = False
    ) -> None:
        super().__init__(*children, name=name, never_cull=never_cull)
        self._active = self._checked(active)

    def _checked(self, active: str | int | Iterable[int]) -> str | frozenset[int]:
        if isinstance(active, str):
            if active not in ("all", "none"):
                raise SceneError(f"{self!r}: active={active!r}; use 'all', 'none', an index or a set of indices")
            return active
        return frozenset([active] if isinstance(active, int) else active)

    @property
    def active(self) -> str | frozenset[int]:
        """Which children are on."""
        return self._active

    @active.setter
    def active(self, value: str | int | Iterable[int]) -> None:
        self._active = self._checked(value)
        self._tell("structure")

    def active_children(self) -> list[Node]:
        """The children that are on, in order."""
        if isinstance(self._active, str):
            return list(self._children) if self._active == "all" else []
        return [c for i, c in enumerate(self._children) if i in self._active]


class Geode(Node):
    """One drawable: a mesh at a place in the graph.

    Parameters
    ----------
    mesh : Mesh
        May be shared by any number of geodes.
    color : 3 or 4 floats in 0..1, optional
        Instead of the mesh's own base color.
    source : object, optional
        What this drawable was imported from (a VTK actor, a trimesh node); the host never looks inside.
    """

    def __init__(
        self,
        mesh: Mesh,
        *,
        name: str = "",
        color: Sequence[float] | None = None,
        never_cull: bool = False,
        source: object = None,
    ) -> None:
        super().__init__(name=name or getattr(mesh, "name", ""), never_cull=never_cull)
        if not isinstance(mesh, Mesh):
            raise SceneError(f"Geode needs a scenegraph Mesh, got {type(mesh).__name__}; see Scene.from_trimesh")
        self._mesh = mesh
        self._color = as_color(color)
        self.source = source

    @property
    def color(self) -> Color | None:
        """RGBA in 0..1, or None for the mesh's own; assign to repaint."""
        return self._color

    @color.setter
    def color(self, value: Sequence[float] | None) -> None:
        self._color = as_color(value)
        self._tell("color")

    @property
    def mesh(self) -> Mesh:
        """The shared mesh; assigning another one is a structural edit."""
        return self._mesh

    @mesh.setter
    def mesh(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self._tell("structure")


class Lod(Node):
    """One drawable with several meshes; level 0 is the finest.

    Parameters
    ----------
    *levels : Geode or Mesh
        Finest first.
    errors : floats, optional
        Model error of each level in local units: how far its surface lies from level 0. Unknown (NaN) if not given,
        except that level 0 has none.
    """

    def __init__(
        self,
        *levels: Geode | Mesh,
        errors: Sequence[float] | None = None,
        name: str = "",
        never_cull: bool = False,
    ) -> None:
        super().__init__(name=name, never_cull=never_cull)
        self.levels: tuple[Geode, ...] = tuple(
            level if isinstance(level, Geode) else Geode(level, name=f"{name}:{i}") for i, level in enumerate(levels)
        )
        if not self.levels:
            raise SceneError(f"{self!r} has no levels; give at least one Geode or Mesh")
        values = [0.0] + [np.nan] * (len(self.levels) - 1) if errors is None else [float(e) for e in errors]
        if len(values) != len(self.levels):
            raise SceneError(f"{self!r}: {len(values)} errors for {len(self.levels)} levels")
        if any(b < a for a, b in itertools.pairwise(values)):
            raise SceneError(f"{self!r}: errors {values} must not decrease from finest to coarsest")
        self.errors: tuple[float, ...] = tuple(values)
