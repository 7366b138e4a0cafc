"""Occluders for meshes that have none: convex solids inside them, and polygons in their large flat parts.

Every candidate is proved to be inside before anything is chosen (the arguments stand in `solids` and `facets`); what
covers most of the silhouette is taken first. Whatever cannot be proved is left out, and the result says why: a wrong
occluder makes visible things vanish, a missing one costs some time.
"""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from typing import Literal

import numpy as np

from ..errors import SceneError
from ..mesh import Mesh
from ..progress import Progress, silent
from ..threads import one_blas_thread
from .cache import DiskCache
from .candidates import Candidate, flat_candidates, insides_of, solid_candidates, tally, volume_share
from .convex import convex_solid, upright_box
from .fitted import FittedOccluder, FittedOccluders
from .prepared import PreparedMesh, hindrance
from .silhouette import Silhouette
from .solids import Openings
from .topology import Shell

#: Counted up whenever results change; part of the name of what is cached.
VERSION = 2
CACHE_KIND = "occluders"

_VIEWS, _PIXELS = 16, 64


@dataclass(frozen=True)
class _Settings:
    shape: Literal["box", "polytope"]
    max_occluders: int
    min_gain: float
    cells: int
    planes: int
    polygons: bool
    openings: Openings

    def __post_init__(self) -> None:
        bounds = {"max_occluders": (1, 64), "min_gain": (0.0, 1.0), "cells": (8, 160), "planes": (6, 64)}
        for name, (low, high) in bounds.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise SceneError(f"fitting occluders: {name}={value!r} is not between {low} and {high}")
        if self.shape not in ("box", "polytope"):
            raise SceneError(f"fitting occluders: shape={self.shape!r}; use 'box' or 'polytope'")
        if self.openings not in ("none", "outward", "any"):
            raise SceneError(f"fitting occluders: openings={self.openings!r}; use 'none', 'outward' or 'any'")


def fit_occluders(
    mesh: Mesh,
    *,
    shape: Literal["box", "polytope"] = "polytope",
    max_occluders: int = 8,
    min_gain: float = 0.01,
    cells: int = 48,
    planes: int = 12,
    polygons: bool = True,
    openings: Openings = "none",
    cache: DiskCache | Literal["default"] | None = "default",
    refresh: bool = False,
    trace_memory: bool = False,
    progress: Progress = silent,
) -> FittedOccluders:
    """Find occluders that lie inside a mesh.

    For eyes outside the mesh, whatever lies behind one of them is hidden by the mesh itself. With `openings`, this
    holds only for things that are outside, too, as one can look in through an opening; see `scenegraph.meshes.solids`.
    They hold for the mesh as it is given: a coarser level of it may be thinner.

    Parameters
    ----------
    mesh : Mesh
    shape : "polytope" or "box"
        Polytopes cover more, but have more sides for a stage to work on; boxes are taken where they cover nearly as
        much.
    max_occluders : int
    min_gain : float
        Share of the silhouette that each must add.
    cells : int
        Resolution of the search along each axis, 8 to 160: time and memory grow with its third power. It decides what
        is found, not whether that is right.
    planes : int
        Sides of a polytope, and of a polygon, at most.
    polygons : bool
        Whether to look for flat occluders as well. They are one-sided where all of the mesh is closed.
    openings : "none", "outward" or "any"
        Look for solids in open shells, too, as if each opening had a flat cover: in buildings without a floor, in
        scans with holes. Only where nothing else is inside, and no eye goes there. "outward" takes only shells whose
        faces are turned outward, unlike those of a room or a valley.
    cache : DiskCache, None or "default"
    refresh : bool
        Write to the cache, but do not read from it.
    trace_memory : bool
        Measure the memory as well; small meshes then take several times as long.
    progress : Progress, optional

    Returns
    -------
    FittedOccluders
        Without occluders, but with the reason, for a mesh that is translucent, not finite, too thin, or open.

    Raises
    ------
    SceneError
        A setting out of bounds.
    """
    settings = _Settings(shape, max_occluders, min_gain, cells, planes, polygons, openings)
    reason = hindrance(mesh)
    if reason:
        return FittedOccluders(notes=(reason,))
    store = DiskCache() if cache == "default" else cache
    key = DiskCache.key(mesh.key, VERSION, asdict(settings))
    if store is not None and not refresh:
        arrays = store.load(CACHE_KIND, key)
        if arrays is not None:
            try:
                return FittedOccluders.from_arrays(arrays)
            except (ValueError, KeyError, TypeError):
                store.forget(CACHE_KIND, key)
    start = time.perf_counter()
    with _peak_memory(trace_memory) as peak, one_blas_thread():
        result = _fitted(mesh, settings, progress)
    result = replace(result, seconds=time.perf_counter() - start, peak_bytes=peak[0] if peak else None)
    if store is not None:
        store.store(CACHE_KIND, key, result.to_arrays())
    progress("done", 1.0)
    return result


@contextmanager
def _peak_memory(wanted: bool) -> Iterator[list[int]]:
    """Measure the most that is allocated within; what someone else traces is left alone, and the answer stays empty."""
    out: list[int] = []
    if not wanted or tracemalloc.is_tracing():
        yield out
        return
    tracemalloc.start()
    try:
        yield out
        out.append(tracemalloc.get_traced_memory()[1])
    finally:
        tracemalloc.stop()


