"""Snapshot: the scene graph flattened into arrays, the form in which stages see it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .errors import SceneError
from .flattening import flattened
from .hierarchy import spatialize
from .kernels.boxes import box_packed, box_to_bounds, box_transformed
from .kernels.slices import slice_expand
from .mesh import Mesh
from .nodes import Change, Geode, Group, Lod, Node, Transform
from .occluder import Occluder
from .occluders import OccluderTable
from .shape_table import ShapeTable

if TYPE_CHECKING:
    from .scene import Scene

#: Color of a drawable that has none of its own.
DEFAULT_COLOR = (0.78, 0.78, 0.76, 1.0)


class Snapshot:
    """Arrays over the drawables (rows) of a scene, in depth-first order of the bounding hierarchy.

    Parameters
    ----------
    scene : Scene
    fanout : int
        See `scenegraph.hierarchy.spatialize`.

    Attributes
    ----------
    n : int
        Number of rows. Children that a `Switch` has turned off have none.
    boxes : (6, n) float64
        World boxes, components first: center, half extent. NaN where unknown.
    origin : (3,) float64
        Center of the scene; `packed` is relative to it.
    packed : (n, 8) float32
        See `scenegraph.kernels.boxes.box_packed`.
    radius : float
        Upper bound of |center - origin| + |half extent| over rows and nodes.
    meshes : list of Mesh
    level_meshes : (n, L) int32
        Index into `meshes` per level, -1 where a row has fewer levels.
    triangles : (L, n) int32
    errors : (L, n) float32
        Model error in world units of each level; NaN where unknown.
    transforms : (t, 4, 4) float64
        World matrices; `transform_index` (n,) int32 says which row uses which.
    colors : (n, 4) float32
    never_cull, unknown : (n,) bool
        Rows no stage may hide: by wish of the author; because the box is not finite.
    keys : (n,) int64
        Serial numbers of the drawables: stable over edits that reorder rows.
    tree : Hierarchy
    occluders : OccluderTable
    version, structure_version : int
        Counted up by `sync` when anything, or the set of rows, has changed.
    """

    def __init__(self, scene: Scene, *, fanout: int = 16) -> None:
        self.scene = scene
        self.fanout = fanout
        self.version = 0
        self.structure_version = 0
        self._moved: dict[int, Transform] = {}
        self._shape_index: NDArray[np.int32]
        self.unknown: NDArray[np.bool_]
        self._rebuild = False
        self._prepared: dict[str, Any] = {}
        self._adopted: dict[Geode | Lod, Sequence[Occluder]] = {}
        self._chains: dict[Mesh, Sequence[tuple[Mesh, float]]] = {}
        self._watched: Group | None = None
        self._build()

    # -- building -------------------------------------------------------------------------------------------------

    def _build(self) -> None:
        root = self.scene.root
        if self._watched is not root:
            if self._watched is not None:
                self._watched._unlisten(self)
            root._listen(self)
            self._watched = root
        flat = flattened(root)
        self._transform_nodes = flat.transforms
        self._transform_parent = flat.transform_parent
        self._transform_row = {id(t): i for i, t in enumerate(flat.transforms) if t is not None}
        self.transforms = np.tile(np.eye(4), (len(flat.transforms), 1, 1))
        self._update_transforms(np.arange(len(flat.transforms)))

        self.n = len(flat.drawables)
        self._shapes, shape_index = ShapeTable.build(flat.drawables, self._chains)
        boxes = self._placed(shape_index, flat.transform)
        order, self.tree = spatialize(boxes, flat.group, flat.group_parent, fanout=self.fanout)
        position = np.empty(self.n, np.int64)
        position[order] = np.arange(self.n)
        self.boxes = np.ascontiguousarray(boxes[:, order])
        self.transform_index = flat.transform[order]
        self.geodes: list[Geode | Lod] = [flat.drawables[i] for i in order]
        self.keys = np.array([node.serial for node in self.geodes], np.int64)
        self._row_by_key: dict[int, int] = {}
        self.never_cull = flat.never_cull[order]
        self._shape_index = shape_index[order]
        self._take_shapes()
        self._paint()
        self._set_origin()
        self._repack(None)
        self._rows_by_transform: tuple[NDArray[np.int32], NDArray[np.int64]] | None = None
        # a group's rows are a slice in either order, if not the same rows in the same order
        self._group_slice: dict[int, tuple[int, int]] = {}
        for node, a, b in zip(flat.groups, flat.group_first, flat.group_end, strict=True):
            if b > a:
                start = int(position[a:b].min()) if b - a < self.n else 0
                self._group_slice[id(node)] = (start, start + b - a)
        self._occluder_nodes = flat.occluders
        self._build_occluders()
        self._moved.clear()
        self._rebuild = False

    def _placed(self, shapes: NDArray[np.int32], transforms: NDArray[np.int32]) -> NDArray[np.float64]:
        """World boxes of shapes below transforms; all NaN where a number is not finite."""
        boxes = box_transformed(self._shapes.boxes[:, shapes], self.transforms[transforms])
        boxes[:, ~np.isfinite(boxes).all(axis=0)] = np.nan
        return boxes

    def _take_shapes(self) -> None:
        shapes = self._shapes
        self.meshes: list[Mesh] = shapes.meshes
        self.level_meshes = shapes.levels[self._shape_index]
        self.triangles = shapes.triangles(self.level_meshes)
        self.level_count = (self.level_meshes >= 0).sum(axis=1).astype(np.uint8)
        self.errors = np.full((shapes.errors.shape[1], self.n), np.nan, np.float32)
        self._scale_errors(np.arange(self.n))

    def _scale_errors(self, rows: NDArray[np.int64]) -> None:
        self.errors[:, rows] = self._shapes.world_errors(
            self._shape_index[rows], self.transforms, self.transform_index[rows]
        )

    def _paint(self) -> None:
        self.colors = np.array([self._color(node) for node in self.geodes], np.float32).reshape(-1, 4)
        self._repaint = False

    @staticmethod
    def _color(node: Geode | Lod) -> tuple[float, float, float, float]:
        geode = node if isinstance(node, Geode) else node.levels[0]
        mesh = geode._mesh
        # a base color multiplies textures and vertex colors: white leaves them as they are
        painted = mesh.texture is not None or mesh.vertex_colors is not None
        return geode._color or mesh.color or ((1.0, 1.0, 1.0, 1.0) if painted else DEFAULT_COLOR)

    def _set_origin(self) -> None:
        bounds = box_to_bounds(self.boxes)
        known = bounds[:, np.isfinite(bounds).all(axis=0)]
        self.origin = np.zeros(3) if not known.size else 0.5 * known[:3].min(axis=1) + 0.5 * known[3:].max(axis=1)

    def _repack(self, rows: NDArray[np.int64] | None) -> None:
        if rows is None:
            self.packed = box_packed(self.boxes, self.origin)
            self.unknown = np.asarray(~np.isfinite(self.boxes).all(axis=0))
        else:
            self.packed[rows] = box_packed(self.boxes[:, rows], self.origin)
            self.unknown[rows] = ~np.isfinite(self.boxes[:, rows]).all(axis=0)
        self.protected = self.never_cull | self.unknown
        self.any_protected = bool(self.protected.any())
        self.tree.refit(self.boxes, self.origin, rows)
        if len(self.tree):
            reach = np.abs(self.tree.boxes[:3, 0] - self.origin) + self.tree.boxes[3:, 0]
            # every box lies in the root's; 3x covers that a corner is not a center and what `packed` was grown by
            self.radius = float(3 * np.linalg.norm(reach)) if np.isfinite(reach).all() else np.inf
        else:
            self.radius = 0.0

    def adopt_occluders(self, occluders: Mapping[Geode | Lod, Sequence[Occluder]]) -> None:
        """Use occluders that are not in the graph, in the coordinates of a drawable each, which owns them.

        Replaces those adopted before; those of drawables that are taken out of the graph are dropped with them.
        """
        self._adopted = dict(occluders)
        self._build_occluders()
        self.version += 1

    def adopt_levels(self, chains: Mapping[Mesh, Sequence[tuple[Mesh, float]]]) -> None:
        """Use coarser levels that are not in the graph, for all drawables that have a mesh and no levels of their own.

        Rows and numbers of meshes stay as they are. What was prepared before is dropped, and `structure_version`
        counted up: who holds arrays over levels has to look again.

        Parameters
        ----------
        chains : mapping of Mesh to sequences of (Mesh, float)
            The mesh itself and its coarser levels, each with its model error in local units, as
            `scenegraph.meshes.level_chain` gives them. They stay until others are adopted for the same mesh.
        """
        new = {m: tuple(c) for m, c in chains.items() if self._chains.get(m, ((m, 0.0),)) != tuple(c)}
        if not new:
            return
        if any(not chain or chain[0][0] is not mesh for mesh, chain in new.items()):
            raise SceneError("adopted levels begin with the mesh that they belong to")
        self._chains |= new
        before = self._shapes.boxes[:, self._shape_index]
        self._shapes, self._shape_index = ShapeTable.build(self.geodes, self._chains, self.meshes)
        if np.array_equal(before, self._shapes.boxes[:, self._shape_index], equal_nan=True):
            self._take_shapes()
        else:
            self._build()
        self._prepared.clear()
        self.version += 1
        self.structure_version += 1

    def _build_occluders(self) -> None:
        nodes = [o for o, _ in self._occluder_nodes]
        places = [t for _, t in self._occluder_nodes]
        owners = [self._owned_rows(o.owner) for o in nodes]
        for node, adopted in self._adopted.items():
            first, end = self.rows_of(node)
            if end > first:
                nodes.extend(adopted)
                places.extend([int(self.transform_index[first])] * len(adopted))
                owners.extend([(first, end)] * len(adopted))
        self.occluders = OccluderTable.build(
            nodes, np.array(places, np.int64), np.array(owners, np.int64).reshape(-1, 2)
        )
        self.occluders.place(self.transforms)

    def _owned_rows(self, owner: Node | None) -> tuple[int, int]:
        return (0, 0) if owner is None else self.rows_of(owner)

    # -- asking ---------------------------------------------------------------------------------------------------

    @property
    def boxes32(self) -> NDArray[np.float32]:
        """(8, n) float32 components-first view of `packed`."""
        return self.packed.T

    @property
    def mesh_index(self) -> NDArray[np.int32]:
        """(n,) index into `meshes` of the finest level."""
        first: NDArray[np.int32] = self.level_meshes[:, 0]
        return first

    def rows_of(self, node: Node) -> tuple[int, int]:
        """First and end row of the drawables below a node; (0, 0) if there are none."""
        if isinstance(node, (Geode, Lod)):
            if not self._row_by_key:
                self._row_by_key = {int(key): row for row, key in enumerate(self.keys)}
            row = self._row_by_key.get(node.serial)
            return (0, 0) if row is None else (row, row + 1)
        return self._group_slice.get(id(node), (0, 0))

    def names(self, rows: Sequence[int] | NDArray[np.integer]) -> list[str]:
        """Paths of drawables, for people."""
        return [self.geodes[int(r)].path() for r in rows]

    def prepared(self, name: str, build: Callable[[Snapshot], Any]) -> Any:
        """A product derived from this snapshot, built at the first call and kept until the rows change."""
        if name not in self._prepared:
            self._prepared[name] = build(self)
        return self._prepared[name]

    def memory(self) -> dict[str, int]:
        """Bytes of each array that grows with the rows, the hierarchy and the transforms; meshes are counted apart."""
        names: tuple[str, ...] = (
            "boxes",
            "packed",
            "level_meshes",
            "triangles",
            "errors",
            "level_count",
            "transform_index",
            "colors",
        )
        names += ("never_cull", "unknown", "protected", "keys", "transforms", "_shape_index")
        sizes = {name.lstrip("_"): int(getattr(self, name).nbytes) for name in names}
        return sizes | {"tree": self.tree.nbytes, "occluders": self.occluders.nbytes}

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays of the snapshot, without the meshes."""
        return sum(self.memory().values())

    # -- following edits ------------------------------------------------------------------------------------------

    def _hear(self, change: Change, source: Node) -> None:
        if change == "moved" and isinstance(source, Transform):
            self._moved[id(source)] = source
        elif change == "color":
            self._repaint = True
        else:
            self._rebuild = True

    def _update_transforms(self, index: NDArray[np.int64]) -> None:
        for i in index:
            node = self._transform_nodes[i]
            if node is not None:
                self.transforms[i] = node._matrix
        # parents come first in depth-first order; a chain of k transforms takes k rounds over what is left
        left = index[index > 0]
        done = np.ones(len(self.transforms), bool)
        done[left] = False
        while len(left):
            ready = done[self._transform_parent[left]]
            now = left[ready]
            with np.errstate(invalid="ignore", over="ignore"):
                self.transforms[now] = self.transforms[self._transform_parent[now]] @ self.transforms[now]
            done[now] = True
            left = left[~ready]

    def sync(self) -> set[str]:
        """Take over what changed in the graph since the last call.

        Returns
        -------
        set of str
            Empty; with "transforms" and "boxes" after moves, "colors" after painting, "structure" when the set of rows
            was rebuilt.
        """
        if self._rebuild or self._watched is not self.scene.root:
            self._build()
            self._prepared.clear()
            self.version += 1
            self.structure_version += 1
            return {"structure", "transforms", "boxes", "colors"}
        changed: set[str] = set()
        if self._repaint:
            self._paint()
            self.version += 1
            changed.add("colors")
        return changed | self._sync_moves()

    def _sync_moves(self) -> set[str]:
        if not self._moved:
            return set()
        below = np.zeros(len(self.transforms), bool)
        below[[self._transform_row[k] for k in self._moved if k in self._transform_row]] = True
        self._moved.clear()
        if len(self.transforms) > 1:
            below = self._spread(below)
        index = np.flatnonzero(below)
        if not len(index):
            return set()
        self._update_transforms(index)
        if self._rows_by_transform is None:
            order = np.argsort(self.transform_index, kind="stable").astype(np.int32)
            start = np.searchsorted(self.transform_index[order], np.arange(len(self.transforms) + 1))
            self._rows_by_transform = order, start
        order, start = self._rows_by_transform
        rows = np.sort(order[slice_expand(start[index], start[index + 1])]).astype(np.int64)
        self.boxes[:, rows] = self._placed(self._shape_index[rows], self.transform_index[rows])
        self._repack(rows)
        if len(self.errors) > 1:
            self._scale_errors(rows)
        self.occluders.place(self.transforms)
        self.version += 1
        return {"transforms", "boxes"}

    def _spread(self, moved: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Moved transforms and all below them: parents come first, so the sweep ends after as many rounds as levels."""
        parent = self._transform_parent[1:]
        while True:
            grown = moved.copy()
            grown[1:] |= moved[parent]
            if np.array_equal(grown, moved):
                return moved
            moved = grown
