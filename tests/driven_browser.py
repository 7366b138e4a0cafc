"""The viewer's page: its server in a process of its own, its messages without a browser, and a headless Chromium.

Chromium is driven through its own debugging protocol, so that no driver has to be installed. As everywhere in the
driven tests, whoever acts waits for the effect, and what was started is ended.
"""

from __future__ import annotations

import asyncio
import base64
import io
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import numpy as np
from PIL import Image

from driven_window import PATIENCE, end_process

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
_SWITCHES = [
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--hide-scrollbars",
    "--window-size=1280,800",
    "--remote-debugging-port=0",
]
_SMALL_CITY = """
import sys
from scenegraph.viewer import command
command.find_scene = lambda source, known: known.scene(source).build(buildings=200)
from scenegraph.cli import main
main()
"""


@contextmanager
def served(folder: Path, *arguments: str) -> Iterator[str]:
    """Address of `scenegraph view city --web` of a small city."""
    with (folder / "server.txt").open("wb") as log:
        process = subprocess.Popen(
            [sys.executable, "-c", _SMALL_CITY, "view", "city", "--web", *arguments],
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=log,
        )
        try:
            assert process.stdout is not None
            # the first line, or none when it ends
            line = process.stdout.readline().decode()
            assert " at http://" in line, line + (folder / "server.txt").read_text()
            yield line.split(" at ")[1].split()[0]
        finally:
            end_process(process)
            if process.stdout is not None:
                process.stdout.close()


async def until(what: str, holds: Callable[[], Awaitable[Any]]) -> Any:
    """Wait for something; what it is when it holds."""
    end = time.monotonic() + PATIENCE
    while True:
        found = await holds()
        if found:
            return found
        assert time.monotonic() < end, f"no sign of {what} in {PATIENCE:.0f} s"
        await asyncio.sleep(0.1)


