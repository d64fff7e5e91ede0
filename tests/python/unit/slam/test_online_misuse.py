"""What a loop of one's own can hand over wrongly is refused, with its name."""

from __future__ import annotations

import numpy as np
import pytest

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import SensorStream
from sfmcpp.model.frames import Frame, RightView, View
from sfmcpp.slam import Gps, Gyroscope, Ins, Odometer, Slam, SlamSettings
from slam_helpers import INTRINSICS
from winding import AT_CAMERA, winding

VIEW = View(np.arange(3, dtype=np.int32), np.zeros((3, 2)))


@pytest.mark.parametrize(
    ("row", "told"),
    [
        ([707.0, 707.0, 601.0, 183.0, 0.0], "aspect = 707: must be f, aspect, cx, cy, skew"),
        ([-500.0, 1.0, 320.0, 240.0, 0.0], "f = -500"),
        ([500.0, 1.0, np.inf, 240.0, 0.0], "intrinsics"),
        ([500.0, 320.0, 240.0], "3 numbers, must be 5, or 12 with distortion"),
    ],
)
def test_intrinsics_in_another_order_are_refused(row: list[float], told: str) -> None:
    with pytest.raises(InvalidArgument, match=told):
        Slam(np.array(row))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("triangulation_keyframes", 0),
        ("triangulation_keyframes", 2.5),
        ("keyframe_min_tracks", np.nan),
        ("start_point_ratio", np.nan),
        ("start_point_ratio", 2.0),
        ("min_angle_deg", np.nan),
        ("correct_drift", "no"),
        ("correct_scale", None),
        ("hindsight", "off"),
        ("seed", -1),
    ],
)
def test_settings_that_are_none_are_refused_by_name(name: str, value: object) -> None:
    with pytest.raises(InvalidArgument, match=f"{name} = {value!r}"):
        SlamSettings(**{name: value})  # type: ignore[arg-type]


@pytest.mark.parametrize("wrong", [0.0, -1.0, np.nan, "a"])
def test_standard_deviations_of_sensors_are_refused_by_name(wrong: float) -> None:
    rates = SensorStream(SPEEDS.t_s, np.zeros((len(SPEEDS), 3)), "angular_rate")
    places = SensorStream(SPEEDS.t_s, np.zeros((len(SPEEDS), 3)), "position")
    poses = SensorStream(SPEEDS.t_s, np.zeros((len(SPEEDS), 6)), "pose")
    with pytest.raises(InvalidArgument, match="sigma_m = "):
        Odometer(SPEEDS, sigma_m=wrong)
    with pytest.raises(InvalidArgument, match="sigma_rad = "):
        Gyroscope(rates, AT_CAMERA, sigma_rad=wrong)
    with pytest.raises(InvalidArgument, match="sigma_m = "):
        Gps(places, sigma_m=wrong)
    with pytest.raises(InvalidArgument, match="sigma_m = "):
        Ins(poses, AT_CAMERA, sigma_m=wrong)
    with pytest.raises(InvalidArgument, match="mounting = "):
        Odometer(SPEEDS, mounting="ahead")  # type: ignore[arg-type]


def test_sensors_have_names_of_their_own() -> None:
    with pytest.raises(InvalidArgument, match="sensors: 2 are named 'odometer'"):
        Slam(INTRINSICS, sensors=[Odometer(SPEEDS), Odometer(SPEEDS)])
    Slam(INTRINSICS, sensors=[Odometer(SPEEDS), Odometer(SPEEDS, "another")])


def test_a_frame_must_come_after_the_one_before() -> None:
    slam = Slam(INTRINSICS)
    slam.step(Frame(4, 1.0, VIEW))
    for number in (4, 3):
        with pytest.raises(InvalidArgument, match=rf"frame\.number = {number}: must be above 4"):
            slam.step(Frame(number, 1.1, VIEW))
    for t_s in (1.0, 0.9, np.nan):
        with pytest.raises(InvalidArgument, match=r"frame 5: t_s = .* must be after 1 s, that of 4"):
            slam.step(Frame(5, t_s, VIEW))
    slam.step(Frame(5, 1.1, VIEW))
    assert list(slam.result.path.times) == [4, 5]


def test_no_frame_comes_after_the_end() -> None:
    slam = Slam(INTRINSICS)
    slam.step(Frame(0, 0.0, VIEW))
    slam.finish()
    with pytest.raises(InvalidArgument, match=r"frame 1: comes after finish\(\)"):
        slam.step(Frame(1, 1.0, VIEW))


SPEEDS = SensorStream(np.array([0.0, 0.1]), np.ones(2), "speed")


@pytest.mark.parametrize(
    ("view", "told"),
    [
        (View(np.array([0, -1, 2]), np.zeros((3, 2))), r"view\.tracks: -1 is negative"),
        (View(np.array([4, 2, 4]), np.zeros((3, 2))), r"view\.tracks: track 4 is there twice"),
        (View(np.arange(3.0), np.zeros((3, 2))), r"view\.tracks: dtype float64, must be integers"),
        (View(np.zeros((3, 1), dtype=int), np.zeros((3, 2))), r"view\.tracks: shape \(3, 1\)"),
        (View(np.arange(3), np.zeros((2, 3))), r"view\.pixels: shape \(2, 3\)"),
        (View(np.arange(3), np.zeros((2, 2))), r"view\.pixels: shape \(2, 2\)"),
        (View(np.arange(1), np.full((1, 2), np.nan)), r"view\.pixels"),
        (View(np.arange(1), np.zeros((1, 2)), RightView(np.zeros((2, 2)), 0.5)), r"view\.right\.pixels"),
        (View(np.arange(1), np.zeros((1, 2)), RightView(np.zeros((1, 2)), -1.0)), r"baseline_m = -1"),
    ],
)
def test_views_that_are_none_are_refused_by_name(view: View, told: str) -> None:
    slam = Slam(INTRINSICS)
    with pytest.raises(InvalidArgument, match=told):
        slam.step(Frame(0, 0.0, view))
    assert not slam.result.path.times


