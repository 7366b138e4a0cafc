"""A viewer in a real window on a display of its own, driven by xdotool as a person would.

Nothing here sleeps and hopes. The viewer writes what it is doing into a file, beginning after its first frame; a test
acts and waits until the file says that the act has had its effect. Whatever happens, viewer and display are ended.
"""

from __future__ import annotations

import ctypes
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

INSTALLED = bool(shutil.which("Xvfb") and shutil.which("xdotool"))
#: Seconds that anything may take, on a machine that does other things, too.
PATIENCE = 60.0

#: Runs `scenegraph view ...` with a window that tells what it does.
PROGRAM = """
import json, os, sys
from scenegraph.viewer import command, window

class ToldWindow(window.ViewerWindow):
    turns = 0

    def start(self):
        super().start()
        self.tell()

    def tick(self):
        super().tick()
        self.tell()

    def press(self, keysym):
        known = super().press(keysym)
        self.tell()
        return known

    def tell(self):
        self.turns += 1
        session = self.session
        told = {
            "id": self.number(), "size": list(self.window.GetSize()), "turns": self.turns,
            "eye": list(session.view.eye), "forward": list(map(float, session.view.forward)),
            "help": self.show_help, "panel": self.show_panel, "hidden": session.show_hidden, "frozen": session.frozen,
            "coloring": session.coloring.name if session.coloring else None, "truth": session.truth,
            "verdict": session.verdict.text if session.verdict else None,
            "disabled": sorted(session.pipeline.disabled), "which": session.which, "walking": self.walking,
            "saved": [str(p) for p in self.saved], "at": self.at, "replaying": self.replaying,
            "parameters": {s.name: s.values() for s in session.pipeline.stages},
            "spots": self.spots(), "failures": session.driver.failures, "preparing": session.driver.preparing,
            "off": session.driver.off_because, "objects": session.snapshot.n,
            "drawn": session.driver.frame.visible_count if session.driver.frame is not None else None,
        }
        with open("told.new", "w") as file:
            json.dump(told, file)
        os.replace("told.new", "told.json")

    def number(self):
        # "_0000000000400002_p_void"
        return int(self.window.GetGenericWindowId().split("_")[1], 16)

    def spots(self):
        found = {}
        for actor in (self._panel, self._numbers):
            for spot in actor.card.spots if actor.card is not None else ():
                found[".".join(spot.what)] = [actor.x + spot.x, actor.y + spot.y, spot.width, spot.height]
        return found

def find_scene(source, known):
    # "city:200" is a small one, made faster than the whole
    name, _, buildings = source.partition(":")
    return known.scene(name).build(buildings=int(buildings)) if buildings else find(source, known)

window.ViewerWindow = ToldWindow
find, command.find_scene = command.find_scene, find_scene
from scenegraph.cli import main
main()
"""


