"""The step of a camera on a body that turns, beside the circle it is on."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sfmcpp.model import SensorStream
from sfmcpp.sensors import Mounting, camera_displacement, travelled_distance
from sfmcpp.sensors.odometer import displacement_along
from sfmcpp.slam import Gyroscope, Odometer
from sfmcpp.slam.sensor_suite import SensorSuite

SPEED_M_S, YAW_RAD_S, END_S = 8.0, 0.4, 0.6
T_S = np.arange(0.0, 1.01, 0.1)
AHEAD = Mounting(Mounting.forward_looking().camera_from_body, np.array([1.1, 0.3, 0.8]))
RATE = SensorStream(T_S, np.tile([0.0, 0.0, YAW_RAD_S], (len(T_S), 1)), "angular_rate")


def streams() -> list[SensorStream]:
    velocity = np.tile([SPEED_M_S, 0.0, 0.0], (len(T_S), 1))
    return [
        SensorStream(T_S, velocity, "velocity"),
        SensorStream(T_S, velocity[:, :1], "speed"),
        SensorStream(T_S, SPEED_M_S * T_S[:, None], "distance"),
    ]


def chord() -> float:
    """On a circle about the body's centre of rotation the camera is farther out than the body."""
    radius = np.hypot(SPEED_M_S / YAW_RAD_S - AHEAD.lever_arm_m[1], AHEAD.lever_arm_m[0])
    return float(2 * radius * np.sin(YAW_RAD_S * END_S / 2))


def turn_of_camera() -> np.ndarray:
    return AHEAD.camera_rotation(Rotation.from_rotvec([0.0, 0.0, YAW_RAD_S * END_S]).as_matrix())


def displacement() -> np.ndarray:
    """The camera goes on a circle about the point that the body turns about; its axes: right, down, ahead."""
    about = np.array([0.0, SPEED_M_S / YAW_RAD_S, 0.0])
    from_it = AHEAD.lever_arm_m - about
    moved = Rotation.from_rotvec([0.0, 0.0, YAW_RAD_S * END_S]).apply(from_it) - from_it
    return np.array([-moved[1], -moved[2], moved[0]])


@pytest.mark.parametrize("stream", streams(), ids=lambda stream: stream.kind)
def test_a_camera_on_a_circle_goes_along_its_chord(stream: SensorStream) -> None:
    found = camera_displacement(stream, 0.0, END_S, AHEAD, turn_of_camera())
    assert found == pytest.approx(displacement(), rel=1e-9)
    assert np.linalg.norm(displacement()) == pytest.approx(chord(), rel=1e-9)
    assert travelled_distance(stream, 0.0, END_S) != pytest.approx(chord(), rel=0.005)


def test_a_camera_at_the_origin_goes_straight_as_far_as_the_body() -> None:
    found = camera_displacement(streams()[0], 0.0, END_S, Mounting.forward_looking(), np.eye(3))
    assert found == pytest.approx([0.0, 0.0, SPEED_M_S * END_S])


@pytest.mark.parametrize("with_gyro", [True, False])
def test_the_turn_is_that_of_the_gyroscope_or_of_the_keyframes(with_gyro: bool) -> None:
    odometer, gyro = Odometer(streams()[0], mounting=AHEAD), Gyroscope(RATE, AHEAD)
    suite = SensorSuite([odometer, gyro] if with_gyro else [odometer])
    seen = np.eye(3) if with_gyro else turn_of_camera()
    measured = suite.measure(0.0, END_S, seen, metric=True, previous=np.eye(3))
    expected = np.column_stack([turn_of_camera(), displacement()])
    assert measured[0].kind == "displacement-pose"
    assert measured[0].value == pytest.approx(expected, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(
    "odometer",
    [
        Odometer(streams()[0], mounting=AHEAD, directions=False),
        Odometer(streams()[0], mounting=AHEAD, sigma_m=None),
        Odometer(streams()[1], mounting=AHEAD),
    ],
    ids=["not asked for", "of unknown accuracy", "speeds have none"],
)
def test_without_directions_an_odometer_tells_the_distance_of_the_camera(odometer: Odometer) -> None:
    measured = odometer.measure(0.0, END_S, np.eye(3), turn_of_camera())
    assert measured is not None
    assert measured.kind == "scale"
    assert measured.value == pytest.approx(chord(), rel=1e-9)


def test_nothing_is_told_where_nothing_is_measured() -> None:
    assert camera_displacement(streams()[0], 5.0, 6.0, AHEAD, np.eye(3)) is None
    assert Odometer(streams()[0], mounting=AHEAD).measure(5.0, 6.0, np.eye(3), np.eye(3)) is None


def step_of(velocities: np.ndarray, t_s: np.ndarray, turn: np.ndarray) -> np.ndarray:
    stream = SensorStream(t_s, velocities, "velocity")
    found = camera_displacement(stream, 0.0, 1.0, Mounting(np.eye(3), np.zeros(3)), turn)
    assert found is not None
    return found


def test_a_body_that_goes_to_and_fro_gets_nowhere() -> None:
    """Its way was taken for its step, forwards or backwards."""
    t_s = np.linspace(0.0, 1.0, 51)
    ahead = np.sin(2 * np.pi * t_s)[:, None] * [1.0, 0.0, 0.0]
    assert step_of(ahead, t_s, np.eye(3)) == pytest.approx(np.zeros(3), abs=1e-6)


def test_a_walker_who_bobs_gets_as_far_as_without() -> None:
    t_s = np.linspace(0.0, 1.0, 51)
    bobbing = np.column_stack([np.full(51, 1.3), np.zeros(51), 0.4 * np.cos(4 * np.pi * t_s)])
    assert step_of(bobbing, t_s, np.eye(3)) == pytest.approx([1.3, 0.0, 0.0], abs=1e-3)


def test_a_drone_that_spins_goes_straight_on() -> None:
    t_s = np.linspace(0.0, 1.0, 51)
    turns = Rotation.from_rotvec(np.radians(100.0) * t_s[:, None] * [0.0, 0.0, 1.0])
    velocities = turns.inv().apply([4.0, 1.0, 0.5])
    found = step_of(velocities, t_s, turns[-1].as_matrix())
    assert found == pytest.approx([4.0, 1.0, 0.5], rel=1e-3)


def test_a_body_that_turns_for_half_of_the_time_gets_where_its_parts_get() -> None:
    """Straight ahead for 0.4 s, then on the circle for 0.6 s; turning evenly it would get elsewhere."""
    straight_s = 1.0 - END_S
    turns = np.stack([np.eye(3), np.eye(3), *(_turn_after(k * straight_s / 2) for k in (1, 2, 3))])
    found = displacement_along(streams()[0], 0.0, 1.0, AHEAD, turns)
    truth = displacement() + np.array([0.0, 0.0, SPEED_M_S * straight_s])
    assert found == pytest.approx(truth, rel=1e-9)
    assert camera_displacement(streams()[0], 0.0, 1.0, AHEAD, turns[-1]) != pytest.approx(truth, rel=0.01)


def _turn_after(turning_s: float) -> np.ndarray:
    return AHEAD.camera_rotation(Rotation.from_rotvec([0.0, 0.0, YAW_RAD_S * turning_s]).as_matrix())
