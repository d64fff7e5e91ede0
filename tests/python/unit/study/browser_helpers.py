"""Pages as a headless browser draws them, and the scenes that they hold."""

from __future__ import annotations

import base64
import io
import json
import re
import shutil
import subprocess
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import TIMEOUT_S
from matplotlib.image import imread

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
OPTIONS = ("--headless=new", "--no-sandbox", "--hide-scrollbars", "--window-size=1000,700")
# What draws in three dimensions without a graphics card.
SOFTWARE_3D = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
_SCENE = re.compile(r'<script type="application/json" id="scene">(.*?)</script>', re.DOTALL)

Ask = Callable[..., dict[str, Any]]


def browser() -> str:
    """Path of a browser; skips the test if there is none."""
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        pytest.skip(f"no browser found: {', '.join(BROWSERS)}")
    return found


def screenshot(page: Path, picture: Path, size: tuple[int, int] | None = None) -> np.ndarray:
    """Pixels (height, width, 3) of a page in a file."""
    profile = f"--user-data-dir={picture.parent / 'profile'}"
    options = [*OPTIONS, "--disable-gpu", profile, "--virtual-time-budget=2000", f"--screenshot={picture}"]
    if size is not None:
        options.append(f"--window-size={size[0]},{size[1]}")
    command = [browser(), *options, page.as_uri()]
    subprocess.run(command, check=True, capture_output=True, timeout=TIMEOUT_S)
    return np.asarray(imread(picture))[:, :, :3]


def screenshot_when(url: str, folder: Path, drawn: Callable[[np.ndarray], bool]) -> np.ndarray:
    """Pixels of a served page, as soon as `drawn` says that they are all there, or at the end of the time."""
    deadline = time.monotonic() + TIMEOUT_S
    with opened(url, folder, SOFTWARE_3D) as ask:
        while True:
            data = base64.b64decode(ask("Page.captureScreenshot")["data"])
            picture = np.asarray(imread(io.BytesIO(data)))[:, :, :3]
            if drawn(picture) or time.monotonic() > deadline:
                return picture
            time.sleep(0.2)


@contextmanager
def opened(url: str, folder: Path, more_options: tuple[str, ...] = ("--disable-gpu",)) -> Iterator[Ask]:
    """Open a page in a browser that takes commands of the Chrome DevTools protocol."""
    connect = pytest.importorskip("websockets.sync.client", reason="websockets is not installed").connect
    deadline = time.monotonic() + TIMEOUT_S
    options = [*OPTIONS, *more_options, f"--user-data-dir={folder / 'profile'}", "--remote-debugging-port=0"]
    process = subprocess.Popen(
        [browser(), *options, url], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        address = _debugger(folder / "profile/DevToolsActivePort", deadline)
        with connect(address, max_size=None) as socket:

            def ask(method: str, **parameters: Any) -> dict[str, Any]:
                socket.send(json.dumps({"id": 1, "method": method, "params": parameters}))
                while (answer := json.loads(socket.recv(TIMEOUT_S))).get("id") != 1:
                    pass
                result: dict[str, Any] = answer["result"]
                return result

            yield ask
    finally:
        process.terminate()
        process.wait()


@contextmanager
def opened_at(
    url: str, folder: Path, width: int, height: int, more_options: tuple[str, ...] = ("--disable-gpu",)
) -> Iterator[Ask]:
    """Open a page in a window of that many pixels; a narrow one is that of a phone."""
    with opened("about:blank", folder, more_options) as ask:
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
        ask("Emulation.setDeviceMetricsOverride", **size)
        ask("Page.navigate", url=url)
        yield ask


def value_of(ask: Ask, expression: str) -> Any:
    """Value of a JavaScript expression in the page, once all of the page is there."""
    deadline = time.monotonic() + TIMEOUT_S
    # A new tab is empty, and complete, before it begins to load.
    ready = "location.href !== 'about:blank' && document.readyState === 'complete'"
    while not ask("Runtime.evaluate", expression=ready)["result"].get("value"):
        assert time.monotonic() < deadline, "the page is not loaded"
        time.sleep(0.05)
    answer = ask("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
    assert "exceptionDetails" not in answer, answer
    return answer["result"].get("value")


def click(ask: Ask, x: float, y: float) -> None:
    """Press and let go of the left button of the mouse at a place of the window."""
    for kind in ("mousePressed", "mouseReleased"):
        ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)


def _debugger(port_file: Path, deadline: float) -> str:
    """Address at which the browser takes commands for its page."""
    while time.monotonic() < deadline:
        lines = port_file.read_text().splitlines() if port_file.exists() else []
        if len(lines) == 2:
            with urllib.request.urlopen(f"http://127.0.0.1:{lines[0]}/json") as answer:
                pages = [target for target in json.load(answer) if target["type"] == "page"]
            if pages:
                return str(pages[0]["webSocketDebuggerUrl"])
        time.sleep(0.1)
    raise TimeoutError("the browser opened no page")


def scene_in(page: str, **widths: int) -> dict[str, Any]:
    """The scene that a page holds, with these of its arrays decoded, in rows of so many numbers."""
    match = _SCENE.search(page)
    assert match is not None
    content: dict[str, Any] = json.loads(match[1])
    for name, width in widths.items():
        content[name] = np.frombuffer(base64.b64decode(content[name]), "<f4").reshape(-1, width)
    return content
