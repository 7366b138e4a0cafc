"""What an HLOD tree is: nodes in depth-first order with boxes, errors and meshes, and what a cut through it covers."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..mesh import MeshTable

if TYPE_CHECKING:
    from ..snapshot import Snapshot

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


@dataclass
class HlodReport:
    """What building a tree took, and how well it went.

    Attributes
    ----------
    seconds : float
        Build time; of reading, if it came from the cache.
    from_cache : bool
    input_triangles, node_triangles : int
        Of the scene, and of all nodes together.
    nbytes : int
        Of the meshes.
    border_edges, broken_edges : int
        At which simplified nodes may meet others; and those of them that a neighbor no longer finds.
    left_out : int
        Rows with triangles that the tree does not cover: translucent, textured, protected or without a place.
    """

    seconds: float = 0.0
    from_cache: bool = False
    input_triangles: int = 0
    node_triangles: int = 0
    nbytes: int = 0
    border_edges: int = 0
    broken_edges: int = 0
    left_out: int = 0

    @property
    def text(self) -> str:
        """In one line."""
        how = "read" if self.from_cache else "built"
        return (
            f"{self.input_triangles:,} triangles → {self.node_triangles:,} in all nodes, {self.nbytes / 1e6:.0f} MB, "
            f"{how} in {self.seconds:.1f} s; {self.broken_edges} of {self.border_edges:,} border edges broken; "
            f"{self.left_out} drawables left out"
        )


@dataclass(frozen=True, eq=False)
class Hlod:
    """A tree of meshes over the rows of a snapshot; nodes in depth-first order, the root first.

    Attributes
    ----------
    parent : (m,) int64
        -1 for the root.
    end : (m,) int64
        One behind the last node below; a subtree is a slice.
    child_start, children : (m + 1,), (m - 1,) int64
        ``children[child_start[i]:child_start[i + 1]]`` are those of node i.
    first_leaf : (m + 1,) int64
        Number of leaves before each node: those below node i are ``first_leaf[i]`` to ``first_leaf[end[i]]``.
    leaf_row_start, leaf_rows : (leaves + 1,), (r,) int64
        Rows that have triangles in each leaf.
    boxes : (6, m) float64
        World boxes, components first; nested, and around all meshes below.
    errors : (m,) float64
        Bound of the distance from the original surface, in world units; 0 at leaves, never below a child's.
    triangles : (m,) int64
    table : MeshTable
        The mesh of each node, in world coordinates; then those of the coarser levels within nodes.
    level_mesh : (L, m) int64
        Meshes of the levels of each node, finest first; row 0 is the node's own. -1 where a node has fewer.
    level_errors : (L, m) float64
        Their model errors; infinite where there is no level.
    covered : (n,) bool
        Rows that the tree stands for.
    transforms, colors : arrays
        Of the snapshot when the tree was built.
    report : HlodReport
    """

    parent: I64
    end: I64
    child_start: I64
    children: I64
    first_leaf: I64
    leaf_row_start: I64
    leaf_rows: I64
    boxes: F64
    errors: F64
    triangles: I64
    table: MeshTable
    level_mesh: I64
    level_errors: F64
    covered: NDArray[np.bool_]
    transforms: F64
    colors: NDArray[np.float32]
    report: HlodReport = field(default_factory=HlodReport)

    def __len__(self) -> int:
        return len(self.parent)

    @property
    def is_leaf(self) -> NDArray[np.bool_]:
        """(m,) nodes without children: their meshes are the original triangles."""
        return np.asarray(self.end == np.arange(1, len(self) + 1))

    def children_of(self, nodes: I64) -> I64:
        """Children of nodes, one after another."""
        first, counts = self.child_start[nodes], np.diff(self.child_start)[nodes]
        ends = np.cumsum(counts)
        total = int(ends[-1]) if len(ends) else 0
        return np.asarray(self.children[np.repeat(first - (ends - counts), counts) + np.arange(total)])

    def leaves_of(self, nodes: I64) -> NDArray[np.int64]:
        """(leaves,) how many of the nodes stand over each leaf: 1 everywhere for a cut through the whole tree."""
        change = np.zeros(len(self.leaf_row_start), np.int64)
        np.add.at(change, self.first_leaf[nodes], 1)
        np.add.at(change, self.first_leaf[self.end[nodes]], -1)
        return np.asarray(np.cumsum(change)[:-1])

    def rows_of(self, nodes: I64, n: int) -> NDArray[np.bool_]:
        """(n,) rows with a triangle below one of the nodes."""
        rows = np.zeros(n, bool)
        seen = np.repeat(self.leaves_of(nodes) > 0, np.diff(self.leaf_row_start))
        rows[self.leaf_rows[seen]] = True
        return rows

    def cut(self, fine_enough: NDArray[np.bool_]) -> I64:
        """The highest nodes that are fine enough, or leaves: a cut through the tree, ascending.

        Parameters
        ----------
        fine_enough : (m,) bool
        """
        stop = fine_enough | self.is_leaf
        nodes = np.zeros(min(len(self), 1), np.int64)
        found = []
        while len(nodes):
            found.append(nodes[stop[nodes]])
            nodes = self.children_of(nodes[~stop[nodes]])
        return np.sort(np.concatenate(found)) if found else np.zeros(0, np.int64)

    def is_stale(self, snapshot: Snapshot) -> bool:
        """Whether what the tree covers has moved or changed its color since it was built."""
        return not (
            np.array_equal(self.transforms, snapshot.transforms) and np.array_equal(self.colors, snapshot.colors)
        )
