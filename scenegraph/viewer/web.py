"""The viewer in a browser: the same window, drawn here and shown there by pyvista's trame back end.

What happens in the browser comes back as the name of an action of the key table, a stage, or a place of a slider, so
that both viewers do the same.

The server listens on this machine only, and answers only to who knows the secret of the run, which is part of the
address: other users of the machine can connect, too, and so can the pages of any site in the same browser.
"""

from __future__ import annotations

import asyncio
import secrets
import tempfile
import webbrowser
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from ..errors import ScenegraphError
from .actions import ACTIONS
from .keys import KEYS
from .panel import share_of, shown, value_at
from .window import ViewerWindow

if TYPE_CHECKING:
    from ..stage import Stage

HOST = "127.0.0.1"
#: Seconds between turns of the clock.
_TURN_S = 0.04
#: What browsers call keys, by the names that the key table has.
_NAMES = {
    " ": "space", "ArrowUp": "Up", "ArrowDown": "Down", "ArrowLeft": "Left", "ArrowRight": "Right",
    "PageUp": "Prior", "PageDown": "Next", "+": "plus", "-": "minus", "=": "equal",
}  # fmt: skip
#: Actions that make no sense in a browser, or have controls of their own there.
_NOT_HERE = ("quit", "toggle_stage", "toggle_panel")


class WebWindow(ViewerWindow):
    """A viewer window that is drawn when a browser asks for a picture.

    Attributes
    ----------
    dirty : bool
        Something has changed since the browser got its last picture.
    """

    dirty = True

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **{**options, "off_screen": True})
        # no window waits for anything, but a browser does
        self.session.driver.background = True

    def render(self) -> None:
        """Leave the drawing to whoever sends the picture."""
        if self.recorder is not None:
            self.recorder.add(self.session.view)
        self.update_cards()
        self.dirty = True

    def start(self) -> None:
        """Listen to the mouse of the browser; there is no loop to wait in, and no timer."""
        from .mouse import Mouse

        self.plotter.enable_trackball_style()
        self.plotter.show(auto_close=False, interactive_update=True, interactive=False)
        self.plotter.iren.initialize()
        self._mouse = Mouse(self, self.plotter.iren.interactor)
        # or the back end would choose a camera
        self.plotter.camera.is_set = True
        self.go_home()
        self.window.Render()
        self.say("h lists the keys")
        self.render()

    def go_home(self) -> None:
        """To the first view."""
        assert self.home is not None
        self.session.view = self.home.resized(*self.window.GetSize())


