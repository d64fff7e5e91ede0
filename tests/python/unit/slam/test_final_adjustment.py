"""All keyframes adjusted together at the end of a run."""

from __future__ import annotations

import numpy as np
import pytest

from sfmcpp import InvalidArgument
from sfmcpp.slam import FinalAdjustment, Gyroscope, Odometer, SlamResult, SlamSettings, run_slam
from winding import AT_CAMERA, Winding, winding


@pytest.fixture(scope="module")
def drive() -> Winding:
    return winding(seed=1)


def run(drive: Winding, how: str) -> SlamResult:
    sensors = [Odometer(drive.odometer), Gyroscope(drive.gyro, AT_CAMERA)]
    return run_slam(drive.sequence, SlamSettings(final_adjustment=how), sensors)


def test_it_lowers_the_error_and_the_cost_of_images_and_sensors(drive: Winding) -> None:
    off, auto = run(drive, "off"), run(drive, "auto")
    assert off.final is None
    assert auto.final is not None
    assert auto.final.kept
    assert set(auto.final.sensors) == {"odometer", "gyro"}
    for before, after in (auto.final.pixels, *auto.final.sensors.values()):
        assert after < before
    assert drive.errors(auto)[0] < drive.errors(off)[0]


def test_frames_between_keyframes_move_too(drive: Winding) -> None:
    off, on = run(drive, "off"), run(drive, "on")
    between = sorted(off.path.between)
    assert between == sorted(on.path.between)
    assert all(not np.array_equal(off.path.between[f], on.path.between[f]) for f in between)


def test_it_is_kept_only_where_all_gain_unless_it_must_be() -> None:
    gain, loss = (2.0, 1.0), (1.0, 2.0)
    assert FinalAdjustment(True, gain, {"odometer": gain}).improved
    assert not FinalAdjustment(True, gain, {"odometer": gain, "gyro": loss}).improved
    assert not FinalAdjustment(True, loss, {"odometer": gain}).improved
    assert "not kept: cost of images 1 to 2" in FinalAdjustment(False, loss).describe()


def test_another_wish_is_refused() -> None:
    with pytest.raises(InvalidArgument, match="final_adjustment"):
        SlamSettings(final_adjustment="maybe")
