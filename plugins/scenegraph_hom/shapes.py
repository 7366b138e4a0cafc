"""Occluder shapes: what has to be known about a mesh to draw its outline and its depth, worked out once.

A mesh falls into connected parts, and each part is a shape of its own: the outline of one part does not cut into the
coverage of another, and a part that is flat or convex has a depth at every texel instead of one for all of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenegraph import Mesh, OccluderTable
from scenegraph.kernels.contours import mesh_edges
from scenegraph.kernels.slices import slice_expand

I64 = NDArray[np.int64]
F64 = NDArray[np.float64]

#: Shapes with more planes than this are given one depth: that of their farthest visible corner.
PLANES = 12

#: Relative to the extent of a shape: farther than this from a plane is not on it.
FLATNESS = 1e-9


@dataclass(frozen=True)
class ShapeTable:
    """Connected parts of many meshes as flat arrays; all indices count from the start of the table.

    Attributes
    ----------
    mesh_first : (m + 1,) int64
        Shapes of mesh i are [mesh_first[i], mesh_first[i + 1]).
    vertex_first, face_first, edge_first, facet_first : (s + 1,) int64
        The same for the vertices, faces, edges and facets of a shape.
    vertices : (v, 3) float64
        Local; equal positions within a mesh are one vertex.
    faces, face_edges : (f, 3) int64
    face_signs : (f, 3) int8
    edges : (e, 2) int64
    layer : (f,) int8
        1; -1 for the faces of a hole, which take away from what the others cover.
    facet : (f,) int64
        Facets are faces in one plane, turned the same way; faces of shapes with many planes are facets of their own.
    facet_face : (p,) int64
        A face that stands for the facet.
    outward : (p,) int8
        ±1 where only the outer side of the shape counts: its normals point out or in. 0 if both sides cover.
    has_planes : (s,) bool
        The depth of the shape is that of its facets' planes.
    radius : (s,) float64
        Half the diagonal of the shape's local bounding box.
    """

    mesh_first: I64
    vertex_first: I64
    face_first: I64
    edge_first: I64
    facet_first: I64
    vertices: F64
    faces: I64
    face_edges: I64
    face_signs: NDArray[np.int8]
    edges: I64
    layer: NDArray[np.int8]
    facet: I64
    facet_face: I64
    outward: NDArray[np.int8]
    has_planes: NDArray[np.bool_]
    radius: F64

    def __len__(self) -> int:
        return len(self.radius)

    @property
    def nbytes(self) -> int:
        """Bytes held by the arrays."""
        return sum(int(v.nbytes) for v in vars(self).values())


def occluder_shapes(meshes: Sequence[Mesh], declared: OccluderTable | None = None) -> ShapeTable:
    """The table of these meshes, and behind them of declared occluders, one "mesh" and one shape each.

    Faces with a corner that is not finite are left out.
    """
    sizes = [len(m.vertices) for m in meshes]
    starts = np.cumsum([0, *sizes])[:-1].tolist()
    vertices = [np.zeros((0, 3)), *(m.vertices for m in meshes)]
    owner = [np.repeat(np.arange(len(meshes)), sizes)]
    faces = [np.zeros((0, 3), np.int64), *(m.faces + start for m, start in zip(meshes, starts, strict=True))]
    links = np.zeros((0, 2), np.int64)
    holes = 0
    if declared is not None and len(declared):
        points, of, made, holes = _declared_faces(declared)
        base = sum(sizes)
        faces.append(made + base)
        vertices.append(points)
        owner.append(of + len(meshes))
        # a hole touches its occluder nowhere, but they are one shape
        first = np.full(len(declared), len(points))
        np.minimum.at(first, of, np.arange(len(points)))
        links = np.column_stack([np.arange(len(points)), first[of]]) + base
    count = sum(len(f) for f in faces)
    layer = np.where(np.arange(count) < count - holes, 1, -1).astype(np.int8)
    total = len(meshes) + (0 if declared is None else len(declared))
    return _build(np.concatenate(vertices), np.concatenate(owner), np.concatenate(faces), layer, links, total)


def _declared_faces(table: OccluderTable) -> tuple[F64, I64, I64, int]:
    """Local vertices and the occluder of each, triangles, and how many of these, at the end, are holes."""
    corners = np.diff(table.loop_first)
    # a fan of triangles over each convex face; the diagonals cancel in every outline
    fans = corners - 2
    face = np.repeat(np.arange(len(corners)), fans)
    step = np.arange(len(face)) - np.repeat(np.cumsum(fans) - fans, fans)
    first = table.loop_first[:-1][face]
    loop = table.loop
    faces = np.column_stack([loop[first], loop[first + step + 1], loop[first + step + 2]])
    owner = np.repeat(np.arange(len(table)), np.diff(table.vertex_first))
    cut = [(a, b, b + 1) for _, a, e in table.holes for b in range(a + 1, e - 1)]
    holes = np.array(cut, np.int64).reshape(-1, 3) + len(table.local_vertices)
    return (
        np.concatenate([table.local_vertices, table.local_hole_vertices]),
        np.concatenate([owner, table.hole_occluder]),
        np.concatenate([faces, holes]),
        len(holes),
    )


def _build(vertices: F64, mesh: I64, faces: I64, layer: NDArray[np.int8], links: I64, meshes: int) -> ShapeTable:
    """Weld, split into connected parts, and sort everything by part; linked vertices are in one part."""
    # a tenth of a second that listing the stages does not need
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    finite = np.asarray(np.isfinite(vertices).all(axis=1))
    keep = np.asarray(finite[faces].all(axis=1))
    faces, layer = faces[keep], layer[keep]
    used = np.zeros(len(vertices), bool)
    used[faces] = True
    kept = np.flatnonzero(used)
    # vertices of equal position are one: files repeat them for normals, and every triangle would be an island
    # adding 0 makes a negative zero a positive one
    position = vertices[kept] + 0.0
    order = np.lexsort([position[:, 2], position[:, 1], position[:, 0], mesh[kept]])
    position, owner = position[order], mesh[kept][order]
    fresh = np.ones(len(order), bool)
    fresh[1:] = (position[1:] != position[:-1]).any(axis=1) | (owner[1:] != owner[:-1])
    number = np.zeros(len(vertices), np.int64)
    number[kept[order]] = np.cumsum(fresh) - 1
    position, owner = position[fresh], owner[fresh]
    faces = number[faces]
    proper = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    faces, layer = faces[proper], layer[proper]
    # vertices that only faces without area had would be parts without faces
    left = np.zeros(len(owner), bool)
    left[faces] = True
    links = number[links[used[links].all(axis=1)]]
    links = links[left[links].all(axis=1)]
    shorter = np.cumsum(left) - 1
    position, owner, faces, links = position[left], owner[left], shorter[faces], shorter[links]
    # parts are numbered by their first vertex, so those of one mesh follow each other
    ends = np.concatenate([faces[:, :2], faces[:, 1:], links]).T
    count, part = connected_components(
        coo_matrix((np.ones(ends.shape[1], np.int8), (ends[0], ends[1])), shape=(len(owner),) * 2), directed=False
    )
    part_mesh = np.zeros(count, np.int64)
    part_mesh[part] = owner
    order = np.argsort(part, kind="stable")
    position, part = position[order], part[order].astype(np.int64)
    moved = np.empty(len(order), np.int64)
    moved[order] = np.arange(len(order))
    faces = moved[faces]
    order = np.argsort(part[faces[:, 0]], kind="stable")
    faces, layer = faces[order], layer[order]
    edges, face_edges, face_signs = mesh_edges(faces)
    steps = np.arange(count + 1)
    vertex_first = np.searchsorted(part, steps)
    face_first = np.searchsorted(part[faces[:, 0]], steps)
    edge_first = np.searchsorted(part[edges[:, 0]], steps)
    low = np.minimum.reduceat(position, vertex_first[:-1]) if count else np.zeros((0, 3))
    high = np.maximum.reduceat(position, vertex_first[:-1]) if count else np.zeros((0, 3))
    radius = 0.5 * np.sqrt(((high - low) ** 2).sum(axis=1))
    facet, facet_face, facet_first, outward, has_planes = _facets(position, vertex_first, faces, face_first, radius)
    oriented = _closed_sense(position, faces, face_edges, face_signs, face_first, edge_first, len(edges))
    of_part = np.repeat(np.arange(count), np.diff(facet_first))
    outward = np.where(has_planes[of_part], outward, oriented[of_part]).astype(np.int8)
    return ShapeTable(
        np.searchsorted(part_mesh, np.arange(meshes + 1)),
        vertex_first,
        face_first,
        edge_first,
        facet_first,
        position,
        faces,
        face_edges,
        face_signs,
        edges,
        layer,
        facet,
        facet_face,
        outward,
        has_planes,
        radius,
    )


def _facets(
    vertices: F64, vertex_first: I64, faces: I64, face_first: I64, radius: F64
) -> tuple[I64, I64, I64, NDArray[np.int8], NDArray[np.bool_]]:
    """Facet of each face; face, first and outward sense of each facet; and which shapes are flat or convex."""
    part = np.repeat(np.arange(len(radius)), np.diff(face_first))
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    length = np.sqrt((normal**2).sum(axis=1))
    with np.errstate(invalid="ignore", divide="ignore"):
        normal = normal / length[:, None]
        start = vertices[vertex_first[:-1]][part]
        offset = ((a - start) * normal).sum(axis=1) / radius[part]
    # rounding splits a plane now and then, which costs a facet more and nothing else
    key = np.nan_to_num(np.column_stack([part, np.round(normal * 1e6), np.round(offset * 1e6)]))
    _, first, facet = np.unique(key, axis=0, return_index=True, return_inverse=True)
    facet = facet.reshape(-1)
    planes = np.bincount(part[first], minlength=len(radius))
    few = planes <= PLANES
    # faces of shapes with many planes are facets of their own
    alone = ~few[part]
    facet = np.where(alone, len(first) + np.arange(len(faces)), facet)
    ids, facet_face, facet = np.unique(facet, return_index=True, return_inverse=True)
    order = np.argsort(facet_face, kind="stable")
    rank = np.empty(len(ids), np.int64)
    rank[order] = np.arange(len(ids))
    facet, facet_face = rank[facet.reshape(-1)], facet_face[order]
    facet_first = np.searchsorted(part[facet_face], np.arange(len(radius) + 1))
    # all vertices of a shape against all its planes
    chosen = np.flatnonzero(few[part[facet_face]])
    of = part[facet_face[chosen]]
    count = vertex_first[of + 1] - vertex_first[of]
    pair = np.repeat(np.arange(len(chosen)), count)
    point = vertices[slice_expand(vertex_first[of], vertex_first[of + 1])]
    face = facet_face[chosen]
    side = ((point - a[face][pair]) * normal[face][pair]).sum(axis=1)
    starts = np.cumsum(count) - count
    limit = FLATNESS * radius[of]
    outward = np.zeros(len(facet_face), np.int8)
    has_planes = few.copy()
    if len(chosen):
        # a face without area has no plane (NaN): it says nothing, and covers nothing either
        below = ~(np.maximum.reduceat(side, starts) > limit)
        above = ~(np.minimum.reduceat(side, starts) < -limit)
        outward[chosen] = np.where(below & above, 0, np.where(below, 1, -1))
        has_planes[of[~(below | above)]] = False
    return facet, facet_face, facet_first, outward, has_planes


def _closed_sense(
    vertices: F64,
    faces: I64,
    face_edges: I64,
    face_signs: NDArray[np.int8],
    face_first: I64,
    edge_first: I64,
    edges: int,
) -> NDArray[np.int8]:
    """(s,) ±1 where a shape is closed and oriented, with normals out or in; 0 otherwise."""
    uses = np.bincount(face_edges.ravel(), minlength=edges)
    net = np.bincount(face_edges.ravel(), face_signs.ravel(), minlength=edges)
    fair = (uses == 2) & (net == 0)
    count = len(face_first) - 1
    part_of_edge = np.repeat(np.arange(count), np.diff(edge_first))
    closed = np.bincount(part_of_edge, ~fair, minlength=count) == 0
    part = np.repeat(np.arange(count), np.diff(face_first))
    origin = vertices[faces[face_first[:-1], 0]][part] if len(faces) else np.zeros((0, 3))
    a, b, c = (vertices[faces[:, i]] - origin for i in range(3))
    volume = np.bincount(part, (a * np.cross(b, c)).sum(axis=1), minlength=count)
    return np.where(closed, np.sign(volume), 0).astype(np.int8)
