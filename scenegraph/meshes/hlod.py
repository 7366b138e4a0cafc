"""HLOD trees: an octree over a whole scene whose every node has a simplified mesh of all that is below it.

Built as Charalambos (after Gobetti & Marton 2005 and Yoon et al. 2004) describes: split top-down until a leaf has no
more than some 2000 triangles; simplify bottom-up, each node from the meshes of its children, to as many.

What is promised, and tested:

* *Every leaf is drawn once by any cut.* Each triangle belongs to one leaf, by its middle; nothing is clipped.
* *No cracks.* The border at which nodes meet is never simplified: two neighbors fit whatever their levels. Edges of a
  border that the simplification did lose are counted (`HlodReport.broken_edges`). The price is that a node whose border
  is long has more triangles than asked for.
* *Errors are bounds.* No point of the original surface is farther from a node's mesh than the node's model error: the
  largest error of the children plus the measured distance to their meshes, by the triangle inequality
  (`scenegraph.meshes.deviation`). Corners and middles of the node's triangles are measured the other way, too. A
  parent's error is never below a child's.
* *Boxes are nested*, and each encloses its mesh and all meshes below.
"""

from __future__ import annotations

from collections.abc import Iterator
from time import perf_counter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..kernels.boxes import box_from_bounds
from ..mesh import Mesh, MeshTable
from ..progress import Progress, silent
from ..threads import one_blas_thread, upward
from .cache import DiskCache
from .hlod_nodes import NodeMesh, Step, joined, leaf_mesh, simplified
from .hlod_tree import Hlod, HlodReport
from .octree import octree
from .soup import Soup, rows_for_soup, soup_key, soup_of

if TYPE_CHECKING:
    from ..snapshot import Snapshot

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

CACHE_KIND = "hlod trees"
#: Triangles of a node.
TRIANGLES = 2000
#: No level within a node has fewer.
LEAST_TRIANGLES = 32
#: Counted up whenever a tree built from the same input would be another one.
_VERSION = 5


def hlod_of(
    snapshot: Snapshot,
    *,
    triangles: int = TRIANGLES,
    levels: int = 1,
    progress: Progress = silent,
    cache: DiskCache | None = None,
) -> Hlod:
    """The HLOD tree over all rows of a snapshot that can be merged; read from disk if it was built before.

    Parameters
    ----------
    snapshot : Snapshot
    triangles : int
        Most triangles of a leaf; what inner nodes are simplified to.
    levels : int
        Meshes of each node, at most: its own, and some of a half, a quarter, ... of its triangles for refinement within
        nodes. Borders are kept in all of them.
    progress : callable, optional
    cache : DiskCache, optional
        The usual one by default.

    Raises
    ------
    ValueError
        `triangles` below 4, or `levels` below 1.
    """
    if triangles < 4 or levels < 1:
        raise ValueError(f"hlod_of: triangles={triangles}, levels={levels}; a node has at least 4 and 1")
    start = perf_counter()
    cache = DiskCache() if cache is None else cache
    covered = rows_for_soup(snapshot)
    key = cache.key(soup_key(snapshot, covered), _VERSION, {"triangles": triangles, "levels": levels})
    stored = cache.load(CACHE_KIND, key)
    made = None
    if stored is not None:
        try:
            made = _unpacked(snapshot, stored)
        except (KeyError, ValueError, IndexError):
            cache.forget(CACHE_KIND, key)
    if made is None:
        made, arrays = _built(snapshot, soup_of(snapshot, covered), covered, (triangles, levels), progress)
        cache.store(CACHE_KIND, key, arrays)
    made.report.seconds = perf_counter() - start
    return made


class _Node(NamedTuple):
    """Mesh of a node, how it was made from those below, and coarser ones with their distance from it."""

    mesh: NodeMesh
    step: Step
    coarser: list[tuple[NodeMesh, float]]