class Browser:
    """One page in Chromium."""

    def __init__(self, socket: Any) -> None:
        self._socket, self._number = socket, 0

    async def send(self, method: str, **parameters: Any) -> Any:
        """One command of the protocol; its result."""
        self._number += 1
        await self._socket.send_json({"id": self._number, "method": method, "params": parameters})
        while True:
            answer = await asyncio.wait_for(self._socket.receive_json(), PATIENCE)
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                return answer["result"]

    async def value(self, script: str) -> Any:
        """What an expression of JavaScript gives."""
        result = await self.send("Runtime.evaluate", expression=script, returnByValue=True)
        return result["result"].get("value")

    async def text(self, selector: str) -> str:
        """Text of an element, or ''."""
        return str(await self.value(f"document.querySelector({json.dumps(selector)})?.innerText ?? ''"))

    async def box(self, selector: str) -> dict[str, float]:
        """Where an element is, once it is there and in sight."""
        script = f"""(() => {{ const e = document.querySelector({json.dumps(selector)}); if (!e) return null;
            e.scrollIntoView({{block: 'center'}}); const r = e.getBoundingClientRect();
            return r.width ? {{x: r.x, y: r.y, width: r.width, height: r.height}} : null; }})()"""
        found: dict[str, float] = await until(selector, lambda: self.value(script))
        return found

    async def mouse(self, kind: str, x: float, y: float) -> None:
        """One event of the left button or of a move."""
        button = "none" if kind == "mouseMoved" else "left"
        await self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, button=button, buttons=1, clickCount=1)

    async def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Press, move, let go."""
        await self.mouse("mousePressed", *start)
        for share in (0.3, 0.6, 1.0):
            place = [a + share * (b - a) for a, b in zip(start, end, strict=True)]
            await self.mouse("mouseMoved", *place)
        await self.mouse("mouseReleased", *end)

    async def click(self, selector: str) -> None:
        """Click in the middle of an element."""
        box = await self.box(selector)
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        await self.mouse("mousePressed", x, y)
        await self.mouse("mouseReleased", x, y)

    async def picture(self, selector: str) -> np.ndarray:
        """(h, w, 3) of an element as it is shown."""
        box = await self.box(selector)
        shot = await self.send("Page.captureScreenshot", format="png", clip={**box, "scale": 1})
        return np.asarray(Image.open(io.BytesIO(base64.b64decode(shot["data"]))).convert("RGB"))

    async def keep(self, name: str) -> None:
        """A picture of the page for whoever wants to look at it, if SCENEGRAPH_PICTURES names a folder."""
        folder = os.environ.get("SCENEGRAPH_PICTURES")
        if folder:
            Path(folder).mkdir(parents=True, exist_ok=True)
            shot = await self.send("Page.captureScreenshot", format="png")
            (Path(folder) / f"{name}.png").write_bytes(base64.b64decode(shot["data"]))


def browse(folder: Path, address: str, act: Callable[[Browser], Awaitable[None]]) -> None:
    """Open a page and act on it."""
    assert CHROMIUM
    profile = folder / "profile"
    with (folder / "browser.txt").open("wb") as log:
        process = subprocess.Popen(
            [CHROMIUM, *_SWITCHES, f"--user-data-dir={profile}", "about:blank"], stdout=log, stderr=log
        )
    try:
        asyncio.run(_browse(profile, address, act))
    finally:
        end_process(process)


async def _browse(profile: Path, address: str, act: Callable[[Browser], Awaitable[None]]) -> None:
    import aiohttp

    async def port() -> str:
        file = profile / "DevToolsActivePort"
        return file.read_text().split("\n")[0] if file.exists() else ""

    number = await until("Chromium", port)
    async with aiohttp.ClientSession() as client:

        async def page() -> Any:
            try:
                async with client.get(f"http://127.0.0.1:{number}/json/list") as answer:
                    return next((p for p in await answer.json() if p["type"] == "page"), None)
            except aiohttp.ClientError:
                return None

        where = (await until("a page", page))["webSocketDebuggerUrl"]
        async with client.ws_connect(where, max_msg_size=0) as socket:
            browser = Browser(socket)
            await browser.send("Page.navigate", url=address)
            await act(browser)


class Messages:
    """A client of the page's server that is no browser."""

    def __init__(self, socket: Any) -> None:
        self._socket, self._number = socket, 0

    async def call(self, method: str, *arguments: Any, system: bool = False) -> Any:
        """What the server answers to a call."""
        answer = await self.answer(method, *arguments, system=system)
        assert "error" not in answer, answer
        return answer["result"]

    async def answer(self, method: str, *arguments: Any, system: bool = False) -> dict[str, Any]:
        """What the server answers, be it a result or an error."""
        import msgpack
        from wslink.chunking import UnChunker, generate_chunks

        self._number += 1
        name = f"{'system' if system else 'rpc'}:c0:{self._number}"
        message = msgpack.packb({"wslink": "1.0", "id": name, "method": method, "args": list(arguments), "kwargs": {}})
        for chunk in generate_chunks(message, 0):
            await self._socket.send_bytes(chunk)
        parts = UnChunker()
        parts.set_max_message_size(1 << 30)
        while True:
            received = await asyncio.wait_for(self._socket.receive_bytes(), PATIENCE)
            answer: dict[str, Any] | None = parts.process_chunk(received)
            if answer is not None and answer.get("id") == name:
                return answer


def talk(address: str, act: Callable[[Messages, Any], Awaitable[None]]) -> None:
    """Connect to the server of a page, as the page would: the secret is part of the address."""
    parts = urlsplit(address)
    (secret,) = parse_qs(parts.query)["secret"]

    async def run() -> None:
        import aiohttp

        async with (
            aiohttp.ClientSession() as client,
            client.ws_connect(f"http://{parts.netloc}/ws", max_msg_size=0) as socket,
        ):
            messages = Messages(socket)
            await messages.call("wslink.hello", {"secret": secret}, system=True)
            await act(messages, client)

    asyncio.run(run())
