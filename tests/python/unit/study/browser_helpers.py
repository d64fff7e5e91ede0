"""Pages as a headless browser draws them."""

from __future__ import annotations

import base64
import io
import json
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
from matplotlib.image import imread

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
OPTIONS = ("--headless=new", "--no-sandbox", "--hide-scrollbars", "--window-size=1000,700")
# What draws in three dimensions without a graphics card.
SOFTWARE_3D = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
TIMEOUT_S = 120


def browser() -> str:
    """Path of a browser; skips the test if there is none."""
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        pytest.skip(f"no browser found: {', '.join(BROWSERS)}")
    return found


def screenshot(page: Path, picture: Path) -> np.ndarray:
    """Pixels (height, width, 3) of a page in a file."""
    profile = f"--user-data-dir={picture.parent / 'profile'}"
    options = [*OPTIONS, "--disable-gpu", profile, "--virtual-time-budget=2000", f"--screenshot={picture}"]
    command = [browser(), *options, page.as_uri()]
    subprocess.run(command, check=True, capture_output=True, timeout=TIMEOUT_S)
    return np.asarray(imread(picture))[:, :, :3]


def screenshot_when(url: str, folder: Path, drawn: Callable[[np.ndarray], bool]) -> np.ndarray:
    """Pixels of a served page, as soon as `drawn` says that they are all there, or at the end of the time."""
    deadline = time.monotonic() + TIMEOUT_S
    with _tab(url, folder, deadline) as ask:
        while True:
            data = base64.b64decode(ask("Page.captureScreenshot")["data"])
            picture = np.asarray(imread(io.BytesIO(data)))[:, :, :3]
            if drawn(picture) or time.monotonic() > deadline:
                return picture
            time.sleep(0.2)


@contextmanager
def _tab(url: str, folder: Path, deadline: float) -> Iterator[Callable[[str], dict[str, Any]]]:
    """Open a page in a browser that takes commands of the Chrome DevTools protocol."""
    from websockets.sync.client import connect

    options = [*OPTIONS, *SOFTWARE_3D, f"--user-data-dir={folder / 'profile'}", "--remote-debugging-port=0"]
    process = subprocess.Popen(
        [browser(), *options, url], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        address = _debugger(folder / "profile/DevToolsActivePort", deadline)
        with connect(address, max_size=None) as socket:

            def ask(method: str) -> dict[str, Any]:
                socket.send(json.dumps({"id": 1, "method": method}))
                while (answer := json.loads(socket.recv(TIMEOUT_S))).get("id") != 1:
                    pass
                result: dict[str, Any] = answer["result"]
                return result

            yield ask
    finally:
        process.terminate()
        process.wait()


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
