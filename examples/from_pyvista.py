"""
Start from a PyVista plotter
============================

Any plot can be measured: its actors become drawables, its camera becomes a view, and what is hidden can be seen.
"""

# %%
# A plot as one writes it every day.

import numpy as np
import pyvista as pv

from scenegraph import Pipeline, Scene, View
from scenegraph.render.item_buffer import ItemBuffer

rng = np.random.default_rng(4)
plotter = pv.Plotter(off_screen=True, window_size=(640, 480))
for center in rng.uniform(-30, 30, (200, 3)):
    plotter.add_mesh(pv.Sphere(radius=2.5, center=center, theta_resolution=16, phi_resolution=16), color="tan")
plotter.camera.position = (0, -50, 10)
plotter.camera.focal_point = (0, 0, 0)
plotter.camera.up = (0, 0, 1)
plotter.camera.clipping_range = (0.1, 200)

# %%
# The plot as a scene, and its camera as a view.

scene = Scene.from_pyvista(plotter)
view = View.from_pyvista(plotter.camera, *plotter.window_size)
snapshot = scene.snapshot()
print(snapshot.n, "drawables from", len(plotter.actors), "actors")

with Pipeline.parse("frustum") as pipeline:
    frame = pipeline.open(snapshot).run(view)

exact = ItemBuffer(snapshot).render(view).visible
print(f"the frustum leaves {frame.visible_count}; {exact.sum()} can really be seen")
print("visible and hidden:", int((exact & ~frame.visible).sum()))

# %%
# And back: a `MultiBlock` of what is left to draw.

blocks = scene.to_multiblock()
print("as a MultiBlock:", type(blocks).__name__, "with", len(blocks), "blocks at the top")
plotter.close()
