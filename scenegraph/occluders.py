"""OccluderTable: the occluders of a snapshot as arrays, in world coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .kernels.slices import slice_expand
from .occluder import Occluder
from .view import View


@dataclass
class OccluderTable:
    """Planar and solid occluders; the world arrays are refreshed by `place` when something moves.

    Attributes
    ----------
    nodes : tuple of Occluder
    solid, two_sided : (o,) bool
        A planar occluder has one face and as many edges as vertices; its face's normal points to the front.
    outside_only : (o,) bool
        See `Occluder.outside_only`, and `holds_for`.
    owner : (o, 2) int
        First and end row that the occluder may never hide.
    vertex_first : (o + 1,) int
        Vertices of occluder i are [vertex_first[i], vertex_first[i + 1]); likewise `face_first`, `edge_first`.
    loop_first : (f + 1,) int
        Corners of face j are loop[loop_first[j] : loop_first[j + 1]], indices of vertices.
    edges : (e, 2) int
        Vertex indices of each edge.
    edge_faces : (e, 2) int
        The two faces at each edge of a solid; (face, -1) for a planar occluder.
    holes : tuple of (occluder, (first, end) in hole_vertices)
        Convex polygons cut out of planar occluders.
    vertices : (v, 3) float64
        World coordinates; so are `hole_vertices`.
    normals : (f, 3) float64
        Outward unit normals; NaN where a face has no area after its transform.
    areas : (f,) float64
    """

    solid: NDArray[np.bool_]
    two_sided: NDArray[np.bool_]
    outside_only: NDArray[np.bool_]
    owner: NDArray[np.int64]
    nodes: tuple[Occluder, ...]
    vertex_first: NDArray[np.int64]
    face_first: NDArray[np.int64]
    edge_first: NDArray[np.int64]
    loop: NDArray[np.int32]
    loop_first: NDArray[np.int64]
    edges: NDArray[np.int32]
    edge_faces: NDArray[np.int32]
    holes: tuple[tuple[int, int, int], ...]
    transform_index: NDArray[np.int64]
    local_vertices: NDArray[np.float64]
    local_hole_vertices: NDArray[np.float64]
    hole_occluder: NDArray[np.int64]
    vertices: NDArray[np.float64]
    hole_vertices: NDArray[np.float64]
    normals: NDArray[np.float64]
    areas: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.solid)

    @property
    def nbytes(self) -> int:
        """Bytes held by the arrays."""
        return sum(v.nbytes for v in vars(self).values() if isinstance(v, np.ndarray))

    @classmethod
    def build(
        cls, nodes: Sequence[Occluder], transform_index: NDArray[np.int64], owner: NDArray[np.int64]
    ) -> OccluderTable:
        """Topology of occluder nodes; call `place` for the world arrays.

        Parameters
        ----------
        nodes : o occluder nodes
        transform_index : (o,) int
        owner : (o, 2) int
        """
        # instances share their topology: what is counted once per shape is repeated by arrays
        shapes: dict[int, _Shape] = {}
        of: list[_Shape] = []
        for node in nodes:
            shape = shapes.get(id(node.faces))
            if shape is None:
                shape = shapes[id(node.faces)] = _Shape.of(node.faces, len(node.vertices))
            of.append(shape)
        starts = _starts([s.vertices for s in of])
        face_first = _starts([len(s.corners) for s in of])
        edge_first = _starts([len(s.edges) for s in of])
        loops = _joined([s.loop for s in of])
        edges = _joined([s.edges for s in of]).reshape(-1, 2)
        edge_faces = _joined([s.edge_faces for s in of]).reshape(-1, 2)
        loops += np.repeat(starts[:-1], [len(s.loop) for s in of])
        edges += np.repeat(starts[:-1], np.diff(edge_first))[:, None]
        edge_faces = np.where(
            edge_faces >= 0, edge_faces + np.repeat(face_first[:-1], np.diff(edge_first))[:, None], edge_faces
        )
        holes: list[tuple[int, int, int]] = []
        hole_points: list[NDArray[np.float64]] = []
        hole_occluder: list[int] = []
        for i, node in enumerate(nodes):
            for hole in node.holes:
                holes.append((i, len(hole_occluder), len(hole_occluder) + len(hole)))
                hole_points.append(hole)
                hole_occluder.extend([i] * len(hole))
        return cls(
            solid=np.array([n.kind == "solid" for n in nodes], bool),
            two_sided=np.array([n.two_sided for n in nodes], bool),
            outside_only=np.array([n.outside_only for n in nodes], bool),
            owner=np.asarray(owner, np.int64).reshape(-1, 2),
            nodes=tuple(nodes),
            vertex_first=starts,
            face_first=face_first,
            edge_first=edge_first,
            loop=loops.astype(np.int32),
            loop_first=_starts(_joined([s.corners for s in of])),
            edges=edges.astype(np.int32),
            edge_faces=edge_faces.astype(np.int32),
            holes=tuple(holes),
            transform_index=np.asarray(transform_index, np.int64),
            local_vertices=np.concatenate([n.vertices for n in nodes]) if nodes else np.zeros((0, 3)),
            local_hole_vertices=np.concatenate(hole_points) if hole_points else np.zeros((0, 3)),
            hole_occluder=np.array(hole_occluder, np.int64),
            vertices=np.zeros((0, 3)),
            hole_vertices=np.zeros((0, 3)),
            normals=np.zeros((0, 3)),
            areas=np.zeros(0),
        )

    def place(self, transforms: NDArray[np.float64]) -> None:
        """World vertices, normals and areas under the (t, 4, 4) world matrices."""
        matrix = transforms[self.transform_index]
        of_vertex = np.repeat(np.arange(len(self)), np.diff(self.vertex_first))
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            self.vertices = _apply(matrix[of_vertex], self.local_vertices)
            self.hole_vertices = _apply(matrix[self.hole_occluder], self.local_hole_vertices)
            if not len(self):
                return
            # Newell, relative to the first corner of each loop
            of_loop = np.repeat(np.arange(len(self.loop_first) - 1), np.diff(self.loop_first))
            start = self.loop_first[:-1]
            point = self.vertices[self.loop] - self.vertices[self.loop[start]][of_loop]
            following = np.arange(len(self.loop)) + 1
            following[self.loop_first[1:] - 1] = start
            area = 0.5 * np.add.reduceat(np.cross(point, point[following]), start, axis=0)
            self.areas = np.linalg.norm(area, axis=1)
            of_face = np.repeat(np.arange(len(self)), np.diff(self.face_first))
            mirrored = np.where(np.linalg.det(matrix[:, :3, :3]) < 0, -1.0, 1.0)
            # a mirror turns loops clockwise; the front of a planar occluder stays the side its author meant
            self.normals = area / self.areas[:, None] * mirrored[of_face][:, None]

    def holds_for(self, view: View, boxes: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which occluders may be used for a view: all but those `outside_only` that it looks at from within.

        Parameters
        ----------
        view : View
            Its rays start between the eye and the near plane; without perspective, on the near plane.
        boxes : (6, n) float64
            Of the rows. Where the box of the owner is unknown, or there is no owner left, the occluder is not used.

        Returns
        -------
        (o,) bool
        """
        out = ~self.outside_only
        first, end = self.owner.T
        asked = np.flatnonzero(self.outside_only & (end > first))
        if len(asked):
            starts = view.corners()[:4]
            if not view.is_parallel:
                starts = np.concatenate([starts, [view.eye]])
            low, high = starts.min(axis=0)[:, None], starts.max(axis=0)[:, None]
            center, half = boxes[:3, first[asked]], boxes[3:, first[asked]]
            out[asked] = ((low > center + half) | (high < center - half)).any(axis=0)
        return np.asarray(out)

    def points_of(self, occluder: int) -> NDArray[np.float64]:
        """(k, 3) world vertices of one occluder."""
        return self.vertices[self.vertex_first[occluder] : self.vertex_first[occluder + 1]]

    def take(self, chosen: NDArray[np.integer]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Vertex, face and edge indices of the chosen occluders, one after the other."""
        return tuple(  # type: ignore[return-value]
            slice_expand(first[chosen], first[1:][chosen])
            for first in (self.vertex_first, self.face_first, self.edge_first)
        )


def _apply(matrices: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.einsum("nij,nj->ni", matrices[:, :3, :3], points) + matrices[:, :3, 3])


def _starts(sizes: Sequence[int] | NDArray[np.int64]) -> NDArray[np.int64]:
    return np.concatenate([[0], np.cumsum(sizes, dtype=np.int64)])


def _joined(parts: Sequence[NDArray[np.int64]]) -> NDArray[np.int64]:
    return np.concatenate(parts) if parts else np.zeros(0, np.int64)


@dataclass(frozen=True)
class _Shape:
    """Topology that occluders share: corners of all faces, corners per face, edges, and the faces at each edge."""

    vertices: int
    loop: NDArray[np.int64]
    corners: NDArray[np.int64]
    edges: NDArray[np.int64]
    edge_faces: NDArray[np.int64]

    @classmethod
    def of(cls, faces: tuple[tuple[int, ...], ...], vertices: int) -> _Shape:
        sides: dict[tuple[int, int], list[int]] = {}
        for number, face in enumerate(faces):
            for a, b in zip(face, face[1:] + face[:1], strict=True):
                sides.setdefault((min(a, b), max(a, b)), []).append(number)
        return cls(
            vertices=vertices,
            loop=np.array([k for face in faces for k in face], np.int64),
            corners=np.array([len(face) for face in faces], np.int64),
            edges=np.array(list(sides), np.int64),
            edge_faces=np.array([(f[0], f[1] if len(f) > 1 else -1) for f in sides.values()], np.int64),
        )
