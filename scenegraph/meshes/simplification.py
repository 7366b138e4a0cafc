"""Coarser levels of a mesh by edge collapse, each with a measured bound on how far it lies from the mesh.

The collapses are those of the quadric error metric (Garland & Heckbert 1997) in `fast_simplification`. One run down to
the coarsest level gives their order, and every level is a prefix of it: levels are nested, and a chain costs little
more than its coarsest level. What the library leaves to its callers is done here:

* It reports no error. Ours is a bound on the two-sided distance of the surfaces that holds for all their points (see
  `deviation`), larger from level to level.
* Files repeat vertices where normals or texture coordinates have a seam; the library would take each seam for a border
  and tear it open. Positions are welded first, and the attributes looked up on the original surface afterwards.
* It moves vertices out of the mesh's box. They are put back: a level never lies outside the box of the mesh, so that
  nothing that was said of the box is wrong for a level.
* A level is what was asked for or finer; components may vanish and open borders shrink, which the error includes.
"""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..errors import SceneError
from ..mesh import Mesh
from ..progress import Progress, silent
from ..threads import one_blas_thread
from .attributes import Carried, carried
from .cache import DiskCache
from .collapsing import collapse, replay
from .deviation import Surface, surface_deviation

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

#: Counted up whenever results change; part of the name of what is cached.
VERSION = 2
CACHE_KIND = "levels"

#: Shares of the triangles that the levels of a chain have.
RATIOS = (1 / 2, 1 / 4, 1 / 8, 1 / 16, 1 / 32, 1 / 64)
#: No level has fewer triangles: less encloses nothing.
COARSEST = 4

#: How eager the library is; lower values keep the shape a little better and miss the wanted count without a word.
_EAGERNESS = 7.0
#: Rounding of the measurement itself.
_ROUNDING = 1e-9


def simplify(
    mesh: Mesh,
    triangles: int,
    *,
    preserve_border: bool = False,
    cache: DiskCache | Literal["default"] | None = "default",
    progress: Progress = silent,
) -> tuple[Mesh, float]:
    """Collapse edges until no more than so many triangles are left.

    Parameters
    ----------
    mesh : Mesh
    triangles : int
        How many to keep at most; the result has more if nothing else can be collapsed.
    preserve_border : bool
        Never touch an edge with an open end: borders keep their place, but flat parts stay fine along them.
    cache : DiskCache, None or "default"
    progress : Progress, optional

    Returns
    -------
    Mesh
        The mesh itself if it is coarse enough, or not finite.
    float
        Bound on the two-sided distance of the surfaces, in the mesh's units.
    """
    chain = level_chain(mesh, counts=(triangles,), preserve_border=preserve_border, cache=cache, progress=progress)
    return chain[-1]


def level_chain(
    mesh: Mesh,
    ratios: Sequence[float] = RATIOS,
    *,
    counts: Sequence[int] | None = None,
    preserve_border: bool = False,
    cache: DiskCache | Literal["default"] | None = "default",
    refresh: bool = False,
    progress: Progress = silent,
) -> list[tuple[Mesh, float]]:
    """Levels of a mesh, finest first, as `scenegraph.Lod` takes them.

    Parameters
    ----------
    mesh : Mesh
    ratios : floats in 0..1
        Shares of the mesh's triangles, falling.
    counts : ints, optional
        Numbers of triangles instead.
    preserve_border : bool
        See `simplify`.
    cache : DiskCache, None or "default"
    refresh : bool
        Write to the cache, but do not read from it.
    progress : Progress, optional

    Returns
    -------
    list of (Mesh, float)
        The mesh itself with error 0, then each level with its error in the mesh's units; errors never fall. Levels
        that are not coarser than the one before, or would be empty, are left out.

    Examples
    --------
    >>> chain = level_chain(mesh)
    >>> Lod(*(level for level, _ in chain), errors=[error for _, error in chain])
    """
    wanted = _counts(mesh, ratios, counts)
    if not wanted or mesh.problems:
        return [(mesh, 0.0)]
    store = DiskCache() if cache == "default" else cache
    settings = {"counts": wanted, "preserve_border": preserve_border, "attributes": _attribute_key(mesh)}
    key = DiskCache.key(mesh.key, VERSION, settings)
    levels = None
    if store is not None and not refresh:
        arrays = store.load(CACHE_KIND, key)
        if arrays is not None:
            try:
                levels = _from_arrays(arrays)
            except (ValueError, KeyError):
                store.forget(CACHE_KIND, key)
    if levels is None:
        with one_blas_thread():
            levels = _levels(mesh, wanted, preserve_border, progress)
        if store is not None:
            store.store(CACHE_KIND, key, _to_arrays(levels))
    progress("done", 1.0)
    return [(mesh, 0.0), *((_mesh(mesh, level), level.error) for level in levels)]


@dataclass(frozen=True)
class _Level:
    vertices: F64
    faces: I64
    attributes: Carried
    error: float


def _counts(mesh: Mesh, ratios: Sequence[float], counts: Sequence[int] | None) -> list[int]:
    if counts is None:
        if any(not 0 < r <= 1 for r in ratios):
            raise SceneError(f"levels: ratios {list(ratios)!r} are not all in 0..1")
        counts = [int(r * mesh.triangles) for r in ratios]
    if any(b > a for a, b in itertools.pairwise(counts)):
        raise SceneError(f"levels: {list(counts)!r} do not fall from fine to coarse")
    return sorted({int(c) for c in counts if COARSEST <= c < mesh.triangles}, reverse=True)