def _built(
    snapshot: Snapshot, soup: Soup, covered: NDArray[np.bool_], shape: tuple[int, int], progress: Progress
) -> tuple[Hlod, dict[str, Any]]:
    most, levels = shape
    progress("octree", 0.0)
    tree = octree(soup.vertices[soup.faces].mean(axis=1) if len(soup.faces) else np.zeros((0, 3)), most)
    count = len(tree)
    is_leaf = tree.end == np.arange(1, count + 1)
    first_leaf = np.concatenate([[0], np.cumsum(is_leaf)])
    below: list[list[int]] = [[] for _ in range(count)]
    for node in range(1, count):
        below[int(tree.parent[node])].append(node)
    made: list[_Node | None] = [None] * count
    share = np.where(is_leaf, 1, tree.last - tree.first)
    worked, total = 0, max(int(share.sum()), 1)

    def work(node: int) -> None:
        if is_leaf[node]:
            mesh, step = leaf_mesh(soup, tree.order[tree.first[node] : tree.last[node]]), Step(0.0, 0, 0)
        else:
            mesh, step = simplified(joined([m.mesh for m in (made[c] for c in below[node]) if m is not None]), most)
        made[node] = _Node(mesh, step, list(_coarser(mesh, levels - 1)))

    def done(node: int) -> None:
        nonlocal worked
        worked += int(share[node])
        progress("HLOD tree", worked / total)

    with one_blas_thread():
        upward(tree.parent.tolist(), work, done)
    nodes = [m for m in made if m is not None]
    extra: list[NodeMesh] = []
    level_mesh, errors = np.full((levels, count), -1), np.zeros(count)
    level_errors = np.full((levels, count), np.inf)
    low, high = np.full((3, count), np.inf), np.full((3, count), -np.inf)
    # children come after their parents, so backwards each finds its children ready
    for node in range(count - 1, -1, -1):
        mesh, step, coarser = nodes[node]
        errors[node] = float(errors[below[node]].max(initial=0.0)) + step.error
        level_mesh[0, node], level_errors[0, node] = node, errors[node]
        for level, (half, error) in enumerate(coarser, 1):
            level_mesh[level, node], level_errors[level, node] = count + len(extra), errors[node] + error
            extra.append(half)
        points = np.concatenate([mesh.vertices, *(half.vertices for half, _ in coarser)])
        if len(points):
            low[:, node], high[:, node] = points.min(axis=0), points.max(axis=0)
        low[:, node] = np.minimum(low[:, node], low[:, below[node]].min(axis=1, initial=np.inf))
        high[:, node] = np.maximum(high[:, node], high[:, below[node]].max(axis=1, initial=-np.inf))
    edges = [sum(n.step.border_edges for n in nodes), sum(n.step.broken_edges for n in nodes), len(soup.faces)]
    row_start, rows = _rows_by_leaf(soup, tree.order, tree.first[is_leaf], tree.last[is_leaf])
    arrays: dict[str, Any] = {
        "parent": tree.parent,
        "end": tree.end,
        "first_leaf": first_leaf,
        "leaf_row_start": row_start,
        "leaf_rows": rows,
        "errors": errors,
        "bounds": np.concatenate([low, high]),
        "covered": covered,
        "origin": soup.origin,
        "edges": np.array(edges),
        "level_mesh": level_mesh,
        "level_errors": level_errors,
        **_packed([*(n.mesh for n in nodes), *extra]),
    }
    hlod = _unpacked(snapshot, arrays)
    hlod.report.from_cache = False
    return hlod, arrays


def _coarser(mesh: NodeMesh, count: int) -> Iterator[tuple[NodeMesh, float]]:
    """Levels within a node and their distance from its mesh, each with half the triangles if its border lets it."""
    error = 0.0
    for _ in range(count):
        half = len(mesh.faces) // 2
        if half < LEAST_TRIANGLES:
            return
        coarser, step = simplified(mesh, half)
        if len(coarser.faces) > 0.75 * len(mesh.faces):
            return
        mesh, error = coarser, error + step.error
        yield mesh, error


