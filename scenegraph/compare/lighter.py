"""A lighter copy of a snapshot, for pictures in which a drawable is a few pixels large."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scenegraph.mesh import Mesh
from scenegraph.meshes.collapsing import collapse
from scenegraph.nodes import Geode, Transform
from scenegraph.scene import Scene
from scenegraph.snapshot import Snapshot

#: A mesh is not made coarser than this.
COARSEST = 60


def lighter(snapshot: Snapshot, enough: int) -> tuple[Snapshot, NDArray[np.int64]]:
    """Simplify the meshes of a snapshot until all of it has about `enough` triangles.

    Returns
    -------
    Snapshot
        The same one if it is light already.
    (n,) int64
        Row of the first snapshot for each row of the second.
    """
    counts = snapshot.triangles[0].astype(np.int64)
    if counts.sum() <= enough:
        return snapshot, np.arange(snapshot.n)
    # Rows of few triangles keep them; what they leave is shared by the others.
    limit = max(_shared_limit(counts, enough), COARSEST)
    meshes = {i: _simplified(snapshot.meshes[i], limit) for i in np.unique(snapshot.mesh_index).tolist()}
    geodes = [
        Geode(meshes[mesh], color=tuple(color))
        for mesh, color in zip(snapshot.mesh_index.tolist(), snapshot.colors.tolist(), strict=True)
    ]
    row_of = {id(geode): row for row, geode in enumerate(geodes)}
    places = snapshot.transforms[snapshot.transform_index]
    scene = Scene(name=snapshot.scene.name, up=snapshot.scene.up)
    scene.add(*(Transform(geode, matrix=place) for geode, place in zip(geodes, places, strict=True)))
    light = scene.snapshot()
    return light, np.array([row_of[id(geode)] for geode in light.geodes], np.int64)


def _shared_limit(counts: NDArray[np.int64], enough: int) -> int:
    """Find the largest limit for which the triangles, cut to it in every row, are enough."""
    rising = np.sort(counts)
    before = np.concatenate([[0], np.cumsum(rising)[:-1]])
    rest = np.arange(len(rising), 0, -1)
    fits = before + rest * rising <= enough
    last = int(np.count_nonzero(fits))
    return int((enough - before[last]) // rest[last]) if last < len(rising) else int(rising[-1])


def _simplified(mesh: Mesh, limit: int) -> Mesh:
    if mesh.triangles <= limit or mesh.problems:
        return mesh
    # It refuses arrays that are read-only, as those of a mesh are.
    points, faces = collapse(mesh.vertices.copy(), mesh.faces.copy(), target_reduction=1.0 - limit / mesh.triangles)
    return Mesh(points, faces, color=mesh.color) if len(faces) else mesh
