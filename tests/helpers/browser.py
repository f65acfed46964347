"""A real browser for tests of pages: Chromium without a window, spoken to by the Chrome DevTools Protocol."""

from __future__ import annotations

import asyncio
import json
import re
import shutil
import subprocess
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

BROWSER = next((b for b in map(shutil.which, ("chromium", "chromium-browser", "google-chrome")) if b), None)
browser = pytest.mark.skipif(BROWSER is None, reason="no chromium or google-chrome is installed")
websocket = pytest.importorskip("tornado.websocket")


class NavigatedError(Exception):
    """The tab opened another page before it answered."""


class Tab:
    """One tab of a headless browser, spoken to by the Chrome DevTools Protocol."""

    def __init__(self, socket: Any) -> None:
        self._socket, self._number, self.events = socket, 0, []

    async def call(self, method: str, **parameters: Any) -> dict:
        self._number += 1
        await self._socket.write_message(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            message = json.loads(await asyncio.wait_for(self._socket.read_message(), 30))
            if message.get("id") == self._number:
                if "navigated" in message.get("error", {}).get("message", ""):
                    raise NavigatedError
                assert "error" not in message, message
                return message["result"]
            self.events.append(message)

    async def value(self, expression: str) -> Any:
        result = await self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in result, result
        return result["result"].get("value")

    async def open(self, address: str, ready: str = "true") -> None:
        await self.call("Page.navigate", url=address)
        await self.until(f"document.readyState === 'complete' && ({ready})")

    async def until(self, condition: str) -> None:
        for _ in range(1500):
            # A page that is left while it is asked gives no answer; the next one does.
            with suppress(NavigatedError):
                if await self.value(condition):
                    return
            await asyncio.sleep(0.02)
        raise AssertionError(f"never true: {condition}")

    async def centre(self, selector: str) -> tuple[float, float]:
        x, y = await self.value(
            f"(() => {{ const n = document.querySelector({json.dumps(selector)});"
            "n.scrollIntoView({block: 'nearest'});"
            "const r = n.getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2]; })()"
        )
        return x, y

    async def mouse(self, kind: str, x: float, y: float) -> None:
        button = {"button": "left", "clickCount": 1} if kind != "mouseMoved" else {}
        await self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **button)

    async def click(self, selector: str) -> None:
        x, y = await self.centre(selector)
        for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
            await self.mouse(kind, x, y)


Act = Callable[[Tab], Awaitable[None]]


def visit(page: Path, profile: Path, act: Act, ready: str = "true") -> None:
    """Open a page in a fresh browser without a network, do something there, and see that nothing went wrong.

    Parameters
    ----------
    page : Path
    profile : Path
        A directory for what the browser keeps.
    act : callable
        Is given the tab.
    ready : str
        What is true in JavaScript once the page can be used.
    """
    command = [
        str(BROWSER), "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-quic",
        "--disable-background-networking", "--disable-component-update", "--disable-sync",
        f"--user-data-dir={profile}", "--remote-debugging-port=0", "--remote-allow-origins=*",
        "--window-size=1400,1000",
    ]  # fmt: skip
    with subprocess.Popen([*command, "about:blank"], stderr=subprocess.PIPE, text=True) as process:
        try:
            line = next(line for line in process.stderr if "DevTools listening on" in line)
            asyncio.run(_talk(line.split()[-1], page, act, ready))
        finally:
            process.kill()


async def _talk(address: str, page: Path, act: Act, ready: str) -> None:
    connect = websocket.websocket_connect
    socket = await connect(address)
    browser = Tab(socket)
    target = (await browser.call("Target.createTarget", url="about:blank"))["targetId"]
    socket = await connect(re.sub(r"/devtools/.*", f"/devtools/page/{target}", address), max_message_size=1 << 26)
    tab = Tab(socket)
    for domain in ("Page", "Runtime", "Network", "Log"):
        await tab.call(f"{domain}.enable")
    rates = {"latency": 0, "downloadThroughput": 0, "uploadThroughput": 0}
    await tab.call("Network.emulateNetworkConditions", offline=True, **rates)
    await tab.open(page.as_uri(), ready)
    await act(tab)
    requests = [e["params"]["request"]["url"] for e in tab.events if e["method"] == "Network.requestWillBeSent"]
    assert all(url.startswith(("file:", "data:", "about:")) for url in requests), requests
    wrong = [e for e in tab.events if e["method"] in ("Runtime.exceptionThrown", "Log.entryAdded")]
    assert not wrong, wrong
