"""What a run leaves behind: plain records, from which the summary and the report are made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenegraph.compare.metrics import Image, Rows, false_hides
from scenegraph.view import View


@dataclass(frozen=True)
class StageShare:
    """One stage in one frame."""

    name: str
    ms: float
    tested: int
    hidden: int
    coarsened: int
    skipped: str | None = None


@dataclass(frozen=True)
class FrameResult:
    """One pipeline on one view, judged."""

    path: str
    index: int
    """Number of the view in the run, from 0."""
    cull_ms: float
    draw_ms: float
    """Handing the frame to the renderer, and drawing it to the end."""
    apply_ms: float
    """The part of `draw_ms` before anything is drawn."""
    drawn_objects: int
    drawn_triangles: int
    visible_objects: int
    """In truth."""
    false_hides: int
    missing_pixels: float
    overestimate: int
    wrong_pixels: int
    snr_db: float
    psnr_db: float
    ssim: float
    level_pops: int
    host_ms: float = 0.0
    stages: tuple[StageShare, ...] = ()
    metrics: Mapping[str, float] = field(default_factory=dict)
    """What plugins measured, by name."""

    @property
    def frame_ms(self) -> float:
        """Culling and drawing together."""
        return self.cull_ms + self.draw_ms


@dataclass(frozen=True)
class OptFrame:
    """Drawing exactly the visible set of one view, with no culling cost."""

    index: int
    frame_ms: float
    objects: int
    triangles: int


@dataclass
class PipelineResult:
    """All frames of one pipeline."""

    name: str
    text: str
    draw: str
    """How its frames were drawn: batches or actors."""
    vtk_culler: bool
    summary: str
    guarantee: str
    """What the whole pipeline claims; "" where VTK culls, which claims nothing."""
    guarantees: dict[str, str]
    """What each stage claims, by stage name."""
    open_ms: float = 0.0
    upload_ms: float = 0.0
    """Making what is drawn, before the first frame."""
    first_frame_ms: float = 0.0
    memory_bytes: int = 0
    frames: list[FrameResult] = field(default_factory=list)
    longest_streak: int = 0


@dataclass(frozen=True)
class Shot:
    """What one pipeline made of the view that the report shows."""

    image: Image
    kept: Rows
    missing: NDArray[np.bool_]
    """(h, w) pixels of falsely hidden drawables, as the item buffer has them."""
    wrong: NDArray[np.bool_]
    """(h, w) pixels that differ from the reference."""


@dataclass
class Pictures:
    """The view that the report shows, and why this one."""

    view: View
    path: str
    index: int
    reason: str
    exact: Rows
    reference: Image
    """The frame that hides nothing."""
    shots: dict[str, Shot]
    overhead: dict[str, Image] = field(default_factory=dict)
    """From above, hidden drawables in wire frame."""
    overhead_view: View | None = None
    reach: float = 0.0
    """How deep the scene goes on, in world units along the line of sight."""

    def false_hides(self, name: str) -> int:
        """Visible drawables that a pipeline hid in this view."""
        return false_hides(self.exact, self.shots[name].kept)


@dataclass
class RunResult:
    """A comparison, whole or as far as it came."""

    suite: str
    summary: str
    quick: bool
    scene: dict[str, Any]
    """name, drawables, triangles, and what loading found odd."""
    machine: dict[str, str]
    preparation: dict[str, float]
    """Milliseconds by step, in order."""
    pipelines: dict[str, PipelineResult]
    """In the suite's order; the first is what speedups are relative to."""
    planned_frames: int
    width: int
    height: int
    supersample: int
    command: str = ""
    opt: list[OptFrame] = field(default_factory=list)
    truth_ms: list[float] = field(default_factory=list)
    memory: dict[str, int] = field(default_factory=dict)
    """Bytes."""
    interrupted: bool = False
    notes: list[str] = field(default_factory=list)
    pictures: Pictures | None = None

    @property
    def baseline(self) -> PipelineResult:
        """What speedups are relative to."""
        return next(iter(self.pipelines.values()))

    def trim(self) -> None:
        """Forget a view that not all have finished."""
        whole = min([len(self.opt), *(len(p.frames) for p in self.pipelines.values())])
        del self.opt[whole:]
        for pipeline in self.pipelines.values():
            del pipeline.frames[whole:]

    @property
    def finished_frames(self) -> int:
        """Views that every pipeline finished."""
        return len(self.opt)