class WebViewer:
    """The page around a window.

    Parameters
    ----------
    window : WebWindow

    Raises
    ------
    ScenegraphError
        The packages of the extra `web` are not installed.
    """

    def __init__(self, window: WebWindow) -> None:
        try:
            from trame.app import get_server
            from trame_pyvista import PyVistaRemoteView
        except ImportError as error:
            raise ScenegraphError(
                f"the browser view needs {error.name}; pip install 'scenegraph-culling[web]'"
            ) from None
        self.window = window
        self.server: Any = get_server(f"scenegraph-{id(self)}", client_type="vue3")
        self._view: Any = None
        self._size = (0, 0)
        self._view_class: Any = PyVistaRemoteView
        for name in ("act", "press", "toggle_stage", "slide"):
            self.server.controller.trigger(name)(getattr(self, name))
        window.start()
        self._tell()
        self._build()

    # -- what the page asks for ------------------------------------------------------------------------------------

    def act(self, name: str) -> None:
        """Do what the key table calls by this name."""
        if name in ACTIONS and name not in _NOT_HERE:
            ACTIONS[name](self.window, "")
            self._changed()

    def press(self, key: str) -> None:
        """A key went down, by the browser's name for it."""
        keysym = _NAMES.get(key, key)
        if keysym not in ("q", "Escape", "p") and self.window.press(keysym):
            self._changed()

    def toggle_stage(self, index: int) -> None:
        """Switch a stage off, or on again."""
        self.window.session.toggle_stage(int(index))
        self._changed()

    def slide(self, stage: str, name: str, share: float, settled: bool = True) -> None:
        """The slider of a parameter is here; `settled` when it is let go."""
        found = self._stage(stage)
        if found is not None and name in found.parameters():
            value = value_at(found.parameters()[name], float(share))
            self.window.session.set_parameter(stage, name, value, settled=settled)
            self._changed()

    def _stage(self, name: str) -> Stage | None:
        return next((s for s in self.window.session.pipeline.stages if s.name == name), None)

    # -- what the page shows ---------------------------------------------------------------------------------------

    def _changed(self) -> None:
        # twice, because the cards speak of the frame before
        self.window.window.Render()
        self.window.render()
        self._show()

    def _show(self) -> None:
        self.window.dirty = False
        self._tell()
        if self._view is not None and self.server.running:
            self.server.state.flush()
            self._view.update()

    def _tell(self) -> None:
        session, state = self.window.session, self.server.state
        numbers = session.numbers()
        state.stages = [
            {
                "name": stage.name,
                "on": stage.name not in numbers.disabled and stage.name not in numbers.failures,
                "failure": numbers.failures.get(stage.name, ""),
                "parameters": [
                    {"name": p.name, "share": share_of(p, v := getattr(stage, p.name)), "shown": shown(p, v)}
                    for p in stage.parameters().values()
                ],
            }
            for stage in numbers.stages
        ]
        frame = numbers.frame
        state.pipeline = numbers.pipeline
        state.drawn = frame.record.visible if frame is not None and not numbers.off else session.snapshot.n
        state.objects = session.snapshot.n
        state.note = numbers.off
        state.modes = numbers.state
        state.truth = numbers.truth

    def _build(self) -> None:
        from trame.ui.vuetify3 import VAppLayout
        from trame.widgets import client, html
        from trame.widgets import vuetify3 as v3

        state = self.server.state
        state.query = ""
        state.trame__title = f"scenegraph - {self.window.session.snapshot.scene.name}"
        with VAppLayout(self.server, theme="dark") as layout:
            layout.root.classes = "scenegraph"
            # trame takes the secret out of the address once it is connected, and a page reloaded without it stays empty
            client.ClientTriggers(mounted="utils.get('history').replaceState({}, '', query)")
            with v3.VNavigationDrawer(permanent=True, width=300):
                with html.Div(classes="pa-4"):
                    html.Div("{{ pipeline }}", classes="text-body-2")
                    html.Div("{{ drawn }} of {{ objects }} objects drawn", classes="text-caption", id="drawn")
                    html.Div("{{ note }} {{ truth }}", classes="text-caption text-amber")
                with html.Div(v_for="stage, i in stages", key="i", classes="px-4"):
                    v3.VSwitch(
                        model_value=("stage.on",),
                        label=("`${i + 1}  ${stage.name}`",),
                        click="trigger('toggle_stage', [i])",
                        classes=("`stage-${stage.name}`",),
                        density="compact",
                        hide_details=True,
                        color="amber",
                        readonly=True,
                    )
                    html.Div("{{ stage.failure }}", v_if="stage.failure", classes="text-caption text-red")
                    with html.Div(v_for="p in stage.parameters", key="p.name"):
                        with html.Div(classes="d-flex text-caption"):
                            html.Span("{{ p.name }}")
                            v3.VSpacer()
                            html.Span("{{ p.shown }}")
                        v3.VSlider(
                            model_value=("p.share",),
                            min=0,
                            max=1,
                            step=0.005,
                            density="compact",
                            hide_details=True,
                            color="amber",
                            classes=("`slider-${stage.name}-${p.name}`",),
                            update_modelValue="trigger('slide', [stage.name, p.name, $event, false])",
                            end="trigger('slide', [stage.name, p.name, $event, true])",
                        )
                v3.VDivider(classes="my-2")
                with html.Div(classes="px-3 pb-4"):
                    for key in KEYS:
                        if key.action not in _NOT_HERE:
                            v3.VBtn(
                                f"{key.shown}  {key.text}",
                                click=f"trigger('act', ['{key.action}'])",
                                size="small",
                                variant="text",
                                block=True,
                                classes=f"justify-start text-none action-{key.action}",
                            )
            with (
                v3.VMain(style="height: 100vh; overflow: hidden;"),
                html.Div(
                    tabindex=0,
                    style="position: relative; width: 100%; height: 100%; outline: none;",
                    keydown="trigger('press', [$event.key])",
                    classes="view",
                ),
            ):
                self._view = self._view_class(self.window.plotter, interactive_ratio=1, still_ratio=1)
                self._view.update_image()
        # the back end may have set a camera of its own
        self.window.go_home()

    # -- running ---------------------------------------------------------------------------------------------------

    async def _clock(self) -> None:
        while True:
            await asyncio.sleep(_TURN_S)
            self.window.tick()
            size = tuple(self.window.window.GetSize())
            if size != self._size:
                # the browser has another size than before, and cards stand at its borders
                self._size = size
                self._changed()
            elif self.window.dirty:
                self._show()

    def run(self, port: int = 0, *, open_browser: bool = False) -> None:
        """Serve the page until interrupted; the address is printed.

        Parameters
        ----------
        port : int
            0 takes any that is free.
        open_browser : bool
            Open the page in the user's browser.
        """
        from rich.console import Console

        # wslink's default is a word that everybody knows
        self.server.cli.set_defaults(authKey=secrets.token_urlsafe(32))

        def ready(**_: Any) -> None:
            # asked for, as TRAME_ARGS may bring one of the user's own
            query = f"?secret={quote(str(self.server.protocol.secret), safe='')}"
            self.server.state.query = query
            address = f"http://{HOST}:{self.server.port}/{query}"
            Console(highlight=False).print(f"the viewer is at {address} (Ctrl+C ends it)", soft_wrap=True, markup=False)
            if open_browser:
                _open(address, Path(files.enter_context(tempfile.TemporaryDirectory(prefix="scenegraph-"))))
            # held, or it might be collected
            self._task = asyncio.ensure_future(self._clock())

        self.server.controller.on_server_ready.add(ready)
        with ExitStack() as files:
            self.server.start(
                port=port,
                host=HOST,
                open_browser=False,
                show_connection_info=False,
                disable_logging=True,
                timeout=0,
            )
        self.window.close()


def _open(address: str, folder: Path) -> None:
    """Open a page by a file that leads there: every user can read the command line of a browser, but not the folder."""
    file = folder / "viewer.html"
    file.write_text(f'<!DOCTYPE html><meta http-equiv="refresh" content="0; url={address}">', encoding="utf-8")
    webbrowser.open(file.as_uri())
