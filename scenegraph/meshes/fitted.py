"""What fitting gives: occluders of one mesh, how good they are, and why there are not more."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..json_text import json_text
from ..nodes import Node
from ..occluder import Occluder

F64 = NDArray[np.float64]
Kind = Literal["box", "polytope", "polygon"]


@dataclass(frozen=True)
class FittedOccluder:
    """One occluder in the mesh's local coordinates.

    Attributes
    ----------
    kind : "box", "polytope" or "polygon"
        The first two are solid. A box may be turned.
    points : (k, 3) float64
        Corners; of a polygon in counterclockwise order seen from its front.
    two_sided : bool
        Whether a polygon hides for eyes behind it, too; True for solids.
    gain : float
        Share of the mesh's silhouette that it covers and those before it do not; mean over directions.
    """

    kind: Kind
    points: F64
    two_sided: bool
    gain: float

    @property
    def is_solid(self) -> bool:
        """Whether it has a volume."""
        return self.kind != "polygon"

    def node(self, *, owner: Node | None = None, name: str = "") -> Occluder:
        """A new graph node, to be put where a geode with the mesh is.

        Parameters
        ----------
        owner : Node, optional
            What it must never hide: the geode that it was fitted to.
        name : str
        """
        if self.kind == "polygon":
            return Occluder.planar(self.points, two_sided=self.two_sided, owner=owner, name=name)
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        if self.kind == "box" and ((self.points == low) | (self.points == high)).all():
            node = Occluder.box(low, high, owner=owner, name=name)
        else:
            node = Occluder.solid(self.points, owner=owner, name=name)
        node.outside_only = True
        return node


@dataclass(frozen=True)
class FittedOccluders:
    """Occluders of one mesh.

    Attributes
    ----------
    occluders : tuple of FittedOccluder
        The one that covers most first.
    coverage : float
        Share of the silhouette that all cover together, mean over `views` directions and their opposites, each as seen
        from far away.
    solid_coverage : float
        The same of the solids alone.
    volume_share : float
        Share of the volume inside closed (or covered) shells that solids fill; NaN without such a shell.
    closed_shells, open_shells : int
        Pieces of the mesh that enclose something; those that are open. Pieces of less than four triangles are neither.
    openings : int
        Of all open shells.
    is_covered : bool
        Whether solids rely on covers over openings (see `scenegraph.meshes.solids`).
    notes : tuple of str
        Why there are no solids, no polygons, or none at all; one sentence each.
    seconds : float
        Time it took when it was computed.
    peak_bytes : int or None
        Most memory held for it meanwhile, if that was measured.
    is_cached : bool
        Whether it was read from disk.
    """

    occluders: tuple[FittedOccluder, ...] = ()
    coverage: float = 0.0
    solid_coverage: float = 0.0
    volume_share: float = float("nan")
    closed_shells: int = 0
    open_shells: int = 0
    openings: int = 0
    is_covered: bool = False
    notes: tuple[str, ...] = ()
    seconds: float = 0.0
    peak_bytes: int | None = None
    is_cached: bool = False

    @property
    def solids(self) -> tuple[FittedOccluder, ...]:
        """Boxes and polytopes."""
        return tuple(o for o in self.occluders if o.is_solid)

    @property
    def polygons(self) -> tuple[FittedOccluder, ...]:
        """Flat ones."""
        return tuple(o for o in self.occluders if not o.is_solid)

    @property
    def reason(self) -> str:
        """Why there is no occluder; empty if there is one."""
        return "" if self.occluders else "; ".join(self.notes)

    def summary(self) -> dict[str, Any]:
        """Plain values, without the geometry."""
        plain = {k: getattr(self, k) for k in _PLAIN}
        plain["volume_share"] = None if np.isnan(self.volume_share) else self.volume_share
        return plain | {
            "occluders": [{"kind": o.kind, "two_sided": o.two_sided, "gain": o.gain} for o in self.occluders],
            "is_cached": self.is_cached,
            "reason": self.reason,
        }

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """For `DiskCache.store`."""
        meta = self.summary() | {"counts": [len(o.points) for o in self.occluders]}
        points = [o.points for o in self.occluders]
        return {
            "points": np.concatenate(points) if points else np.zeros((0, 3)),
            "meta": np.frombuffer(json_text(meta).encode(), np.uint8),
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> FittedOccluders:
        """From what `to_arrays` gave; ValueError, KeyError or TypeError for anything else."""
        meta = json.loads(arrays["meta"].tobytes().decode())
        points = np.asarray(arrays["points"], np.float64)
        counts = [int(c) for c in meta["counts"]]
        if points.shape != (sum(counts), 3) or len(counts) != len(meta["occluders"]) or not np.isfinite(points).all():
            raise ValueError("the entry does not fit together")
        ends = np.cumsum([0, *counts])
        occluders = tuple(
            FittedOccluder(o["kind"], points[a:b].copy(), bool(o["two_sided"]), float(o["gain"]))
            for o, a, b in zip(meta["occluders"], ends[:-1], ends[1:], strict=True)
        )
        values = {k: meta[k] for k in _PLAIN} | {"notes": tuple(meta["notes"])}
        if values["volume_share"] is None:
            values["volume_share"] = float("nan")
        return replace(cls(occluders), **values, is_cached=True)


_PLAIN = (
    "coverage",
    "solid_coverage",
    "volume_share",
    "closed_shells",
    "open_shells",
    "openings",
    "is_covered",
    "notes",
    "seconds",
    "peak_bytes",
)
