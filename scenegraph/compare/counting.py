"""Pipelines along camera paths without drawing: what they leave and what culling costs, for scenes too large to draw.

No window is opened, so that triangles can be counted that no machine at hand could draw. Nothing is judged: truth and
pictures need drawing.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from dataclasses import dataclass, field

from scenegraph.compare.metrics import level_pops
from scenegraph.compare.sources import PathView, build_scene, camera_paths
from scenegraph.compare.suite import Suite
from scenegraph.errors import SuiteError
from scenegraph.frame import Frame
from scenegraph.log import FrameRecord
from scenegraph.pipeline import Pipeline
from scenegraph.progress import Progress, silent
from scenegraph.registry import Registry


@dataclass
class CountedPath:
    """One pipeline on all views, in order.

    Attributes
    ----------
    records : list of FrameRecord
    pops : list of int
        Drawables whose level changed since the view before of the same path.
    """

    records: list[FrameRecord] = field(default_factory=list)
    pops: list[int] = field(default_factory=list)

    @property
    def triangles(self) -> list[int]:
        """Left to be drawn in each view."""
        return [r.triangles for r in self.records]

    @property
    def objects(self) -> list[int]:
        """Left to be drawn in each view."""
        return [r.visible for r in self.records]

    @property
    def cull_ms(self) -> list[float]:
        """Time of culling in each view."""
        return [r.cull_ms for r in self.records]


@dataclass
class CountedRun:
    """What was counted.

    Attributes
    ----------
    scene : str
    drawables, triangles : int
        Of the whole scene at its finest levels.
    views : list of PathView
    pipelines : dict of str to CountedPath
    """

    scene: str
    drawables: int
    triangles: int
    views: list[PathView]
    pipelines: dict[str, CountedPath]

    @property
    def paths(self) -> list[str]:
        """Name of the path that each view belongs to."""
        return [v.path for v in self.views]

    def on(self, path: str) -> list[int]:
        """Numbers of the views of one path."""
        return [i for i, name in enumerate(self.paths) if name == path]


def count_along(
    suite: Suite,
    registry: Registry,
    *,
    tell: Progress = silent,
    look: Callable[[str, int, Frame], None] | None = None,
) -> CountedRun:
    """Run the pipelines of a suite on its views, and draw nothing.

    Parameters
    ----------
    suite : Suite
        What it says about windows, truth and images is ignored, but for the size of the image.
    registry : Registry
    tell : callable, optional
    look : callable, optional
        Called with the pipeline's name, the number of the view and the frame.

    Raises
    ------
    ScenegraphError
        The scene cannot be built or has no such path, or a stage needs OpenGL.
    """
    tell("building the scene", 0.0)
    scene = build_scene(suite, registry)
    snapshot = scene.snapshot()
    views = camera_paths(suite, snapshot)
    run = CountedRun(scene.name, snapshot.n, int(snapshot.triangles[0].sum(dtype="int64")), views, {})
    opened: dict[str, Pipeline] = {}
    try:
        for spec in suite.pipelines:
            if spec.vtk_culler:
                raise SuiteError([f"pipeline {spec.name!r}: VTK's own culler cannot be counted without drawing"])
            tell(f"opening {spec.name}", 0.0)
            opened[spec.name] = Pipeline.parse(spec.stages, registry, name=spec.name).open(snapshot, progress=tell)
            run.pipelines[spec.name] = CountedPath()
        for _ in range(suite.warmup):
            for pipeline in opened.values():
                pipeline.run(views[0].view, view_name=" warm-up")
        _run(run, opened, tell, look)
    finally:
        for pipeline in opened.values():
            pipeline.close()
    return run


def _run(
    run: CountedRun, opened: dict[str, Pipeline], tell: Progress, look: Callable[[str, int, Frame], None] | None
) -> None:
    last: dict[tuple[str, str], Frame] = {}
    names = list(opened)
    for index, at in enumerate(run.views):
        tell(f"{at.path}, view {index + 1} of {len(run.views)}", index / len(run.views))
        turn = index % len(names)
        # turning order, as where frames are drawn
        for name in names[turn:] + names[:turn]:
            frame = opened[name].run(at.view, index=index, view_name=at.path)
            before = last.get((name, at.path))
            pops = 0 if before is None else level_pops(before.level, frame.level, before.visible, frame.visible)
            last[name, at.path] = frame
            run.pipelines[name].records.append(frame.record)
            run.pipelines[name].pops.append(pops)
            if look is not None:
                look(name, index, frame)
        gc.collect()
