"""
Compare two pipelines and see what they hide
============================================

The frame of a street view, and a map of the city that tells for every drawable which stage hid it. With a file name as
argument the picture is saved; the one in the README was:
``python examples/compare_two_pipelines.py docs/images/city.png``.
"""

# %%
# A city seen from one of its streets, and two pipelines: a conservative one, and one that also leaves out small things.

import sys

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import PatchCollection
from matplotlib.patches import Rectangle

from scenegraph import Pipeline, registry
from scenegraph.render.drawing import Drawing
from scenegraph.render.item_buffer import ItemBuffer
from scenegraph.render.window import OffscreenWindow

scene = registry().scene("city").build(buildings=500)
view = scene.paths["street"][60].resized(960, 600)
snapshot = scene.snapshot()
exact = ItemBuffer(snapshot).render(view)

frames = {}
for text in ("frustum", "frustum | contribution(pixels=24)"):
    with Pipeline.parse(text) as pipeline:
        frame = frames[text] = pipeline.open(snapshot).run(view)
    lost = exact.visible & ~frame.visible
    print(f"{text}: {frame.visible_count} of {snapshot.n} drawn, {exact.visible.sum()} visible in truth, ", end="")
    print(f"{lost.sum()} falsely hidden ({exact.pixels[lost].sum()} of {exact.pixels.sum()} pixels)")

# %%
# The picture that the bold pipeline leaves, and what became of every drawable, seen from above.

with OffscreenWindow(view.width, view.height, scene.background) as window:
    Drawing(snapshot, window.renderer).apply(frame)
    window.draw(view)
    image = window.image()

fate = np.where(frame.visible, np.where(exact.visible, "visible", "drawn in vain"), "outside the view")
fate[frame.hidden_by() == 1] = "too small"
COLORS = {"outside the view": "#d9d9de", "too small": "#d1495b", "drawn in vain": "#8fb8de", "visible": "#1d3557"}

figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.2), width_ratios=(1.5, 1), layout="constrained")
left.imshow(image)
left.set_axis_off()
left.set_title("what is drawn", loc="left")

# The ground would cover the map: only what stands on it is shown.
x, y, _, dx, dy, dz = snapshot.boxes
stands = dz > 1.0
for name, color in COLORS.items():
    rows = np.flatnonzero(stands & (fate == name))
    order = rows[np.argsort(-dx[rows] * dy[rows], kind="stable")]
    shapes = [Rectangle((x[i] - dx[i], y[i] - dy[i]), 2 * dx[i], 2 * dy[i]) for i in order]
    right.add_collection(PatchCollection(shapes, color=color, lw=0, label=f"{name} ({np.sum(fate == name)})"))
corners = view.corners(far=2 * np.hypot(*np.ptp(scene_bounds := np.array([x[stands], y[stands]]), axis=1)))
wedge = np.array([corners[4, :2], view.eye[:2], corners[5, :2]])
right.plot(*wedge.T, color="#1d3557", lw=1)
right.set_xlim(scene_bounds[0].min(), scene_bounds[0].max())
right.set_ylim(scene_bounds[1].min(), scene_bounds[1].max())
right.set_aspect("equal")
right.set_axis_off()
right.set_title(f"seen from above: {frame.snapshot.n} drawables", loc="left")
right.legend(loc="upper left", bbox_to_anchor=(1, 1), frameon=False)

if len(sys.argv) > 1:
    figure.savefig(sys.argv[1], dpi=100)
    print("saved", sys.argv[1])
plt.show()
