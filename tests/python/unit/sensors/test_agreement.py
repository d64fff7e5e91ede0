"""Streams of one body that tell of different motions, and stamps of another clock, are named."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sfmcpp.errors import InvalidArgument
from sfmcpp.sensors import SensorStream, require_agreement, require_overlap

SPEED, RATE = 8.0, 0.4
SECONDS = 40.0
WGS84_METRES_PER_DEGREE = 111_195.0


def round_trip(hz: float = 20.0) -> dict[str, SensorStream]:
    """Every stream that a body which goes in a circle at an even speed could give: 3.2 m/s² across."""
    t_s = np.arange(0.0, SECONDS, 1 / hz)
    heading = RATE * t_s
    position = SPEED / RATE * np.stack([np.sin(heading), 1 - np.cos(heading), 0 * t_s], axis=1)
    turned = Rotation.from_rotvec(heading[:, None] * [0.0, 0.0, 1.0]).as_rotvec()
    geodetic = np.column_stack(
        [position[:, 1] / WGS84_METRES_PER_DEGREE, position[:, 0] / WGS84_METRES_PER_DEGREE]
    )
    values = {
        "speed": np.full(len(t_s), SPEED),
        "distance": SPEED * t_s,
        "velocity": np.tile([SPEED, 0.0, 0.0], (len(t_s), 1)),
        "angular_rate": np.tile([0.0, 0.0, RATE], (len(t_s), 1)),
        "orientation": turned,
        "position": position,
        "pose": np.hstack([position, turned]),
        "geodetic": np.column_stack([geodetic, 0 * t_s]),
    }
    return {kind: SensorStream(t_s, value, kind) for kind, value in values.items()}


def times(stream: SensorStream, factor: float) -> SensorStream:
    return SensorStream(stream.t_s, factor * stream.values, stream.kind)


def test_what_was_not_measured_is_no_acceleration() -> None:
    """Fast and straight before a gap, turning on the spot after it: on lines between, 15 m/s² across."""
    t_s = np.concatenate([np.arange(0.0, 20.0, 0.1), np.arange(80.0, 100.0, 0.1)])
    speed = SensorStream(t_s, np.where(t_s < 50, 30.0, 0.0), "speed")
    rates = SensorStream(t_s, np.where(t_s < 50, 0.0, 2.0)[:, None] * [0.0, 0.0, 1.0], "angular_rate")
    require_agreement([speed, rates])


def test_before_both_streams_have_begun_there_is_no_acceleration() -> None:
    t_s = np.arange(0.0, 40.0, 0.1)
    pace = SensorStream(t_s, np.where(t_s < 19, 30.0, 2.0)[:, None], "speed")
    rates = np.zeros((200, 3))
    rates[:, 1] = np.where(np.arange(200) < 20, 1.0, 0.0)
    require_agreement([pace, SensorStream(t_s[200:], rates, "angular_rate")])


def test_a_body_that_spins_while_it_flies_straight_on_is_possible() -> None:
    """A drone at 10 m/s that turns about itself at 240°/s: nothing pushes it across, unless the other way."""
    t_s = np.arange(0.0, 20.0, 0.04)
    spin = np.radians(240.0) * np.exp(-(((t_s - 10.0) / 2.0) ** 2))
    heading = np.cumsum(spin) * 0.04
    flown = 10.0 * np.stack([np.cos(heading), -np.sin(heading), 0 * t_s], axis=1)
    velocity = SensorStream(t_s, flown, "velocity")
    rates = SensorStream(t_s, spin[:, None] * [0.0, 0.0, 1.0], "angular_rate")
    require_agreement([velocity, rates])
    with pytest.raises(InvalidArgument, match="across for a second"):
        require_agreement([velocity, times(rates, -1.0)])


@pytest.mark.parametrize("kind", ["orientation", "pose"])
def test_more_than_half_a_turn_between_two_orientations_is_counted(kind: str) -> None:
    """A body that spins at 150°/s turns by 300° in two seconds; its orientations are 60° apart."""
    t_s = np.arange(0.0, SECONDS, 0.05)
    spin = np.radians(150.0) * t_s[:, None] * [0.0, 0.0, 1.0]
    turned = Rotation.from_rotvec(spin).as_rotvec()
    values = turned if kind == "orientation" else np.hstack([0 * turned, turned])
    rates = SensorStream(t_s, np.tile([0.0, 0.0, np.radians(150.0)], (len(t_s), 1)), "angular_rate")
    require_agreement([rates, SensorStream(t_s, values, kind)])
    with pytest.raises(InvalidArgument, match="times those of stream"):
        require_agreement([times(rates, 1 / 57.3), SensorStream(t_s, values, kind)])


@pytest.mark.parametrize("kind", ["speed", "velocity"])
def test_a_motorcycle_that_leans_over_is_possible(kind: str) -> None:
    """From one side to the other at 45°/s and 20 m/s."""
    t_s = np.arange(0.0, 20.0, 0.04)
    lean = np.where((t_s > 8.0) & (t_s < 10.0), np.radians(45.0), 0.0)
    ahead = np.full((len(t_s), 1), 20.0)
    speed = SensorStream(t_s, ahead if kind == "speed" else ahead * [1.0, 0.0, 0.0], kind)
    require_agreement([speed, SensorStream(t_s, lean[:, None] * [1.0, 0.0, 0.0], "angular_rate")])


def test_streams_of_one_motion_agree() -> None:
    require_agreement(round_trip().values())


@pytest.mark.parametrize(
    ("wrong", "factor", "other", "told"),
    [
        ("speed", 3.6, "position", r"'speed': its ways are 3\.\d+ times those of stream 'position'.*km/h"),
        ("speed", 3.6, "geodetic", r"'speed': its ways are 3\.\d+ times those of stream 'geodetic'"),
        (
            "velocity",
            1 / 3.6,
            "distance",
            r"'velocity': its ways are 0\.278 times those of stream 'distance'",
        ),
        (
            "position",
            0.001,
            "distance",
            r"'position': its ways are 0\.000\d+ times those of stream 'distance'",
        ),
        (
            "angular_rate",
            57.3,
            "orientation",
            r"'angular_rate': its rotations are 57\.3 times those of .*degrees",
        ),
        (
            "angular_rate",
            1 / 57.3,
            "pose",
            r"'angular_rate': its rotations are 0\.0175 times those of stream 'pose'",
        ),
        (
            "speed",
            3.9,
            "angular_rate",
            r"'speed' at 31.2 m/s with stream 'angular_rate' at 0.4 rad/s.* 12.5 m/s²",
        ),
        (
            "angular_rate",
            57.3,
            "velocity",
            r"'velocity' at 8 m/s with .* 22.9 rad/s.* 183 m/s² across.*degrees/s",
        ),
    ],
)
@pytest.mark.parametrize("turned", [False, True])
def test_a_unit_that_another_stream_rules_out_is_named(
    wrong: str, factor: float, other: str, told: str, turned: bool
) -> None:
    streams = round_trip()
    pair = [times(streams[wrong], factor), streams[other]]
    if not turned:
        with pytest.raises(InvalidArgument, match=told):
            require_agreement(pair)
    else:
        with pytest.raises(InvalidArgument, match=r"times those of stream|across for a second"):
            require_agreement(pair[::-1])


def test_a_sensor_that_is_wrong_for_a_while_is_left_to_its_weight() -> None:
    streams = round_trip()
    speed, rate = streams["speed"], streams["angular_rate"]
    lie = (speed.t_s > 10) & (speed.t_s < 20)
    fast = SensorStream(speed.t_s, np.where(lie, 1.3, 1.0) * speed.values[:, 0], "speed")
    bias = rate.values + np.radians(5.0) * lie[:, None] * [0.0, 0.0, 1.0]
    require_agreement([fast, SensorStream(rate.t_s, bias, "angular_rate"), streams["pose"]])


def test_noise_of_a_body_that_stands_is_no_disagreement() -> None:
    rng = np.random.default_rng(0)
    t_s = np.arange(0.0, 60.0, 0.5)
    speed = SensorStream(t_s, np.zeros(len(t_s)), "speed")
    require_agreement([speed, SensorStream(t_s, rng.normal(0, 1.5, (len(t_s), 3)), "position")])


def test_streams_that_share_no_time_have_nothing_to_disagree_about() -> None:
    streams = round_trip()
    require_agreement([times(streams["speed"], 3.6).shifted(1000.0), streams["position"]])


def test_stamps_of_another_clock_are_refused_with_both_spans() -> None:
    stream = round_trip()["speed"]
    require_overlap(stream, 39.0, 80.0)
    require_overlap(stream, -50.0, 0.0)
    told = r"'speed' lasts from 0.000 to 39.950 s and the images from 1300000000.000 to 1300000009.000 s"
    with pytest.raises(InvalidArgument, match=told):
        require_overlap(stream, 1.3e9, 1.3e9 + 9)


@pytest.mark.parametrize("unit", [1e9, 1e298])
def test_stamps_in_nanoseconds_are_told_before_they_take_the_memory(unit: float) -> None:
    streams = [
        SensorStream(s.t_s * unit, s.values, kind)
        for kind, s in round_trip().items()
        if kind in ("speed", "angular_rate")
    ]
    with pytest.raises(
        InvalidArgument, match=r"'speed' lasts .* s: must be at most 10000000 s; .* in ms, us or ns"
    ):
        require_agreement(streams)


def test_a_bend_late_in_a_long_recording_is_looked_at() -> None:
    t_s = np.arange(0.0, 40_000.0, 5.0)
    late = np.where(np.abs(t_s - 30_000.0) < 20.0, 30.0, 1.0)
    speed = SensorStream(t_s, late, "speed", max_gap_s=6.0)
    turning = SensorStream(t_s, np.tile([0.0, 0.0, 1.0], (len(t_s), 1)), "angular_rate", max_gap_s=6.0)
    with pytest.raises(InvalidArgument, match="across for a second"):
        require_agreement([speed, turning])


@pytest.mark.parametrize("factor", [1e-3, 1e3, 1e6, 1e9])
def test_times_in_another_unit_are_named_instead_of_a_clock_offset(factor: float) -> None:
    stream = SensorStream(factor * (1.3e9 + np.arange(5.0)), np.ones((5, 1)), "speed")
    with pytest.raises(InvalidArgument, match=f"its times are {factor:,.10g} times those") as told:
        require_overlap(stream, 1.3e9, 1.3e9 + 9)
    assert "offset" not in str(told.value)


def test_a_stream_a_thousandth_as_long_as_the_images_is_asked_for_its_unit() -> None:
    seconds = np.arange(0.0, 16.0, 0.1)
    stream = SensorStream(1e-3 * seconds, np.ones(len(seconds)), "speed")
    told = "must overlap; it lasts about 0.001 times as long: check the unit of its times; are both"
    with pytest.raises(InvalidArgument, match=told):
        require_overlap(stream, 0.05, 15.7)
    with pytest.raises(InvalidArgument, match="must overlap; are both"):
        require_overlap(SensorStream(0.5 * seconds, np.ones(len(seconds)), "speed"), 20.0, 35.7)
