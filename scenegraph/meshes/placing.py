"""Occluders for the drawables of a scene: which meshes are fitted, and which of their occluders are worth having.

A solid is proved for things outside its mesh (see `scenegraph.meshes.solids`). A sky dome or the walls of a room are
closed meshes, too, and everything is inside: solids of drawables that hold other drawables are left out.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import SceneError
from ..mesh import Mesh
from ..nodes import Geode, Group, Lod, Switch
from ..occluder import Occluder
from ..progress import Progress, silent
from .candidates import insides_of
from .fitted import FittedOccluder, FittedOccluders
from .fitting import fit_convex, fit_occluders
from .prepared import PreparedMesh
from .solids import Interior

if TYPE_CHECKING:
    from ..scene import Scene
    from ..snapshot import Snapshot

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

#: Resolution at which it is looked whether something is inside.
_CELLS = 32


@dataclass
class PlacedOccluders:
    """Occluders of one drawable, ready to be put where it is.

    Attributes
    ----------
    node : Geode or Lod
        Their owner.
    occluders : list of Occluder
    """

    node: Geode | Lod
    occluders: list[Occluder] = field(default_factory=list)


@dataclass
class MeshOccluders:
    """What became of one mesh.

    Attributes
    ----------
    mesh : Mesh
    drawables : int
        How many drawables that are large enough share it.
    area : float
        Mean projected area of all of them together, in world units squared.
    fitted : FittedOccluders
    placed : int
        Occluder nodes made from it.
    notes : list of str
        Why some or all of its drawables got none.
    """

    mesh: Mesh
    drawables: int
    area: float
    fitted: FittedOccluders
    placed: int = 0
    notes: list[str] = field(default_factory=list)


@dataclass
class SceneOccluders:
    """Occluders for a scene; nothing is changed in its graph before `attach`.

    Attributes
    ----------
    placed : list of PlacedOccluders
    meshes : list of MeshOccluders
        In the order in which they were fitted, the most promising first.
    meshes_left : int
        Meshes that were not looked at, as they promise little.
    """

    placed: list[PlacedOccluders]
    meshes: list[MeshOccluders]
    meshes_left: int

    def __len__(self) -> int:
        return sum(len(p.occluders) for p in self.placed)

    def attach(self) -> None:
        """Put the occluders into the graph, beside the drawables they belong to: they move with them.

        A drawable directly below a `Switch` gets a group of its own, which takes its place, so that the switch goes on
        counting its children as before.
        """
        for entry in self.placed:
            parent = entry.node.parent
            if parent is None:
                raise SceneError(f"{entry.node!r} is no longer in the graph; fit its occluders anew")
            if isinstance(parent, Switch):
                parent = _wrapped(entry.node, parent)
            parent.add(*entry.occluders)

    def detach(self) -> None:
        """Take the occluders out of the graph again."""
        for entry in self.placed:
            for occluder in entry.occluders:
                if occluder.parent is not None:
                    occluder.parent.remove(occluder)


def occluders_for(
    source: Scene | Snapshot,
    *,
    max_meshes: int = 64,
    max_nodes: int = 5000,
    least_size: float = 0.001,
    progress: Progress = silent,
    **settings: Any,
) -> SceneOccluders:
    """Fit occluders to the drawables of a scene that promise most.

    Meshes are taken in the order of the projected area of all drawables that share them. Of what is found, those
    occluders are kept that cover the largest areas.

    Parameters
    ----------
    source : Scene or Snapshot
    max_meshes : int
        How many meshes are searched at most; of the others, those that are convex themselves still count.
    max_nodes : int
        How many occluders are made at most.
    least_size : float
        Drawables whose box has a shorter diagonal than this share of the scene's are left out.
    progress : Progress, optional
    **settings
        For `fit_occluders`.

    Returns
    -------
    SceneOccluders
        Call its `attach` to use them.
    """
    # the scene's room lies above this one; a snapshot is what has no snapshot
    snapshot: Snapshot = source.snapshot() if hasattr(source, "snapshot") else source
    rows = _large_rows(snapshot, least_size)
    size = snapshot.boxes[3:, rows]
    area = 2 * (size[0] * size[1] + size[1] * size[2] + size[2] * size[0])  # a quarter of the surface
    mesh_of = snapshot.mesh_index[rows]
    promise = np.bincount(mesh_of, area, minlength=len(snapshot.meshes))
    ranked = np.argsort(-promise, kind="stable")
    ranked = ranked[promise[ranked] > 0]
    chosen = [int(m) for m in ranked[:max_meshes]]
    meshes: list[MeshOccluders] = []
    offers: list[tuple[int, FittedOccluder, MeshOccluders]] = []
    benefit: list[float] = []
    by_mesh = np.argsort(mesh_of, kind="stable")
    first = np.searchsorted(mesh_of[by_mesh], np.arange(len(snapshot.meshes) + 1))

    def offer(number: int, fitted: FittedOccluders) -> None:
        mine = by_mesh[first[number] : first[number + 1]]
        report = MeshOccluders(snapshot.meshes[number], len(mine), float(promise[number]), fitted)
        meshes.append(report)
        for row, world in zip(rows[mine], area[mine], strict=True):
            offers.extend((int(row), occluder, report) for occluder in fitted.occluders)
            benefit.extend(occluder.gain * float(world) for occluder in fitted.occluders)

    for done, number in enumerate(chosen):
        mesh = snapshot.meshes[number]

        def part(what: str, share: float, done: int = done, name: str = mesh.name) -> None:
            progress(f"{name}: {what}" if name else what, (done + share) / len(chosen))

        offer(number, fit_occluders(mesh, progress=part, **settings))
    left = 0
    for done, number in enumerate(ranked[max_meshes:]):
        progress("convex meshes", done / (len(ranked) - max_meshes))
        fitted_whole = fit_convex(snapshot.meshes[number]) if len(offers) < max_nodes else None
        if fitted_whole is None:
            left += 1
            continue
        offer(int(number), fitted_whole)
    best = np.argsort(-np.array(benefit), kind="stable")[:max_nodes]
    kept = [offers[i] for i in np.sort(best)]
    _note_left_out(offers, kept, max_nodes)
    return SceneOccluders(_placed(snapshot, kept), meshes, left)


def _large_rows(snapshot: Snapshot, least_size: float) -> I64:
    """Rows that are opaque, placed by a proper matrix, and not small."""
    linear = snapshot.transforms[:, :3, :3]
    with np.errstate(all="ignore"):
        scale = np.linalg.norm(linear, axis=1)
        proper = np.abs(np.linalg.det(linear / scale[:, None])) > 1e-9
        diagonal = 2 * np.linalg.norm(snapshot.boxes[3:], axis=0)
        bounds = np.stack([snapshot.boxes[:3] - snapshot.boxes[3:], snapshot.boxes[:3] + snapshot.boxes[3:]])
        known = ~snapshot.unknown
        if not known.any():
            return np.zeros(0, np.int64)
        whole = float(np.linalg.norm(bounds[1][:, known].max(axis=1) - bounds[0][:, known].min(axis=1)))
        good = (
            known & proper[snapshot.transform_index] & (snapshot.colors[:, 3] >= 1) & (diagonal >= least_size * whole)
        )
    return np.flatnonzero(good)


def _note_left_out(offers: list[Any], kept: list[Any], limit: int) -> None:
    if len(offers) == len(kept):
        return
    wanted: dict[int, int] = {}
    for _, _, report in offers:
        wanted[id(report)] = wanted.get(id(report), 0) + 1
    for _, _, report in kept:
        wanted[id(report)] -= 1
    told = set()
    for _, _, report in offers:
        if wanted[id(report)] and id(report) not in told:
            told.add(id(report))
            report.notes.append(f"some left out, as others cover more ({wanted[id(report)]}; {limit} are kept in all)")


def _placed(snapshot: Snapshot, kept: list[tuple[int, FittedOccluder, MeshOccluders]]) -> list[PlacedOccluders]:
    contents = _Contents(snapshot)
    out: dict[int, PlacedOccluders] = {}
    refused: dict[int, bool] = {}
    samples: dict[int, Occluder] = {}
    for row, occluder, report in kept:
        node = snapshot.geodes[row]
        if occluder.is_solid:
            if row not in refused:
                refused[row] = contents.is_holder(row, is_covered=report.fitted.is_covered)
                if refused[row]:
                    report.notes.append(f"no solids: other drawables are inside ({node.path()})")
            if refused[row]:
                continue
        entry = out.setdefault(row, PlacedOccluders(node))
        name = f"{node.name or 'drawable'}: {occluder.kind} {len(entry.occluders) + 1}"
        if id(occluder) not in samples:
            samples[id(occluder)] = occluder.node()
        entry.occluders.append(_copied(samples[id(occluder)], node, name))
        report.placed += 1
    return list(out.values())


def _copied(sample: Occluder, owner: Geode | Lod, name: str) -> Occluder:
    """Another node with the same arrays: of thousands of drawables that share a mesh, only one needs a convex hull."""
    node = Occluder(sample.kind, sample.vertices, sample.faces, two_sided=sample.two_sided, owner=owner, name=name)
    node.outside_only = sample.outside_only
    return node


class _Contents:
    """Whether drawables are inside others."""

    def __init__(self, snapshot: Snapshot) -> None:
        self.snapshot = snapshot
        center, half = snapshot.boxes[:3], snapshot.boxes[3:]
        self.low, self.high = center - half, center + half
        self.insides: dict[int, tuple[PreparedMesh, list[Interior]]] = {}

    def is_holder(self, row: int, *, is_covered: bool) -> bool:
        """Whether something is inside a drawable.

        Inside a closed mesh, that is something that is wholly inside: what merely sticks in the wall of a house could
        be seen from within the wall, but nobody is there. Inside a mesh with covered openings, where one can look in,
        whatever reaches an enclosed cell counts.
        """
        low, high = self.low[:, [row]], self.high[:, [row]]
        slack = 1e-9 * (high - low)
        with np.errstate(invalid="ignore"):
            if is_covered:
                near = ((self.low <= high) & (self.high >= low)).all(axis=0)
            else:
                near = ((self.low >= low - slack) & (self.high <= high + slack)).all(axis=0)
        rows = np.flatnonzero(near & ~self.snapshot.unknown)
        rows = rows[rows != row]
        if not len(rows):
            return False
        prepared, insides = self._insides(int(self.snapshot.mesh_index[row]), is_covered)
        back = np.linalg.inv(self.snapshot.transforms[self.snapshot.transform_index[row]])
        for other in rows:
            matrix = back @ self.snapshot.transforms[self.snapshot.transform_index[other]]
            triangles = _corners(self.snapshot.meshes[self.snapshot.mesh_index[other]], matrix)
            triangles = (triangles - prepared.center) / prepared.size
            for inside in insides:
                reached, wholly = inside.holds(triangles)
                if wholly or (reached and is_covered):
                    return True
        return False

    def _insides(self, number: int, is_covered: bool) -> tuple[PreparedMesh, list[Interior]]:
        if number not in self.insides:
            prepared = PreparedMesh.of(self.snapshot.meshes[number])
            shells = prepared.worth_a_look("any" if is_covered else "none")
            insides = insides_of(shells, "any", prepared.clearance, cells=_CELLS, progress=silent)
            self.insides[number] = prepared, insides
        return self.insides[number]


def _corners(mesh: Mesh, matrix: F64) -> F64:
    with np.errstate(invalid="ignore", over="ignore"):  # vertices that no face uses may be anything
        placed = mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3]
    return np.asarray(placed[mesh.faces])


def _wrapped(node: Geode | Lod, switch: Switch) -> Group:
    group = Group(name=node.name)
    for child in switch.children:
        switch.remove(child)
        switch.add(group if child is node else child)
    group.add(node)
    return group
