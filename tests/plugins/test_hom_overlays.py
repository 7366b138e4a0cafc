"""What the viewer can show of the stage `hom`."""

from __future__ import annotations

import numpy as np
import pytest

import scenegraph as sg
from scenegraph.testing import box_at, wall_scene, wall_views
from scenegraph_hom import Hom, OcclusionMap
from scenegraph_hom.overlays import BLOCK, DARK, OCCLUDER, PALE, PICKED, ByVisibility, MapInset, occluding_rows


def framed(scene: sg.Scene, view: sg.View, **values: object) -> sg.Frame:
    with sg.Pipeline([Hom(least=1, **values)]).open(scene.snapshot()) as pipeline:
        return pipeline.run(view)


def two_walls() -> tuple[sg.Scene, sg.View]:
    """A wall, a box half behind it, one wholly behind it, and a free one."""
    scene = sg.Scene().add(
        box_at((-5, 0, 0), (10, 1, 10), name="wall"),
        box_at((0, 6, 0), (4, 1, 4), name="half"),
        box_at((-5, 6, 0), (2, 1, 2), name="behind"),
        box_at((8, 6, 0), (2, 1, 2), name="free"),
    )
    return scene, sg.View((0, -20, 0), (0, 0, 0), fov=60)


def test_occluders_are_red_and_the_others_the_paler_the_less_can_be_seen() -> None:
    frame = framed(*two_walls(), active=1)
    colors = ByVisibility().colors(frame)
    assert colors is not None
    row = {g.name: r for r, g in enumerate(frame.snapshot.geodes)}
    assert colors[row["wall"]] == pytest.approx([*OCCLUDER, 1])
    assert colors[row["free"]] == pytest.approx([*DARK, 1])
    assert colors[row["behind"], 3] == 0
    assert colors[row["behind"], :3] == pytest.approx(PALE)
    half = colors[row["half"]]
    assert half[3] == 1
    assert DARK[0] < half[0] < PALE[0]
    assert ("occluders: 1", OCCLUDER) in ByVisibility().legend(frame)


def test_owners_of_declared_occluders_are_occluders() -> None:
    frame = framed(wall_scene(), wall_views()[0], occluders="declared")
    names = {frame.snapshot.geodes[r].name for r in occluding_rows(frame, frame.get(OcclusionMap))}
    assert names == {"wall"}


def test_the_inset_is_the_map_and_the_block_of_what_is_picked() -> None:
    frame = framed(*two_walls(), active=1, width=1025, height=511)
    inset = MapInset()
    plain = inset.inset(frame)
    assert plain is not None
    assert plain.shape == (171, 342, 3)
    assert (plain == 255).all(axis=2)[85, 130]
    assert not (plain == 255).all(axis=2)[85, 300]
    inset.picked = [g.name for g in frame.snapshot.geodes].index("half")
    picked = inset.inset(frame)
    assert picked is not None
    above, below = picked[:171], picked[171:]
    assert (above == BLOCK).all(axis=2).any()
    # what is half covered has no mean, but much of F(1, 0)
    assert (below == BLOCK).all(axis=2).any()
    y, x = np.nonzero((above == PICKED).all(axis=2))
    texels = frame.get(OcclusionMap).footprint(frame.snapshot.boxes[:, [inset.picked]]).texels[:, 0]
    assert (x.min(), x.max()) == (texels[0] // 3, (texels[2] - 1) // 3)
    assert (170 - y.max(), 170 - y.min()) == (texels[1] // 3, (texels[3] - 1) // 3)
    inset.picked = 1000
    assert np.array_equal(inset.inset(frame), plain)


def test_one_open_texel_is_seen_in_a_map_that_is_shown_smaller() -> None:
    frame = framed(*two_walls(), active=1, width=2048, height=1024)
    occlusion = frame.get(OcclusionMap)
    occlusion.codes[:] = 60000
    occlusion.codes[700, 1500] = 0
    picture = MapInset().inset(frame)
    assert picture is not None
    assert [tuple(p) for p in np.argwhere(picture[..., 0] != 255)] == [(255 - 700 // 4, 1500 // 4)]


def test_nothing_to_show_without_the_stage() -> None:
    with sg.Pipeline([]).open(wall_scene().snapshot()) as pipeline:
        frame = pipeline.run(wall_views()[0])
    assert ByVisibility().colors(frame) is None
    assert ByVisibility().legend(frame) == []
    assert MapInset().inset(frame) is None
