"""Charts for pages, as SVG text or pictures of pixels, in the colours of the page's style."""

from __future__ import annotations

import html
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model.arrays import FloatArray
from sfmcpp.study.sfm_measures import ResidualMap

_WIDTH, _HEIGHT = 480, 200
_LEFT, _RIGHT, _TOP, _BOTTOM = 58, 8, 10, 34
# Arrows of residuals: the longest that is not cut, in cells.
_LONGEST_ARROW = 1.0
_CAMERA = (213, 94, 0, 255)
# Steps from few to many inliers, even in lightness.
_RAMP = np.array(
    [[222, 235, 247], [158, 202, 225], [66, 146, 198], [8, 81, 156], [8, 48, 107]], dtype=np.float64
)
_MOST_CELLS = 500
_MOST = (0.01, 0.99)  # of the points, along each axis
_FAR = 1.5  # times as far from the middle as most are: not shown
Pixels = NDArray[np.uint8]


def nice_ticks(highest: float, count: int = 4) -> list[float]:
    """Round numbers from 0 to just above `highest`, about `count` steps."""
    if not highest > 0:
        return [0.0, 1.0]
    raw = highest / count
    power = 10.0 ** np.floor(np.log10(raw))
    step = float(power * next(s for s in (1, 2, 2.5, 5, 10) if s * power >= raw * (1 - 1e-9)))
    return [float(f"{i * step:.12g}") for i in range(int(np.ceil(highest / step - 1e-9)) + 1)]


def bars(
    values: Sequence[float | None],
    titles: Sequence[str],
    *,
    x_label: str,
    y_label: str,
    marked: Sequence[bool] | None = None,
    tick_labels: Sequence[tuple[float, str]] = (),
) -> str:
    """Draw a bar for each value, with a title that shows under the pointer; none where a value is None.

    Parameters
    ----------
    values : sequence of float or None
        Heights.
    titles : sequence of str
        What is said of each.
    x_label, y_label : str
        What the axes are.
    marked : sequence of bool, optional
        Bars in the second colour.
    tick_labels : sequence of (float, str)
        Places along the horizontal axis, counted in bars, and what stands there.
    """
    ticks = nice_ticks(max((v for v in values if v is not None), default=0.0))
    wide, high = _WIDTH - _LEFT - _RIGHT, _HEIGHT - _TOP - _BOTTOM
    step, gap = wide / max(len(values), 1), 0.18 if len(values) <= 120 else 0.0
    parts = [_grid(ticks, high, wide)]
    for number, (value, title) in enumerate(zip(values, titles, strict=True)):
        if value is None:
            continue
        height = high * value / ticks[-1]
        kind = "bar marked" if marked is not None and marked[number] else "bar"
        x, y = _LEFT + step * (number + gap / 2), _TOP + high - height
        size = f'x="{x:.2f}" y="{y:.2f}" width="{step * (1 - gap):.2f}" height="{height:.2f}"'
        parts.append(f'<rect class="{kind}" {size}><title>{html.escape(title)}</title></rect>')
    for place, text in tick_labels:
        x = _LEFT + step * place
        parts.append(f'<text class="tick" x="{x:.1f}" y="{_HEIGHT - 20}" text-anchor="middle">{text}</text>')
    parts.append(_axis_labels(x_label, y_label))
    return _svg(_WIDTH, _HEIGHT, "".join(parts), f"{y_label} by {x_label}")


