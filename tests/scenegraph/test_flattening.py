"""What a snapshot is made from: the walk over the graph, and the table of shapes."""

from __future__ import annotations

import sys

import numpy as np

import scenegraph as sg
from scenegraph.flattening import flattened
from scenegraph.shape_table import ShapeTable

BOX, SMALL, OTHER = (sg.Mesh.box((-h, -h, -h), (h, h, h)) for h in (2.0, 1.0, 3.0))


def test_drawables_know_what_is_above_them() -> None:
    first, second, third, off = (sg.Geode(BOX) for _ in range(4))
    occluder = sg.Occluder.box((-1, -1, -1), (1, 1, 1))
    inner = sg.Transform(second, occluder)
    outer = sg.Transform(first, inner, never_cull=True)
    switch = sg.Switch(off, third, active=1)
    root = sg.Group(outer, switch)
    flat = flattened(root)
    assert flat.drawables == [first, second, third]
    assert [flat.groups[g] for g in flat.group] == [outer, inner, switch]
    assert [flat.transforms[t] for t in flat.transform] == [outer, inner, None]
    assert flat.never_cull.tolist() == [True, True, False]
    assert flat.transform_parent.tolist() == [-1, 0, 1]
    assert [(o, flat.transforms[t]) for o, t in flat.occluders] == [(occluder, inner)]
    below = {g: flat.drawables[a:b] for g, a, b in zip(flat.groups, flat.group_first, flat.group_end, strict=True)}
    assert below == {root: [first, second, third], outer: [first, second], inner: [second], switch: [third]}
    parents = dict(zip(flat.groups, flat.group_parent.tolist(), strict=True))
    assert [flat.groups[parents[g]] for g in (outer, inner, switch)] == [root, outer, root]
    assert parents[root] == -1


def test_a_graph_may_be_deeper_than_the_stack_of_python() -> None:
    root = leaf = sg.Group()
    depth = 2 * sys.getrecursionlimit()
    for _ in range(depth):
        below = sg.Transform(translation=(1, 0, 0))
        leaf.add(below)
        leaf = below
    leaf.add(sg.Geode(BOX))
    flat = flattened(root)
    assert len(flat.groups) == depth + 1
    assert flat.transform.tolist() == [depth]


def test_shapes_are_shared_and_known_meshes_keep_their_numbers() -> None:
    drawables = [
        sg.Geode(BOX),
        sg.Lod(BOX, SMALL, errors=(0, 0.5)),
        sg.Geode(BOX),
        sg.Lod(BOX, SMALL, errors=(0, 0.25)),
        sg.Lod(BOX, SMALL, errors=(0, 0.5)),
    ]
    table, index = ShapeTable.build(drawables, {}, [OTHER, SMALL])
    assert index.tolist() == [0, 1, 0, 2, 1]
    assert table.meshes == [OTHER, SMALL, BOX]
    assert table.levels.tolist() == [[2, -1], [2, 1], [2, 1]]
    assert np.array_equal(table.errors, [[0, np.nan], [0, 0.5], [0, 0.25]], equal_nan=True)
    assert table.triangles(table.levels[index]).tolist() == [[12] * 5, [0, 12, 0, 12, 12]]
    chained, index = ShapeTable.build(drawables[:1], {BOX: [(BOX, 0.0), (OTHER, 1.0)]})
    assert chained.levels.tolist() == [[0, 1]]
    center, half = np.split(chained.boxes[:, index[0]], 2)
    assert (center == 0).all()
    assert ((half >= 3) & (half < 3.001)).all(), "around all levels"


def test_errors_grow_by_the_largest_stretch() -> None:
    table, _ = ShapeTable.build([sg.Lod(BOX, SMALL, errors=(0, 0.5))], {})
    matrices = np.array([np.diag([1.0, -4.0, 2.0, 1.0]), np.full((4, 4), np.nan)])
    errors = table.world_errors(np.zeros(2, np.int32), matrices, np.arange(2, dtype=np.int32))
    assert np.array_equal(errors, [[0, np.nan], [2, np.nan]], equal_nan=True)
