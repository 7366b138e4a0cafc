"""LOD selection: what each stage costs for 10⁴ and 10⁵ visible rows of seven levels, and what levels cost to make.

Times are the best of several repeats in one run, because the machine does other things too.
"""

from __future__ import annotations

import itertools
import sys
from typing import Any

import numpy as np
import pytest

import scenegraph as sg
from bench_tools import best_ms
from level_shapes import ball
from scenegraph.kernels.levels import mesh_level_budget
from scenegraph.meshes import level_chain, tessellate
from scenegraph_lod import LodBudget, LodDistance, LodError, LodStress, LodVisibility

LEVELS = 7


class PutsVisibility(sg.Stage):
    """Stands for an occlusion map."""

    name = "puts_visibility"
    writes = (sg.LevelOfVisibility,)

    def run(self, frame: sg.Frame) -> None:
        """Anything."""
        frame.put(sg.LevelOfVisibility.of(np.linspace(-1, 1, frame.snapshot.n)))


def forest(n: int) -> sg.Snapshot:
    """n balls with levels of 7680 triangles down to 120, of different sizes, over a plain."""
    rng = np.random.default_rng(5)
    mesh = ball(25, 0.1)
    chain = level_chain(mesh, cache=None)
    side = 10 * np.sqrt(n)
    places = np.column_stack([rng.uniform(-side / 2, side / 2, (n, 2)), np.zeros(n)])
    sizes = rng.uniform(0.5, 2, n)
    levels, errors = [m for m, _ in chain], [e for _, e in chain]
    assert len(levels) == LEVELS
    nodes = (
        sg.Transform(sg.Lod(*levels, errors=errors), translation=p, scale=s) for p, s in zip(places, sizes, strict=True)
    )
    return sg.Scene(sg.Group(*nodes)).snapshot()


STAGES: dict[str, tuple[sg.Stage, ...]] = {
    "lod_distance": (LodDistance(),),
    "lod_error": (LodError(),),
    "lod_visibility": (PutsVisibility(), LodVisibility()),
    "lod_visibility, combined": (PutsVisibility(), LodVisibility(rule="combined")),
    "lod_budget, 20 %": (LodBudget(triangles=0),),
    "lod_budget, 60 %": (LodBudget(triangles=0),),
    "lod_stress": (LodStress(clock="triangles", milliseconds=1.0),),
}


def stage_ms(snapshot: sg.Snapshot, stages: tuple[sg.Stage, ...], frames: int = 9) -> tuple[float, sg.Frame]:
    """Best time of the last stage over frames of a moving camera, after the first."""
    reach = float(np.abs(snapshot.boxes[:2]).max())
    with sg.Pipeline(stages).open(snapshot) as pipeline:
        times = []
        for i in range(frames + 1):
            eye = (0, -reach + 5 * i, 20)
            frame = pipeline.run(sg.View(eye, (0, -reach + 5 * i + 100, 0), width=1280, height=720))
            times.append(frame.record.stages[-1].ms)
    return min(times[1:]), frame


@pytest.mark.parametrize("n", [10_000, 100_000])
def test_stages(n: int) -> None:
    snapshot = forest(n)
    full = int(snapshot.triangles[0].sum(dtype=np.int64))
    sys.stdout.write(f"\n{n} rows, {LEVELS} levels, {full} triangles at the finest\n")
    for name, stages in STAGES.items():
        share = float(name.split(",")[1].strip(" %")) / 100 if "%" in name else 0.0
        if share:
            stages = (LodBudget(triangles=int(share * full)),)
        ms, frame = stage_ms(snapshot, stages)
        used = frame.drawn_triangles()
        if share:
            assert 0.99 * share * full <= used <= share * full
        sys.stdout.write(
            f"  {name:26s} {ms:7.2f} ms  {1e6 * ms / n:6.0f} ns a row   {used / full:6.1%} of the triangles\n"
        )


def test_budget_against_a_full_sort() -> None:
    """The histogram over the bits of the errors, beside sorting all steps."""
    rng = np.random.default_rng(1)
    for n in (10_000, 100_000):
        errors = np.cumsum(rng.random((LEVELS, n)), axis=0).astype(np.float32)
        errors *= (10 ** rng.normal(size=n)).astype(np.float32)
        triangles = np.repeat(7680 // 2 ** np.arange(LEVELS), n).reshape(LEVELS, n)
        base, budget = np.zeros(n, np.int64), int(0.3 * triangles[0].sum())

        def by_sorting(errors: Any = errors, triangles: Any = triangles, budget: int = budget) -> int:
            order = np.argsort(errors[1:].reshape(-1), kind="stable")
            saved = np.cumsum((triangles[:-1] - triangles[1:]).reshape(-1)[order])
            return int(np.searchsorted(saved, triangles[0].sum() - budget)) + 1

        def by_bits(args: Any = (errors, triangles, base), budget: int = budget) -> Any:
            return mesh_level_budget(*args, budget=budget)

        assert abs(int(by_bits().sum()) - by_sorting()) <= 64, "but for what is given back"
        a, b = best_ms(by_bits), best_ms(by_sorting)
        sys.stdout.write(f"\nbudget of {n} rows x {LEVELS} levels: {a:.2f} ms; by sorting all steps {b:.2f} ms\n")


def test_making_levels() -> None:
    mesh = ball(50, 0.1)
    ms = best_ms(lambda: level_chain(mesh, cache=None), 2)
    chain = level_chain(mesh, cache=None)
    size = float(np.ptp(mesh.bounds, axis=0).max())
    sys.stdout.write(f"\n{len(chain) - 1} levels of {mesh.triangles} triangles, errors measured: {ms:.0f} ms\n")
    for (level, error), (_, finer) in zip(chain[1:], itertools.chain(chain[:-1]), strict=True):
        assert error >= finer
        sys.stdout.write(f"  {level.triangles:6d} triangles, within {error / size:.3%} of the size\n")
    bunny = ball(3)
    small = sg.Mesh(bunny.vertices, bunny.faces[:98])
    ms = best_ms(lambda: tessellate(small, 20))
    sys.stdout.write(f"98 triangles to level 20 ({98 * 600}): {ms:.1f} ms\n")
