"""Building blocks of pages: templates and scripts of this folder, packed arrays, pictures."""

from __future__ import annotations

import base64
import html
import json
import re
import struct
import zlib
from importlib.resources import files
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from sfmcpp.sources.io.atomic import atomic_files

_HERE = "sfmcpp.study.pages"
_PNG_HEADER = b"\x89PNG\r\n\x1a\n"
_PNG_COLOR_TYPES = {3: 2, 4: 6}


def template(name: str) -> str:
    """Text of a template or script of this folder."""
    return files(_HERE).joinpath(name).read_text(encoding="utf-8")


def filled_page(name: str, title: str, scene: Any) -> str:
    """Page of a scene in three dimensions: a template with its title, data and the script that turns it."""
    scripts = "".join(map(template, ("orbit.js", "fit.js", "gauges.js")))
    return filled(name, orbit=scripts, title=html.escape(title), scene=script(scene))


def filled(name: str, **given: str) -> str:
    """A template with its places filled at once: a title may hold the name of another place."""
    return re.sub("{{(" + "|".join(given) + ")}}", lambda place: given[place[1]], template(name))


def save_page(text: str, path: str | PathLike[str]) -> None:
    """Write a page; the file appears complete or not at all.

    Raises
    ------
    DatasetError
        If the file cannot be written.
    """
    with atomic_files(Path(path)) as (stream,):
        stream.write(text.encode("utf-8", "replace"))  # names of files may be bytes that are no text


def script(data: Any) -> str:
    """JSON that is safe inside a script element."""
    return json.dumps(data, ensure_ascii=True, allow_nan=False).replace("<", "\\u003c")


def packed(array: NDArray[Any], dtype: DTypeLike = "<f4") -> str:
    """Base64 of the numbers of an array, little-endian."""
    return base64.b64encode(np.ascontiguousarray(array, dtype=dtype).tobytes()).decode("ascii")


def data_uri(kind: str, content: bytes) -> str:
    """Data URI of a file: `kind` is its MIME type, as ``image/jpeg``."""
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"


def png_bytes(pixels: NDArray[np.uint8]) -> bytes:
    """Make a PNG file of (height, width, 3 or 4) pixels; the same pixels give the same bytes."""
    height, width, channels = pixels.shape
    head = struct.pack(">IIBBBBB", width, height, 8, _PNG_COLOR_TYPES[channels], 0, 0, 0)
    # Each row begins with the number of its filter: none.
    rows = np.zeros((height, 1 + width * channels), dtype=np.uint8)
    rows[:, 1:] = pixels.reshape(height, -1)
    body = zlib.compress(rows.tobytes(), 9)
    return b"".join([_PNG_HEADER, _chunk(b"IHDR", head), _chunk(b"IDAT", body), _chunk(b"IEND", b"")])


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