def histogram(values: FloatArray, edges: FloatArray, *, x_label: str, y_label: str) -> str:
    """Draw how many of some values lie between edges; those above the last stand in the last bar.

    Parameters
    ----------
    values : (n,) float64
        What is counted.
    edges : (b + 1,) float64
        Where bars begin and end.
    x_label, y_label : str
        What the axes are.
    """
    counts = np.histogram(np.clip(values, edges[0], edges[-1]), edges)[0]
    ranges = [f"{a:g} – {b:g}: {c:,}" for a, b, c in zip(edges[:-1], edges[1:], counts.tolist(), strict=True)]
    every = max(1, len(counts) // 5)
    labels = [(float(place), f"{edges[place]:g}") for place in range(0, len(edges), every)]
    return bars(counts.tolist(), ranges, x_label=x_label, y_label=y_label, tick_labels=labels)


def arrows(residuals: ResidualMap) -> tuple[str, float]:
    """Draw mean residuals over an image; also how many pixels of residual one cell's width stands for."""
    rows, columns = residuals.counts.shape
    cell = _WIDTH / columns
    lengths = np.linalg.norm(residuals.means, axis=2)
    is_known = np.isfinite(lengths)
    scale = float(nice_ticks(float(np.quantile(lengths[is_known], 0.95)), 1)[-1]) if is_known.any() else 1.0
    darkest = max(int(residuals.counts.max()), 1)
    parts = []
    for row, column in np.ndindex(rows, columns):
        x, y = column * cell, row * cell
        share = residuals.counts[row, column] / darkest
        size = f'x="{x:.2f}" y="{y:.2f}" width="{cell:.2f}" height="{cell:.2f}"'
        title = f"{residuals.counts[row, column]:,} observations"
        if is_known[row, column]:
            dx, dy = residuals.means[row, column]
            title += f", mean ({dx:+.3f}, {dy:+.3f}) px"
        look = f'class="cell" fill-opacity="{0.5 * share:.3f}"'
        parts.append(f"<rect {look} {size}><title>{title}</title></rect>")
        if is_known[row, column]:
            parts.append(_arrow(x + cell / 2, y + cell / 2, dx, dy, cell / scale, cell * _LONGEST_ARROW))
    frame = f'<rect class="frame" x="0.5" y="0.5" width="{_WIDTH - 1}" height="{rows * cell - 1:.2f}"/>'
    return _svg(_WIDTH, round(rows * cell, 2), "".join(parts) + frame, "mean residuals"), scale


def match_squares(
    names: Sequence[str], firsts: NDArray[np.intp], seconds: NDArray[np.intp], inliers: NDArray[np.intp]
) -> str:
    """Draw which images match: a square for each two, whose names show under the pointer.

    Parameters
    ----------
    names : sequence of str
        Images.
    firsts, seconds, inliers : (p,) int
        Images of each pair, and how many matches agree; 0 for a pair that was tried and does not match.
    """
    cell, most = _WIDTH / max(len(names), 1), max(int(inliers.max(initial=0)), 1)
    parts = []
    for a, b, count in zip(firsts.tolist(), seconds.tolist(), inliers.tolist(), strict=True):
        title = html.escape(f"{names[a]} – {names[b]}: {f'{count:,} inliers' if count else 'no match'}")
        shade = 0.12 + 0.88 * (count / most) ** 0.5
        look = f'class="bar" fill-opacity="{shade:.3f}"' if count else 'class="tried"'
        for row, column in ((a, b), (b, a)):
            place = f'x="{column * cell:.2f}" y="{row * cell:.2f}" width="{cell:.2f}" height="{cell:.2f}"'
            parts.append(f"<rect {look} {place}><title>{title}</title></rect>")
    for number in range(len(names)):
        at = number * cell
        place = f'x="{at:.2f}" y="{at:.2f}" width="{cell:.2f}" height="{cell:.2f}"'
        parts.append(f'<rect class="self" {place}><title>{html.escape(names[number])}</title></rect>')
    return _svg(_WIDTH, _WIDTH, "".join(parts), "matrix of matching images")


def _arrow(x: float, y: float, dx: float, dy: float, zoom: float, longest: float) -> str:
    length = float(np.hypot(dx, dy)) * zoom
    if length < 0.3:
        return f'<circle class="arrow" cx="{x:.2f}" cy="{y:.2f}" r="0.8"/>'
    shrink = min(1.0, longest / length)
    u, v = dx * zoom * shrink, dy * zoom * shrink
    # Barbs: a fifth of the arrow, turned by 30 degrees against it.
    ends = [(x + u - 0.3 * (0.87 * u - s * v), y + v - 0.3 * (0.87 * v + s * u)) for s in (0.5, -0.5)]
    (ax, ay), (bx, by) = ends
    tip = f"{x + u:.2f} {y + v:.2f}"
    return f'<path class="arrow" d="M{x:.2f} {y:.2f}L{tip}M{ax:.2f} {ay:.2f}L{tip}L{bx:.2f} {by:.2f}"/>'


def _grid(ticks: Sequence[float], high: float, wide: float) -> str:
    parts = []
    for tick in ticks:
        y = _TOP + high * (1 - tick / ticks[-1])
        parts.append(f'<path class="grid" d="M{_LEFT} {y:.2f}h{wide:.2f}"/>')
        text = f"{tick:,.0f}" if tick >= 1000 else f"{tick:g}"
        parts.append(f'<text class="tick" x="{_LEFT - 5}" y="{y + 4:.2f}" text-anchor="end">{text}</text>')
    return "".join(parts)


def _axis_labels(x_label: str, y_label: str) -> str:
    below = f'x="{(_WIDTH + _LEFT) / 2}" y="{_HEIGHT - 4}"'
    beside = f'transform="translate(10 {(_HEIGHT - _BOTTOM + _TOP) / 2}) rotate(-90)"'
    return "".join(
        f'<text class="label" {place} text-anchor="middle">{html.escape(label)}</text>'
        for place, label in ((below, x_label), (beside, y_label))
    )


def _svg(width: float, height: float, body: str, name: str) -> str:
    title = html.escape(name, quote=True)
    return f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="{title}">{body}</svg>'


def top_view(
    points: FloatArray, colors: NDArray[np.uint8], centres: FloatArray, size: tuple[int, int] = (640, 400)
) -> Pixels:
    """Draw a model as from above, what is higher over what is lower; transparent where there is nothing.

    The few points that lie far off are left out; nothing is cut at the edges.

    Parameters
    ----------
    points : (N, 3) float64
        x right, y ahead, z up.
    colors : (N, 3) uint8
        Their colours.
    centres : (K, 3) float64
        Centres of the cameras, drawn as dots.
    size : (int, int)
        Width and height of the picture [px].
    """
    width, height = size
    picture: Pixels = np.zeros((height, width, 4), dtype=np.uint8)
    is_near = _near_the_others(points)
    points, colors = points[is_near], colors[is_near]
    low, high = _box(np.concatenate([centres, points]))
    middle, spans = (low + high) / 2, high - low
    scale = min((width - 24) / max(spans[0], 1e-12), (height - 24) / max(spans[1], 1e-12))
    order = np.argsort(points[:, 2], kind="stable")
    at = _pixels(points[order], middle, scale, size)
    rgba = np.concatenate([colors[order], np.full((len(points), 1), 255, dtype=np.uint8)], axis=1)
    for dx, dy in np.ndindex(2, 2):
        _draw_dot(picture, at + np.array([dx, dy]), rgba)
    marks = _pixels(centres, middle, scale, size)
    for dx in range(-3, 4):
        for dy in range(-3, 4):
            if dx * dx + dy * dy <= 10:
                _draw_dot(picture, marks + np.array([dx, dy]), np.array(_CAMERA, dtype=np.uint8))
    return picture


def _near_the_others(points: FloatArray) -> NDArray[np.bool_]:
    """Mask (N,) of the points that do not lie far off, as seen from above."""
    if not len(points):
        return np.zeros(0, dtype=np.bool_)
    flat = points[:, :2]
    middle, (low, high) = np.median(flat, axis=0), np.quantile(flat, _MOST, axis=0)
    inside = (flat >= middle + _FAR * (low - middle)) & (flat <= middle + _FAR * (high - middle))
    return np.asarray(inside.all(axis=1))


def _box(places: FloatArray) -> FloatArray:
    """Least and largest coordinates (2, 3)."""
    if not len(places):
        return np.array([[-0.5] * 3, [0.5] * 3])
    return np.stack([places.min(axis=0), places.max(axis=0)])


def _pixels(places: FloatArray, middle: FloatArray, scale: float, size: tuple[int, int]) -> NDArray[np.int64]:
    flat = (places[:, :2] - middle[:2]) * (scale, -scale) + (size[0] / 2, size[1] / 2)
    # Far outside is as good as just outside.
    return np.asarray(np.floor(np.clip(flat, -100, 100_000)), dtype=np.int64)


def _draw_dot(picture: Pixels, at: NDArray[np.int64], rgba: Pixels) -> None:
    inside = ((at >= 0) & (at < (picture.shape[1], picture.shape[0]))).all(axis=1)
    x, y = at[inside].T
    picture[y, x] = rgba[inside] if rgba.ndim == 2 else rgba


def match_matrix(
    count: int, firsts: NDArray[np.intp], seconds: NDArray[np.intp], inliers: NDArray[np.intp]
) -> Pixels:
    """Draw which of `count` images match: a cell for each two, or for each two groups of many images.

    Parameters
    ----------
    count : int
        Images.
    firsts, seconds, inliers : (p,) int
        Images of each pair, and how many matches agree; 0 for a pair that was tried and does not match.
    """
    cells = max(1, min(count, _MOST_CELLS))
    group = -(-max(count, 1) // cells)
    cells = -(-max(count, 1) // group)
    most = np.zeros((cells, cells))
    tried = np.zeros((cells, cells), dtype=np.bool_)
    for a, b in ((firsts, seconds), (seconds, firsts)):
        np.maximum.at(most, (a // group, b // group), inliers)
        tried[a // group, b // group] = True
    picture: Pixels = np.full((cells, cells, 4), (0, 0, 0, 0), dtype=np.uint8)
    picture[tried] = (128, 128, 128, 40)
    share = np.sqrt(most / max(float(most.max(initial=0)), 1.0)) * (len(_RAMP) - 1)
    shown = most > 0
    steps = np.arange(len(_RAMP))
    rgb = np.stack([np.interp(share[shown], steps, channel) for channel in _RAMP.T], axis=1)
    picture[shown] = np.concatenate([rgb, np.full((len(rgb), 1), 255)], axis=1).astype(np.uint8)
    picture[np.arange(cells), np.arange(cells)] = (128, 128, 128, 160)
    zoom = max(1, 480 // cells)
    return np.repeat(np.repeat(picture, zoom, axis=0), zoom, axis=1)