def _fitted(mesh: Mesh, settings: _Settings, progress: Progress) -> FittedOccluders:
    progress("taking the mesh apart", 0.0)
    box = _box(mesh)
    if box is not None:
        return box
    prepared = PreparedMesh.of(mesh)
    if not len(prepared.faces):
        return FittedOccluders(notes=("none of its triangles has an area",))
    whole = _itself(prepared, settings)
    if whole is not None:
        return whole
    silhouette = Silhouette.of(prepared.points[prepared.faces], views=_VIEWS, size=_PIXELS)
    shells = prepared.worth_a_look(settings.openings)
    insides = insides_of(
        shells, settings.openings, prepared.clearance, cells=settings.cells, progress=_part(progress, 0.05, 0.4)
    )
    pool = solid_candidates(
        insides,
        silhouette,
        # some more than wanted, and smaller ones: growing changes the order
        count=settings.max_occluders + max(4, settings.max_occluders // 2),
        least_gain=0.5 * settings.min_gain,
        planes=settings.planes if settings.shape == "polytope" else None,
        progress=_part(progress, 0.4, 0.8),
    )
    notes = [] if pool else [_why_no_solids(prepared, shells, settings.openings)]
    if settings.polygons:
        progress("finding flat parts", 0.8)
        before = tally(silhouette, pool)
        before.choose(settings.max_occluders, settings.min_gain, np.array([c.worth for c in pool]))
        flat = flat_candidates(prepared, silhouette, before, least_gain=settings.min_gain, corners=settings.planes)
        if not flat:
            notes.append("no polygons: no flat part adds much")
        pool += flat
    progress("choosing", 0.9)
    worth = np.array([c.worth for c in pool])
    taken = tally(silhouette, pool).choose(settings.max_occluders, settings.min_gain, worth)
    if pool and not taken:
        notes.append(f"nothing covers {settings.min_gain:.1%} of the silhouette")
    kept: list[Candidate] = []
    occluders: list[FittedOccluder] = []
    for i, gain in taken:
        occluder = FittedOccluder(pool[i].kind, prepared.in_mesh(pool[i].points), pool[i].two_sided, gain)
        try:
            occluder.node()
        except SceneError:  # far from the origin, rounding can bend what was flat
            notes.append(f"a {occluder.kind} left out: rounding spoils it so far from the origin")
        else:
            kept.append(pool[i])
            occluders.append(occluder)
    solids = [c for c in kept if c.kind != "polygon"]
    alone = tally(silhouette, solids).choose(len(solids), 0.0, np.ones(len(solids)))
    return FittedOccluders(
        occluders=tuple(occluders),
        coverage=sum(o.gain for o in occluders),
        solid_coverage=sum(gain for _, gain in alone),
        volume_share=volume_share(insides, solids),
        closed_shells=len(prepared.closed),
        open_shells=len(prepared.shells) - len(prepared.closed),
        openings=sum(len(s.openings) for s in prepared.shells),
        is_covered=bool(solids) and any(not s.is_closed for s in shells),
        notes=tuple(notes),
    )


def fit_convex(mesh: Mesh, *, planes: int = 12) -> FittedOccluders | None:
    """The one occluder of a mesh that is a convex solid already, in a few milliseconds; None for any other mesh.

    Parameters
    ----------
    mesh : Mesh
    planes : int
        A solid of more sides is no occluder: stages work on every side.
    """
    if hindrance(mesh):
        return None
    box = _box(mesh)
    if box is not None:
        return box
    prepared = PreparedMesh.of(mesh)
    return _itself(prepared, _Settings("polytope", 1, 0.0, 8, planes, False, "none")) if len(prepared.faces) else None


def _box(mesh: Mesh) -> FittedOccluders | None:
    corners = upright_box(mesh)
    return None if corners is None else _alone(FittedOccluder("box", corners, True, 1.0))


def _itself(prepared: PreparedMesh, settings: _Settings) -> FittedOccluders | None:
    found = convex_solid(prepared, planes=settings.planes)
    if found is None or (settings.shape == "box" and not found[1]):
        return None
    corners, is_box = found
    occluder = FittedOccluder("box" if is_box else "polytope", prepared.in_mesh(corners), True, 1.0)
    try:
        occluder.node()
    except SceneError:  # far from the origin, rounding can bend what was flat
        return None
    return _alone(occluder)


def _alone(occluder: FittedOccluder) -> FittedOccluders:
    """All of a convex mesh but a hair's breadth."""
    return FittedOccluders((occluder,), coverage=1.0, solid_coverage=1.0, volume_share=1.0, closed_shells=1)


def _why_no_solids(prepared: PreparedMesh, shells: Sequence[Shell], openings: Openings) -> str:
    if not prepared.shells:
        return "no solids: no piece has the four triangles that it takes to enclose something"
    if not shells:
        edges = sum(len(o) for s in prepared.shells for o in s.openings)
        count = sum(len(s.openings) for s in prepared.shells)
        where = "1 opening" if count == 1 else f"{count} openings"
        return f"no solids: open ({edges} free or mismatched edges in {where})"
    if openings == "outward" and all(not s.is_closed and s.volume < 0 for s in shells):
        return "no solids: open, and faces inward like a room"
    return "no solids: no room inside at this resolution"


def _part(progress: Progress, start: float, end: float) -> Progress:
    def part(what: str, share: float) -> None:
        progress(what, start + (end - start) * share)

    return part
