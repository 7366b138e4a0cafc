"""Who takes part in a comparison: pipelines with a window of their own each, and OPT."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from time import perf_counter
from typing import Any

import numpy as np

from scenegraph.compare.metrics import Image, Rows
from scenegraph.compare.results import PipelineResult
from scenegraph.compare.suite import PipelineSpec
from scenegraph.frame import Frame
from scenegraph.pipeline import Pipeline
from scenegraph.progress import Progress
from scenegraph.registry import Registry
from scenegraph.snapshot import Snapshot
from scenegraph.view import View


@dataclass(frozen=True)
class Drawn:
    """One view, as a pipeline drew it."""

    frame: Frame
    """With what VTK's culler took away, where that is on."""
    image: Image
    apply_ms: float
    draw_ms: float
    """With `apply_ms`."""

    @cached_property
    def kept(self) -> Rows:
        """(n,) rows that reached OpenGL, by themselves or by a stand-in."""
        return self.frame.kept()


class Contestant:
    """A pipeline, and what it draws into.

    Each has its own window: sharing one would make every pipeline pay for the change from the one before, most of all
    the one that never changes what it draws.
    """

    def __init__(
        self,
        spec: PipelineSpec,
        registry: Registry,
        snapshot: Snapshot,
        size: tuple[int, int],
        background: tuple[float, float, float],
        tell: Progress,
    ) -> None:
        from scenegraph.render.drawing import Drawing
        from scenegraph.render.window import OffscreenWindow

        self.spec = spec
        self._window = OffscreenWindow(*size, background, vtk_culler=spec.vtk_culler)
        self.pipeline = Pipeline.parse(spec.stages, registry, name=spec.name, adaptive=spec.adaptive)
        start = perf_counter()
        self.pipeline.open(snapshot, device=self._device(), progress=tell)
        opened = perf_counter()
        self._drawing: Any = Drawing(snapshot, self._window.renderer, mode=spec.draw)
        self.result = PipelineResult(
            name=spec.name,
            text=self.pipeline.text if self.pipeline.stages else "",
            draw=self._drawing.mode,
            vtk_culler=spec.vtk_culler,
            summary=spec.summary,
            guarantee="" if spec.vtk_culler else self.pipeline.guarantee.value,
            guarantees={stage.name: stage.guarantee.value for stage in self.pipeline.stages},
            open_ms=1e3 * (opened - start),
            upload_ms=1e3 * (perf_counter() - opened),
            memory_bytes=self._drawing.memory,
        )

    def _device(self) -> Any:
        if "gl" not in self.pipeline.needs:
            return None
        from scenegraph.render.device import Device

        return Device(self._window.render_window)

    @property
    def hides_nothing(self) -> bool:
        """Whether its frames are the reference for others."""
        return not self.pipeline.stages and not self.spec.vtk_culler

    def cull(self, view: View, index: int, path: str) -> Frame:
        """Cull one view without drawing it."""
        return self.pipeline.run(view, index=index, view_name=path)

    def draw(self, view: View, index: int, path: str) -> Drawn:
        """Cull and draw one view."""
        frame = self.cull(view, index, path)
        start = perf_counter()
        self._drawing.apply(frame)
        applied = perf_counter()
        self._window.draw(view)
        end = perf_counter()
        draw_ms = frame.record.draw_ms = 1e3 * (end - start)
        if self.spec.vtk_culler:
            frame.visible &= self._drawing.drawn_by_vtk()
            frame.record.visible = int(np.count_nonzero(frame.visible))
            frame.record.triangles = frame.drawn_triangles()
        return Drawn(
            frame=frame,
            image=self._window.image(),
            apply_ms=1e3 * (applied - start),
            draw_ms=draw_ms,
        )

    def close(self) -> None:
        """Release the pipeline and the window."""
        self.pipeline.close()
        self._drawing.remove()
        self._window.close()


class Opt:
    """Draws exactly the visible set of a view, with no culling cost: what no method can be faster than."""

    def __init__(self, snapshot: Snapshot, size: tuple[int, int], background: tuple[float, float, float]) -> None:
        from scenegraph.render.drawing import Drawing
        from scenegraph.render.window import OffscreenWindow

        self._window = OffscreenWindow(*size, background)
        self._drawing = Drawing(snapshot, self._window.renderer)

    def draw(self, view: View, visible: Rows) -> float:
        """Draw these rows and nothing else; milliseconds."""
        start = perf_counter()
        self._drawing.show(visible)
        self._window.draw(view)
        return 1e3 * (perf_counter() - start)

    def image(self) -> Image:
        """Read the last picture."""
        return self._window.image()

    def close(self) -> None:
        """Release the window."""
        self._drawing.remove()
        self._window.close()
