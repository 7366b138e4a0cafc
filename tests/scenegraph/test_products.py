"""Products that belong to no plugin: any stage may put them, any other may read them."""

from __future__ import annotations

import numpy as np

import scenegraph as sg
from scenegraph.testing import grid_scene


class PutsVisibility(sg.Stage):
    """Stands for a plugin that knows nothing of occlusion maps."""

    name = "puts_visibility"
    writes = (sg.LevelOfVisibility,)

    def run(self, frame: sg.Frame) -> None:
        """Rising by rows."""
        frame.put(sg.LevelOfVisibility.of(np.linspace(-1, 1, frame.snapshot.n)))


class ReadsVisibility(sg.Stage):
    """Stands for another plugin."""

    name = "reads_visibility"
    reads = (sg.LevelOfVisibility,)
    writes = ("visible",)

    def run(self, frame: sg.Frame) -> None:
        """Hide what shows no detail."""
        frame.hide(frame.get(sg.LevelOfVisibility).values > 0.5)


def test_stages_of_different_plugins_meet_in_a_product_of_the_host():
    with sg.Pipeline([PutsVisibility(), ReadsVisibility()]).open(grid_scene(2).snapshot()) as pipeline:
        frame = pipeline.run(sg.View((0, -20, 0), (0, 0, 0)))
    assert frame.visible.tolist() == [True] * 6 + [False] * 2


def test_a_reader_without_a_writer_is_told_so_before_the_first_frame():
    (fault,) = sg.Pipeline([ReadsVisibility()], preparations=sg.Registry(discover=False)).faults()
    assert "LevelOfVisibility" in fault


def test_values_are_one_where_hidden_and_minus_one_where_nobody_looked():
    asked = []

    def evaluate() -> np.ndarray:
        asked.append(1)
        return np.array([0.25, 0.5])

    hidden = np.array([False, False, True, True])
    product = sg.LevelOfVisibility(4, hidden, np.array([1, 2]), evaluate)
    assert not asked, "not before somebody asks"
    assert product.values.tolist() == product.values.tolist() == [-1.0, 0.25, 1.0, 1.0]
    assert len(asked) == 1


def test_values_given_are_copied():
    mine = np.zeros(3)
    product = sg.LevelOfVisibility.of(mine)
    mine[:] = 1
    assert product.values.dtype == np.float32
    assert product.values.tolist() == [0, 0, 0]
