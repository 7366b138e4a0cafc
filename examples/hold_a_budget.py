"""
Hold a budget of triangles
==========================

Levels of detail for a mesh that has none, and three rules that choose among them.
"""

# %%
# A ball with bumps, and its levels by edge collapse. The error of a level bounds how far its surface lies from the
# mesh, in the mesh's units.

import matplotlib.pyplot as plt
import numpy as np
import trimesh

from scenegraph import Group, Lod, Mesh, Pipeline, Scene, Transform, View
from scenegraph.meshes import level_chain

ball = trimesh.creation.icosphere(subdivisions=4)
x, y, z = ball.vertices.T
bumps = 1 + 0.1 * np.sin(9 * x) * np.sin(7 * y + 1) * np.sin(8 * z + 2)
chain = level_chain(Mesh(ball.vertices * bumps[:, None], ball.faces))
for level, error in chain:
    print(f"{level.triangles:5d} triangles within {error:.4f}")

# %%
# Many of them on a plain. Drawables without levels would get theirs when the pipeline is opened.

rng = np.random.default_rng(1)
places = np.column_stack([rng.uniform(-60, 60, (600, 2)), np.zeros(600)])
levels, errors = [mesh for mesh, _ in chain], [error for _, error in chain]
scene = Scene(Group(*(Transform(Lod(*levels, errors=errors), translation=p) for p in places)))
snapshot = scene.snapshot()
view = View((0, -70, 15), (0, 0, 0), fov=50)

# %%
# An error of one pixel takes as many triangles as it takes; a budget takes as large an error as it has to.

rules = ("lod_distance", "lod_error(pixels=1)", "lod_budget(triangles=100000)")
figure, axes = plt.subplots(1, len(rules), figsize=(12, 4), layout="constrained", sharey=True)
for rule, plot in zip(rules, axes, strict=True):
    with Pipeline.parse(f"frustum | {rule}").open(snapshot) as pipeline:
        frame = pipeline.run(view)
    seen = view.error_pixels(snapshot.errors[frame.level, np.arange(snapshot.n)], snapshot.boxes)[frame.visible]
    print(f"{rule}: {frame.drawn_triangles():,} triangles, largest error {seen.max():.2f} pixels")
    rows = np.flatnonzero(frame.visible)
    plot.scatter(*snapshot.boxes[:2, rows], c=frame.level[rows], cmap="inferno_r", vmin=0, vmax=len(chain) - 1, s=18)
    plot.plot(*view.eye[:2], "*", color="black", markersize=12)
    plot.set(title=f"{rule}\n{frame.drawn_triangles():,} triangles", aspect="equal", xticks=[], yticks=[])
plt.show()
