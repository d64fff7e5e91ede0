"""A map brought to metres by positions alone: straight and bent streets, noise, and standing still."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from random_scenes import angle_between
from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry.similarity import Similarity
from sfmcpp.sensors import Registration, register_by_poses, register_by_positions

UP = np.array([0.0, 0.0, 1.0])
COUNT = 12


def street(
    bend_rad: float = 0.0, slope_rad: float = 0.0, count: int = COUNT, step_m: float = 3.0
) -> np.ndarray:
    """Poses (count, 3, 4) of a camera that looks along a street; x east, y north, z up."""
    headings = 0.7 + np.linspace(0, bend_rad, count)
    ahead = np.stack(
        [
            np.cos(headings) * np.cos(slope_rad),
            np.sin(headings) * np.cos(slope_rad),
            np.full(count, np.sin(slope_rad)),
        ],
        axis=1,
    )
    right = np.stack([np.sin(headings), -np.cos(headings), np.zeros(count)], axis=1)
    rotations = np.stack([right, np.cross(ahead, right), ahead], axis=2)
    centres = np.cumsum(step_m * 0.5 * (ahead[1:] + ahead[:-1]), axis=0)
    centres = np.array([400.0, -90.0, 30.0]) + np.concatenate([np.zeros((1, 3)), centres])
    return np.concatenate([rotations, centres[:, :, None]], axis=2)


def hidden(seed: int) -> Similarity:
    rng = np.random.default_rng(seed)
    return Similarity(20.0, Rotation.random(rng=rng).as_matrix(), rng.normal(0, 10, 3))


def registered(
    truth: np.ndarray, sigma_m: float = 0.0, seed: int = 0, **options: object
) -> tuple[Registration, float]:
    """The registration of a map of these cameras by noisy positions, and its error in rotation [rad]."""
    back = hidden(seed)
    vision = back.inverse().apply_to_poses(truth)
    noise = np.random.default_rng(100 + seed).normal(0, sigma_m, (len(truth), 3))
    found = register_by_positions(vision, truth[:, :, 3] + noise, len(truth), **options)  # type: ignore[arg-type]
    return found, angle_between(found.similarity.rotation, back.rotation)


@pytest.mark.parametrize("slope_rad", [0.0, 0.15])
def test_a_straight_street_registers_exactly_where_cameras_stand_upright(slope_rad: float) -> None:
    truth = street(slope_rad=slope_rad)
    found, angle = registered(truth, up=3 * UP)
    assert angle < 1e-9
    assert found.similarity.scale == pytest.approx(20.0)
    assert found.upright
    assert found.roll_sigma_rad == np.inf
    assert found.rmse_m < 1e-9


@pytest.mark.parametrize("seed", range(6))
def test_noise_on_a_straight_street_does_not_turn_the_map_over(seed: int) -> None:
    """Noise bends the measured path, never by enough to be taken for the roll."""
    truth = street()
    found, angle = registered(truth, 0.5, seed, up=UP)
    assert found.upright
    assert found.roll_sigma_rad > 1.0
    # The direction of 33 m by 12 positions that are 0.5 m off: 0.014 rad about either axis across.
    assert found.relative_sigma == pytest.approx(0.5 / (3.0 * np.sqrt(12 * 143 / 12)), rel=0.6)
    assert angle < 4 * 0.014
    assert found.similarity.scale == pytest.approx(20.0, rel=4 * 0.014)
    with pytest.raises(InvalidArgument, match="measured: the positions lie on a line to within their noise"):
        registered(truth, 0.5, seed)


@pytest.mark.parametrize("seed", range(4))
def test_a_bend_tells_the_roll_by_itself(seed: int) -> None:
    """A camera that is not upright at all shows that `up` has no say."""
    truth = street(bend_rad=1.5)
    truth[:, :, :3] = truth[:, :, :3] @ Rotation.from_rotvec([0, 0, 0.5]).as_matrix()
    found, angle = registered(truth, 0.1, seed, up=UP)
    alone, _ = registered(truth, 0.1, seed)
    assert not found.upright
    np.testing.assert_array_equal(found.similarity.rotation, alone.similarity.rotation)
    assert angle < 4 * found.roll_sigma_rad < 0.1


def test_the_roll_sigma_is_what_the_roll_scatters_by() -> None:
    truth = street(bend_rad=0.5, count=20)
    rolls, sigmas = [], []
    for seed in range(60):
        back, noise = hidden(0), np.random.default_rng(seed).normal(0, 0.05, (20, 3))
        found = register_by_positions(back.inverse().apply_to_poses(truth), truth[:, :, 3] + noise, 20)
        along = np.linalg.svd(truth[:, :, 3] - truth[:, :, 3].mean(axis=0))[2][0]
        turn = Rotation.from_matrix(found.similarity.rotation @ back.rotation.T).as_rotvec()
        rolls.append(turn @ along)
        sigmas.append(found.roll_sigma_rad)
    assert np.std(rolls) == pytest.approx(np.median(sigmas), rel=0.25)


def test_another_direction_can_be_up_in_the_camera() -> None:
    truth = street()
    truth[:, :, :3] = truth[:, :, :3] @ Rotation.from_rotvec([0, 0, np.pi / 2]).as_matrix()
    assert registered(truth, up=UP, up_in_camera=[-1, 0, 0])[1] < 1e-9
    assert registered(truth, up=UP)[1] == pytest.approx(np.pi / 2)


def test_a_way_straight_up_has_no_roll_by_up() -> None:
    truth = street()
    with pytest.raises(InvalidArgument, match="up: is zero or along the path"):
        registered(truth, up=truth[-1, :, 3] - truth[0, :, 3])
    with pytest.raises(InvalidArgument, match="up_in_camera: is zero or along the path"):
        registered(truth, up=UP, up_in_camera=[0, 0, 1])
    with pytest.raises(InvalidArgument, match="up: is zero"):
        registered(truth, up=[0, 0, 0])


def test_fewer_positions_than_pairs_are_named() -> None:
    poses = np.tile(np.eye(3, 4), (8, 1, 1))
    poses[:, 0, 3], poses[:, 1, 3] = np.arange(8.0), np.arange(8.0) ** 2
    with pytest.raises(InvalidArgument, match="measured: there are 4 positions, must be 6 or more"):
        register_by_positions(poses, poses[:4, :, 3])


def test_standing_still_is_refused_with_noise_and_without() -> None:
    truth = street()
    standing = truth.copy()
    standing[:, :, 3] = standing[0, :, 3]
    with pytest.raises(InvalidArgument, match="vision: all 12 positions are the same"):
        register_by_positions(standing, truth[:, :, 3], COUNT, up=UP)
    with pytest.raises(InvalidArgument, match="measured: all 12 positions are the same"):
        register_by_positions(truth, standing[:, :, 3], COUNT, up=UP)
    with pytest.raises(InvalidArgument, match="measured: all 12 positions are the same"):
        register_by_poses(truth, standing, COUNT)


@pytest.mark.parametrize("seed", range(8))
def test_noise_alone_is_no_movement(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = street()
    jitter = truth[:1, :, 3] + rng.normal(0, 1.0, (COUNT, 3))
    told = "measured: 12 positions spread over .* too much to tell a scale|runs against"
    with pytest.raises(InvalidArgument, match=told):
        register_by_positions(truth, jitter, COUNT, up=UP)
    standing = np.concatenate([truth[:, :, :3], jitter[:, :, None]], axis=2)
    with pytest.raises(InvalidArgument, match=told):
        register_by_poses(truth, standing, COUNT)


@pytest.mark.parametrize("bend_rad", [0.0, 1.5])
def test_noisy_poses_register_straight_and_bent_streets(bend_rad: float) -> None:
    truth = street(bend_rad)
    for seed in range(4):
        rng, back = np.random.default_rng(seed), hidden(seed)
        turns = Rotation.from_rotvec(rng.normal(0, 0.01, (COUNT, 3))).as_matrix()
        noisy = np.concatenate(
            [truth[:, :, :3] @ turns, truth[:, :, 3:] + rng.normal(0, 0.2, (COUNT, 3, 1))], axis=2
        )
        found = register_by_poses(back.inverse().apply_to_poses(truth), noisy, COUNT)
        assert angle_between(found.similarity.rotation, back.rotation) < 0.012
        assert found.similarity.scale == pytest.approx(20.0, rel=4 * found.relative_sigma)
        assert 0 < found.relative_sigma < 0.02
        assert not found.upright
