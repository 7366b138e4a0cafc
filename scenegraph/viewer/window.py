"""The viewer's window: a pyvista plotter, the keys and the mouse, a clock, and the cards in front of the scene."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyvista

from ..overlay import Overlay
from ..pipeline import Pipeline
from ..registry import Registry
from ..render.window import lamp
from ..snapshot import Snapshot
from ..view import View
from .canvas import Spot
from .hud import help_card, inset_card, message_card, numbers_card
from .keys import KEYS, Key, by_keysym
from .mouse import Mouse
from .panel import panel_card, value_at
from .pictures import CardActor, pixels_of
from .recording import Recorder
from .session import Session

_TICK_MS = 25
_MESSAGE_S = 4.0
#: Seconds between looks at the truth, and between new cards while frames go by.
_TRUTH_S, _CARDS_S = 1.0, 0.1
_MARGIN = 16


class ViewerWindow:
    """A window on a scene. `KEYS` and `ACTIONS` say what its keys do; overlays may bring keys of their own.

    Parameters
    ----------
    snapshot : Snapshot
    pipelines : sequence of Pipeline
        A and B.
    registry : Registry
    path : sequence of View
        What is replayed; its first view is shown first.
    size : (int, int)
    off_screen : bool
    record : Path, optional
        Where the camera path goes when the window closes; recording starts at once.
    """

    def __init__(
        self,
        snapshot: Snapshot,
        pipelines: Sequence[Pipeline],
        registry: Registry,
        *,
        path: Sequence[View] = (),
        size: tuple[int, int] = (1280, 720),
        off_screen: bool = False,
        record: Path | None = None,
    ) -> None:
        scene = snapshot.scene
        # pyvista's own annotations do not fit what it takes
        make: Any = pyvista.Plotter
        self.plotter: Any = make(off_screen=off_screen, window_size=list(size), lighting="none")
        self.plotter.background_color = scene.background
        self.plotter.disable_anti_aliasing()
        self.window: Any = self.plotter.render_window
        self.window.SetMultiSamples(0)
        # shown by pyvista, which has a title of its own otherwise
        self.plotter.title = f"scenegraph - {scene.name}"
        renderer = self.plotter.renderer
        renderer.SetAutomaticLightCreation(False)
        renderer.AddLight(lamp())
        renderer.GetCullers().RemoveAllItems()
        front, top = self._layer(renderer.GetActiveCamera()), self._layer(None)
        self.session: Session = Session(snapshot, renderer, pipelines, registry, front=front, background=not off_screen)
        self._numbers, self._panel, self._help, self._messages = (CardActor(top) for _ in range(4))
        self._inset = CardActor(top)
        self._insets_shown: list[Any] = []
        self.show_hud, self.show_panel, self.show_help = True, False, False
        self.walking = bool(path) or self.session.walker.ground is not None
        self.path, self.at, self.replaying = list(path), 0, False
        self.recorder: Recorder | None = Recorder() if record is not None else None
        self.record_to = record
        self.saved: list[Path] = []
        self._message_until = self._truth_at = self._cards_at = 0.0
        self._keys = by_keysym()
        self._done = False
        self._mouse: Mouse | None = None
        self.home = self.path[0].resized(*size) if self.path else None
        renderer.AddObserver("StartEvent", self._fit, 10.0)
        self.window.AddObserver("EndEvent", lambda *_: self.session.finished())
        if self.home is None:
            # obliquely from above, whichever way is up
            self.plotter.view_vector((1.0, 1.0, 1.0), viewup=scene.up)
            self.home = self.session.walker.fitted(View.from_vtk(renderer.GetActiveCamera(), *size))
        self.session.view = self.home

    def _layer(self, camera: Any) -> Any:
        from vtkmodules.vtkRenderingCore import vtkRenderer

        made = vtkRenderer()
        number = self.window.GetNumberOfLayers()
        self.window.SetNumberOfLayers(number + 1)
        made.SetLayer(number)
        made.InteractiveOff()
        if camera is not None:
            made.SetActiveCamera(camera)
        self.window.AddRenderer(made)
        return made

    def _fit(self, *_: object) -> None:
        # a trackball moves the camera and knows nothing of clipping planes; a path brings its own
        if not (self.walking or self.replaying or self.session.quiet):
            self.session.view = self.session.walker.fitted(self.session.view)

    # -- running ---------------------------------------------------------------------------------------------------

    def run(self) -> None:
        """Show the window until it is closed."""
        self.start()
        self.plotter.iren.start()
        self.close()

    def start(self) -> None:
        """Show the window and listen, but return."""
        self.plotter.iren.clear_key_event_callbacks()
        self.plotter.enable_trackball_style()
        self.plotter.show(auto_close=False, interactive_update=True, interactive=False)
        interactor = self.plotter.iren.interactor
        self._mouse = Mouse(self, interactor)
        interactor.AddObserver("TimerEvent", lambda *_: self.tick())
        interactor.CreateRepeatingTimer(_TICK_MS)
        # pyvista resets the camera when it shows
        assert self.home is not None
        width, height = self.window.GetSize()
        self.session.view = self.home.resized(width, height)
        self.say("h lists the keys")
        self.render()

    def close(self) -> None:
        """Write what was recorded, and give everything back. Closing twice is allowed."""
        if self._done:
            return
        self._done = True
        if self.recorder is not None and self.record_to is not None and self.recorder.views:
            self.recorder.write(self.record_to)
            self.saved.append(self.record_to)
        self.session.close()
        self.plotter.close()

    def tick(self) -> None:
        """What happens by the clock: replay, preparation, truth, and messages that go away."""
        now = time.monotonic()
        dirty = self.session.pump(0.012)
        if self.replaying:
            self.show_step()
            return
        if self.session.truth and now - self._truth_at > _TRUTH_S:
            self._truth_at = now
            before = self.session.verdict
            dirty |= self.session.check_truth() != before
        if self.session.messages or (self._messages.card is not None and now > self._message_until):
            dirty = True
        if dirty or self.session.driver.preparing:
            self.render()

    def show_step(self) -> None:
        """Go one view on along the path."""
        if self.at >= len(self.path):
            self.replaying, self.at = False, 0
            self.say("the path is at its end")
        else:
            width, height = self.window.GetSize()
            self.session.view = self.path[self.at].resized(width, height)
            self.at += 1
        self.render()

    def render(self) -> None:
        """Draw the scene and what is in front of it."""
        if self.recorder is not None:
            self.recorder.add(self.session.view)
        self.update_cards()
        self.window.Render()

    def update_cards(self) -> None:
        """Make the cards that are shown."""
        now = time.monotonic()
        session = self.session
        if session.messages:
            self._message_until = now + _MESSAGE_S
            self._messages.show(message_card(session.messages[-3:]), _MARGIN, -_MARGIN)
            session.messages.clear()
        elif now > self._message_until:
            self._messages.hide()
        shown = self.show_hud and not self.show_help
        if shown and (self._numbers.card is None or now - self._cards_at > _CARDS_S or not self.replaying):
            self._cards_at = now
            self._numbers.show(numbers_card(session.numbers()), _MARGIN, _MARGIN)
        elif not shown:
            self._numbers.hide()
        if self.show_panel:
            self._panel.show(panel_card(session.pipeline.stages), -_MARGIN, _MARGIN)
        else:
            self._panel.hide()
        if session.marks.insets and not self.show_help:
            shown_insets = session.marks.insets
            if shown_insets is not self._insets_shown or self._inset.card is None:
                self._insets_shown = shown_insets
                self._inset.show(inset_card(shown_insets), -_MARGIN, -_MARGIN)
        else:
            self._inset.hide()
        if self.show_help:
            card = self._help.card or help_card(
                (*KEYS, *(Key((key,), "", o.name) for key, o in self.overlay_keys().items()))
            )
            height, width = card.image.shape[:2]
            across, down = self.window.GetSize()
            self._help.show(card, max((across - width) // 2, 0), max((down - height) // 2, 0))
        else:
            self._help.hide()

    def image(self) -> Any:
        """(h, w, 3) the whole window as it is shown, cards and all; top row first."""
        self.render()
        self.render()
        return pixels_of(self.window)

    def say(self, message: str) -> None:
        """Show a sentence for a while."""
        self.session.messages.append(message)

    # -- input -----------------------------------------------------------------------------------------------------

    def press(self, keysym: str) -> bool:
        """A key went down; whether it means anything here."""
        key = self._keys.get(keysym) or self._keys.get(keysym.lower())
        overlay = self.overlay_keys().get(keysym)
        if key is not None:
            self._act(key, keysym)
        elif overlay is not None:
            self.session.toggle_overlay(overlay)
        else:
            return False
        if not self._done:
            self.render()
        return True

    def overlay_keys(self) -> dict[str, Overlay]:
        """Overlays of this pipeline that have a key of their own, by that key."""
        found: dict[str, Overlay] = {}
        for overlay in self.session.offered():
            if overlay.key and overlay.key not in self._keys:
                found.setdefault(overlay.key, overlay)
        return found

    def _act(self, key: Key, keysym: str) -> None:
        from .actions import ACTIONS

        ACTIONS[key.action](self, keysym)

    def spot_at(self, x: float, y: float) -> tuple[Spot, float] | None:
        """What answers to the mouse at a point from the upper left corner, and how far along it the point is."""
        for actor in (self._panel, self._numbers):
            found = actor.at(x, y)
            if found is not None:
                card, dx, dy = found
                spot = card.spot(dx, dy)
                return None if spot is None else (spot, spot.share(dx))
        return None

    def card_left(self, spot: Spot) -> int:
        """Where the card begins that has a spot, in pixels from the window's left border."""
        return self._panel.x if spot.what[0] == "parameter" else self._numbers.x

    def drag(self, spot: Spot, share: float, *, settled: bool) -> None:
        """The mouse is at this share of a spot; `settled` when the button goes up."""
        if spot.what[0] == "parameter":
            stage = next(s for s in self.session.pipeline.stages if s.name == spot.what[1])
            value = value_at(stage.parameters()[spot.what[2]], share)
            self.session.set_parameter(spot.what[1], spot.what[2], value, settled=settled)
        elif settled:
            self.session.toggle_stage(int(spot.what[1]))
        self.render()