@pytest.mark.parametrize("far", [10**9, 2**40, 2**62])
def test_large_track_numbers_and_any_order_give_the_same_poses(far: int) -> None:
    drive, rng = winding(), np.random.default_rng(0)
    plain, large = Slam(drive.sequence.intrinsics), Slam(drive.sequence.intrinsics)
    number_of: dict[int, int] = {}
    for frame in list(drive.sequence)[:60]:
        plain.step(Frame(frame.number, frame.t_s, _numbered(frame.view, number_of, 0)))
        order = rng.permutation(len(frame.view.tracks))
        view = _numbered(frame.view, number_of, far)
        large.step(Frame(frame.number, frame.t_s, View(view.tracks[order], view.pixels[order])))
    assert large.result.poses.keys() == plain.result.poses.keys()
    assert all(np.array_equal(large.result.poses[k], pose) for k, pose in plain.result.poses.items())


@pytest.mark.parametrize("dtype", [np.uint8, np.uint32, np.uint64, np.int16])
def test_track_numbers_may_be_of_any_integer_type(dtype: type) -> None:
    slam = Slam(INTRINSICS)
    for number, tracks in enumerate(([], [0, 7, 3], [2, 7])):
        slam.step(Frame(number, 0.1 * number, View(np.array(tracks, dtype), np.zeros((len(tracks), 2)))))
    assert list(slam.result.path.times) == [0, 1, 2]


def _numbered(view: View, number_of: dict[int, int], far: int) -> View:
    """With tracks in the order of their coming."""
    tracks = [number_of.setdefault(track, len(number_of)) for track in view.tracks.tolist()]
    return View(np.array(tracks, dtype=np.int64) + far, view.pixels)


def test_one_stamp_in_nanoseconds_is_refused_and_the_run_goes_on() -> None:
    slam = Slam(INTRINSICS, sensors=[Odometer(SPEEDS)])
    slam.step(Frame(0, 0.0, VIEW))
    with pytest.raises(InvalidArgument, match=r"frame 1: t_s = 100000000 s: must be within a day"):
        slam.step(Frame(1, 1e8, VIEW))
    slam.step(Frame(1, 0.1, VIEW))
    with pytest.raises(InvalidArgument, match=r"'speed': t_s = 200000000 s: must be within a day of 0\.1 s"):
        slam.feed("odometer", np.array([2e8]), np.ones((1, 1)))
    slam.feed("odometer", np.array([0.2]), np.ones((1, 1)))
    with pytest.raises(InvalidArgument, match="frame 2: t_s"):
        slam.step(Frame(2, np.nan, VIEW))


def test_streams_of_another_unit_are_told_at_the_first_frame() -> None:
    late = SensorStream(1.3e12 + np.array([0.0, 100.0]), np.ones(2), "speed")
    slam = Slam(INTRINSICS, sensors=[Odometer(late)])
    slam.step(Frame(0, 1.3e9, VIEW))
    (told,) = slam.result.warnings
    assert "its times are 1,000 times those of the images" in told


def test_a_state_of_another_run_is_refused() -> None:
    state = Slam(INTRINSICS, sensors=[Odometer(SPEEDS)]).state()
    wide = INTRINSICS * [2, 1, 1, 1, 1]
    short = SensorStream(SPEEDS.t_s[:1], SPEEDS.values[:1], "speed")
    for other, told in [
        (Slam(wide, sensors=[Odometer(SPEEDS)]), "other intrinsics"),
        (Slam(INTRINSICS, SlamSettings(seed=3), [Odometer(SPEEDS)]), "other settings"),
        (Slam(INTRINSICS), "with the sensors odometer, must be those here: none"),
        (Slam(INTRINSICS, sensors=[Odometer(short)]), "must be fed what it had measured up to 0.100 s"),
    ]:
        with pytest.raises(InvalidArgument, match=told):
            other.restore(state)
    for none in ({"frames": []}, {"run": {}}, None):
        with pytest.raises(InvalidArgument, match=r"must be what state\(\)"):
            Slam(INTRINSICS).restore(none)  # type: ignore[arg-type]
    Slam(INTRINSICS, sensors=[Odometer(SPEEDS)]).restore(state)


def test_a_fault_is_told_while_the_run_goes() -> None:
    drive = winding()
    values = np.where(drive.odometer.t_s[:, None] < 5.0, drive.odometer.values, 0.0)
    dead = SensorStream(drive.odometer.t_s, values, drive.odometer.kind)
    slam, before_end = Slam(drive.sequence.intrinsics, sensors=[Odometer(dead)]), []
    for frame in drive.sequence:
        slam.step(frame)
        before_end += [told for told in slam.result.warnings if "is it dead?" in told]
    slam.finish()
    assert before_end
    assert len([told for told in slam.result.warnings if "is it dead?" in told]) == 1
