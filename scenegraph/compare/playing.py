"""Pipelines along a camera path as somebody who inspects a model sees them: every frame of it, and no truth.

A comparison judges each frame against everything drawn in full detail, which takes far longer than the frame itself;
paths are thinned for that, and what a method remembers of the last frame is then worth less than it would be. Here only
what the pipelines do is recorded, in every frame; pictures, and one in full detail to hold them against, are kept of a
few.
"""

from __future__ import annotations

import gc
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from scenegraph.compare.contest import Contestant, Drawn, Opt
from scenegraph.compare.metrics import Image
from scenegraph.compare.sources import build_scene, camera_paths
from scenegraph.compare.suite import Suite
from scenegraph.log import FrameLog, FrameRecord
from scenegraph.progress import Progress
from scenegraph.registry import Registry


@dataclass
class Played:
    """One pipeline along a path.

    Attributes
    ----------
    text : str
        The pipeline.
    records : list of FrameRecord
    draw_ms : list of float
        With the time for choosing what is drawn; not a number for frames that were only culled.
    drawn_objects : list of int
        Rows and meshes of stand-ins.
    pictures : dict of int to (h, w, 3) uint8
        By number of the frame.
    drawn : dict of int to Drawn
        The frames of the pictures.
    """

    text: str
    records: list[FrameRecord] = field(default_factory=list)
    draw_ms: list[float] = field(default_factory=list)
    drawn_objects: list[int] = field(default_factory=list)
    pictures: dict[int, Image] = field(default_factory=dict)
    drawn: dict[int, Drawn] = field(default_factory=dict)

    @property
    def frame_ms(self) -> list[float]:
        """Culling and drawing of each frame that was drawn."""
        return [r.cull_ms + d for r, d in zip(self.records, self.draw_ms, strict=True) if d == d]

    def counted(self, stage: str, name: str) -> list[float]:
        """A counter of a stage in each frame; 0 where it did not count, or was skipped."""
        found = []
        for record in self.records:
            own = [s for s in record.stages if s.name == stage]
            found.append(own[0].counts.get(name, 0.0) if own else 0.0)
        return found


def play(
    suite: Suite,
    known: Registry,
    *,
    pictures: Sequence[float] = (),
    every: int = 1,
    log: FrameLog | None = None,
    tell: Progress,
) -> tuple[dict[str, Played], dict[int, Image]]:
    """Play the paths of a suite with all its pipelines, frame by frame in turns.

    Parameters
    ----------
    suite : Suite
        What it says of truth is not used.
    known : Registry
    pictures : floats in 0..1
        Where along the path pictures are kept.
    every : int
        Only each so many-th frame is drawn and timed; all are culled.
    log : FrameLog, optional
    tell : Progress

    Returns
    -------
    dict of str to Played
        By name of the pipeline.
    dict of int to (h, w, 3) uint8
        Everything in full detail, in the frames of which there are pictures.
    """
    scene = build_scene(suite, known)
    snapshot = scene.snapshot()
    views = camera_paths(suite, snapshot)
    kept = sorted({round(share * (len(views) - 1)) for share in pictures})
    size = (suite.width, suite.height)
    found: dict[str, Played] = {}
    whole: dict[int, Image] = {}
    contestants: list[Contestant] = []
    reference: Opt | None = None
    try:
        for spec in suite.pipelines:
            contestants.append(Contestant(spec, known, snapshot, size, scene.background, tell))
            found[spec.name] = Played(contestants[-1].pipeline.text)
        if kept:
            reference = Opt(snapshot, size, scene.background)
        for contestant in contestants:
            for at in views[: suite.warmup]:
                contestant.draw(at.view, 0, "warm-up")
        gc.collect()
        for index, at in enumerate(views):
            tell("playing", index / len(views))
            turn = index % len(contestants)
            for contestant in contestants[turn:] + contestants[:turn]:
                name = contestant.spec.name
                one, draw_ms = found[name], float("nan")
                if index % every == 0 or index in kept:
                    drawn = contestant.draw(at.view, index, at.path)
                    frame, draw_ms = drawn.frame, drawn.draw_ms
                    if index in kept:
                        one.pictures[index], one.drawn[index] = drawn.image, drawn
                else:
                    frame = contestant.cull(at.view, index, at.path)
                one.records.append(frame.record)
                one.draw_ms.append(draw_ms)
                one.drawn_objects.append(frame.drawn_objects)
                if log is not None:
                    log.append(name, frame.record, draw_ms=draw_ms)
            if index in kept and reference is not None:
                reference.draw(at.view, np.ones(snapshot.n, bool))
                whole[index] = reference.image()
    finally:
        for contestant in contestants:
            contestant.close()
        if reference is not None:
            reference.close()
    return found, whole
