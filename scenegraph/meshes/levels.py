"""Levels of detail for the drawables of a scene that have none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from ..mesh import Mesh
from ..nodes import Geode
from ..progress import Progress, silent
from .cache import DiskCache
from .simplification import RATIOS, level_chain

if TYPE_CHECKING:
    from ..scene import Scene
    from ..snapshot import Snapshot


@dataclass
class SceneLevels:
    """Levels for a scene; nothing is changed in its graph.

    Attributes
    ----------
    chains : dict of Mesh to list of (Mesh, float)
        Each mesh, finest first, with its levels and their errors, as `level_chain` gives them.
    too_small : int
        Meshes of so few triangles that levels would save nothing.
    left_out : int
        Meshes beyond the limits.
    """

    chains: dict[Mesh, list[tuple[Mesh, float]]] = field(default_factory=dict)
    too_small: int = 0
    left_out: int = 0

    def __len__(self) -> int:
        return len(self.chains)


def levels_for(
    source: Scene | Snapshot,
    *,
    ratios: Sequence[float] = RATIOS,
    least_triangles: int = 64,
    max_meshes: int = 1000,
    max_triangles: int = 5_000_000,
    cache: DiskCache | Literal["default"] | None = "default",
    progress: Progress = silent,
) -> SceneLevels:
    """Make levels for the meshes of a scene, those first that most triangles are drawn of.

    Parameters
    ----------
    source : Scene or Snapshot
    ratios : floats in 0..1
        See `level_chain`.
    least_triangles : int
        Meshes of fewer triangles are left as they are.
    max_meshes, max_triangles : int
        How many different meshes, and triangles of all of them together, are worked on at most.
    cache : DiskCache, None or "default"
    progress : Progress, optional

    Returns
    -------
    SceneLevels
        Give its `chains` to `Snapshot.adopt_levels`; the preparation "levels" does.
    """
    # the scene's room lies above this one; a snapshot is what has no snapshot
    snapshot: Snapshot = source.snapshot() if hasattr(source, "snapshot") else source
    bare = np.array([isinstance(node, Geode) for node in snapshot.geodes], bool) & (snapshot.level_count == 1)
    drawn = np.bincount(snapshot.mesh_index[bare], minlength=len(snapshot.meshes))
    triangles = np.array([mesh.triangles for mesh in snapshot.meshes], np.int64)
    used = (drawn > 0) & np.array([mesh.is_finite for mesh in snapshot.meshes], bool)
    large = used & (triangles >= least_triangles)
    order = np.argsort(-drawn * triangles, kind="stable")
    order = order[large[order]]
    chosen = order[np.cumsum(triangles[order]) <= max_triangles][:max_meshes].tolist()
    out = SceneLevels(too_small=int((used & ~large).sum()), left_out=len(order) - len(chosen))
    work = np.cumsum([0, *triangles[chosen]]) / max(int(triangles[chosen].sum()), 1)
    for number, start, end in zip(chosen, work[:-1], work[1:], strict=True):
        mesh = snapshot.meshes[number]

        def part(what: str, share: float, mesh: Mesh = mesh, a: float = start, b: float = end) -> None:
            progress(f"{mesh.name or 'mesh'}: {what}", float(a + (b - a) * share))

        chain = level_chain(mesh, ratios, cache=cache, progress=part)
        if len(chain) > 1:
            out.chains[mesh] = chain
    return out