class DrivenViewer:
    """What a person does, and what the viewer says about itself.

    Parameters
    ----------
    folder : Path
        Where the viewer runs.
    display : str
    process : subprocess.Popen
    """

    def __init__(self, folder: Path, display: str, process: subprocess.Popen[bytes]) -> None:
        self.folder, self.process = folder, process
        self.env = {**os.environ, "DISPLAY": display}
        self.window = 0

    def errors(self) -> str:
        """What the viewer printed."""
        return (self.folder / "printed.txt").read_text(encoding="utf-8", errors="replace")

    def told(self) -> dict[str, Any]:
        """What the viewer said last; empty before its first frame."""
        try:
            found: dict[str, Any] = json.loads((self.folder / "told.json").read_text(encoding="utf-8"))
        except FileNotFoundError:
            return {}
        return found

    def until(self, what: str, holds: Callable[[dict[str, Any]], Any], patience: float = PATIENCE) -> dict[str, Any]:
        """Wait until something holds of what the viewer says.

        Raises
        ------
        AssertionError
            It ended or took too long; with what it printed.
        """
        end = time.monotonic() + patience
        while True:
            told = self.told()
            if told and holds(told):
                return told
            if self.process.poll() is not None:
                raise AssertionError(f"the viewer ended ({self.process.returncode}) before {what}:\n{self.errors()}")
            if time.monotonic() > end:
                raise AssertionError(f"no sign of {what} in {patience:.0f} s; last {told}\n{self.errors()}")
            time.sleep(0.05)

    def ready(self) -> DrivenViewer:
        """Wait for the first frame, and for the window to be on the display."""
        self.window = int(self.until("its first frame", lambda told: told["id"])["id"])
        end = time.monotonic() + PATIENCE
        # what another viewer left on a display can have the name, but not the number
        while (
            str(self.window)
            not in self._run("search", "--onlyvisible", "--name", "^scenegraph - ", check=False).split()
        ):
            assert time.monotonic() < end, f"window {self.window} was never mapped\n{self.errors()}"
            time.sleep(0.05)
        self.do("windowfocus", str(self.window))
        return self

    def _run(self, *words: str, check: bool = True) -> str:
        command = ["xdotool", *words]
        done = subprocess.run(command, env=self.env, capture_output=True, timeout=PATIENCE, text=True, check=False)
        if check and done.returncode:
            raise AssertionError(f"{' '.join(command)}: {done.stdout}{done.stderr}\n{self.errors()}")
        return done.stdout

    def do(self, *words: str) -> None:
        """One command of xdotool, which must work."""
        self._run(*words)

    def press(self, key: str, what: str, holds: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
        """Press a key, and wait for its effect."""
        assert self.window, "the window is not there yet"
        self.do("key", "--window", str(self.window), key)
        return self.until(f"{what} after {key}", holds)

    def move(self, x: float, y: float) -> None:
        """Move the pointer to a place in the window."""
        self.do("mousemove", "--window", str(self.window), str(round(x)), str(round(y)))

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Drag with the left button."""
        self.move(*start)
        self.do("mousedown", "1")
        self.move(*end)
        self.do("mouseup", "1")

    def ended(self) -> str:
        """Wait until the viewer has ended well; what it printed."""
        try:
            code = self.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            raise AssertionError(f"the viewer goes on; last {self.told()}\n{self.errors()}") from None
        assert code == 0, f"ended with {code}:\n{self.errors()}"
        assert "Traceback" not in self.errors(), self.errors()
        return self.errors()

    def ask_to_close(self) -> None:
        """What a window manager sends when somebody clicks on the cross: WM_DELETE_WINDOW."""
        x11 = ctypes.CDLL("libX11.so.6")
        x11.XOpenDisplay.restype = ctypes.c_void_p
        x11.XInternAtom.restype = ctypes.c_ulong
        x11.XInternAtom.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int]
        display = ctypes.c_void_p(x11.XOpenDisplay(self.env["DISPLAY"].encode()))
        assert display, "the display is gone"
        protocols, delete = (x11.XInternAtom(display, name, 0) for name in (b"WM_PROTOCOLS", b"WM_DELETE_WINDOW"))
        event = _ClientMessage(33, 0, 1, display, self.window, protocols, 32, (ctypes.c_long * 5)(delete, 0, 0, 0, 0))
        x11.XSendEvent(display, ctypes.c_ulong(self.window), 0, ctypes.c_long(0), ctypes.byref(event))
        x11.XCloseDisplay(display)

    def screen(self) -> np.ndarray:
        """(h, w, 3) what is on the display."""
        # the frame buffer of Xvfb is a file, in the format of xwd
        dump = (self.folder / "Xvfb_screen0").read_bytes()
        header = np.frombuffer(dump[:100], ">u4")
        width, height, row = int(header[4]), int(header[5]), int(header[12])
        pixels = dump[int(header[0]) + 12 * int(header[19]) :]
        shape = np.frombuffer(pixels, np.uint8)[: row * height].reshape(height, row)[:, : 4 * width]
        return np.ascontiguousarray(shape.reshape(height, width, 4)[..., 2::-1])

    def keep(self, name: str) -> None:
        """A picture of the display for whoever wants to look at it, if SCENEGRAPH_PICTURES names a folder."""
        folder = os.environ.get("SCENEGRAPH_PICTURES")
        if folder:
            Path(folder).mkdir(parents=True, exist_ok=True)
            Image.fromarray(self.screen()).save(Path(folder) / f"{name}.png")


class _ClientMessage(ctypes.Structure):
    """XClientMessageEvent, and room up to the size of XEvent."""

    _fields_ = (
        ("type", ctypes.c_int),
        ("serial", ctypes.c_ulong),
        ("send_event", ctypes.c_int),
        ("display", ctypes.c_void_p),
        ("window", ctypes.c_ulong),
        ("message_type", ctypes.c_ulong),
        ("format", ctypes.c_int),
        ("data", ctypes.c_long * 5),
        ("room", ctypes.c_long * 24),
    )


@contextmanager
def virtual_display(folder: Path) -> Iterator[str]:
    """A display that nobody sees; its name. The server chooses a free number by itself."""
    reads, writes = os.pipe()
    with (folder / "display.txt").open("wb") as log:
        server = subprocess.Popen(
            [
                "Xvfb",
                "-displayfd",
                str(writes),
                "-screen",
                "0",
                "1200x800x24",
                "-nolisten",
                "tcp",
                "-noreset",
                "-fbdir",
                ".",
            ],
            cwd=folder,
            pass_fds=[writes],
            stdout=log,
            stderr=log,
        )
    os.close(writes)
    try:
        with os.fdopen(reads) as answer:
            number = answer.readline().strip()
        assert number, f"Xvfb does not start: {(folder / 'display.txt').read_text()}"
        yield f":{number}"
    finally:
        end_process(server)


@contextmanager
def driven(folder: Path, *arguments: str) -> Iterator[DrivenViewer]:
    """`scenegraph view` with these arguments, ready to be driven."""
    env = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY", "VTK_DEFAULT_OPENGL_WINDOW")}
    with virtual_display(folder) as display, (folder / "printed.txt").open("wb") as printed:
        process = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, "view", *arguments],
            cwd=folder,
            env={**env, "DISPLAY": display},
            stdout=printed,
            stderr=printed,
        )
        try:
            yield DrivenViewer(folder, display, process).ready()
        finally:
            end_process(process)


def end_process(process: subprocess.Popen[bytes]) -> None:
    """End a process that was started here."""
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(5)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
