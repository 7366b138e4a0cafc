"""
See which occluder hides what
=============================

The shadows that the buildings of a city cast from one eye, on a map: what each of the active occluders hides.
"""

# %%
# A street view of a small city. Each building owns a solid occluder a little inside its walls.

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Rectangle

from scenegraph import Pipeline, registry
from scenegraph_shadow import ShadowFrusta

scene = registry().scene("city").build(buildings=400, detail=0, views=24)
snapshot = scene.snapshot()
view = scene.paths["street"][5]

with Pipeline.parse("frustum | shadow(active=8)").open(snapshot) as pipeline:
    frame = pipeline.run(view)

frusta = frame.get(ShadowFrusta)
outside, inside = (int(s.hidden) for s in frame.record.stages)
print(f"{snapshot.n} drawables: {outside} outside the view, {inside} in the shadow of {len(frusta)} occluders")
print(f"{frame.visible_count} are left to be drawn")

# %%
# The stage leaves its frusta in the frame. They can be asked which boxes they hold; the first one counts here.

hidden = np.flatnonzero(frame.hidden_by() == 1)
first = frusta.hides(snapshot.boxes[:, hidden]).argmax(axis=0)
for rank, (occluder, count) in enumerate(zip(frusta.ids, np.bincount(first, minlength=len(frusta)), strict=True)):
    print(f"{rank}: {snapshot.occluders.nodes[occluder].parent.name} hides {count}")

# %%
# On the map, buildings have an edge in the color of the occluder that hides them. What is drawn is black, or filled
# with a color if it is an active occluder; what lies outside the view is pale. A shadow begins behind its occluder and
# never ends.

colors = plt.get_cmap("tab10")(np.arange(len(frusta)) % 10)
figure, axes = plt.subplots(figsize=(8, 8), layout="constrained")
eye = np.array(view.eye)
for rank, occluder in reversed(list(enumerate(frusta.ids))):
    ring = snapshot.occluders.points_of(occluder)[:, :2] - eye[:2]
    ring = ring[np.argsort(np.arctan2(*(ring - ring.mean(axis=0)).T))]
    turn = np.arctan2(ring @ [[-view.forward[1]], [view.forward[0]]], ring @ view.forward[:2, None])[:, 0]
    left, right = ring[turn.argmax()], ring[turn.argmin()]
    shadow = np.array([left, left * 1e3, right * 1e3, right]) + eye[:2]
    axes.fill(*shadow.T, color=colors[rank], alpha=0.12, linewidth=0)
    axes.fill(*(ring + eye[:2]).T, color=colors[rank], zorder=3)

size = snapshot.boxes[3:5].T * 2
buildings = np.flatnonzero((size < 60).all(axis=1) & (snapshot.boxes[5] > 1))
by = np.full(snapshot.n, -1)
by[hidden] = first
for row in buildings:
    x, y = snapshot.boxes[:2, row] - snapshot.boxes[3:5, row]
    color = "black" if frame.visible[row] else colors[by[row]] if by[row] >= 0 else "gainsboro"
    axes.add_patch(Rectangle((x, y), *size[row], fill=by[row] < 0, color=color, linewidth=1.5))
axes.plot(*eye[:2], "*", color="black", markersize=16)
center, reach = snapshot.boxes[:2, buildings], snapshot.boxes[3:5, buildings]
low, high = (center - reach).min(axis=1), (center + reach).max(axis=1)
axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xticks=[], yticks=[])
axes.set_title(f"{inside} drawables hidden by {len(frusta)} shadow frusta, {frame.visible_count} drawn")
plt.show()
