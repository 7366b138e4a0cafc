"""
Build a scene by hand
=====================

A graph of groups, transforms and geodes; one mesh shared by many drawables; a move that costs only what it touches.
"""

# %%
# A row of columns on a step. The column is one mesh; every geode that shows it is a drawable of its own.

import matplotlib.pyplot as plt
import numpy as np

from scenegraph import Geode, Group, Mesh, Occluder, Scene, Switch, Transform, View
from scenegraph.render.drawing import Drawing
from scenegraph.render.window import OffscreenWindow

STONE, ROOF = (0.86, 0.83, 0.76), (0.70, 0.36, 0.27)

angle = np.linspace(0, 2 * np.pi, 16, endpoint=False)
ring = np.column_stack([0.4 * np.cos(angle), 0.4 * np.sin(angle)])
shaft = np.vstack([np.insert(ring, 2, 0.0, axis=1), np.insert(0.85 * ring, 2, 5.0, axis=1)])
low = np.arange(16)
high, following = low + 16, (low + 1) % 16
faces = np.vstack([np.column_stack([low, following, high]), np.column_stack([following, following + 16, high])])
column = Mesh(shaft, faces, name="column", color=STONE)

columns = Group(name="columns")
for x in np.arange(-10, 11, 4):
    for y in (-5, 5):
        columns.add(Transform(Geode(column), translation=(x, y, 0.5)))

# %%
# An occluder is not drawn: it is a promise that something opaque fills this space. A switch shows some of its children.

cella = Group(
    Geode(Mesh.box((-8, -3, 0.5), (8, 3, 5.5), color=STONE), name="walls"),
    Occluder.box((-8, -3, 0.5), (8, 3, 5.5)),
    name="cella",
)
roof = Switch(Geode(Mesh.box((-11, -6, 5.5), (11, 6, 6.3), color=ROOF), name="slab"), name="roof")
temple = Transform(
    Geode(Mesh.box((-11, -6, 0), (11, 6, 0.5), color=STONE), name="step"), columns, cella, roof, name="temple"
)
ground = Geode(Mesh.box((-40, -40, -1), (40, 40, 0), color=(0.55, 0.62, 0.42)), name="ground", never_cull=True)
scene = Scene().add(ground, temple)

# %%
# Stages see a snapshot: arrays with one row per drawable. It follows edits when it is told to.

snapshot = scene.snapshot()
print(snapshot.n, "drawables share", len(snapshot.meshes), "meshes,", int(snapshot.triangles[0].sum()), "triangles")

temple.matrix = Transform(rotation=(30, (0, 0, 1))).matrix
print("after turning the temple:", sorted(snapshot.sync()))

roof.active = "none"
print("after taking the roof off:", sorted(snapshot.sync()), "and", snapshot.n, "drawables")

# %%
# Drawn without a display:

view = View(eye=(24, -22, 14), target=(0, 0, 2), fov=40, width=960, height=540)
with OffscreenWindow(view.width, view.height, scene.background) as window:
    Drawing(snapshot, window.renderer)
    window.draw(view)
    image = window.image()

figure, axes = plt.subplots(figsize=(8, 4.5), layout="constrained")
axes.imshow(image)
axes.set_axis_off()
plt.show()
