"""Leaps of the speed of an odometer that no body can make, and the stretches between them.

A wheel that slips, blocks or spins, or a factor that changes: all that inertia tells without any image.
"""

from __future__ import annotations

import numpy as np

from sfmcpp.geometry.significance import SIGMA_OF_MEDIAN
from sfmcpp.model import Gap, SensorStream
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors.odometer import speeds_of
from sfmcpp.sensors.speed_resolution import measured_anew, step_of
from sfmcpp.sensors.stream import local_medians

# Along or across, tyres on a dry road hold about 1 g; nor does a train or a walker do more for a second.
LARGEST_ACCELERATION_M_S2 = 12.0
# An acceleration that differs by more from the median of its neighbours, two on either side, is the sensor's:
# on KITTI's 0001, 0027, 0036 and 0039 they differ by 3.5 m/s³ at most.
_LARGEST_JERK_M_S3 = 30.0
_NEIGHBOURS = 2
# Noise changes the speed by this many standard deviations at most.
_NOISE_SIGMAS = 6.0
# The noise is estimated from the changes that are not zero if at least this share is not.
_VARIED = 0.1
# A leap undoes an earlier one if their factors on the speed agree to this share.
_SAME = 0.15
# Of a leap that nothing else takes back, the factor is known: one that takes it back to this share of its
# logarithm may be less sudden by this share. At low speeds a factor makes small leaps.
_FAINT_SAME, _FAINT_SHARE = 0.3, 1.0 / 3.0
# Below this speed the body stands: every odometer repeats itself, and its factor may change without a leap.
STANDING_M_S = 0.3
# A wheel blocks that falls from at least this speed to standing within so many samples, and comes back
# likewise: no odometer leaves out so many low speeds.
_LEAST_BLOCKED_M_S, _BLOCKED_WITHIN = 3.0, 2


