"""Colors of levels: the table's where it reaches, spread between its ends where there are more."""

from __future__ import annotations

import numpy as np
import pytest

from lod_scenes import field, run, view
from scenegraph.viewer.colorings import LEVEL_COLORS, ByLevel, level_colors
from scenegraph_lod import LodError


@pytest.mark.parametrize("count", [1, 2, 6, 7, 20, 255])
def test_every_level_has_a_color_of_its_own(count):
    colors = level_colors(count)
    assert len(np.unique(colors, axis=0)) == count
    assert tuple(colors[0]) == LEVEL_COLORS[0]
    if count <= len(LEVEL_COLORS):
        assert [tuple(c) for c in colors] == list(LEVEL_COLORS[:count])
    else:
        assert tuple(colors[-1]) == LEVEL_COLORS[-1]


def test_what_a_stage_made_coarser_is_darker():
    (frame,) = run(field(), [view()], LodError(pixels=2.0))
    colors = ByLevel().colors(frame)
    assert colors.shape == (frame.snapshot.n, 4)
    brightness = colors[:, :3].sum(axis=1)
    order = np.argsort(frame.level, kind="stable")
    assert (np.diff(brightness[order]) <= 1e-12).all()
    names = [name for name, _ in ByLevel().legend(frame)]
    assert names[0] == "level 0"
    assert names[-1] == "level 7"
    assert len(names) == len(LEVEL_COLORS)
