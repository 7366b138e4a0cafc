"""
Write a stage, and judge it
===========================

A stage of a few lines hides what stands far to the side of the line of sight. The exact visible set tells what that
costs.
"""

# %%
# A stage declares its name, its parameters and what it promises, and takes away from the frame.

import numpy as np

from scenegraph import Frame, Guarantee, Pipeline, Registry, Stage, hookimpl, parameter, registry
from scenegraph.render.item_buffer import ItemBuffer


class Blinkers(Stage):
    """Hides what lies wholly outside a cone around the line of sight."""

    name = "blinkers"
    guarantee = Guarantee.AGGRESSIVE
    bound = "nothing within `angle` of the line of sight is hidden"
    angle: float = parameter(20.0, minimum=0.0, maximum=90.0, unit="degrees", help="half the opening of the cone")

    def run(self, frame: Frame) -> None:
        boxes = frame.snapshot.boxes
        to_center = boxes[:3] - np.asarray(frame.view.eye)[:, None]
        distance = np.linalg.norm(to_center, axis=0)
        radius = np.linalg.norm(boxes[3:], axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            off_axis = np.arccos(np.clip(frame.view.forward @ to_center / distance, -1, 1))
            apparent = np.arcsin(np.clip(radius / distance, 0, 1))
        frame.hide((distance > radius) & (off_axis - apparent > np.radians(self.angle)))


# %%
# A plugin hands its stages over through a hook. An installed one is found by itself; this one is added by hand.


class Plugin:
    @hookimpl
    def scenegraph_register_stages(self, register):
        register(Blinkers)


known = Registry()
known.add(Plugin())

# %%
# Narrower blinkers draw less and lose more.

scene = registry().scene("city").build(buildings=150)
snapshot = scene.snapshot()
truth = ItemBuffer(snapshot)
views = scene.paths["street"][::12]
exact = [truth.render(view).visible for view in views]

for angle in (10, 20, 30, 45, 60):
    with Pipeline.parse(f"frustum | blinkers(angle={angle})", known) as pipeline:
        pipeline.open(snapshot)
        kept = [pipeline.run(view).visible for view in views]
    drawn = np.mean([k.sum() for k in kept])
    lost = sum(int((e & ~k).sum()) for e, k in zip(exact, kept, strict=True))
    seen = sum(int(e.sum()) for e in exact)
    print(f"angle {angle:2d}: {drawn:6.0f} drawn per view; {lost} of {seen} visible ones lost in {len(views)} views")