def _rows_by_leaf(soup: Soup, order: I64, first: I64, last: I64) -> tuple[I64, I64]:
    leaf = np.repeat(np.arange(len(first)), last - first)
    count = int(soup.rows.max(initial=0)) + 1
    # leaves are ranges of the order, one after another
    leaf, rows = np.divmod(np.unique(leaf * count + soup.rows[order]), count)
    return np.searchsorted(leaf, np.arange(len(first) + 1)).astype(np.int64), rows


def _packed(meshes: list[NodeMesh]) -> dict[str, Any]:
    colors = np.concatenate([m.colors for m in meshes])
    return {
        "vertex_start": np.cumsum([0, *(len(m.vertices) for m in meshes)]),
        "face_start": np.cumsum([0, *(len(m.faces) for m in meshes)]),
        "vertices": np.concatenate([m.vertices for m in meshes]),
        "normals": np.concatenate([m.normals for m in meshes]),
        # one color is one row, not a million
        "colors": colors[:1] if len(colors) and (colors == colors[0]).all() else colors,
        "faces": np.concatenate([m.faces for m in meshes]).astype(np.int32),
    }


def _unpacked(snapshot: Snapshot, arrays: dict[str, Any]) -> Hlod:
    vertex, face = arrays["vertex_start"], arrays["face_start"]
    parent, end = arrays["parent"], arrays["end"]
    count = int(np.count_nonzero(arrays["level_mesh"] >= 0))
    if arrays["covered"].shape != (snapshot.n,) or len(vertex) != count + 1 or len(face) != count + 1:
        raise ValueError("the stored tree belongs to another scene")
    one_color = len(arrays["colors"]) <= 1
    color = tuple(arrays["colors"][0] / 255) if len(arrays["colors"]) == 1 else None
    normals = arrays["normals"]
    meshes = []
    for node in range(count):
        v, f = slice(int(vertex[node]), int(vertex[node + 1])), slice(int(face[node]), int(face[node + 1]))
        meshes.append(
            Mesh(
                arrays["vertices"][v] + arrays["origin"],
                arrays["faces"][f],
                name=f"hlod {node}",
                color=color,
                # all zero where everything below is shaded flat
                normals=normals[v] if normals[v].any() else None,
                vertex_colors=None if one_color else arrays["colors"][v],
            )
        )
    table = MeshTable(meshes)
    with np.errstate(invalid="ignore"):
        origin = np.tile(arrays["origin"], 2)[:, None]
        low, high = np.split(arrays["bounds"] + origin, 2)
        boxes = box_from_bounds(low, high)
    boxes[:, ~np.isfinite(boxes).all(axis=0)] = np.nan
    border, broken, given = arrays["edges"].tolist()
    children = np.argsort(parent[1:], kind="stable") + 1
    left_out = int(np.count_nonzero(~arrays["covered"] & (snapshot.triangles[0] > 0)))
    return Hlod(
        parent=parent,
        end=end,
        child_start=np.searchsorted(parent[children], np.arange(len(parent) + 1)).astype(np.int64),
        children=children.astype(np.int64),
        first_leaf=arrays["first_leaf"],
        leaf_row_start=arrays["leaf_row_start"],
        leaf_rows=arrays["leaf_rows"],
        boxes=boxes,
        errors=arrays["errors"],
        triangles=table.triangles[: len(parent)],
        table=table,
        level_mesh=arrays["level_mesh"],
        level_errors=arrays["level_errors"],
        covered=arrays["covered"],
        transforms=snapshot.transforms.copy(),
        colors=snapshot.colors.copy(),
        report=HlodReport(
            from_cache=True,
            input_triangles=int(given),
            node_triangles=int(table.triangles.sum()),
            nbytes=sum(m.nbytes for m in table.meshes),
            border_edges=int(border),
            broken_edges=int(broken),
            left_out=left_out,
        ),
    )