@checked()
def doubtful_stretches(stream: SensorStream) -> tuple[Gap, ...]:
    """Stretches between a leap of the speed and the leap that takes it back, or the next stop, or the end.

    A wheel that blocks at speed stands until it leaps back: that is no stop of the body. A leap out of a
    stand to less than 3 m/s lasts for one sample: odometers do not show low speeds.

    A camera alone cannot tell whether it has lost the scale or the odometer is wrong: both drift apart. But a
    body has inertia. A speed that changes faster than tyres can make it, or all at once between two samples,
    is the sensor's: a wheel that slips, blocks or spins, or a factor that changes. Not so what the step of
    the values explains, as ticks or whole km/h, values that are repeated until there is a new one, or stamps
    that are late by less than a period.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"speed"``, ``"distance"`` or ``"velocity"``.

    Returns
    -------
    tuple of Gap
        In order, not overlapping. That of a first sample which alone is wrong begins just before it.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    t_s, speeds = speeds_of(stream)
    step_m_s = step_of(stream)
    anew = measured_anew(t_s, speeds, step_m_s)
    t_s, speeds = t_s[anew], speeds[anew]
    leaps = _speed_leaps(t_s, speeds, step_m_s)
    if leaps:
        leaps = _with_faint_partners(speeds, leaps, _speed_leaps(t_s, speeds, step_m_s, _FAINT_SHARE))
    found: list[Gap] = []
    at = 0
    if _is_first_alone_wrong(speeds, leaps):
        found.append(Gap(float(np.nextafter(stream.t_s[0], -np.inf)), float(t_s[1])))
        at = 1
    while at < len(leaps):
        opening = leaps[at]
        if _is_start(speeds, opening):
            last = opening + 1
        else:
            last = _end_of_block(speeds, leaps, opening) or _end_of_factor(speeds, leaps, at)
        end_s = float(stream.t_s[-1] + stream.max_gap_s if last == len(speeds) - 1 else t_s[last])
        found.append(Gap(float(t_s[opening]), end_s))
        at = next((k for k in range(at + 1, len(leaps)) if leaps[k] >= last), len(leaps))
    return tuple(found)


def _speed_leaps(t_s: FloatArray, speeds: FloatArray, step_m_s: float, share: float = 1.0) -> list[int]:
    """Samples after which the speed changes faster than it can, or otherwise than before and after.

    Beyond what steps of the values explain, and stamps that are early or late by less than a period; by this
    share of what is no body's.
    """
    if len(speeds) < 3:
        return []
    changes, period_s = np.diff(speeds), np.diff(t_s)
    # A second difference of white noise has six times its variance; a median ignores the leaps themselves.
    # Zeros are left out where enough is left: a speed that is repeated was not measured anew.
    bends = np.abs(np.diff(speeds, 2))
    varied = bends[bends > 0] if np.mean(bends > 0) > _VARIED else bends
    noise = SIGMA_OF_MEDIAN * float(np.median(varied)) / np.sqrt(6.0)
    even_s = np.maximum(period_s, float(np.median(period_s)))
    usual = local_medians(changes / even_s, _NEIGHBOURS)
    alone = np.minimum(np.abs(changes - usual * period_s), np.abs(changes - usual * even_s))
    fastest = LARGEST_ACCELERATION_M_S2 * even_s + step_m_s
    most_sudden = share * _LARGEST_JERK_M_S3 * even_s**2 + 2.0 * step_m_s
    shaken = _NOISE_SIGMAS * np.sqrt(2.0) * noise  # by both ends
    too_fast = np.abs(changes) > fastest + shaken
    too_sudden = alone > most_sudden + shaken
    return [int(k) for k in np.flatnonzero(too_fast | too_sudden)]


def _with_faint_partners(speeds: FloatArray, leaps: list[int], faint: list[int]) -> list[int]:
    """Leaps, and beside each that no other takes back the faint one that does, if there is one."""
    factors = np.log(np.maximum(speeds[1:], STANDING_M_S) / np.maximum(speeds[:-1], STANDING_M_S))
    moving = np.minimum(speeds[1:], speeds[:-1]) > STANDING_M_S
    found = set(leaps)
    for leap in (k for k in leaps if moving[k]):
        back = [
            k
            for k in faint
            if moving[k] and abs(factors[k] + factors[leap]) < _FAINT_SAME * abs(factors[leap])
        ]
        if len(back) == 1:
            found.update(back)
    return sorted(found)


def _end_of_factor(speeds: FloatArray, leaps: list[int], at: int) -> int:
    """The sample after the leap that takes number `at` back, or after the next stop; the last if none is."""
    opening = leaps[at]
    closing = next((k for k in leaps[at + 1 :] if _is_opposite_leap(speeds, opening, k)), len(speeds) - 1)
    stop = next((k for k in range(opening + 1, closing) if speeds[k] < STANDING_M_S), closing)
    return min(stop + 1, len(speeds) - 1)


def _is_start(speeds: FloatArray, opening: int) -> bool:
    """Whether a body that stands begins to move, with an odometer that does not show the low speeds."""
    return bool(speeds[opening] < STANDING_M_S and speeds[opening + 1] < _LEAST_BLOCKED_M_S)


def _end_of_block(speeds: FloatArray, leaps: list[int], opening: int) -> int | None:
    """The sample at which a wheel that blocks turns again; None where it does not block, or leap back."""
    stands = speeds < STANDING_M_S
    after = stands[opening + 1 : opening + 1 + _BLOCKED_WITHIN]
    if speeds[opening] < _LEAST_BLOCKED_M_S or not after.any():
        return None
    first = opening + 1 + int(np.argmax(after))
    if stands[first:].all():
        return None
    turns = first + int(np.argmin(stands[first:]))
    if speeds[turns : turns + _BLOCKED_WITHIN].max() < _LEAST_BLOCKED_M_S:
        return None
    return turns + 1 if turns in leaps else turns if turns - 1 in leaps else None


def _is_first_alone_wrong(speeds: FloatArray, leaps: list[int]) -> bool:
    """Whether the first sample is a spike, not the only sound one: its speed does not come to last."""
    if not leaps or leaps[0] != 0 or _end_of_block(speeds, leaps, 0) is not None:
        return False
    back = next((k for k in leaps[1:] if _is_opposite_leap(speeds, 0, k)), None)
    if back is None:
        return True
    following = next((k for k in leaps if k > back), len(speeds) - 1)
    return following - back < back


def _is_opposite_leap(speeds: FloatArray, opening: int, closing: int) -> bool:
    opening_product = speeds[opening] * speeds[closing]
    closing_product = speeds[opening + 1] * speeds[closing + 1]
    return bool(abs(opening_product - closing_product) <= _SAME * max(opening_product, closing_product))