def _attribute_key(mesh: Mesh) -> str:
    digest = hashlib.sha256()
    for name in ("normals", "uv", "vertex_colors"):
        array = getattr(mesh, name)
        digest.update(b"-" if array is None else name.encode() + array.tobytes())
    return digest.hexdigest()[:16]


def _levels(mesh: Mesh, wanted: Sequence[int], preserve_border: bool, progress: Progress) -> list[_Level]:
    low, high = mesh.bounds
    center, size = 0.5 * low + 0.5 * high, float((high - low).max())
    if not 0 < size < np.inf:
        return []
    progress("collapsing edges", 0.0)
    points, faces, source = _welded(mesh, center, size)
    if len(faces) <= wanted[-1]:
        return []
    least = wanted[-1]
    _, _, collapses = collapse(
        points, faces, target_count=least, agg=_EAGERNESS, return_collapses=True, preserve_border=preserve_border
    )
    original = Surface(points[faces])
    out: list[_Level] = []
    before, error = len(faces), 0.0
    for number, count in enumerate(wanted):
        progress(f"level of {count} triangles", (number + 0.5) / (len(wanted) + 0.5))
        some = collapses[: _enough(collapses, points, faces, count)]
        left, kept, _ = replay(points, faces, some)
        kept = _proper(np.asarray(kept, np.int64))
        if not len(kept):
            break
        if len(kept) >= before:
            continue
        before = len(kept)
        used, kept = np.unique(kept, return_inverse=True)
        kept = kept.reshape(-1, 3)
        vertices = np.clip(center + size * np.asarray(left, np.float64)[used], low, high)
        # measured where they have come to lie, rounding and all
        moved = (vertices - center) / size
        there = surface_deviation(moved[kept], original).bound
        back = surface_deviation(original.triangles, Surface(moved[kept])).bound
        error = max(error, size * (max(there, back) + _ROUNDING))
        pairs, kept, attributes = carried(mesh, source, original, moved, kept)
        out.append(_Level(vertices[pairs], kept, attributes, error))
    return out


def _welded(mesh: Mesh, center: F64, size: float) -> tuple[F64, NDArray[np.int32], I64]:
    """Vertices of equal position are one, in the unit frame; faces with three corners, and the mesh's face of each."""
    used, faces = np.unique(mesh.faces, return_inverse=True)
    # adding 0 makes a negative zero a positive one
    position = mesh.vertices[used] + 0.0
    order = np.lexsort(position.T)
    position = position[order]
    fresh = np.ones(len(order), bool)
    fresh[1:] = (position[1:] != position[:-1]).any(axis=1)
    number = np.empty(len(order), np.int64)
    number[order] = np.cumsum(fresh) - 1
    faces = number[faces.reshape(-1, 3)]
    proper = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    source = np.flatnonzero(proper)
    # vertices that only faces without area had are taken out again: the library would count them
    left, faces = np.unique(faces[source], return_inverse=True)
    return (position[fresh][left] - center) / size, faces.reshape(-1, 3).astype(np.int32), source


def _proper(faces: I64) -> I64:
    return np.asarray(faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])])


def _enough(collapses: I64, points: F64, faces: NDArray[np.int32], count: int) -> int:
    """Fewest collapses that leave no more than `count` faces: the list is a forest, and a face needs three roots."""
    low, high = 0, len(collapses)
    while low < high:
        middle = (low + high) // 2
        root = np.arange(len(points))
        root[collapses[:middle, 1]] = collapses[:middle, 0]
        while True:
            above = root[root]
            if np.array_equal(above, root):
                break
            root = above
        if len(_proper(root[faces])) <= count:
            high = middle
        else:
            low = middle + 1
    return low


def _mesh(mesh: Mesh, level: _Level) -> Mesh:
    return Mesh(
        level.vertices,
        level.faces,
        name=mesh.name,
        color=mesh.color,
        texture=mesh.texture if level.attributes.uv is not None else None,
        normals=level.attributes.normals,
        uv=level.attributes.uv,
        vertex_colors=level.attributes.vertex_colors,
    )


def _to_arrays(levels: Sequence[_Level]) -> dict[str, NDArray[Any]]:
    out: dict[str, NDArray[Any]] = {"errors": np.array([level.error for level in levels])}
    for i, level in enumerate(levels):
        out |= {f"vertices{i}": level.vertices, f"faces{i}": level.faces.astype(np.int32)}
        out |= {f"{k}{i}": v for k, v in level.attributes._asdict().items() if v is not None}
    return out


def _from_arrays(arrays: Mapping[str, NDArray[Any]]) -> list[_Level]:
    out = []
    for i, error in enumerate(arrays["errors"].tolist()):
        vertices, faces = arrays[f"vertices{i}"], arrays[f"faces{i}"].astype(np.int64)
        if faces.min(initial=0) < 0 or faces.max(initial=0) >= len(vertices):
            raise ValueError("the entry does not fit together")
        attributes = Carried(*(arrays.get(f"{k}{i}") for k in Carried._fields))
        if any(a is not None and len(a) != len(vertices) for a in attributes):
            raise ValueError("the entry does not fit together")
        out.append(_Level(vertices, faces, attributes, float(error)))
    return out
