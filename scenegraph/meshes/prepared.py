"""A mesh made ready for fitting: scaled to unit size, welded, taken apart; or the reason why it cannot be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..mesh import Mesh
from .solids import CLEARANCE, Openings
from .topology import Shell, open_edges, shells, weld

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

#: Rounding of a coordinate, moved there and back, in units of its last bit: an ample bound.
_BITS = 64
#: Shells smaller than this share of the surface of all are not worth looking into; nor are more than so many.
_SMALL_SHELL, _SHELLS = 0.01, 24


def is_translucent(mesh: Mesh) -> bool:
    """Whether a mesh's own color, vertex colors or texture let light through."""
    return (
        (mesh.color is not None and mesh.color[3] < 1)
        or (mesh.vertex_colors is not None and bool((mesh.vertex_colors[:, 3] < 255).any()))
        or (mesh.texture is not None and mesh.texture.shape[2] == 4 and bool((mesh.texture[..., 3] < 255).any()))
    )


def hindrance(mesh: Mesh) -> str:
    """Why a mesh cannot have occluders at all; '' if nothing is in the way."""
    if not mesh.triangles:
        return "it has no triangles"
    if is_translucent(mesh):
        return "it lets light through"
    if not np.isfinite(mesh.bounds).all():
        return "some of its vertices are not finite"
    with np.errstate(over="ignore"):
        size = float(np.ptp(mesh.bounds, axis=0).max())
    if not np.isfinite(size) or size > 1e150:
        return "its coordinates are too large to compute with"
    if size < 1e-150:
        return "it has no extent"
    if clearance_of(mesh) > 1e-3:
        return "it lies so far from its origin that its coordinates have too few digits; move it to its origin first"
    return ""


def clearance_of(mesh: Mesh) -> float:
    """Distance that occluders keep from the surface, in units of the mesh's largest extent."""
    size = float(np.ptp(mesh.bounds, axis=0).max())
    return max(CLEARANCE, _BITS * float(np.finfo(float).eps) * float(np.abs(mesh.bounds).max()) / size)


@dataclass(frozen=True)
class PreparedMesh:
    """A mesh without hindrance, about the origin, its largest extent 1.

    Attributes
    ----------
    center : (3,) float64
    size : float
        Of the mesh: its coordinates are center + size * x.
    clearance : float
    points : (p, 3) float64
    faces : (f, 3) int
    shells : list of Shell
    pieces : int
        Of how many pieces the mesh consists; those of less than four triangles are not among the shells.
    is_oriented : bool
        Whether all edges are passed as often in one direction as in the other, before any face is turned.
    """

    center: F64
    size: float
    clearance: float
    points: F64
    faces: I64
    shells: list[Shell]
    pieces: int
    is_oriented: bool

    @classmethod
    def of(cls, mesh: Mesh) -> PreparedMesh:
        """Weld a mesh and take it apart."""
        low, high = mesh.bounds
        center, size = 0.5 * low + 0.5 * high, float((high - low).max())
        points, faces, times = weld(mesh.vertices, mesh.faces)
        points = (points - center) / size
        found, pieces = shells(points, np.repeat(faces, times, axis=0))
        is_oriented = bool(times.all()) and not open_edges(faces, times)
        return cls(center, size, clearance_of(mesh), points, faces, found, pieces, is_oriented)

    @property
    def closed(self) -> list[Shell]:
        """The closed shells."""
        return [s for s in self.shells if s.is_closed]

    @property
    def is_closed(self) -> bool:
        """Whether the whole surface is closed, and faces outward as it is given."""
        return self.is_oriented and len(self.closed) == self.pieces and all(s.volume > 0 for s in self.shells)

    def worth_a_look(self, openings: Openings) -> list[Shell]:
        """Shells in which solids are looked for: the closed ones, and if openings count as covered, the others."""
        usable: Sequence[Shell] = self.closed if openings == "none" else self.shells
        total = sum(s.area for s in usable)
        return [s for s in usable[:_SHELLS] if s.area >= _SMALL_SHELL * total]

    def in_mesh(self, points: F64) -> F64:
        """Back to the coordinates of the mesh."""
        return np.asarray(points * self.size + self.center)
