"""Scenes and views that the tests of the stage `shadow` share."""

from __future__ import annotations

from typing import Any

import numpy as np

import scenegraph as sg
from scenegraph.testing import box_at


def run(stage: sg.Stage, snapshot: sg.Snapshot, *views: sg.View) -> list[sg.Frame]:
    with sg.Pipeline([stage]).open(snapshot) as pipeline:
        return [pipeline.run(view) for view in views]


def names(frame: sg.Frame, *, visible: bool) -> set[str]:
    return {g.name for g, v in zip(frame.snapshot.geodes, frame.visible, strict=True) if v == visible}


def counts(frame: sg.Frame) -> dict[str, float]:
    return frame.record.stages[-1].counts


def town(count: int = 200, seed: int = 3, *, kinds: str = "both", spread: float = 40.0) -> sg.Scene:
    """Boxes on a plain, each with a solid and four facades as occluders a little inside it, and small ones between."""
    rng = np.random.default_rng(seed)
    scene = sg.Scene()
    for i in range(count):
        place = np.append(rng.uniform(-spread, spread, 2), 0.0)
        size = np.append(rng.uniform(1, 5, 2), rng.uniform(1, 9))
        low, high = np.array([-0.5, -0.5, 0.0]) * size, np.array([0.5, 0.5, 1.0]) * size
        group = sg.Transform(
            sg.Geode(sg.Mesh.box(low, high)),
            translation=place,
            rotation=(float(rng.uniform(0, 90)), (0, 0, 1)),
            name=f"house {i}",
        )
        if kinds in ("both", "solid"):
            group.add(sg.Occluder.box(low * 0.99, high * 0.99))
        if kinds in ("both", "planar"):
            x, y, z = high * 0.99
            for points in (
                [(-x, -y, 0.01), (x, -y, 0.01), (x, -y, z), (-x, -y, z)],
                [(x, -y, 0.01), (x, y, 0.01), (x, y, z), (x, -y, z)],
            ):
                group.add(sg.Occluder.planar(points))
        scene.add(group)
    for i, place in enumerate(rng.uniform(-spread, spread, (count, 2))):
        scene.add(box_at((*place, 0.3), 0.4, name=f"thing {i}"))
    return scene


def street_views(count: int, seed: int = 5, spread: float = 40.0, **options: Any) -> list[sg.View]:
    rng = np.random.default_rng(seed)
    eyes = np.column_stack([rng.uniform(-spread, spread, (count, 2)), rng.uniform(0.5, 6.0, count)])
    ways = np.column_stack([rng.standard_normal((count, 2)), rng.uniform(-0.2, 0.1, count)])
    options = {"near": 0.05, "far": 300.0, "width": 320, "height": 180} | options
    return [sg.View(e, e + w, **options) for e, w in zip(eyes, ways, strict=True)]
