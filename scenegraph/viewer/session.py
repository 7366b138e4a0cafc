"""A viewer without a window system: scene, pipelines, modes, and what each action does to them."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ScenegraphError
from ..overlay import Overlay
from ..pipeline import Pipeline
from ..registry import Registry
from ..render.drawing import Drawing
from ..render.driver import Driver, without
from ..render.renderers import view_of
from ..snapshot import Snapshot
from ..stage import Stage
from ..view import View
from .colorings import Boxes, ByLevel, ByStage
from .hud import STRIP, Numbers
from .marks import Marks
from .picking import row_at
from .pictures import picture_of
from .truth import Truth, Verdict, judge
from .walking import Walker


class Session:
    """What is being looked at, and how.

    Parameters
    ----------
    snapshot : Snapshot
    renderer : vtkRenderer
        In a render window; drawn by whoever owns it.
    pipelines : sequence of Pipeline
        A and B; the first is shown first.
    registry : Registry
        Where overlays come from.
    front : vtkRenderer, optional
        Of a layer in front, with the same camera: for what shines through.
    background : bool
        Prepare in a thread; see `Driver`.

    Attributes
    ----------
    driver : Driver
    walker : Walker
    coloring : Overlay or None
    gizmos : list of Overlay
        Shown by their own keys, whether all are shown or not.
    marks : Marks
    picked : int or None
        Key of the drawable that the user has picked; overlays get its row.
    verdict : Verdict or None
        The last answer of truth mode.
    """

    def __init__(
        self,
        snapshot: Snapshot,
        renderer: Any,
        pipelines: Sequence[Pipeline],
        registry: Registry,
        *,
        front: Any = None,
        background: bool = False,
    ) -> None:
        self.snapshot, self.renderer, self.pipelines = snapshot, renderer, list(pipelines)
        self.which = 0
        self.drawing = Drawing(snapshot, renderer)
        self.driver = Driver(renderer, self.pipelines[0], drawing=self.drawing, background=background, tolerant=True)
        self.driver.heard.append(self._decided)
        self.walker = Walker(snapshot)
        self.history: deque[tuple[float, float]] = deque(maxlen=STRIP)
        self.messages: list[str] = []
        self.overlays: list[Overlay] = [ByStage(), ByLevel(), *(made() for made in registry.overlays.values())]
        self.coloring: Overlay | None = None
        self.gizmos: list[Overlay] = []
        self.show_hidden = self.show_boxes = self.show_gizmos = False
        self.truth = False
        self.picked: int | None = None
        self.verdict: Verdict | None = None
        self.quiet = False
        self.marks = Marks(snapshot, renderer, front)
        self._truth = Truth(snapshot, renderer)
        self._boxes = Boxes()
        self._begun = 0.0

    # -- what is there ---------------------------------------------------------------------------------------------

    @property
    def pipeline(self) -> Pipeline:
        """The one that is shown, with all its stages, working or not."""
        return self.pipelines[self.which]

    @property
    def view(self) -> View:
        """The camera that is drawn from."""
        return view_of(self.renderer)

    @view.setter
    def view(self, view: View) -> None:
        view.to_vtk(self.renderer.GetActiveCamera())

    @property
    def frozen(self) -> bool:
        """Whether the culling camera stands still."""
        return self.driver.held is not None

    def offered(self) -> list[Overlay]:
        """Overlays whose stage is in the pipeline."""
        names = {stage.name for stage in self.pipeline.stages}
        return [o for o in self.overlays if not o.stage or o.stage in names]

    # -- actions ---------------------------------------------------------------------------------------------------

    def toggle_stage(self, index: int) -> None:
        """Switch a stage off, with those that read what it puts; or on again."""
        stages = self.pipeline.stages
        if index >= len(stages):
            self.messages.append(f"there is no stage {index + 1}")
            return
        name, disabled = stages[index].name, self.pipeline.disabled
        names = {s.name for s in stages} - {s.name for s in without(self.pipeline, name).stages}
        if name in disabled or name in self.driver.failures:
            disabled -= names
            for each in names:
                self.driver.failures.pop(each, None)
            if stages[index] not in self.driver.pipeline.stages:
                # it could not be opened, and the driver goes on without it
                self._reopen()
        else:
            disabled |= names
        self._refresh()

    def other_pipeline(self) -> None:
        """Show the next pipeline."""
        held = self.driver.held
        self.which = (self.which + 1) % len(self.pipelines)
        self.driver.use(self.pipeline)
        self.coloring = self.coloring if self.coloring in self.offered() else None
        if held is not None:
            self.driver.held = self.driver.decide(held.view)
        self.messages.append(f"pipeline {'AB'[self.which] if self.which < 2 else self.which + 1}: {self.pipeline.text}")

    def set_parameter(self, stage: str, name: str, value: Any, *, settled: bool = True) -> None:
        """Set a parameter of a stage that runs.

        Parameters
        ----------
        settled : bool
            False while a slider is being dragged: what takes long to prepare is prepared at the end.
        """
        for each in self.pipeline.stages:
            if each.name == stage and each.parameters()[name].fault(value) is None:
                setattr(each, name, value)
                if settled and type(each).open is not Stage.open:
                    self._reopen()
        self._refresh()

    def _reopen(self) -> None:
        """Prepare the pipeline anew, in the background if that is how it is done here."""
        driver = self.driver
        held, failures = driver.held, {n: why for n, why in driver.failures.items() if n in self.pipeline.disabled}
        driver.use(self.pipeline)
        driver.held, driver.failures = held, failures

    def pump(self, seconds: float) -> bool:
        """Let a preparation go on for so long; whether it has just ended."""
        if not self.driver.pump(seconds):
            return False
        self._refresh()
        return True

    def _refresh(self) -> None:
        """Decide again what a frozen camera sees."""
        if self.driver.held is not None:
            self.driver.held = self.driver.decide(self.driver.held.view) or self.driver.held

    def toggle_freeze(self) -> None:
        """Keep what is drawn now, whatever the camera does; or let it follow again."""
        self.driver.held = None if self.frozen else self.driver.frame

    def next_coloring(self) -> None:
        """Go on to the next coloring; after the last come the scene's own colors."""
        choice = [None, *(o for o in self.offered() if o.is_coloring())]
        at = choice.index(self.coloring) if self.coloring in choice else 0
        self.coloring = choice[(at + 1) % len(choice)]

    def toggle_overlay(self, overlay: Overlay) -> None:
        """Show one overlay, or no longer."""
        if overlay.is_coloring():
            self.coloring = None if self.coloring is overlay else overlay
        elif overlay in self.gizmos:
            self.gizmos.remove(overlay)
        else:
            self.gizmos.append(overlay)

    def pick(self, x: float, y: float) -> str | None:
        """Pick what is drawn at a point of the picture, in pixels from the lower left corner; its path, or None."""
        frame = self.driver.frame
        row = None if frame is None or self.frozen else row_at(frame, x, y)
        self.picked = None if row is None else int(self.snapshot.keys[row])
        return None if row is None else self.snapshot.names([row])[0]

    def _picked_row(self) -> int | None:
        if self.picked is None:
            return None
        found = np.flatnonzero(self.snapshot.keys == self.picked)
        return int(found[0]) if len(found) else None

    # -- one frame -------------------------------------------------------------------------------------------------

    def _decided(self) -> None:
        self._begun = perf_counter()
        self.marks.hide()
        frame = self.driver.frame
        if frame is None or self.driver.off_because or self.quiet:
            return
        gizmos = [o for o in self.offered() if self.show_gizmos or o in self.gizmos] + [self._boxes] * self.show_boxes
        try:
            if self.marks.explain(frame, self.coloring, gizmos, self._picked_row()):
                self.drawing.show(np.zeros(self.snapshot.n, bool))
        except Exception as error:
            # a stranger's overlay; the viewer lives on without it
            self.coloring, self.gizmos, self.show_gizmos = None, [], False
            self.messages.append(f"the overlay failed and is off: {type(error).__name__}: {error}")
            return
        if self.show_hidden:
            self.marks.show_hidden(frame, shine_through=not self.frozen)
        if self.truth and self.verdict is not None and len(self.verdict.rows):
            self.marks.flash(self.verdict.rows)

    def finished(self) -> None:
        """Tell that the frame is on screen."""
        if not self.quiet:
            frame = self.driver.frame
            cull = frame.record.cull_ms if frame is not None and not self.driver.off_because else 0.0
            self.history.append((cull if not self.frozen else 0.0, 1e3 * (perf_counter() - self._begun)))

    # -- pictures and truth ----------------------------------------------------------------------------------------

    def picture(self, *, whole: bool = False) -> NDArray[np.uint8]:
        """(h, w, 3) the scene without anything drawn to explain it, as a suite draws it; top row first.

        Parameters
        ----------
        whole : bool
            With nothing hidden.
        """
        self.quiet, before = True, self.driver.paused
        self.driver.paused = whole
        try:
            return picture_of(self.renderer)
        finally:
            self.quiet, self.driver.paused = False, before

    def check_truth(self) -> Verdict | None:
        """Compare the last frame with the exact visible set of its view; None if there is no frame to judge."""
        frame = self.driver.frame
        if frame is None or self.driver.off_because:
            return None
        try:
            pixels = self._truth.pixels(frame.view)
            self.verdict = judge(frame, pixels, self.picture(), self.picture(whole=True))
        except ScenegraphError as error:
            self.truth = False
            self.messages.append(str(error))
        return self.verdict

    def numbers(self) -> Numbers:
        """What the heads-up display shows."""
        frame, driver = self.driver.frame, self.driver
        verdict = self.verdict if self.truth else None
        modes = {
            "culling camera frozen": self.frozen,
            "hidden objects": self.show_hidden,
            "gizmos": self.show_gizmos,
            **{o.name: o in self.gizmos for o in self.offered()},
            "hierarchy": self.show_boxes,
        }
        return Numbers(
            title=f"{self.snapshot.scene.name}, {self.snapshot.n:,} objects",
            pipeline=f"{'AB'[self.which]}: {self.pipeline.text}" if len(self.pipelines) > 1 else self.pipeline.text,
            frame=frame,
            off=driver.preparing or driver.off_because,
            stages=self.pipeline.stages,
            disabled=self.pipeline.disabled,
            failures=driver.failures,
            history=self.history,
            truth="" if not self.truth else "comparing ..." if verdict is None else verdict.text,
            truth_is_bad=verdict is not None and len(verdict.rows) > 0,
            names=verdict.names if verdict is not None else (),
            state=[name for name, on in modes.items() if on],
            legend=self.marks.legend,
        )

    def close(self) -> None:
        """Give everything back. Closing twice is allowed."""
        self._truth.close()
        self.driver.detach()
