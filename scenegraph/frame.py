"""Frame: what travels through the stages of a pipeline, once per view."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .log import FrameRecord, StageRecord
from .mesh import Mesh, MeshTable
from .nodes import Node
from .snapshot import Snapshot
from .traversal import Batch, walk
from .view import View

if TYPE_CHECKING:
    from .stage import Stage

T = TypeVar("T")


@dataclass(frozen=True)
class StandIn:
    """Meshes of a table that are drawn together instead of the rows they stand for."""

    rows: NDArray[np.int64]
    table: MeshTable
    #: (j,) which meshes of the table; none at all if what the rows show is not worth a triangle.
    chosen: NDArray[np.int64]
    #: (4, 4) local-to-world matrix of the meshes.
    matrix: NDArray[np.float64]

    @property
    def triangles(self) -> int:
        """Triangles of the chosen meshes."""
        return int(self.table.triangles[self.chosen].sum())


class Frame:
    """The state of one view in one frame. Stages only take away from it.

    Attributes
    ----------
    snapshot : Snapshot
    view : View
    index : int
        Number of the frame; seeds anything random.
    view_name : str
        Which of several views this is (the walls of a CAVE, say): what a stage remembers belongs to one of them.
    visible : (n,) bool
        Rows that no stage has hidden. Read-only for stages: use `hide`.
    level : (n,) uint8
        Level to be drawn; use `coarsen`.
    standins : list of StandIn
    previous : Frame or None
        The frame before of the same view, without its own previous. How long it took to draw is in
        `previous.record.draw_ms`, if whoever drew it has told.
    device : object or None
        GL services; present if a stage of the pipeline needs "gl".
    record : FrameRecord
    """

    def __init__(
        self,
        snapshot: Snapshot,
        view: View,
        *,
        index: int = 0,
        view_name: str = "",
        previous: Frame | None = None,
        device: Any = None,
    ) -> None:
        self.snapshot = snapshot
        self.view = view
        self.index = index
        self.view_name = view_name
        self.previous = previous
        self.device = device
        self.visible: NDArray[np.bool_] = np.ones(snapshot.n, bool)
        self.level: NDArray[np.uint8] = np.zeros(snapshot.n, np.uint8)
        self.standins: list[StandIn] = []
        self.record = FrameRecord(index=index)
        self._products: dict[type, Any] = {}
        self._stage: Stage | None = None
        self._stage_record: StageRecord | None = None
        self._after: list[tuple[NDArray[np.bool_], NDArray[np.uint8], list[StandIn]]] = []
        #: (m,) nodes of the hierarchy under which nothing is visible, as far as traversals have found; or None.
        self.dead_nodes: NDArray[np.bool_] | None = None
        self._visible_count = snapshot.n

    # -- asking ---------------------------------------------------------------------------------------------------

    @property
    def visible_count(self) -> int:
        """Number of rows still visible."""
        if self._visible_count < 0:
            self._visible_count = int(np.count_nonzero(self.visible))
        return self._visible_count

    def candidates(self) -> NDArray[np.int64]:
        """Rows still visible, ascending."""
        return self.visible.nonzero()[0]

    def kept(self) -> NDArray[np.bool_]:
        """(n,) rows that are drawn, by themselves or by a stand-in; a copy."""
        return _kept(self.visible, self.standins)

    @property
    def kept_count(self) -> int:
        """Number of rows that are drawn, by themselves or by a stand-in."""
        return int(np.count_nonzero(self.kept())) if self.standins else self.visible_count

    @property
    def drawn_objects(self) -> int:
        """Rows that are drawn by themselves, and meshes of stand-ins."""
        return int(np.count_nonzero(self.visible)) + sum(len(s.chosen) for s in self.standins)

    def dead_nodes_now(self) -> NDArray[np.bool_]:
        """(m,) nodes of the hierarchy under which nothing is visible; a copy."""
        if self.dead_nodes is not None:
            return self.dead_nodes.copy()
        tree = self.snapshot.tree
        before = np.concatenate([[0], np.cumsum(self.visible, dtype=np.int32)])
        return np.asarray(before[tree.end] == before[tree.first])

    def mesh_index(self) -> NDArray[np.int32]:
        """(n,) index into `snapshot.meshes` of the level chosen for each row."""
        meshes: NDArray[np.int32] = self.snapshot.level_meshes[np.arange(self.snapshot.n), self.level]
        return meshes

    def drawn_triangles(self) -> int:
        """Triangles that this frame draws: visible rows at their levels, and stand-ins."""
        return self.triangles_of(self.visible, self.level, self.standins)

    def triangles_of(
        self, visible: NDArray[np.bool_], level: NDArray[np.uint8], standins: Sequence[StandIn] = ()
    ) -> int:
        """Triangles of (n,) visible rows at their (n,) levels, and of stand-ins."""
        rows = np.flatnonzero(visible)
        counts = self.snapshot.triangles
        picked = counts[0, rows] if len(counts) == 1 else counts[level[rows], rows]
        return int(picked.sum(dtype=np.int64)) + sum(s.triangles for s in standins)

    def _remember(self, *, changed: bool, levels: bool) -> None:
        """Keep the state after a stage, for `hidden_by` and the triangle counts; `levels` may have changed, or not."""
        if self._after and not changed:
            self._after.append(self._after[-1])
            return
        level = self.level.copy() if levels or not self._after else self._after[-1][1]
        self._after.append((self.visible.copy(), level, list(self.standins)))

    def _count_triangles(self) -> None:
        whole = int(self.snapshot.triangles[0].sum(dtype=np.int64)) if self.snapshot.n else 0
        for record, state in zip(self.record.stages, self._after, strict=True):
            record.triangles_before = whole
            whole = record.triangles_after = whole if record.skipped else self.triangles_of(*state)
        self.record.triangles = whole

    def hidden_by(self) -> NDArray[np.int16]:
        """(n,) index of the stage that hid each row, -1 where it is drawn, by itself or by a stand-in."""
        out = np.full(self.snapshot.n, -1, np.int16)
        before = np.ones(self.snapshot.n, bool)
        for i, (visible, _, standins) in enumerate(self._after):
            after = _kept(visible, standins)
            out[before & ~after] = i
            before = after
        return out

    # -- taking away ----------------------------------------------------------------------------------------------

    def _declared(self, what: str | type) -> None:
        if self._stage is not None and what not in self._stage.writes:
            word = what if isinstance(what, str) else what.__name__
            raise TypeError(
                f"stage {self._stage.name!r} changes {word!r} but does not declare it: writes = {self._stage.writes!r}"
            )

    def hide(self, rows: ArrayLike) -> None:
        """Visible → hidden, except for rows that are protected (NEVER_CULL, or of unknown extent).

        Parameters
        ----------
        rows : (n,) bool, or indices
        """
        self._declared("visible")
        rows = np.asarray(rows)
        if rows.dtype == bool:
            if rows.shape != self.visible.shape:
                raise ValueError(f"hide: a mask of shape {rows.shape} for {self.snapshot.n} rows")
            if self.snapshot.any_protected:
                rows = rows & ~self.snapshot.protected
            np.logical_and(self.visible, ~rows, out=self.visible)
        else:
            rows = rows.astype(np.int64).ravel()
            self.visible[rows[~self.snapshot.protected[rows]]] = False
        self._touched()

    def _touched(self) -> None:
        self._visible_count = -1
        self.dead_nodes = None

    def coarsen(self, rows: ArrayLike, levels: ArrayLike) -> None:
        """Finer → coarser; a level beyond the last becomes the last, a finer one than now is ignored.

        Parameters
        ----------
        rows : (n,) bool, or (k,) indices
        levels : int or (k,) int
        """
        self._declared("level")
        index = np.asarray(rows)
        index = np.flatnonzero(index) if index.dtype == bool else index.astype(np.int64)
        last = self.snapshot.level_count[index].astype(np.int64) - 1
        wanted = np.minimum(np.asarray(levels, np.int64), last)
        self.level[index] = np.maximum(self.level[index], np.maximum(wanted, 0)).astype(np.uint8)

    def replace(
        self,
        rows: ArrayLike | Node,
        mesh: Mesh | MeshTable,
        matrix: ArrayLike | None = None,
        *,
        chosen: ArrayLike | None = None,
    ) -> None:
        """Draw a stand-in instead of rows, or of all rows below a node.

        Rows of an earlier stand-in may be covered by a later one only as a whole.

        Parameters
        ----------
        rows : (k,) indices, or a node of the graph
        mesh : Mesh or MeshTable
            The stand-in; or what it is chosen from: meshes that are loaded once, of which each frame draws a few.
        matrix : (4, 4) float, optional
            Its local-to-world matrix; world coordinates without.
        chosen : (j,) indices, optional
            Which meshes of the table are drawn, all of them by default. They stand for the rows together: which mesh
            shows which row is the business of the stage.
        """
        self._declared("standins")
        if isinstance(rows, Node):
            index = np.arange(*self.snapshot.rows_of(rows))
        else:
            index = np.asarray(rows, np.int64).ravel()
        table = mesh.alone if isinstance(mesh, Mesh) else mesh
        picked = np.arange(len(table)) if chosen is None else np.asarray(chosen, np.int64).ravel()
        if len(picked) and not (picked.min() >= 0 and picked.max() < len(table)):
            raise ValueError(f"replace: chosen names mesh {int(picked.max())} of a table of {len(table)}")
        index = index[~self.snapshot.protected[index]]
        covered = np.zeros(self.snapshot.n, bool)
        covered[index] = True
        kept = []
        for standin in self.standins:
            inside = covered[standin.rows]
            if inside.any() and not inside.all():
                raise ValueError("replace: the rows overlap an earlier stand-in without covering it")
            if not inside.any():
                kept.append(standin)
        place = np.eye(4) if matrix is None else np.array(matrix, np.float64)
        self.standins = [*kept, StandIn(index, table, picked, place)]
        self.visible[index] = False
        self._touched()

    def traverse(
        self,
        classify: Callable[[Batch], NDArray[np.integer]],
        *,
        carry: ArrayLike | None = None,
        flat: bool | None = None,
    ) -> None:
        """Walk the hierarchy level by level and hide what `classify` calls OUT.

        Subtrees in which nothing is visible any more are not entered; below a node that is IN nothing is asked again.

        Parameters
        ----------
        classify : callable
            Gets a `Batch` of boxes (nodes, then rows) and returns (k,) verdicts `OUT`, `PARTIAL` or `IN`. A node may be
            called OUT only if every box inside it would be.
        carry : array, optional
            What the root inherits; children get their parent's row of `Batch.carry`, which `classify` may change.
        flat : bool, optional
            Ask rows at once, without the tree. By default the host decides by their number: a few array operations over
            all rows are cheaper than several levels, up to some 10⁵ rows.
        """
        self._declared("visible")
        result = walk(self, classify, carry=carry, flat=flat)
        self.dead_nodes = result.dead
        if self._stage_record is not None:
            self._stage_record.tested += result.tested
        if result.visible is not None:
            self.visible = result.visible
        self._visible_count = -1

    # -- handing on -----------------------------------------------------------------------------------------------

    def put(self, product: object) -> None:
        """Hand a product to later stages, by its class."""
        self._declared(type(product))
        self._products[type(product)] = product

    def get(self, kind: type[T]) -> T:
        """The product of this class.

        Raises
        ------
        KeyError
            No stage of this frame has put one.
        """
        if kind not in self._products:
            raise KeyError(f"no stage of this frame has put a {kind.__name__}")
        product: T = self._products[kind]
        return product

    def find(self, kind: type[T]) -> T | None:
        """The product of this class, or None."""
        return self._products.get(kind)

    def count(self, **values: float) -> None:
        """Add to this stage's counters in the log; `tested` and `queries` are columns of their own."""
        if self._stage_record is None:
            return
        counts = self._stage_record.counts
        for key, value in values.items():
            if key in ("tested", "queries"):
                setattr(self._stage_record, key, getattr(self._stage_record, key) + int(value))
            else:
                counts[key] = counts.get(key, 0) + float(value)


def _kept(visible: NDArray[np.bool_], standins: list[StandIn]) -> NDArray[np.bool_]:
    kept = visible.copy()
    for standin in standins:
        kept[standin.rows] = True
    return kept
