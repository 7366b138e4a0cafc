"""The mouse and the keyboard of a live window, before VTK's interactor style gets to see them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .canvas import Spot
    from .window import ViewerWindow

#: Degrees of a turn per pixel dragged.
_TURN = 0.2
_EARLY = 100.0


class Mouse:
    """Listens to an interactor, and keeps from the style what is handled here.

    Parameters
    ----------
    viewer : ViewerWindow
    interactor : vtkRenderWindowInteractor
    """

    def __init__(self, viewer: ViewerWindow, interactor: Any) -> None:
        self._viewer, self._interactor = viewer, interactor
        self._spot: Spot | None = None
        self._button = ""
        self._last = (0, 0)
        self._tags: dict[str, int] = {}
        for event, handle in (
            ("LeftButtonPressEvent", lambda: self._press("left")),
            ("LeftButtonReleaseEvent", lambda: self._release("left")),
            ("RightButtonPressEvent", lambda: self._press("right")),
            ("RightButtonReleaseEvent", lambda: self._release("right")),
            ("MouseMoveEvent", self._move),
            ("MouseWheelForwardEvent", lambda: self._wheel(1.0)),
            ("MouseWheelBackwardEvent", lambda: self._wheel(-1.0)),
            ("KeyPressEvent", self._key),
            # VTK's own keys would close the window or turn everything into wires
            ("CharEvent", lambda: True),
        ):
            self._tags[event] = interactor.AddObserver(event, self._handler(event, handle), _EARLY)
        interactor.AddObserver("ConfigureEvent", lambda *_: viewer.update_cards())

    def _handler(self, event: str, handle: Any) -> Any:
        def handler(*_: object) -> None:
            if handle():
                # whoever comes later does not see the event
                self._interactor.GetCommand(self._tags[event]).SetAbortFlag(True)

        return handler

    def _at(self) -> tuple[int, int]:
        x, y = self._interactor.GetEventPosition()
        return x, self._viewer.window.GetSize()[1] - 1 - y

    def _press(self, button: str) -> bool:
        self._last = self._at()
        found = self._viewer.spot_at(*self._last)
        if button == "left" and found is not None:
            self._spot = found[0]
            if self._spot.what[0] == "parameter":
                self._viewer.drag(self._spot, found[1], settled=False)
            return True
        self._button = button if self._viewer.walking else ""
        return self._viewer.walking

    def _release(self, button: str) -> bool:
        if self._spot is not None and button == "left":
            self._viewer.drag(self._spot, self._along(self._spot), settled=True)
            self._spot = None
            return True
        self._button = ""
        return self._viewer.walking

    def _along(self, spot: Spot) -> float:
        card_x = self._viewer.card_left(spot)
        return spot.share(self._at()[0] - card_x)

    def _move(self) -> bool:
        x, y = self._at()
        dx, dy = x - self._last[0], y - self._last[1]
        self._last = (x, y)
        if self._spot is not None:
            if self._spot.what[0] == "parameter":
                self._viewer.drag(self._spot, self._along(self._spot), settled=False)
            return True
        if not self._button:
            return False
        session = self._viewer.session
        if self._button == "left":
            session.view = session.walker.turn(session.view, _TURN * dx, _TURN * dy)
        else:
            session.view = session.walker.step(session.view, right=0.05 * dx, up=-0.05 * dy)
        self._viewer.render()
        return True

    def _wheel(self, way: float) -> bool:
        if not self._viewer.walking:
            return False
        session = self._viewer.session
        session.view = session.walker.step(session.view, 2 * way)
        self._viewer.render()
        return True

    def _key(self) -> bool:
        self._viewer.press(self._interactor.GetKeySym() or "")
        return True
