"""Photos drawn for tests: texture of all sizes, blobs at known places, and files with EXIF blocks."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]


def texture(height: int, width: int, seed: int = 0) -> Picture:
    """(height, width, 3) grey noise that is as strong at every size, and the same for each seed."""
    rng = np.random.default_rng(seed)
    total = np.zeros((height, width))
    for cell in (2, 4, 8, 16, 32):
        grid = rng.normal(size=(height // cell + 2, width // cell + 2))
        total += _interpolated(grid, height, width, cell)
    total = 128 + 60 * (total - total.mean()) / total.std()
    return np.repeat(total.clip(0, 255).astype(np.uint8)[:, :, None], 3, axis=2)


def _interpolated(grid: NDArray[np.float64], height: int, width: int, cell: int) -> NDArray[np.float64]:
    y, x = np.arange(height) / cell, np.arange(width) / cell
    rows, columns = y.astype(int), x.astype(int)
    a, b = (y - rows)[:, None], (x - columns)[None, :]
    upper = grid[rows][:, columns] * (1 - b) + grid[rows][:, columns + 1] * b
    lower = grid[rows + 1][:, columns] * (1 - b) + grid[rows + 1][:, columns + 1] * b
    return upper * (1 - a) + lower * a


def blobs(height: int, width: int, centres: NDArray[np.float64], sigma: float) -> Picture:
    """(height, width, 3) bright Gaussian blobs; the centre of the top left pixel is at (0.5, 0.5)."""
    x, y = np.arange(width) + 0.5, np.arange(height) + 0.5
    total = np.full((height, width), 40.0)
    for cx, cy in centres:
        total += 180 * np.outer(
            np.exp(-((y - cy) ** 2) / (2 * sigma**2)), np.exp(-((x - cx) ** 2) / (2 * sigma**2))
        )
    return np.repeat(total.clip(0, 255).round().astype(np.uint8)[:, :, None], 3, axis=2)


def write_photo(path: Path, pixels: Picture, tags: Mapping[int, Any] | None = None, **blocks: Any) -> Path:
    """A file of the format that its suffix says, `tags` in its main block, others in `exif` and `gps`."""
    from PIL import Image

    exif = Image.Exif()
    exif.update(tags or {})
    for name, number in (("exif", 0x8769), ("gps", 0x8825)):
        exif.get_ifd(number).update(blocks.get(name, {}))
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(path, exif=exif)
    return path


def cut_short(path: Path, part: float = 0.6) -> Path:
    """The file without its end."""
    data = path.read_bytes()
    path.write_bytes(data[: int(part * len(data))])
    return path
