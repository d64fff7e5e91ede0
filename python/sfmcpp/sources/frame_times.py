"""Times of images, as given by the user or found beside them.

The first that there is counts: a frame rate of the user; stamps of the sensors' drive; ``times.txt``, a line
for each image, in seconds, of some clock since 1970 in nanoseconds, or in ISO 8601; KITTI's
``timestamps.txt``, which is that; EuRoC's ``data.csv``, which tells the
time of each image by its name; names of images that are nanoseconds or, with decimals, seconds since 1970;
the times of the frames of a video, or its frame rate; ten a second. Files lie with the images or one folder
above.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from sfmcpp.errors import DatasetError
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import require_positive
from sfmcpp.sources.cameras import file_beside
from sfmcpp.sources.io.csv_text import finite_number, numbered_lines
from sfmcpp.sources.io.files import failures_named, is_folder, read_text_bytes
from sfmcpp.sources.io.iso_times import seconds_of_iso
from sfmcpp.sources.io.number_text import NumberText
from sfmcpp.sources.io.sensor_columns import parse_column
from sfmcpp.sources.vision import Frames

_FOLDER_FPS = 10.0
_TIMES, _KITTI, _EUROC = "times.txt", "timestamps.txt", "data.csv"
_NS = 1e-9
# No clock of seconds is in the year 5138, nor one of nanoseconds in 1973.
_NO_SECONDS, _SURELY_NS = 1e11, 1e17
# Numbers of fewer images tell no usual step, and more gaps than this share are none.
_FEWEST_NUMBERED, _MOST_GAPS = 4, 0.2
_NAMED_BY_NS = re.compile(r"\d{18,19}")
_NAMED_BY_S = re.compile(r"\d{9,10}\.\d{2,9}")

TimeOf = Callable[[int], float]


def times_of_images(
    images: Frames, fps: float | None, stamps: FloatArray | None
) -> tuple[TimeOf, float | None, str | None]:
    """Times of images, their rate where that had to be assumed, and what makes them doubtful.

    Parameters
    ----------
    images : Frames
        A folder or a video.
    fps : float or None
        Images per second; None: something else tells.
    stamps : (n,) float64 or None
        Times as the sensors' drive knows them [s]. With `fps` only the first counts.

    Returns
    -------
    time_of : callable
        Time of the image of a number [s]. It raises a DatasetError for one that has none.
    assumed_fps : float or None
        None where something tells the times.
    doubt : str or None
        A sentence where images are counted and some seem to be missing.

    Raises
    ------
    DatasetError
        If a file of times cannot be read, does not fit the images, or its times do not increase.
    InvalidArgument
        If `fps` is not positive.
    """
    doubt = doubt_of_numbers(images.names)
    if fps is not None:
        require_positive("fps", fps)
        return _even_times(fps, 0.0 if stamps is None else float(stamps[0])), None, doubt
    if stamps is not None:
        if len(stamps) < len(images):
            reason = f"{len(images)} images for {len(stamps)} stamps of the sensors' drive: give --fps"
            raise DatasetError(images.path, reason)
        return _times_of_argument(images.path, stamps), None, doubt
    found = _times_beside_images(images)
    if found is not None:
        return _times_of_argument(images.path, found), None, None
    own_fps = _frame_rate_of_video(images)
    return _times_of_frames(images, own_fps), own_fps if images.fps is None else None, doubt


def doubt_of_numbers(names: Sequence[str]) -> str | None:
    """Tell where images are missing by the numbers in their names; None where they are numbered evenly.

    Parameters
    ----------
    names : sequence of str
        Of images whose times are told by their count, in order.

    Returns
    -------
    str or None
        A sentence; None also where not all names have a number, as it is the last in them.
    """
    found = [re.findall(r"\d+", Path(name).stem) for name in names]
    if len(names) < _FEWEST_NUMBERED or not all(found):
        return None
    steps = np.diff([float(numbers[-1]) for numbers in found])
    usual = float(np.median(steps))
    odd = np.flatnonzero(steps != usual)
    # Names that are numbered otherwise than by time say nothing.
    if not len(odd) or usual <= 0 or (steps <= 0).any() or len(odd) > _MOST_GAPS * len(steps):
        return None
    k = int(odd[0])
    more = f", and {len(odd) - 1} more such gaps" if len(odd) > 1 else ""
    return (
        f"images are missing from {names[k]} to {names[k + 1]} by their numbers{more}, and their times count "
        "those that are there: give times.txt"
    )


def require_as_many(path: Path, count: int, what: str, images: Frames) -> None:
    """As many as images; what a video says of itself can be a few too many.

    Raises
    ------
    DatasetError
        If `count` is another number.
    """
    if count not in range(images.fewest, len(images) + 1):
        raise DatasetError(path, f"holds {count} {what} for {len(images)} images: must be as many")


def _even_times(fps: float, start_s: float = 0.0) -> TimeOf:
    return lambda number: start_s + number / fps


def _times_of_frames(images: Frames, fps: float) -> TimeOf:
    """Times as a video tells them, of frames that are decoded; by their numbers otherwise."""
    counted = _even_times(fps)
    return lambda number: images.stamps[number] if number < len(images.stamps) else counted(number)


def _times_of_argument(source: Path, t_s: FloatArray) -> TimeOf:
    def time_of(number: int) -> float:
        if number >= len(t_s):
            raise DatasetError(source, f"image {number} has no time: {len(t_s)} are known; give --fps")
        return float(t_s[number])

    return time_of


def _frame_rate_of_video(images: Frames) -> float:
    if images.fps is not None:
        return images.fps
    if is_folder(images.path):
        return _FOLDER_FPS
    raise DatasetError(images.path, "the video tells no frame rate: give --fps")


def _times_beside_images(images: Frames) -> FloatArray | None:
    """Times from files or names of images [s]; None if there are none."""
    listed = file_beside(images.path, _TIMES) or _iso_times_beside(images.path)
    if listed is not None:
        return read_times(listed, lambda count: require_as_many(listed, count, "times", images))
    by_name = file_beside(images.path, _EUROC)
    found = None if by_name is None or not images.names else _times_by_name(by_name, images)
    return times_of_names(images) if found is None else found


def _iso_times_beside(images: Path) -> Path | None:
    """KITTI's list of times; other data sets have other lists of that name."""
    path = file_beside(images, _KITTI)
    return path if path is not None and _holds_iso_times(path) else None


