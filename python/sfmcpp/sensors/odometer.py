"""Odometer: travelled distance and displacement, and stretches of implausible speed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sfmcpp.geometry import so3
from sfmcpp.model import Gap, SensorStream
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors.mounting import Mounting
from sfmcpp.sensors.stream import (
    interpolate_vectors,
    measured_at,
    require_interval,
    require_kind,
    segments,
)
from sfmcpp.sensors.turn import Turn, rotations_of

# An odometer is dead if for so many pairs of images in a row it moves by at most this share of its usual
# distance, the quantile `_USUAL` of all pairs.
_FEWEST_PAIRS, _DEAD_SHARE, _USUAL = 4, 0.02, 0.9
# Images show a step if their parallax is more than this [px], and this share of its median: that of a body
# which stands or hovers is noise and sway. If the camera turns by more than so much, the step must go about
# where it usually goes: beside the axis of a body that turns on the spot it goes aside [rad].
_LEAST_PARALLAX_PX, _SEEN_SHARE = 1.0, 0.1
_LARGEST_TURN_RAD, _LARGEST_ASIDE_RAD = np.radians([5.0, 45.0]).tolist()
# A body is taken to turn evenly for so long [s]: over two seconds of KITTI's 0036 that costs as much as the
# odometer's own error, over eight ten times as much.
_EVEN_TURN_S = 0.5
# Shorter steps determine no scale.
LEAST_STEP_M = 0.05


@checked()
def travelled_distance(stream: SensorStream, start_s: float, end_s: float) -> float | None:
    """Distance along the path between two times, backwards negative.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"speed"``, ``"distance"`` or ``"velocity"`` (whose norm is taken).
    start_s, end_s : float
        The interval [s].

    Returns
    -------
    float or None
        Distance [m]: the integral of the speed, or the difference of the distances at both ends. None if the
        stream does not cover the interval.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind, or the interval is none.
    """
    require_kind(stream, "speed", "distance", "velocity")
    require_interval(start_s, end_s)
    if not stream.covers(start_s, end_s):
        return None
    if stream.kind == "distance":
        start, end = measured_at(stream, np.array([start_s, end_s]))[:, 0]
        return float(end - start)
    middles_s, lengths_s = segments(start_s, end_s, stream)
    values = measured_at(stream, middles_s)
    if stream.kind == "velocity":
        return float(np.linalg.norm(values, axis=1) @ lengths_s)
    return float((values[:, 0] * lengths_s).sum())


@checked(turn=(3, 3))
def camera_displacement(
    stream: SensorStream, start_s: float, end_s: float, mounting: Mounting, turn: FloatArray
) -> FloatArray | None:
    """Step of a camera on the body between two times: in a bend it is not that of the body.

    The body is taken to turn at a constant rate: at a constant velocity its chord is then sin(θ/2)/(θ/2) of
    its way, and half the turn aside. Velocities that change add up as they are turned: what goes to and fro,
    or bounces, gets nowhere.

    Parameters
    ----------
    stream : SensorStream
        As for :func:`travelled_distance`; without a direction of its own it goes along the body's x axis.
    start_s, end_s : float
        The interval [s].
    mounting : Mounting
        How the camera sits on the body.
    turn : (3, 3) float64
        Rotation start_from_end of the camera.

    Returns
    -------
    (3,) float64 or None
        From the first centre to the second, in the axes of the camera at the start [m]; None if the stream
        does not cover the interval.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind, or the interval is none.
    """
    way = travelled_distance(stream, start_s, end_s)
    if way is None:
        return None
    body = mounting.camera_from_body.T @ turn @ mounting.camera_from_body
    if stream.kind == "velocity":
        step = _step_of_velocities(stream, start_s, end_s, so3.log(body))
    else:
        step = _turned(np.array([[way, 0.0, 0.0]]), so3.log(body), np.array([0.5]), np.ones(1))
    return np.asarray(mounting.camera_from_body @ (step + body @ mounting.lever_arm_m - mounting.lever_arm_m))


def stops_on_the_way(start_s: float, end_s: float, count: int | None = None) -> FloatArray:
    """Times (n,) evenly spaced up to the end [s]; by default so near that a vehicle turns evenly between."""
    count = count or max(1, math.ceil((end_s - start_s) / _EVEN_TURN_S))
    return np.linspace(start_s, end_s, count + 1)[1:]


def displacement_along(
    stream: SensorStream, start_s: float, end_s: float, mounting: Mounting, turns: FloatArray
) -> FloatArray | None:
    """Step (3,) of a camera as :func:`camera_displacement` has it, along a path whose turns are known.

    `turns` are the rotation start_from_end (3, 3) of the camera, or start_from_then (n, 3, 3) at n
    :func:`stops_on_the_way`: who turns for some of the time only gets elsewhere than who turns evenly.
    """
    after = turns.reshape(-1, 3, 3)
    before = np.concatenate([np.eye(3)[None], after[:-1]])
    times_s = np.append(start_s, stops_on_the_way(start_s, end_s, len(after)))
    steps = [
        camera_displacement(stream, a_s, b_s, mounting, a.T @ b)
        for a_s, b_s, a, b in zip(times_s[:-1], times_s[1:], before, after, strict=True)
    ]
    known = [step for step in steps if step is not None]
    return np.einsum("nij,nj->i", before, known) if len(known) == len(steps) else None


def _step_of_velocities(stream: SensorStream, start_s: float, end_s: float, turn: FloatArray) -> FloatArray:
    """Step (3,) of a body that turns evenly by a rotation vector (3,), in its axes at the start [m]."""
    middles_s, lengths_s = segments(start_s, end_s, stream)
    ways = lengths_s[:, None] * measured_at(stream, middles_s)
    lasts_s = max(end_s - start_s, np.finfo(float).tiny)
    return _turned(ways, turn, (middles_s - start_s) / lasts_s, lengths_s / lasts_s)


def _turned(ways: FloatArray, turn: FloatArray, middles: FloatArray, lengths: FloatArray) -> FloatArray:
    """Sum of ways (n, 3) in the axes of a body that turns; when and how long, as shares of the turn (n,)."""
    chords = np.sinc(np.linalg.norm(turn) * lengths / (2 * np.pi))[:, None] * ways
    return np.asarray(np.einsum("nij,nj->i", so3.exp(middles[:, None] * turn), chords))


@checked()
def dead_stretches(stream: SensorStream, turns: Sequence[Turn]) -> tuple[Gap, ...]:
    """Stretches in which an odometer does not move while the camera does, as one that has come off.

    It does not where its way from image to image is less than 2 % of what it usually is. The camera may
    stand, too, where the parallax of two images is less than a pixel or a tenth of what it usually is, and
    may be beside the axis of a body that turns on the spot where it turns by more than 5° and goes aside.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"speed"``, ``"distance"`` or ``"velocity"``.
    turns : sequence of Turn
        What pairs of images tell that tell a step, in the order of time. Some may be wrong.

    Returns
    -------
    tuple of Gap
        From the first sample that does not move to the last, of four pairs in a row or more.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    t_s, speeds = speeds_of(stream)
    told = [(t, travelled_distance(stream, t.start_s, t.end_s)) for t in _with_steps(turns)]
    ways = np.array([abs(way) for _, way in told if way is not None])
    pairs = [turn for turn, way in told if way is not None]
    if len(ways) < _FEWEST_PAIRS:
        return ()
    still = ways <= _DEAD_SHARE * np.quantile(ways, _USUAL)
    moving_s = t_s[speeds > _DEAD_SHARE * np.quantile(speeds, _USUAL)]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(int)))
    found = [
        _between(stream, moving_s, 0.5 * (pairs[first].start_s + pairs[first].end_s))
        for first, end in edges.reshape(-1, 2).tolist()
        if end - first >= _FEWEST_PAIRS
    ]
    return tuple(stretch for stretch in found if stretch is not None)


