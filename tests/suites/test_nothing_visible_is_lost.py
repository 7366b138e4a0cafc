"""What promises to lose nothing visible, held against the item buffer from hundreds of places in every built-in scene.

The slow form, which the docs' numbers come from: ``make test PYTEST_ARGS="--run-slow -s -k nothing_visible_is_lost"``.
"""

from __future__ import annotations

import sys
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import scenegraph as sg
from scenegraph.compare.sources import thinned
from scenegraph.scenes.anywhere import anywhere

#: Small forms of the built-in scenes.
SMALL: dict[str, dict[str, Any]] = {
    "city": {"buildings": 120},
    "olympia": {"trees": 60},
    "scatter": {"count": 150},
    "bunnies-5001": {"count": 200},
    "bunnies-10001": {"count": 200},
    "foliage": {},
    "inspection": {},
}
#: Their whole forms, where those are too large to be drawn so often.
LARGE: dict[str, dict[str, Any]] = {"bunnies-5001": {"count": 500}, "bunnies-10001": {"count": 500}}
PIPELINES = (
    "frustum",
    "frustum | contribution",
    "frustum | shadow(occluders='planar')",
    "frustum | shadow(occluders='solid')",
    "frustum | shadow(active=100)",
    "frustum | shadow(cap='depth', ranking='solid_angle')",
    "frustum | shadow(ranking='marginal', reselect=5)",
    "frustum | hom",
)
FILES = ("scenes/virtual_city.glb", "scenes/duplex_building.glb", "scenes/cafe.glb", "city/ingolstadt_lod3.obj")


def held_against_truth(scene: sg.Scene, count: int) -> str:
    """Judge all pipelines by the same item buffers, 4 x 4 samples a pixel; what was found, as lines of a table."""
    from scenegraph.render.item_buffer import ItemBuffer

    snapshot = scene.snapshot()
    views = [path[i] for path in scene.paths.values() for i in thinned(len(path), count // (4 * len(scene.paths) or 1))]
    views += anywhere(snapshot, count - len(views), up=scene.up)
    lost: dict[str, list[str]] = {text: [] for text in PIPELINES}
    hidden = dict.fromkeys(PIPELINES, 0)
    invisible = 0
    with ExitStack() as stack:
        pipelines = [sg.Pipeline.parse(text) for text in PIPELINES]
        for pipeline in pipelines:
            assert pipeline.guarantee is sg.Guarantee.CONSERVATIVE
            stack.enter_context(pipeline.open(snapshot))
        buffer = stack.enter_context(closing(ItemBuffer(snapshot)))
        for number, view in enumerate(views):
            view = view.resized(320, 180)
            truth = buffer.render(view, supersample=4)
            invisible += int((~truth.visible).sum())
            for text, pipeline in zip(PIPELINES, pipelines, strict=True):
                frame = pipeline.run(view)
                hidden[text] += int((~frame.visible).sum())
                wrong = np.flatnonzero(truth.visible & ~frame.visible)
                if len(wrong):
                    lost[text].append(f"view {number} {view}: {snapshot.names(wrong)}, {truth.pixels[wrong]} samples")
    table = "".join(f"  {text:<60} {hidden[text] / invisible:6.1%} of what is invisible\n" for text in PIPELINES)
    assert not any(lost.values()), {text: found[:5] for text, found in lost.items() if found}
    return f"\n{scene.name}: {len(views)} views, {snapshot.n} drawables, nothing visible is lost\n{table}"


@pytest.mark.gl
@pytest.mark.parametrize("name", SMALL)
def test_in_small_scenes(name: str) -> None:
    sys.stdout.write(held_against_truth(sg.registry().scene(name).build(**SMALL[name]), 24))


@pytest.mark.gl
@pytest.mark.slow
@pytest.mark.parametrize("occluders", ["declared", "fitted"])
@pytest.mark.parametrize("name", SMALL)
def test_in_the_built_in_scenes(name: str, occluders: str) -> None:
    scene = sg.registry().scene(name).build(**LARGE.get(name, {}))
    declared = [n for n in scene.root.walk() if isinstance(n, sg.Occluder)]
    if not declared and occluders == "declared":
        pytest.skip("it declares none")
    for node in declared if occluders == "fitted" else ():
        assert node.parent is not None
        node.parent.remove(node)
    sys.stdout.write(held_against_truth(scene, 512))


@pytest.mark.gl
@pytest.mark.slow
@pytest.mark.data
@pytest.mark.parametrize("name", FILES)
def test_in_files_with_fitted_occluders(data_dir: Path, name: str) -> None:
    sys.stdout.write(held_against_truth(sg.Scene.load(data_dir / name), 512))


def test_no_built_in_scene_is_left_out() -> None:
    assert set(SMALL) == set(sg.registry().scenes)
