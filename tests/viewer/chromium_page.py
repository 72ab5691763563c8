"""A page in headless Chromium, driven over its debugging socket in real time."""

from __future__ import annotations

import base64
import io
import itertools
import json
import shutil
import subprocess
import time
from pathlib import Path
from types import TracebackType
from typing import Any
from urllib.request import urlopen

import numpy as np
from PIL import Image

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")

_FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--remote-debugging-port=0",
    "--remote-allow-origins=*",
)
_BY_SOFTWARE = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
_NOT_AT_ALL = ("--disable-gpu", "--disable-software-rasterizer", "--disable-3d-apis")


class Page:
    """One tab: what it asks the network for, what it complains about, what it shows, and a mouse."""

    def __init__(self, folder: Path, width: int = 800, height: int = 600, draws: bool = True) -> None:
        from websockets.sync.client import connect

        assert CHROMIUM is not None
        flags = (*_FLAGS, *(_BY_SOFTWARE if draws else _NOT_AT_ALL))
        self._process = subprocess.Popen(
            [CHROMIUM, *flags, f"--user-data-dir={folder}", f"--window-size={width},{height}", "about:blank"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        port = self._port(folder / "DevToolsActivePort")
        with urlopen(f"http://127.0.0.1:{port}/json") as answer:
            tabs = json.load(answer)
        address = next(tab["webSocketDebuggerUrl"] for tab in tabs if tab["type"] == "page")
        self._socket = connect(address, max_size=None)
        self._number = itertools.count(1)
        self.requests: list[str] = []
        self.complaints: list[str] = []
        for domain in ("Page", "Runtime", "Network", "Log", "DOM"):
            self.send(f"{domain}.enable")

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command and return its answer; events that come in between are noted."""
        number = next(self._number)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            message = json.loads(self._socket.recv(timeout=180))
            if message.get("id") == number:
                if "error" in message:
                    raise RuntimeError(f"{method}: {message['error']}")
                result: dict[str, Any] = message["result"]
                return result
            self._note(message)

    def go(self, address: str) -> None:
        """Load an address."""
        self.send("Page.navigate", url=address)

    def evaluate(self, script: str) -> Any:
        """Return the value of an expression of the page."""
        answer = self.send("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(str(answer["exceptionDetails"]))
        return answer["result"].get("value")

    def wait_for(self, script: str, seconds: float = 60.0) -> Any:
        """Return the value of an expression as soon as it is true."""
        end = time.monotonic() + seconds
        while True:
            value = self.evaluate(script)
            if value:
                return value
            if time.monotonic() > end:
                raise TimeoutError(f"the page never came to {script}; it complains: {self.complaints}")
            time.sleep(0.1)

    def picture(self) -> np.ndarray:
        """Return what the page shows, shape (height, width, 3)."""
        data = base64.b64decode(self.send("Page.captureScreenshot", format="png")["data"])
        return np.asarray(Image.open(io.BytesIO(data)).convert("RGB")).astype(int)

    def rest(self, seconds: float = 60.0) -> None:
        """Wait until two pictures in a row are alike."""
        end = time.monotonic() + seconds
        last = self.picture()
        while time.monotonic() < end:
            time.sleep(1.0)
            now = self.picture()
            if now.shape == last.shape and (np.abs(now - last).sum(axis=2) > 30).mean() < 1e-3:
                return
            last = now

    def upload(self, path: Path) -> None:
        """Hand a file to the page."""
        document = self.send("DOM.getDocument")["root"]["nodeId"]
        field = self.send("DOM.querySelector", nodeId=document, selector="input[type=file]")["nodeId"]
        self.send("DOM.setFileInputFiles", nodeId=field, files=[str(path)])

    def click_button(self, text: str) -> None:
        """Click the button that says so."""
        self.evaluate(f"[...document.querySelectorAll('button')].find(b => b.innerText.includes({text!r})).click()")

    def mouse(self, kind: str, x: float, y: float) -> None:
        """Send a mouse event: ``mouseMoved``, ``mousePressed`` or ``mouseReleased``."""
        self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)

    def drag(self, start: tuple[float, float], end: tuple[float, float], steps: int = 12, release: bool = True) -> None:
        """Drag from here to there in steps, and let go unless told otherwise."""
        self.send("Input.dispatchMouseEvent", type="mouseMoved", x=start[0], y=start[1])
        time.sleep(0.3)  # what lies under the mouse is found between frames
        self.mouse("mousePressed", *start)
        for step in range(1, steps + 1):
            share = step / steps
            x, y = (a + share * (b - a) for a, b in zip(start, end, strict=True))
            self.mouse("mouseMoved", x, y)
            time.sleep(0.03)
        if release:
            self.mouse("mouseReleased", *end)

    def close(self) -> None:
        """End the browser."""
        self._socket.close()
        self._process.terminate()
        self._process.wait(10)

    def __enter__(self) -> Page:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _port(self, note: Path) -> int:
        end = time.monotonic() + 60.0
        while time.monotonic() < end:
            if note.exists() and (lines := note.read_text().split()):
                return int(lines[0])
            time.sleep(0.05)
        raise TimeoutError("Chromium did not start")

    def _note(self, message: dict[str, Any]) -> None:
        method, given = message.get("method"), message.get("params", {})
        if method == "Network.requestWillBeSent":
            self.requests.append(given["request"]["url"])
        elif method == "Runtime.exceptionThrown":
            self.complaints.append(str(given["exceptionDetails"].get("exception", {}).get("description")))
        elif method == "Log.entryAdded" and given["entry"]["level"] == "error":
            self.complaints.append(given["entry"]["text"])
        elif method == "Runtime.consoleAPICalled" and given["type"] == "error":
            self.complaints.append(" ".join(str(part.get("value", part.get("description"))) for part in given["args"]))
