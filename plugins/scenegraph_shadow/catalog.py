"""What a ranking must know of every occluder, in blocks of neighbors, so that most of them need not be looked at.

The measures are those of Papaioannou et al. (2006), equations (3) and (4): volume, area and normal, and the center to
which distances are taken.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scenegraph import OccluderTable, Snapshot
from scenegraph.kernels.slices import slice_expand, slice_morton_order

Floats = NDArray[np.float64]


class Catalog:
    """Measures of the occluders of one snapshot, kept up to date with its version.

    Parameters
    ----------
    snapshot : Snapshot
    kinds : "planar", "solid" or "both"
    drop_contained : bool
        Leave out polygons that lie in a solid of the same owner: where a solid's shadow begins at its faces, it holds
        theirs, whatever the eye.

    Attributes
    ----------
    table : OccluderTable
    ids : (b, j) int
        Occluders of each block, neighbors in space; the last one is padded with -1.
    center : (3, b, j) float64
        World; NaN for padding, and for occluders that are not finite or have no extent.
    radius : (b, j) float64
        No vertex is farther from the center.
    bulk : (b, j) float64
        Volume to the power 2/3: a face of the cube of the same volume. 0 for polygons.
    area : (3, b, j) float64
        Area times normal of polygons, 0 for solids.
    one_sided : (b, j) bool
    image : (b, j) float64
        Half the surface: no parallel projection is larger.
    ball : (6, b, j) float64
        Center, 1, radius and bulk: the arrays above are views of it.
    block_center : (3, b), block_radius, block_image, block_area, block_bulk : (b,) float64
        A ball around each block, and the largest values in it.
    block_ball : (5, b) float64
        Center, 1 and radius.
    has_polygons : bool
    warp : (f,) float64
        For each face of the table, see `scenegraph.kernels.silhouettes.cone_warp`.
    unusable : int
        Number of occluders that are not finite or have no extent.
    """

    def __init__(self, snapshot: Snapshot, kinds: str, *, drop_contained: bool = False) -> None:
        self.snapshot = snapshot
        self.table = table = snapshot.occluders
        wanted = np.ones(len(table), bool) if kinds == "both" else table.solid == (kinds == "solid")
        if drop_contained and kinds == "both":
            wanted[contained(table)] = False
        ids = np.flatnonzero(wanted)
        # about as many blocks to look over as members to look into, a few blocks deep
        j = 1 << round(np.log2(max(np.sqrt(len(ids)) / 4.0, 8.0)))
        blocks = -(-len(ids) // j)
        self.ids: NDArray[np.int64] = np.full((blocks, j), -1)
        # together, so that a ranking takes them along at once: x, y, z, 1, radius, bulk
        self.ball = np.ones((6, blocks, j))
        self.center, self.radius, self.bulk = self.ball[:3], self.ball[4], self.ball[5]
        self.center[:], self.ball[4:] = np.nan, 0.0
        self.image = np.zeros((blocks, j))
        self.area = np.zeros((3, blocks, j))
        self.one_sided = np.zeros((blocks, j), bool)
        self.block_ball = np.ones((5, blocks))
        self.block_center, self.block_radius = self.block_ball[:3], self.block_ball[4]
        self.block_center[:], self.block_radius[:] = 0.0, 0.0
        self.block_image, self.block_area, self.block_bulk = np.zeros((3, blocks))
        self.warp = np.zeros(len(table.areas))
        self._version = -1
        self._matrices: Floats | None = None
        self.unusable = 0
        self.has_polygons = not bool(table.solid[ids].all())
        self._count = len(ids)
        if blocks:
            first = table.vertices[table.vertex_first[ids]].T
            self.ids.reshape(-1)[: len(ids)] = ids[slice_morton_order(first)]
            self.one_sided = ~table.two_sided[self.ids]
        self.refresh()

    def __len__(self) -> int:
        return self._count

    def refresh(self) -> bool:
        """Measure again what has moved since the last call; whether anything has."""
        if self._version == self.snapshot.version:
            return False
        self._version = self.snapshot.version
        table, matrices = self.table, self.snapshot.transforms
        place = np.flatnonzero(self.ids >= 0)
        if self._matrices is not None and self._matrices.shape == matrices.shape:
            moved = (self._matrices != matrices).any(axis=(1, 2))
            place = place[moved[table.transform_index[self.ids.reshape(-1)[place]]]]
        self._matrices = matrices.copy()
        if len(place):
            self._measure(table, place)
            self._bound(np.unique(place // self.ids.shape[1]))
            self.unusable = int(np.isnan(self.center[0]).sum() - (self.ids < 0).sum())
        return True

    def _measure(self, table: OccluderTable, place: NDArray[np.int64]) -> None:
        ids = self.ids.reshape(-1)[place]
        with np.errstate(invalid="ignore", over="ignore"):
            start, of_vertex, vertex = _parts(table.vertex_first, ids)
            points = table.vertices[vertex].T
            center = np.add.reduceat(points, start, axis=1) / np.diff(np.append(start, len(vertex)))
            reach = np.sqrt(((points - center[:, of_vertex]) ** 2).sum(axis=0))
            radius = np.maximum.reduceat(reach, start)
            start, of_face, face = _parts(table.face_first, ids)
            normal, area = table.normals[face].T, table.areas[face]
            height = (normal * (table.vertices[table.loop[table.loop_first[face]]].T - center[:, of_face])).sum(axis=0)
            corner_start, of_corner, corner = _parts(table.loop_first, face)
            points = table.vertices[table.loop[corner]] - table.vertices[table.loop[table.loop_first[face]]][of_corner]
            level = np.abs((points.T * normal[:, of_corner]).sum(axis=0))
            self.warp[face] = np.maximum.reduceat(level, corner_start)
            volume = np.add.reduceat(area * height, start) / 3.0
            solid = table.solid[ids]
            surface = np.add.reduceat(area, start)
            known = np.isfinite(center).all(axis=0) & np.isfinite(radius) & np.isfinite(volume) & np.isfinite(surface)
            # flat or empty by more than rounding can tell: nobody knows which way it faces
            known &= np.where(solid, volume > 1e-9 * radius * surface, surface > 1e-9 * radius * radius)
        center[:, ~known] = np.nan
        for target, value in (
            (self.radius, radius),
            (self.bulk, np.where(solid, np.cbrt(volume) ** 2, 0.0)),
            (self.image, np.where(solid, 0.5, 1.0) * surface),
        ):
            target.reshape(-1)[place] = np.where(known, value, 0.0)
        self.center.reshape(3, -1)[:, place] = center
        vector = np.where(
            known & ~solid, table.areas[table.face_first[ids]] * table.normals[table.face_first[ids]].T, 0.0
        )
        self.area.reshape(3, -1)[:, place] = vector

    def _bound(self, blocks: NDArray[np.int64]) -> None:
        center, radius = self.center[:, blocks], self.radius[blocks]
        known = ~np.isnan(center[0])
        low = np.where(known, center - radius, np.inf).min(axis=2)
        high = np.where(known, center + radius, -np.inf).max(axis=2)
        empty = ~known.any(axis=1)
        with np.errstate(invalid="ignore"):
            middle = np.where(empty, 0.0, 0.5 * low + 0.5 * high)
            far = np.sqrt(((center - middle[:, :, None]) ** 2).sum(axis=0)) + radius
        self.block_center[:, blocks] = middle
        # rounded up: blocks are only ever left out because of what this says
        self.block_radius[blocks] = np.where(known, far, 0.0).max(axis=1) * (1.0 + 1e-12)
        self.block_image[blocks] = self.image[blocks].max(axis=1)
        self.block_bulk[blocks] = self.bulk[blocks].max(axis=1)
        self.block_area[blocks] = np.sqrt((self.area[:, blocks] ** 2).sum(axis=0)).max(axis=1)


def contained(table: OccluderTable) -> NDArray[np.int64]:
    """Polygons that lie in a solid of the same owner, and move with it.

    Parameters
    ----------
    table : OccluderTable

    Returns
    -------
    (k,) int
        Numbers in the table.
    """
    key = np.column_stack([table.transform_index, table.owner, table.outside_only])
    group = np.unique(key, axis=0, return_inverse=True)[1].reshape(-1)
    solids, polygons = np.flatnonzero(table.solid), np.flatnonzero(~table.solid)
    solids = solids[np.argsort(group[solids], kind="stable")]
    first, end = (np.searchsorted(group[solids], group[polygons], side) for side in ("left", "right"))
    polygon, solid = np.repeat(polygons, end - first), solids[slice_expand(first, end)]
    if not len(polygon):
        return polygon
    # each pair's faces, and for each face all vertices of the polygon
    _, of_face, face = _parts(table.face_first, solid)
    _, of_vertex, vertex = _parts(table.vertex_first, polygon[of_face])
    corner = table.vertices[table.loop[table.loop_first[face]]]
    with np.errstate(invalid="ignore", over="ignore"):
        height = ((table.vertices[vertex] - corner[of_vertex]) * table.normals[face[of_vertex]]).sum(axis=1)
        # a little lenient: to leave out too much is no harm
        outside = ~(height <= 1e-6 * np.sqrt(table.areas[face[of_vertex]]))
    beyond = np.bincount(of_face[of_vertex], outside, minlength=len(polygon)) > 0
    return np.unique(polygon[~beyond])


def _parts(
    first: NDArray[np.int64], ids: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Where each occluder's part begins, whose each item is, and the items' indices."""
    count = first[ids + 1] - first[ids]
    start = np.cumsum(count) - count
    return start, np.repeat(np.arange(len(ids)), count), slice_expand(first[ids], first[ids + 1])