def _with_steps(turns: Sequence[Turn]) -> list[Turn]:
    """Pairs of images that no body which stands or turns on the spot can have made."""
    known = [turn.parallax_px for turn in turns if not np.isnan(turn.parallax_px)]
    least_px = max(_LEAST_PARALLAX_PX, _SEEN_SHARE * float(np.median(known))) if known else 0.0
    stepping = [turn for turn in turns if not turn.parallax_px < least_px]
    if not stepping:
        return []
    turned = so3.log(rotations_of(stepping))
    is_small = np.linalg.norm(turned, axis=1) < _LARGEST_TURN_RAD
    # In the axes of the camera amid the pair.
    ways = np.einsum("nji,nj->ni", so3.exp(0.5 * turned), [turn.direction for turn in stepping])
    usual = np.nansum(ways[is_small] if is_small.any() else ways, axis=0)
    is_usual = ways @ usual > np.cos(_LARGEST_ASIDE_RAD) * np.linalg.norm(usual)
    return [turn for turn, kept in zip(stepping, is_small | is_usual, strict=True) if kept]


def _between(stream: SensorStream, moving_s: FloatArray, time_s: float) -> Gap | None:
    """The samples about a time [s] from the first to the last that does not move; None if all do there."""
    before_s = moving_s[moving_s < time_s].max(initial=-np.inf)
    after_s = moving_s[moving_s >= time_s].min(initial=np.inf)
    within = stream.t_s[(stream.t_s > before_s) & (stream.t_s < after_s)]
    return Gap(float(within[0]), float(within[-1])) if len(within) else None


@checked()
def carried_over(stream: SensorStream, stretches: Sequence[Gap]) -> SensorStream:
    """The stream with what inertia makes of it in stretches where it cannot be right.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"speed"`` or ``"velocity"``.
    stretches : sequence of Gap
        Where it cannot be right; both ends are, and measured.

    Returns
    -------
    SensorStream
        Within, values go evenly from that at the start to that at the end.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    require_kind(stream, "speed", "velocity")
    within = np.zeros(len(stream), dtype=bool)
    for stretch in stretches:
        within |= (stream.t_s > stretch.start_s) & (stream.t_s < stretch.end_s)
    values = stream.values.copy()
    values[within] = interpolate_vectors(stream.t_s[~within], values[~within], stream.t_s[within])
    return replace(stream, values=values)


def speeds_of(stream: SensorStream) -> tuple[FloatArray, FloatArray]:
    """Speeds (n,) [m/s], not negative, and their times."""
    require_kind(stream, "speed", "distance", "velocity")
    if stream.kind == "distance":
        middles_s = 0.5 * (stream.t_s[1:] + stream.t_s[:-1])
        return middles_s, np.abs(np.diff(stream.values[:, 0]) / np.diff(stream.t_s))
    return stream.t_s, np.linalg.norm(stream.values, axis=1)
