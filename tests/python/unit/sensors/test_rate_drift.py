"""A bias that changes evenly is found by rotations of images, and nothing else is taken for one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bends import T_S, rates, stream_of, turns
from sensor_helpers import MOUNTING
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors import SensorStream
from sfmcpp.sensors.rate_drift import find_drift, without_drift

AXIS = np.array([0.3, -0.4, 0.866])


def drifting(course: FloatArray, deg_s: float) -> SensorStream:
    """Its bias has the given course (n,) of zero to one."""
    return stream_of(rates() + np.radians(deg_s) * course[:, None] * AXIS)


EVEN = T_S / T_S[-1]


@pytest.mark.parametrize("seed", range(3))
def test_a_drift_is_found_and_taken_from_the_stream(seed: int) -> None:
    found = find_drift(drifting(EVEN, 2.0), MOUNTING, turns(seed=seed))
    assert found is not None
    rest = without_drift(drifting(EVEN, 2.0), found)
    assert np.abs(rest.values - rates()).max() < np.radians(0.25)
    assert "changes by 2.0°/s" in found.complaint or "changes by 1.9°/s" in found.complaint
    assert find_drift(rest, MOUNTING, turns(seed=seed)) is None


@pytest.mark.parametrize("seed", range(3))
def test_other_faults_and_none_are_no_drift(seed: int) -> None:
    seen = turns(seed=seed)
    for_a_while = ((EVEN > 0.6) & (EVEN < 0.8)).astype(float)
    from_then_on = (EVEN > 0.5).astype(float)
    late = stream_of(rates()).shifted(0.5)
    others = [drifting(EVEN, 0.0), drifting(EVEN**0, 5.0), drifting(for_a_while, 5.0), late]
    others += [drifting(from_then_on, deg_s) for deg_s in (1.0, 5.0)]
    others += [stream_of(-rates()), stream_of(rates() / 57.3), stream_of(rates()[:, [1, 2, 0]])]
    assert [find_drift(stream, MOUNTING, seen) for stream in others] == [None] * len(others)


def test_few_turns_tell_none() -> None:
    stream = drifting(EVEN, 20.0)
    assert find_drift(stream, MOUNTING, turns()[::5]) is not None
    assert find_drift(stream, MOUNTING, turns()[::6]) is None
    assert find_drift(replace(stream, t_s=T_S + 100.0), MOUNTING, turns()) is None
