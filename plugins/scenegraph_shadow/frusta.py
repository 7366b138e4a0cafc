"""The shadow frusta of occluders, for one view.

Papaioannou et al. (2006), section 2, with the errata of the silhouette and of the cap (see
`scenegraph.kernels.silhouettes`). Added here: sides that the window's border makes superfluous are dropped, as in
OpenSceneGraph's occluders; only what lies wholly beyond the near plane occludes, because nothing else is sure to be
drawn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenegraph import OccluderTable, View
from scenegraph.kernels.shadow_frusta import box_depth_in_frusta_exact
from scenegraph.kernels.silhouettes import UNUSED, cone_shadow_rows
from scenegraph.kernels.slices import slice_entries, slice_expand, slice_padded
from scenegraph.kernels.solid_angles import angle_solid_triangles
from scenegraph.kernels.windows import edge_enters, point_sides

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


#: Why an occluder is left out: not in the view; a polygon seen edge-on, or one-sided and seen from behind; it
#: contains the eye, or may reach nearer than the near plane; a plane of its shadow cannot be told.
FAULTS = ("outside", "facing_away", "at_eye", "ill_conditioned")


@dataclass
class ShadowFrusta:
    """Shadow frusta of m occluders, seen from the eye of one view; later stages and viewers find them in the frame.

    Attributes
    ----------
    table : OccluderTable
    ids : (m,) int
        Occluders, numbers in the table; the most important first.
    rows : (m, p, 8) float64
        See `scenegraph.kernels.silhouettes.cone_shadow_rows`.
    holes : (h, q, 8) float64
        Planes through the edges of holes, facing away: what is wholly inside one of them cannot be seen through the
        hole.
    hole_of : (h,) int
        The frustum of each hole.
    eye : (3,) float64
    pool : (k,) int
        The occluders to choose from in the next frames.
    chosen_at : int
        Number of the frame in which the pool was ranked.
    """

    table: OccluderTable
    ids: Ints
    rows: Floats
    holes: Floats
    hole_of: Ints
    eye: Floats
    pool: Ints
    chosen_at: int

    def __len__(self) -> int:
        return len(self.ids)

    @cached_property
    def owner(self) -> Ints:
        """(m, 2) first and end row that each may never hide."""
        return self.table.owner.take(self.ids, axis=0)

    def hides(self, boxes: Floats) -> Bools:
        """(m, k) which frusta surely hold which boxes (6, k), in float64."""
        depth = box_depth_in_frusta_exact(boxes, self.rows, eye=self.eye)
        if len(self.holes):
            past = box_depth_in_frusta_exact(boxes, self.holes, eye=self.eye, any_plane=True)
            np.minimum.at(depth, self.hole_of, past)
        return np.asarray(depth > 0.0)


class Topology:
    """Vertices, faces and edges of the occluders of one table, padded; occluders of one build share them.

    Attributes
    ----------
    build : (o,) int
        The build of each occluder.
    vertices : (v, c) int
        Vertices of each build, counted from the occluder's first; the last one is repeated.
    faces : (f, c) int
        Likewise.
    is_face : (f, c) float64
        1, or 0 for padding.
    corners : (f, c) int
        First vertex of each face.
    ends, edge_faces : (2, e, c) int
        See `scenegraph.kernels.silhouettes`.
    any_planar, any_outside_only : bool
        Whether the table has such occluders.
    """

    def __init__(self, table: OccluderTable) -> None:
        builds: dict[tuple[object, ...], int] = {}
        self.build = np.array(
            [builds.setdefault((node.faces, len(node.vertices)), len(builds)) for node in table.nodes], np.int64
        )
        # an example of each
        of = np.unique(self.build, return_index=True)[1]
        base, first_face = table.vertex_first[of], table.face_first[of]
        zero, count = np.zeros_like(base), table.face_first[of + 1] - first_face
        self.any_planar, self.any_outside_only = not table.solid.all(), bool(table.outside_only.any())
        self.vertices = slice_padded(zero, table.vertex_first[of + 1] - base).T.copy()
        self.faces = slice_padded(zero, count).T.copy()
        self.is_face = (np.arange(len(self.faces))[:, None] < count).astype(np.float64)
        faces = self.faces + first_face
        self.corners = table.loop[table.loop_first[faces]] - base
        edge = slice_padded(table.edge_first[of], table.edge_first[of + 1]).T
        self.ends = (table.edges[edge] - base[:, None]).transpose(2, 0, 1).copy()
        sides = table.edge_faces[edge]
        sides = np.where(sides < 0, len(self.faces), sides - first_face[:, None])
        sides[1:][edge[1:] == edge[:-1]] = 0
        self.edge_faces = sides.transpose(2, 0, 1).copy()
        self._table, self._only_build = table, len(of) == 1

    def of_vertices(self, values: NDArray[Any], build: Ints | slice, ids: Ints) -> NDArray[Any]:
        """(v, k, ...) what the vertices of some occluders have, padded."""
        return self._of(values, self.vertices, self._table.vertex_first, build, ids)

    def of_faces(self, values: NDArray[Any], build: Ints | slice, ids: Ints) -> NDArray[Any]:
        """(f, k, ...) what the faces of some occluders have, padded."""
        return self._of(values, self.faces, self._table.face_first, build, ids)

    def _of(self, values: NDArray[Any], part: Ints, first: Ints, build: Ints | slice, ids: Ints) -> NDArray[Any]:
        if self._only_build:
            # all have as many: whole occluders are taken, not one index after the other
            return values.reshape(-1, len(part), *values.shape[1:]).take(ids, axis=0).swapaxes(0, 1)
        return values.take(part[:, build] + first.take(ids), axis=0)


class Shapes:
    """Occluders of a pool as padded arrays, relative to the eye of a view.

    Attributes
    ----------
    ids : (m,) int
    points : (3, v, m) float64
    reach : (m,) float64
        No vertex is farther away.
    """

    def __init__(self, table: OccluderTable, topology: Topology, warp: Floats, ids: Ints, view: View) -> None:
        self.ids, self.view = ids, view
        self._table, self._topology, self._warp = table, topology, warp
        build = topology.build.take(ids)
        # where all are of one build, what is the same for all is left to broadcasting
        alike = len(build) > 0 and bool((build == build[0]).all())
        self._build: Ints | slice = slice(int(build[0]), int(build[0]) + 1) if alike else build
        vertices = topology.of_vertices(table.vertices, self._build, ids)
        self.points = np.empty((3, *vertices.shape[:2]))
        np.subtract(vertices.transpose(2, 0, 1), np.asarray(view.eye)[:, None, None], out=self.points)
        self.reach = 2.0 * np.maximum.reduce(np.abs(self.points).reshape(-1, len(ids)), axis=0)

    def solid_angles(self) -> Floats:
        """(m,) solid angles, exact: faces cover every direction of a solid twice, and of a polygon once.

        In a parallel view, areas of the images.
        """
        table, m = self._table, len(self.ids)
        first, end = table.face_first[self.ids], table.face_first[self.ids + 1]
        faces, whose = slice_expand(first, end), np.repeat(np.arange(m), end - first)
        if self.view.is_parallel:
            angle = table.areas[faces] * np.abs(table.normals[faces] @ self.view.forward)
        else:
            # fans: a convex polygon's triangles all turn the same way
            first, end = table.loop_first[faces], table.loop_first[faces + 1]
            second, size = slice_expand(first + 1, end - 1), end - first - 2
            corner = table.loop[np.stack([np.repeat(first, size), second, second + 1])]
            a, b, c = (table.vertices[corner] - self.view.eye).transpose(0, 2, 1)
            angle, whose = np.abs(angle_solid_triangles(a, b, c)), np.repeat(whose, size)
        total = np.bincount(whose, angle, minlength=m).astype(np.float64)
        return np.asarray(total * np.where(table.solid[self.ids], 0.5, 1.0))

    def rows(self, window: Floats, most_faces: int) -> tuple[Floats, Bools]:
        """Planes of the shadow frusta, and what is wrong with each.

        Parameters
        ----------
        window : (6, 4) float64
            Planes of the view relative to the eye.
        most_faces : int
            See `cone_shadow_rows`.

        Returns
        -------
        rows : (m, p, 8) float64
        faults : (4, m) bool
            In the order of `FAULTS`; no occluder has more than one.
        """
        topology, view = self._topology, self.view
        both = np.empty((7, 4))
        both[:6] = window
        np.negative(window[4], out=both[6])
        size = float(np.maximum.reduce(self.reach))
        codes, seen = point_sides(self.points, both, size=size, around=4)
        common = np.bitwise_and.reduce(codes, axis=0)
        # the last bit: surely behind the near plane, where everything is drawn
        outside, beyond = (common & 0b0111111) != 0, common >= 0b1000000
        # the first four bits: the sides of the window, which are lines on the screen
        codes &= 0b0001111
        ends = slice_entries(codes, topology.ends[..., self._build])
        unneeded = (ends[0] & ends[1]) != 0
        whole = np.logical_and.reduce(unneeded, axis=0) & ~outside
        # that edges beyond a side do not matter holds only for what is seen at all: an occluder beyond a corner may lie
        # on the inner side of the only edge that is left, and so does the window
        some = np.logical_or.reduce(unneeded, axis=0) & ~(whole | outside)
        unseen = some & ~np.logical_or.reduce(seen, axis=0)
        if unseen.any():
            unseen &= ~self._edges_enter(unseen.nonzero()[0], window[:4], size)
        unneeded &= some & ~unseen
        rows, lit, clear, sound = self._planes(None, beyond, unneeded, most_faces)
        if (whole | unseen).any():
            which = ((whole | unseen) & lit & clear & sound).nonzero()[0]
            # no side crosses the window: the occluder covers all of it, or nothing
            covers = _covers_middle(rows[which], view)
            outside[which[~covers]] = True
            which = which[covers & whole[which]]
            if len(which):
                bare = self._planes(which, beyond, np.ones_like(unneeded), most_faces)[0]
                rows[which] = 0.0
                rows[which, :, 6] = UNUSED
                rows[which, : bare.shape[1]] = bare
        faults = np.zeros((4, len(self.ids)), bool)
        faults[0] = outside
        if topology.any_planar:
            np.logical_and(~lit, ~self._table.solid.take(self.ids), out=faults[1])
        np.logical_not(clear & lit, out=faults[2])
        np.logical_not(sound, out=faults[3])
        faults[1:] &= ~np.logical_or.accumulate(faults[:-1], axis=0)
        return rows, faults

    def _edges_enter(self, which: Ints, window: Floats, size: float) -> Bools:
        """(m,) whether some edge of those occluders surely is in the window; False for all others."""
        seen = np.zeros(len(self.ids), bool)
        build = self._build if isinstance(self._build, slice) else self._build[which]
        first, last = self._topology.ends[..., build] * len(which) + np.arange(len(which))
        flat = self.points[..., which].reshape(3, -1)
        enters = edge_enters(flat.take(first, axis=1), flat.take(last, axis=1), window, size=size)
        seen[which] = enters.any(axis=0)
        return seen

    def _planes(
        self, which: Ints | None, beyond: Bools, unneeded: Bools, most_faces: int
    ) -> tuple[Floats, Bools, Bools, Bools]:
        table, topology, view = self._table, self._topology, self.view
        ids, build, points, reach = self.ids, self._build, self.points, self.reach
        if which is not None:
            ids, points, reach = ids[which], points[..., which], reach[which]
            beyond, unneeded = beyond[which], unneeded[:, which]
            build = build if isinstance(build, slice) else build[which]
        two_sided = None
        if topology.any_planar and (polygon := ~table.solid.take(ids)).any():
            two_sided = table.two_sided.take(ids) & polygon
        return cone_shadow_rows(
            points,
            np.ascontiguousarray(topology.of_faces(table.normals, build, ids).transpose(2, 0, 1)),
            np.ascontiguousarray(topology.of_faces(table.areas, build, ids)) * topology.is_face[:, build],
            np.ascontiguousarray(topology.of_faces(self._warp, build, ids)),
            topology.corners[:, build],
            topology.ends[..., build],
            topology.edge_faces[..., build],
            reach=reach,
            world=max(map(abs, view.eye)),
            guard=_guard(view),
            two_sided=two_sided,
            beyond=beyond,
            unneeded=unneeded,
            direction=view.forward if view.is_parallel else None,
            most_faces=most_faces,
        )


def _guard(view: View) -> float:
    """Radius of a ball around the eye that holds all of the view before the near plane."""
    left, right, bottom, top = view.window
    return view.near * math.hypot(1.0, max(-left, right), max(-bottom, top)) * (1.0 + 1e-9)


def _covers_middle(rows: Floats, view: View) -> Bools:
    """(m,) whether the line of sight through the middle of the window ends up inside all planes."""
    left, right, bottom, top = view.window
    middle = np.array([0.5 * (left + right), 0.5 * (bottom + top), 0.0 if view.is_parallel else -1.0]) @ view.axes
    along = rows[..., :3] @ (view.forward if view.is_parallel else middle)
    at = rows[..., 6] + (rows[..., :3] @ middle if view.is_parallel else 0.0)
    grazing = np.abs(along) <= 1e-12
    return np.asarray(np.where(grazing, at > 0.0, along > 0.0).all(axis=1))
