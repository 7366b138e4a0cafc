"""`plotter.scenegraph`: culling in any pyvista plotter, by one line.

pyvista finds this module through the entry-point group `pyvista.plotter_components` when `plotter.scenegraph` is
asked for the first time.
"""

from __future__ import annotations

from typing import Any

import pyvista

from ..errors import SceneError, ScenegraphError
from ..pipeline import Pipeline
from ..registry import registry
from ..render.driver import Driver
from ..stage import parse_stages

#: Milliseconds between turns of a preparation in a live window, and how much of that it gets.
_TURN_MS, _TURN_S = 20, 0.012


class PlotterCulling:
    """Culling of a plotter's own meshes.

    Nothing in the plotter changes but what is drawn of it: between the start and the end of a frame, and never
    otherwise, the renderer holds what the stages leave. Picking, bounds, widgets and whatever else looks at the actors
    find them as they were.

    Parameters
    ----------
    plotter : pyvista.Plotter

    Examples
    --------
    >>> plotter = pyvista.Plotter()
    >>> for mesh in meshes:
    ...     plotter.add_mesh(mesh)
    >>> plotter.scenegraph.enable("frustum | shadow")
    >>> plotter.show()
    """

    def __init__(self, plotter: Any) -> None:
        self._plotter = plotter
        self._drivers: list[Driver] = []
        self._timer: int | None = None
        self._observer: int | None = None

    def enable(self, pipeline: str, *, background: bool | None = None, batches: bool = False) -> None:
        """Cull every subplot that has something to cull; what was enabled before is replaced.

        Parameters
        ----------
        pipeline : str
            As ``frustum | shadow(active=15)``.
        background : bool, optional
            Prepare stages while the window is alive already. By default in interactive plotters: what is drawn off
            screen waits for the preparation.
        batches : bool
            Draw actors that look alike, but for place, shape and color, by one call. Faster where hundreds are left;
            but on a software renderer a few pixels in a million have been seen to differ.

        Raises
        ------
        PipelineError
            The text is not a pipeline.
        SceneError
            There is nothing to cull in the plotter.
        """
        parse_stages(pipeline)
        made = [Pipeline.parse(pipeline, registry()) for _ in self._plotter.renderers]
        self.disable()
        live = not self._plotter.off_screen if background is None else background
        why: SceneError | None = None
        for renderer, own in zip(self._plotter.renderers, made, strict=True):
            try:
                self._drivers.append(Driver(renderer, own, background=live, batches=batches, tolerant=True))
            except SceneError as error:
                # a subplot with nothing but a chart or a legend
                why = error
        if not self._drivers and why is not None:
            raise why
        if live:
            self._start_timer()

    def disable(self) -> None:
        """Draw everything again. Disabling twice is allowed."""
        self._stop_timer()
        for driver in self._drivers:
            driver.detach()
        self._drivers.clear()

    def update(self) -> None:
        """Take over what was added, removed, moved or edited since; until then it is drawn always."""
        for driver in self._drivers:
            driver.reload()

    @property
    def enabled(self) -> bool:
        """Whether anything is culled."""
        return bool(self._drivers)

    @property
    def drivers(self) -> tuple[Driver, ...]:
        """One for each subplot that is culled."""
        return tuple(self._drivers)

    @property
    def status(self) -> str:
        """What was drawn of the last frame, or why it was drawn whole; a line per subplot."""
        lines = []
        for driver in self._drivers:
            if driver.off_because:
                line = f"drawn whole: {driver.off_because}"
            elif driver.frame is None:
                line = "nothing drawn yet"
            else:
                record = driver.frame.record
                n, whole = driver.snapshot.n, int(driver.snapshot.triangles[0].sum())
                line = f"{record.visible:,} of {n:,} drawn with {record.triangles:,} of {whole:,} triangles"
                line += f", decided in {record.cull_ms:.1f} ms"
            if driver.added:
                line += f"; {driver.added} added since, call update()"
            line += "".join(f"; stage {name} is off: {what}" for name, what in driver.failures.items())
            lines.append(line)
        return "\n".join(lines) or "off"

    def __repr__(self) -> str:
        return f"<culling: {self.status}>"

    # -- preparing in a live window ----------------------------------------------------------------------------------

    def _start_timer(self) -> None:
        interactor = getattr(self._plotter.iren, "interactor", None)
        if interactor is None:
            return
        self._observer = interactor.AddObserver("TimerEvent", self._turn)
        # before the window is shown there is no clock to set
        if interactor.GetInitialized():
            self._timer = interactor.CreateRepeatingTimer(_TURN_MS)
        else:
            self._plotter.add_on_render_callback(self._shown, render_event=False)

    def _shown(self, _plotter: object) -> None:
        interactor = self._plotter.iren.interactor
        if self._observer is not None and self._timer is None and interactor.GetInitialized():
            self._timer = interactor.CreateRepeatingTimer(_TURN_MS)

    def _turn(self, *_: object) -> None:
        ended = [driver.pump(_TURN_S) for driver in self._drivers]
        if any(ended):
            self._plotter.render_window.Render()
        if self._timer is not None and all(d.frame is not None and not d.preparing for d in self._drivers):
            self._stop_timer()

    def _stop_timer(self) -> None:
        interactor = getattr(self._plotter.iren, "interactor", None) if self._plotter.iren is not None else None
        if interactor is not None:
            if self._timer is not None:
                interactor.DestroyTimer(self._timer)
            if self._observer is not None:
                interactor.RemoveObserver(self._observer)
        self._timer = self._observer = None

    # -- the contract of pyvista's components ------------------------------------------------------------------------

    def __plotter_close__(self) -> None:
        """Let go when the plotter closes."""
        self.disable()

    def __plotter_deep_clean__(self) -> None:
        """Let go when the plotter is cleaned."""
        self.disable()


if not hasattr(pyvista, "register_plotter_component"):  # pragma: no cover - pyvista before 0.48
    raise ScenegraphError("plotter.scenegraph needs pyvista 0.48 or newer: pip install --upgrade pyvista")
pyvista.register_plotter_component("scenegraph")(PlotterCulling)
