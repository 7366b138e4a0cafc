"""Occluder nodes: planar polygons and convex solids that stages may use to hide what lies behind them.

An occluder is not drawn. Its author promises that it lies inside opaque geometry; nobody can check that for them, but
the item buffer shows every object that a wrong promise hides.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import SceneError
from .mesh import Mesh
from .nodes import Node

#: Relative to the extent of the shape: farther than this from a plane is not in it.
FLATNESS = 1e-6

#: Sides of `Mesh.box`, counterclockwise from outside; one tuple for all boxes, so that their topology is shared.
_BOX_FACES = ((0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6))


def _points(points: ArrayLike, label: str) -> NDArray[np.float64]:
    array = np.array(points, np.float64, ndmin=2)
    if array.ndim != 2 or array.shape[1] != 3:
        raise SceneError(f"{label}: points have shape {array.shape}, expected (k, 3)")
    if not np.isfinite(array).all():
        raise SceneError(f"{label}: {int((~np.isfinite(array)).any(axis=1).sum())} points are not finite")
    return array


def _without_repeats(points: NDArray[np.float64]) -> NDArray[np.float64]:
    extent = float(np.ptp(points, axis=0).max())
    step = np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1)
    kept: NDArray[np.float64] = points[step > 1e-12 * extent]
    return kept


def newell_normal(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3,) area vector of a closed polygon (Newell): its length is the area, its direction the normal."""
    p = points - points[0]
    return np.asarray(0.5 * np.cross(p, np.roll(p, -1, axis=0)).sum(axis=0))


def _convex_polygon(points: ArrayLike, label: str) -> NDArray[np.float64]:
    p = _without_repeats(_points(points, label))
    if len(p) < 3:
        raise SceneError(f"{label}: a polygon needs three different points, got {len(p)}")
    extent = float(np.linalg.norm(np.ptp(p, axis=0)))
    area = newell_normal(p)
    size = float(np.linalg.norm(area))
    if size <= FLATNESS**2 * extent**2:
        raise SceneError(f"{label}: the polygon has no area")
    normal = area / size
    if np.abs((p - p.mean(axis=0)) @ normal).max() > FLATNESS * extent:
        raise SceneError(f"{label}: the points do not lie in one plane; split it into planar pieces")
    edge = np.roll(p, -1, axis=0) - p
    turn = np.cross(edge, np.roll(edge, -1, axis=0)) @ normal
    if (turn < -FLATNESS * extent**2).any():
        raise SceneError(f"{label}: the polygon is not convex; split it, or cut the notch out as a hole")
    return p


def merge_coplanar(vertices: NDArray[np.float64], triangles: NDArray[np.int64]) -> list[tuple[int, ...]]:
    """Faces of a convex polyhedron: coplanar triangles joined into one polygon each, counterclockwise from outside.

    A silhouette edge must separate two different faces; the diagonal of a box side would be one otherwise when the side
    is seen exactly edge-on.
    """
    tri = vertices[triangles]
    normal = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    size = np.linalg.norm(normal, axis=1)
    extent = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    keep = size > (FLATNESS * extent) ** 2
    triangles, normal = triangles[keep], normal[keep] / size[keep, None]
    offset = np.einsum("ij,ij->i", normal, vertices[triangles[:, 0]])
    center = vertices.mean(axis=0)
    flip = normal @ center > offset
    normal[flip], offset[flip] = -normal[flip], -offset[flip]
    faces: list[tuple[int, ...]] = []
    left = np.ones(len(triangles), bool)
    for i in range(len(triangles)):
        if not left[i]:
            continue
        same = left & (normal @ normal[i] > 1 - 1e-9) & (np.abs(offset - offset[i]) <= FLATNESS * extent)
        left &= ~same
        ids = np.unique(triangles[same])
        p = vertices[ids] - vertices[ids].mean(axis=0)
        x = p[np.argmax(np.einsum("ij,ij->i", p, p))]
        y = np.cross(normal[i], x)
        order = np.argsort(np.arctan2(p @ y, p @ x), kind="stable")
        faces.append(tuple(int(k) for k in ids[order]))
    return faces


@cache
def _polygon_face(corners: int) -> tuple[tuple[int, ...], ...]:
    return (tuple(range(corners)),)


