"""Culling in a renderer that belongs to the user: a pyvista plotter or any VTK window, interactive or not.

The renderer's StartEvent comes before anything is drawn and in the same frame: there the pipeline runs and sets what
will be drawn. Its EndEvent puts everything back, so that clipping ranges, `reset_camera` and pickers never notice.
Pictures do not change by a single pixel as long as the pipeline hides nothing visible.

Where culling could change a picture, or what is drawn is not what the snapshot knows, a frame is drawn whole and
`Driver.off_because` says why.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import takewhile
from time import perf_counter
from typing import TYPE_CHECKING, Any

from ..pipeline import Pipeline
from ..stage import Stage
from .device import Device
from .drawing import Drawing
from .preparing import Preparation
from .renderers import casts_shadows, is_part_in_tiles, unknown_projection, view_of
from .user_actors import UserActors

if TYPE_CHECKING:
    from ..frame import Frame
    from ..snapshot import Snapshot
    from ..view import View


class Driver:
    """Runs a pipeline before every frame of a renderer.

    Parameters
    ----------
    target : pyvista.Plotter or vtkRenderer
    pipeline : Pipeline
        Opened and closed by the driver.
    drawing : Drawing, optional
        What is drawn in this renderer, if this package draws it. Without, the user's own actors are culled: they are
        imported with `Scene.from_pyvista`.
    background : bool
        Prepare the pipeline in a thread; meanwhile only its leading stages run that need no preparation. Somebody has
        to call `pump`.
    batches : bool, optional
        Draw users' actors that look alike together; see `UserActors`.
    tolerant : bool
        A stage that raises is switched off for good, and `failures` says why. Without, the frame is drawn whole.

    Attributes
    ----------
    snapshot : Snapshot
    frame : Frame or None
        The last frame that was culled.
    off_because : str
        Why the last frame was drawn whole; empty if it was culled.
    held : Frame or None
        Drawn instead of what the pipeline would say: the culling camera is frozen.
    paused : bool
        Draw everything.
    failures : dict of str to str
        Stages that raised, and what.
    heard : list of callable
        Called without arguments after each frame has been decided, before it is drawn.

    Raises
    ------
    SceneError
        There are no actors to cull.

    Examples
    --------
    >>> driver = Driver(plotter, Pipeline.parse("frustum"))
    >>> plotter.show()
    """

    def __init__(
        self,
        target: Any,
        pipeline: Pipeline,
        *,
        drawing: Drawing | None = None,
        background: bool = False,
        batches: bool | None = None,
        tolerant: bool = False,
    ) -> None:
        self.renderer: Any = getattr(target, "renderer", target)
        self.pipeline = pipeline
        self.background, self.tolerant, self.batches = background, tolerant, batches
        self.frame: Frame | None = None
        self.held: Frame | None = None
        self.paused = False
        self.off_because = ""
        self.failures: dict[str, str] = {}
        self.heard: list[Callable[[], None]] = []
        self._subject: Drawing | UserActors = UserActors(self.renderer, batches) if drawing is None else drawing
        self._device: Device | None = None
        self._preparation: Preparation | None = None
        self._interim: Pipeline | None = None
        self._opened = False
        self._applied = False
        self._began = 0.0
        self._observers = [
            self.renderer.AddObserver("StartEvent", self._start),
            self.renderer.AddObserver("EndEvent", self._end),
        ]

    @property
    def snapshot(self) -> Snapshot:
        """What is culled."""
        return self._subject.snapshot

    @property
    def added(self) -> int:
        """Actors that the user has added since, which are not culled."""
        return self._subject.added if isinstance(self._subject, UserActors) else 0

    def reload(self) -> None:
        """Take over actors that were added, removed, moved, hidden or edited since."""
        self._close_pipelines()
        if isinstance(self._subject, UserActors):
            self._restore()
            self._subject.forget()
            self._subject = UserActors(self.renderer, self.batches)
        self.held = None

    def use(self, pipeline: Pipeline) -> None:
        """Go on with another pipeline; it is opened before the next frame."""
        self._close_pipelines()
        self.pipeline = pipeline
        self.failures = {}
        self.held = None

    def _close_pipelines(self) -> None:
        if self._preparation is not None:
            self._preparation.stop()
            self._preparation = None
        if self._interim is not None:
            self._interim.close()
            self._interim = None
        self.pipeline.close()
        self._opened = False

    def detach(self) -> None:
        """Leave the renderer as it was. Detaching twice is allowed."""
        for observer in self._observers:
            self.renderer.RemoveObserver(observer)
        self._observers = []
        self._restore()
        self._close_pipelines()
        if isinstance(self._subject, UserActors):
            self._subject.forget()
        if self._device is not None:
            self._device.close()
            self._device = None

    # -- a frame ----------------------------------------------------------------------------------------------------

    def _start(self, *_: object) -> None:
        # VTK prints what an observer raises and goes on; a frame that fails must be drawn whole
        self._restore()
        try:
            self.off_because = next(self._reasons(), "")
            if not self.off_because:
                self._cull()
        except Exception as error:
            self._restore()
            self.off_because = f"{type(error).__name__}: {error}"
        for hear in self.heard:
            hear()

    def _cull(self) -> None:
        frame = self.held if self.held is not None else self.decide(view_of(self.renderer))
        if frame is None:
            self.off_because = self.preparing
            return
        self.frame = frame
        self._applied = True
        self._began = perf_counter()
        self._subject.apply(frame)

    def decide(self, view: View) -> Frame | None:
        """What the pipeline leaves of a view; None while it is being prepared and nothing can run yet."""
        while True:
            pipeline = self._ready()
            if pipeline is None:
                return None
            try:
                return pipeline.run(view)
            except Exception as error:
                if not (self.tolerant and self._switch_off(pipeline, error)):
                    raise

    def _switch_off(self, pipeline: Pipeline, error: Exception) -> bool:
        stage = pipeline.running
        if stage is None or stage.name in pipeline.disabled:
            return False
        self.failures[stage.name] = f"{type(error).__name__}: {error}"
        self.pipeline.disabled.add(stage.name)
        pipeline.disabled.add(stage.name)
        return True

    # -- preparing --------------------------------------------------------------------------------------------------

    @property
    def preparing(self) -> str:
        """What is being prepared and how far it is, or ''."""
        if self._preparation is None:
            return ""
        return f"{self._preparation.what}: {self._preparation.share:.0%}"

    def pump(self, seconds: float = 0.01) -> bool:
        """Let a preparation in the background go on for so long; whether it has just ended."""
        return self._preparation is not None and self._preparation.pump(seconds)

    def _ready(self) -> Pipeline | None:
        if self._opened:
            return self.pipeline
        if self._preparation is None:
            if "gl" in self.pipeline.needs and self._device is None:
                self._device = Device(self.renderer.GetRenderWindow())
            self._preparation = Preparation(self.pipeline, self.snapshot, self._device, in_thread=self.background)
        if self._preparation.done:
            return self._finish(self._preparation)
        if self._interim is None:
            self._interim = interim(self.pipeline).open(self.snapshot)
        return self._interim if self._interim.stages else None

    def _finish(self, preparation: Preparation) -> Pipeline | None:
        self._preparation = None
        if self._interim is not None:
            self._interim.close()
            self._interim = None
        if preparation.error is None:
            self._opened = True
            return self.pipeline
        stage = self.pipeline.running
        if not self.tolerant or stage is None:
            raise preparation.error
        self.failures[stage.name] = f"{type(preparation.error).__name__}: {preparation.error}"
        self.pipeline.close()
        self.pipeline = without(self.pipeline, stage.name)
        return self._ready()

    def _end(self, *_: object) -> None:
        if self._applied and self.frame is not None:
            self.frame.record.draw_ms = 1e3 * (perf_counter() - self._began)
        self._restore()

    def _restore(self) -> None:
        if self._applied:
            self._subject.restore()
            self._applied = False

    def _reasons(self) -> Iterator[str]:
        if self.paused:
            yield "switched off"
        if casts_shadows(self.renderer):
            yield "shadows are on, and what is hidden would cast none"
        if self.renderer.GetSelector() is not None:
            yield "a selection is being made"
        if self.renderer.GetRenderWindow().GetStereoRender():
            yield "the window is in stereo, and both eyes' views are not known here"
        if is_part_in_tiles(self.renderer):
            yield "a tiled screenshot is being made, in which VTK gives subplots other proportions"
        odd = unknown_projection(self.renderer.GetActiveCamera())
        if odd:
            yield odd
        if isinstance(self._subject, UserActors):
            change = self._subject.change()
            if change:
                yield f"{change}; call reload()"


def without(pipeline: Pipeline, name: str) -> Pipeline:
    """A new pipeline without a stage, and without those that read what only it puts."""
    stages = [s for s in pipeline.stages if s.name != name]
    put: set[type] = set()
    kept = []
    for stage in stages:
        if put.issuperset(stage.reads):
            kept.append(stage)
            put |= {kind for kind in stage.writes if isinstance(kind, type)}
    left = Pipeline(kept, adaptive=pipeline.adaptive)
    # shared: whoever switches a stage off means it in both
    left.disabled = pipeline.disabled
    return left


def interim(pipeline: Pipeline) -> Pipeline:
    """A pipeline of copies of the leading stages that prepare nothing, for the time until the rest is ready."""
    first = takewhile(lambda stage: not stage.needs and type(stage).open is Stage.open, pipeline.stages)
    made = Pipeline([type(stage)(**stage.values()) for stage in first])
    made.disabled = pipeline.disabled
    return made
