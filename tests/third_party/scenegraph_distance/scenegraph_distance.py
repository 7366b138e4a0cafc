"""A stranger's plugin: a stage that hides what is farther away than a distance."""

import numpy as np

from scenegraph import Frame, Guarantee, Stage, hookimpl, parameter


class Distance(Stage):
    """Hides what lies wholly beyond a distance from the eye."""

    name = "distance"
    guarantee = Guarantee.AGGRESSIVE
    bound = "nothing nearer than `limit` is hidden"
    limit: float = parameter(500.0, minimum=0.0, unit="world units", help="hide what lies wholly beyond")

    def run(self, frame: Frame) -> None:
        boxes = frame.snapshot.boxes
        gap = np.abs(boxes[:3] - np.asarray(frame.view.eye)[:, None]) - boxes[3:]
        frame.hide(np.linalg.norm(np.maximum(gap, 0.0), axis=0) > self.limit)


@hookimpl
def scenegraph_register_stages(register):
    register(Distance)
