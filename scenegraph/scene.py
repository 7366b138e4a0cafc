"""Scene: a graph with its views and camera paths; loading and converting are one call each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .nodes import Group, Node
from .view import View

if TYPE_CHECKING:
    from .snapshot import Snapshot


class Scene:
    """What is looked at: the root of a graph, named views and named camera paths.

    Parameters
    ----------
    root : Group, optional
    name : str
    up : 3 floats
        Which way is up; (0, 0, 1) unless the file says otherwise.
    background : 3 floats in 0..1
    views : mapping of str to View, optional
    paths : mapping of str to list of View, optional
    """

    def __init__(
        self,
        root: Group | None = None,
        *,
        name: str = "scene",
        up: Sequence[float] = (0.0, 0.0, 1.0),
        background: Sequence[float] = (0.72, 0.80, 0.88),
        views: Mapping[str, View] | None = None,
        paths: Mapping[str, Sequence[View]] | None = None,
    ) -> None:
        self.root = Group(name=name) if root is None else root
        self.name = name
        self.up = (float(up[0]), float(up[1]), float(up[2]))
        self.background = (float(background[0]), float(background[1]), float(background[2]))
        self.views: dict[str, View] = dict(views or {})
        self.paths: dict[str, list[View]] = {k: list(v) for k, v in (paths or {}).items()}
        #: What was odd about the input but did not stop it, one sentence each.
        self.problems: list[str] = []

    def __repr__(self) -> str:
        return f"<Scene {self.name!r}>"

    def add(self, *nodes: Node) -> Scene:
        """Add nodes to the root and return this scene."""
        self.root.add(*nodes)
        return self

    def snapshot(self) -> Snapshot:
        """The graph flattened into arrays; keep it and call its `sync()` after edits."""
        from .snapshot import Snapshot

        return Snapshot(self)

    @classmethod
    def load(cls, path: str | Path) -> Scene:
        """Read a model file (see `scenegraph.exchange.load`)."""
        from .exchange import load

        return load(path)

    @classmethod
    def from_trimesh(cls, source: Any, *, name: str = "scene") -> Scene:
        """From a `trimesh.Scene`, `trimesh.Trimesh` or a list of them (see `scenegraph.exchange.from_trimesh`)."""
        from .exchange import from_trimesh

        return from_trimesh(source, name=name)

    @classmethod
    def from_pyvista(cls, source: Any, *, name: str = "scene") -> Scene:
        """From a `pyvista.Plotter`, `MultiBlock` or data set (see `scenegraph.exchange.from_pyvista`)."""
        from .exchange import from_pyvista

        return from_pyvista(source, name=name)

    def to_trimesh(self) -> Any:
        """As a `trimesh.Scene` with the same hierarchy."""
        from .exchange import to_trimesh

        return to_trimesh(self)

    def to_multiblock(self) -> Any:
        """As a nested `pyvista.MultiBlock` in world coordinates."""
        from .exchange import to_multiblock

        return to_multiblock(self)