def _holds_iso_times(path: Path) -> bool:
    with failures_named(path):
        lines = read_text_bytes(path).decode("utf-8-sig", "replace").splitlines()
    first = next((line for line in lines if line.strip() and not line.lstrip().startswith("#")), "")
    return seconds_of_iso(first) is not None


def read_times(path: Path, require_fit: Callable[[int], None]) -> FloatArray:
    """Read times from the lines of a file, in seconds, since 1970 in nanoseconds, or in ISO 8601.

    Parameters
    ----------
    path : Path
        The file; lines that start with ``#`` are comments.
    require_fit : callable
        Called with the number of times; raises if there should be another.

    Returns
    -------
    (n,) float64
        Times [s], strictly increasing.

    Raises
    ------
    DatasetError
        If the file cannot be read, or times are neither or do not increase; and what `require_fit` raises.
    """
    if _holds_iso_times(path):
        return _read_iso_times(path, require_fit)
    with failures_named(path):
        text = NumberText(path, read_text_bytes(path), comments=True)
    text.require_line_counts(text.lines.count == 1, "1, the time of an image in seconds")
    require_fit(len(text.values))
    values = text.values
    if len(values) and values.min() >= _SURELY_NS:
        values = values * _NS
    elif (values >= _NO_SECONDS).any():
        worst = int(np.argmax(values >= _NO_SECONDS))
        rule = "must be in seconds, or all in nanoseconds since 1970"
        raise text.error(f"time {values[worst]:.19g}: {rule}", worst)
    later = np.diff(values, prepend=-np.inf) > 0
    if not later.all():
        worst = int(np.argmin(later))
        raise text.error(f"time {values[worst]:.15g} s: must be later than the one before", worst)
    return values


def _read_iso_times(path: Path, require_fit: Callable[[int], None]) -> FloatArray:
    lines = [(number, line) for number, line in numbered_lines(path) if not line.lstrip().startswith("#")]
    found = [(number, line, seconds_of_iso(line)) for number, line in lines]
    times: list[float] = []
    for number, line, time_s in found:
        if time_s is None:
            raise DatasetError(path, f"{line.strip()[:40]!r} is no time in ISO 8601 as those before", number)
        if times and time_s <= times[-1]:
            raise DatasetError(path, f"time {line.strip()}: must be later than the one before", number)
        times.append(time_s)
    require_fit(len(times))
    return np.array(times)


def _times_by_name(path: Path, images: Frames) -> FloatArray | None:
    """Times of images that EuRoC's list tells by their names; None if it is another file of that name."""
    lines = numbered_lines(path)
    head, header = next(lines, (1, ""))
    titles = [cell.strip() for cell in header.split(",")]
    if len(titles) != 2 or titles[1].lower() != "filename":
        return None
    try:
        column = parse_column(titles[0])
    except ValueError as error:
        raise DatasetError(path, str(error), head) from None
    factor = 1.0 if column is None else column.factor
    rows = ((number, line.partition(",")) for number, line in lines)
    times = {
        name.strip(): finite_number(path, number, "timestamp", stamp.strip(), factor)
        for number, (stamp, _, name) in rows
    }
    missing = next((name for name in images.names if name not in times), None)
    if missing is not None:
        raise DatasetError(path, f"tells no time of {images.path / missing}: give --fps, or remove one")
    return _require_increasing_times(path, images, np.array([times[name] for name in images.names]))


def times_of_names(images: Frames) -> FloatArray | None:
    """Times of images whose names are nanoseconds, or seconds with decimals, since 1970 [s]; None of others.

    Raises
    ------
    DatasetError
        If they do not increase.
    """
    stems = [Path(name).stem for name in images.names]
    for pattern, unit_s in ((_NAMED_BY_NS, _NS), (_NAMED_BY_S, 1.0)):
        if stems and all(map(pattern.fullmatch, stems)):
            times = np.array([float(stem) for stem in stems]) * unit_s
            return _require_increasing_times(images.path, images, times)
    return None


def _require_increasing_times(path: Path, images: Frames, t_s: FloatArray) -> FloatArray:
    late = np.flatnonzero(np.diff(t_s) <= 0)
    if len(late):
        name, before = images.names[late[0] + 1], images.names[late[0]]
        raise DatasetError(path, f"the time of {name} is {t_s[late[0] + 1]:.9f} s: must be after {before}")
    return t_s
