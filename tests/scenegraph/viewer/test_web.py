"""The viewer in a browser: the page, what it asks for, and a person in front of it."""

from __future__ import annotations

import asyncio
import socket
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest

from driven_browser import CHROMIUM, Browser, Messages, browse, served, talk, until
from scenegraph.viewer import web

pytestmark = pytest.mark.gl
pytest.importorskip("trame_pyvista", reason="needs the extra 'web'")
PIPELINES = ("--pipeline", "frustum | contribution", "--pipeline", "none")


def test_the_page_and_its_messages(tmp_path: Path) -> None:
    """Without a browser: every control does what the same key does in a window."""

    async def act(messages: Messages, client: Any) -> None:
        async with client.get(address) as answer:
            page = await answer.text()
            assert answer.status == 200
            assert "<html" in page

        async def state(name: str) -> Any:
            return (await messages.call("trame.state.get"))["state"][name]

        async def trigger(name: str, *arguments: Any) -> None:
            await messages.call("trame.trigger", name, list(arguments), {})

        objects, drawn = await state("objects"), await state("drawn")
        assert 0 < drawn < objects
        stages = await state("stages")
        assert [s["name"] for s in stages] == ["frustum", "contribution"]
        assert [p["name"] for p in stages[1]["parameters"]] == ["pixels"]
        await trigger("slide", "contribution", "pixels", 0.5, True)
        assert await state("drawn") < drawn
        await trigger("slide", "contribution", "pixels", 0.0, True)
        await trigger("toggle_stage", 0)
        assert await state("drawn") == objects
        assert not (await state("stages"))[0]["on"]
        await trigger("press", "1")
        assert await state("drawn") == drawn
        for action, mode in (("toggle_freeze", "culling camera frozen"), ("toggle_hidden", "hidden objects")):
            await trigger("act", action)
            assert mode in await state("modes")
        await trigger("press", "ArrowUp")
        assert await state("drawn") == drawn
        await trigger("press", "Tab")
        assert await state("stages") == []
        # nonsense changes nothing, and ends nothing
        for call in (("act", "quit"), ("act", "__init__"), ("press", "q"), ("slide", "none", "pixels", 2.0, True)):
            await trigger(*call)
        assert await state("objects") == objects

    with served(tmp_path, *PIPELINES) as address:
        talk(address, act)
        # nobody else is served
        assert address.startswith("http://127.0.0.1:")
        port = urlsplit(address).port
        open_ports = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
        mine = {f[1].split(":")[0] for f in open_ports if f[3] == "0A" and int(f[1].split(":")[1], 16) == port}
        assert mine == {f"{int.from_bytes(socket.inet_aton('127.0.0.1'), 'little'):08X}"}
    assert "Traceback" not in (tmp_path / "server.txt").read_text()


def test_who_does_not_know_the_secret_is_not_served(tmp_path: Path) -> None:
    """Neither state nor control; the page that everybody may load does not hold the secret either."""

    async def act() -> None:
        import aiohttp

        parts = urlsplit(address)
        (secret,) = parse_qs(parts.query)["secret"]
        assert len(secret) >= 43
        async with aiohttp.ClientSession() as client:
            for guess in ({"secret": "wslink-secret"}, {"secret": ""}, {"secret": secret[:-1]}, {}, None):
                async with client.ws_connect(f"http://{parts.netloc}/ws", max_msg_size=0) as websocket:
                    messages = Messages(websocket)
                    if guess is not None:
                        answer = await messages.answer("wslink.hello", guess, system=True)
                        assert "Authentication failed" in str(answer["error"])
                        assert "result" not in answer
                    for call in (("trame.state.get",), ("trame.trigger", "press", ["1"], {})):
                        answer = await messages.answer(*call)
                        assert "Unauthorized" in str(answer["error"]), call
                        assert "result" not in answer
            async with client.get(f"http://{parts.netloc}/") as answer:
                assert secret not in await answer.text()
        assert secret not in (tmp_path / "server.txt").read_text()

    async def undisturbed(messages: Messages, _: Any) -> None:
        state = (await messages.call("trame.state.get"))["state"]
        assert [s["on"] for s in state["stages"]] == [True, True], "nobody has switched a stage off"

    with served(tmp_path, *PIPELINES) as address:
        asyncio.run(act())
        talk(address, undisturbed)
    with served(tmp_path, *PIPELINES) as again:
        assert urlsplit(again).query != urlsplit(address).query, "each run has a secret of its own"


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium installed")
def test_in_a_browser(tmp_path: Path) -> None:
    async def act(browser: Browser) -> None:
        async def shows() -> bool:
            return await browser.value("document.querySelector('.view img')?.naturalWidth > 100")

        await until("a picture", shows)
        box = await browser.box(".view")

        async def settled() -> np.ndarray:
            """The picture, once two in a row are equal."""
            last = [await browser.picture(".view")]

            async def same() -> bool:
                last.append(await browser.picture(".view"))
                return np.array_equal(last[-1], last[-2])

            await until("a picture that stays", same)
            return last[-1]

        async def changed(before: np.ndarray) -> np.ndarray:
            async def differs() -> bool:
                now = await browser.picture(".view")
                return now.shape != before.shape or bool((now != before).any(axis=2).mean() > 0.003)

            await until("another picture", differs)
            return await settled()

        # the message that greets goes away by itself
        first = await settled()
        assert len(np.unique(first.reshape(-1, 3), axis=0)) > 50
        await browser.keep("web-first")
        said = await browser.text("#drawn")

        async def says_something_else() -> bool:
            return await browser.text("#drawn") != said

        slider = await browser.box(".slider-contribution-pixels .v-slider__container")
        y = slider["y"] + slider["height"] / 2
        await browser.drag((slider["x"] + 2, y), (slider["x"] + 0.6 * slider["width"], y))
        await until("another number", says_something_else)
        second = await changed(first)
        await browser.keep("web-slider")
        said = await browser.text("#drawn")
        await browser.click(".stage-contribution .v-switch__track")
        await until("another number", says_something_else)
        third = await changed(second)
        await browser.click(".action-toggle_help")
        fourth = await changed(third)
        await browser.keep("web-keys")
        await browser.click(".action-toggle_help")
        await changed(fourth)
        # a look around
        middle = (box["x"] + box["width"] * 0.6, box["y"] + box["height"] * 0.7)
        before = await settled()
        await browser.drag(middle, (middle[0] + 120, middle[1]))
        await changed(before)

    with served(tmp_path, *PIPELINES) as address:
        browse(tmp_path, address, act)
    assert "Traceback" not in (tmp_path / "server.txt").read_text()


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium installed")
def test_the_page_may_be_reloaded(tmp_path: Path) -> None:
    async def act(browser: Browser) -> None:
        async def shows() -> bool:
            return await browser.value("!window.old && document.querySelector('.view img')?.naturalWidth > 100")

        await until("a picture", shows)
        await browser.value("window.old = true")
        await browser.send("Page.reload")
        await until("a picture again", shows)

    with served(tmp_path, *PIPELINES) as address:
        browse(tmp_path, address, act)


def test_the_secret_is_on_no_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    web._open("http://127.0.0.1:1/?secret=a-b_c", tmp_path)
    (told,) = opened
    assert told.startswith("file:")
    assert "a-b_c" not in told
    page = Path(urlsplit(told).path)
    assert page.parent == tmp_path
    assert 'content="0; url=http://127.0.0.1:1/?secret=a-b_c"' in page.read_text()