class Occluder(Node):
    """Something opaque that hides what is behind it. Make one with `planar`, `solid` or `box`.

    Attributes
    ----------
    kind : "planar" or "solid"
    vertices : (v, 3) float64
        In the parent's coordinates.
    faces : tuple of tuples of int
        Polygons, counterclockwise seen from outside; one for a planar occluder.
    two_sided : bool
        A one-sided planar occluder hides only for eyes in front of it (counterclockwise side).
    holes : tuple of (k, 3) float64
        Convex polygons in the occluder's plane that do not occlude.
    outside_only : bool
        Whether it promises nothing to eyes in the box of its owner, a drawable: one that was fitted into a mesh hides
        what the mesh hides, and an eye inside the mesh may see what is inside as well. False unless assigned.
    """

    def __init__(
        self,
        kind: Literal["planar", "solid"],
        vertices: NDArray[np.float64],
        faces: Sequence[tuple[int, ...]],
        *,
        two_sided: bool = True,
        holes: Sequence[NDArray[np.float64]] = (),
        owner: Node | None = None,
        name: str = "",
    ) -> None:
        super().__init__(name=name)
        self.kind = kind
        self.vertices = vertices
        self.faces = tuple(faces)
        self.two_sided = two_sided
        self.holes = tuple(holes)
        self.outside_only = False
        self._owner = owner
        vertices.flags.writeable = False

    @property
    def owner(self) -> Node | None:
        """The node whose drawables this occluder may never hide: as given, else the parent unless that is the root."""
        if self._owner is not None:
            return self._owner
        return self.parent if self.parent is not None and self.parent.parent is not None else None

    @classmethod
    def planar(
        cls,
        points: ArrayLike,
        *,
        two_sided: bool = True,
        holes: Sequence[ArrayLike] = (),
        owner: Node | None = None,
        name: str = "",
    ) -> Occluder:
        """A convex polygon.

        Parameters
        ----------
        points : (k, 3) float
            In order around the border; counterclockwise seen from the front.
        two_sided : bool, default True
        holes : sequence of (k, 3) float
            Convex polygons in the same plane, subtracted from it.
        owner : Node, optional

        Raises
        ------
        SceneError
            Not planar, not convex, without area, or with points that are not finite.
        """
        label = f"occluder {name!r}"
        polygon = _convex_polygon(points, label)
        cut = [_convex_polygon(h, f"{label}, hole {i}") for i, h in enumerate(holes)]
        normal = newell_normal(polygon)
        normal /= np.linalg.norm(normal)
        extent = float(np.linalg.norm(np.ptp(polygon, axis=0)))
        for i, hole in enumerate(cut):
            if np.abs((hole - polygon[0]) @ normal).max() > FLATNESS * extent:
                raise SceneError(f"{label}: hole {i} does not lie in the plane of the occluder")
        return cls(
            "planar", polygon, _polygon_face(len(polygon)), two_sided=two_sided, holes=cut, owner=owner, name=name
        )

    @classmethod
    def solid(cls, shape: Mesh | ArrayLike, *, owner: Node | None = None, name: str = "") -> Occluder:
        """A convex polyhedron: a convex mesh, or the convex hull of points.

        Raises
        ------
        SceneError
            No volume, points that are not finite, or a mesh that is not convex.
        """
        from scipy.spatial import ConvexHull, QhullError

        label = f"occluder {name!r}"
        points = _points(shape.vertices if isinstance(shape, Mesh) else shape, label)
        if len(points) < 4:
            raise SceneError(f"{label}: a solid needs at least four points, got {len(points)}")
        center = points.mean(axis=0)
        extent = float(np.linalg.norm(np.ptp(points, axis=0)))
        # Qhull's own tolerances are absolute: hand it coordinates of order one
        unit = (points - center) / (extent or 1.0)
        try:
            hull = ConvexHull(unit)
        except (QhullError, ValueError):
            raise SceneError(f"{label}: the solid has no volume; use Occluder.planar for a flat one") from None
        if hull.volume < 1e-9:
            raise SceneError(f"{label}: the solid has no volume; use Occluder.planar for a flat one")
        if isinstance(shape, Mesh):
            # centers as well as corners: of an L-shape, every corner may lie on the hull
            sample = np.concatenate([unit[np.unique(shape.faces)], unit[shape.faces].mean(axis=1)])
            inside = (sample @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1) < -1e-6
            if inside.any():
                raise SceneError(
                    f"{label}: the mesh is not convex ({int(inside.sum())} of its corners and triangle centers lie "
                    "inside its hull); split it into convex pieces"
                )
        vertices = points[hull.vertices]
        index = np.full(len(points), -1)
        index[hull.vertices] = np.arange(len(hull.vertices))
        faces = merge_coplanar(unit[hull.vertices], index[hull.simplices].astype(np.int64))
        return cls("solid", vertices, faces, owner=owner, name=name)

    @classmethod
    def box(cls, lo: ArrayLike, hi: ArrayLike, *, owner: Node | None = None, name: str = "") -> Occluder:
        """An axis-aligned box between two corners."""
        mesh = Mesh.box(lo, hi)
        if not (np.isfinite(mesh.vertices).all() and (np.ptp(mesh.vertices, axis=0) > 0).all()):
            raise SceneError(f"occluder {name!r}: the box from {lo!r} to {hi!r} has no volume")
        if (np.asarray(hi, float) < np.asarray(lo, float)).any():
            raise SceneError(f"occluder {name!r}: the box's low corner {lo!r} is above its high corner {hi!r}")
        return cls("solid", np.array(mesh.vertices), _BOX_FACES, owner=owner, name=name)
