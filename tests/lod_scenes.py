"""Scenes of drawables with levels, and stages that stand for others in tests of LOD selection."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

import scenegraph as sg
from level_shapes import ball
from scenegraph.meshes import level_chain


@cache
def chain() -> list[tuple[sg.Mesh, float]]:
    """A bumpy ball of 1200 triangles with levels down to 9."""
    return level_chain(ball(10, 0.1), [2.0**-n for n in range(1, 8)], cache=None)


def lod(name: str = "", *, known: bool = True, **options: Any) -> sg.Lod:
    """A drawable with these levels, and with their errors if they are `known`."""
    levels = chain()
    errors = [error for _, error in levels] if known else None
    return sg.Lod(*(mesh for mesh, _ in levels), errors=errors, name=name, **options)


def field(count: int = 120, *, scale: float = 1.0, offset: float = 0.0, seed: int = 1) -> sg.Scene:
    """Balls of different sizes, scattered over a field around the origin; three lack errors, one has no levels."""
    rng = np.random.default_rng(seed)
    places, sizes = rng.uniform(-40, 40, (count, 3)) * (1, 1, 0.1), rng.uniform(0.2, 2, count)
    nodes: list[sg.Node] = [
        sg.Transform(lod(f"ball {i}", known=i % 40 != 7), translation=place, scale=size)
        for i, (place, size) in enumerate(zip(places, sizes, strict=True))
    ]
    nodes.append(sg.Transform(sg.Geode(sg.Mesh.box((-1, -1, -1), (1, 1, 1)), name="box"), translation=(0, 5, 0)))
    return sg.Scene(sg.Group(sg.Transform(*nodes, scale=scale, translation=(offset,) * 3), name="field"))


def view(scale: float = 1.0, offset: float = 0.0, **options: Any) -> sg.View:
    """From the edge of the field to its middle."""
    at = np.full(3, float(offset))
    values = {"near": 0.1 * scale, "far": 300 * scale, "width": 640, "height": 480} | options
    return sg.View(at + np.array([0, -45, 4]) * scale, at, **values)


def run(scene: sg.Scene | sg.Snapshot, views: list[sg.View], *stages: sg.Stage, **options: Any) -> list[sg.Frame]:
    """The frames of a new pipeline."""
    snapshot = scene.snapshot() if isinstance(scene, sg.Scene) else scene
    with sg.Pipeline(stages, **options).open(snapshot) as pipeline:
        return [pipeline.run(v) for v in views]


class PutsVisibility(sg.Stage):
    """Gives every row the same level of visibility, or rows the values of a list in turn."""

    name = "puts_visibility"
    writes = (sg.LevelOfVisibility,)
    seen_as: tuple[float, ...] = (0.5,)

    def run(self, frame: sg.Frame) -> None:
        """Not by looking."""
        frame.put(sg.LevelOfVisibility.of(np.resize(np.array(self.seen_as), frame.snapshot.n)))

    @classmethod
    def of(cls, *values: float) -> PutsVisibility:
        """A stage with these values."""
        stage = cls()
        stage.seen_as = values
        return stage
