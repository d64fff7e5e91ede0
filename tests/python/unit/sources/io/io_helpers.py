"""Random problems and comparisons for the tests of files."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from hypothesis import HealthCheck, settings

from projection import reference_residuals
from sfmcpp import CAMERA_MODELS, DatasetError, Metadata, Problem
from sfmcpp.sources.io import read

ROTATION_ATOL = 2e-14

_NASTY_WORDS = b"nan,inf,-1,#,\0,\xff,1e999,1e300,-,., ," + b"9" * 30

PROPERTY = settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


def residuals(problem: Problem) -> np.ndarray:
    """Reprojection residuals (M, 2) [px], from the definitions of the camera models alone."""
    return -reference_residuals(replace(problem, sigma_px=None, covariance_px2=None))


def cost(problem: Problem) -> float:
    """Half the sum of squared residuals."""
    return float(0.5 * np.sum(residuals(problem) ** 2))


def mean_squared_error(problem: Problem) -> float:
    """Mean squared norm of the residuals, as sba prints it."""
    return 2 * cost(problem) / problem.num_observations


def random_rotations(rng: np.random.Generator, count: int) -> np.ndarray:
    """Rotations (count, 3, 3), many of them the identity, tiny, or a half turn."""
    axes = rng.normal(size=(count, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    special = np.array([0.0, 1e-12, 1e-6, np.pi - 1e-9, np.pi])
    angles = np.where(rng.random(count) < 0.5, rng.choice(special, count), rng.uniform(0, np.pi, count))
    half = angles[:, None] / 2
    w, (x, y, z) = np.cos(half)[:, 0], (np.sin(half) * axes).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1).reshape(count, 3, 3)


def random_numbers(rng: np.random.Generator, *shape: int) -> np.ndarray:
    """Ordinary numbers mixed with zeros, tiny and huge ones."""
    odd = rng.choice([0.0, -0.0, 1e-300, 5e-324, 1e100, -1e16, 0.1, 1 / 3], shape)
    return np.where(rng.random(shape) < 0.3, odd, rng.normal(size=shape) * 10.0 ** rng.integers(-3, 4, shape))


def random_problem(
    seed: int, model: str, intrinsics: dict[str, float], *, least: int = 0, shared: bool = False
) -> Problem:
    """Make a random problem; `intrinsics` names the parameters that vary and the size of their variation."""
    rng = np.random.default_rng(seed)
    cameras, points = (int(n) for n in rng.integers(least, 6, 2))
    rows = max(1, cameras // 2) if shared else cameras
    names = CAMERA_MODELS[model].intrinsics
    values = np.tile([1.0 if name == "aspect" else 0.0 for name in names], (rows, 1))
    for name, size in intrinsics.items():
        values[:, names.index(name)] += size * rng.uniform(0.1, 1, rows)
    seen = rng.random((points, cameras)) < 0.6
    point_index, camera_index = np.nonzero(seen)
    poses = np.concatenate([random_rotations(rng, cameras), rng.normal(size=(cameras, 3, 1)) * 9], axis=2)
    return Problem(
        model,
        poses,
        values,
        random_numbers(rng, points, CAMERA_MODELS[model].point_size),
        camera_index.astype(np.int32),
        point_index.astype(np.int32),
        random_numbers(rng, len(camera_index), 2),
        intrinsics_index=rng.integers(0, rows, cameras).astype(np.int32) if shared else None,
        metadata=Metadata(point_colors=rng.integers(0, 256, (points, 3)).astype(np.uint8)),
    )


def assert_same_problem(
    actual: Problem, expected: Problem, *, intrinsics_rtol: float = 0.0, pixels_atol: float = 0.0
) -> None:
    """Everything equal to the last bit, but for what rounding does to poses (and, if asked, other fields)."""
    assert actual.camera_model == expected.camera_model
    for name in ("camera_index", "point_index", "intrinsics_index", "points"):
        np.testing.assert_array_equal(getattr(actual, name), getattr(expected, name), err_msg=name)
    np.testing.assert_allclose(actual.pixels, expected.pixels, rtol=0, atol=pixels_atol)
    np.testing.assert_allclose(actual.intrinsics, expected.intrinsics, rtol=intrinsics_rtol, atol=0)
    np.testing.assert_allclose(actual.rotations, expected.rotations, rtol=0, atol=ROTATION_ATOL)
    distance = np.linalg.norm(actual.centres - expected.centres, axis=1)
    assert (distance <= 1e-13 * np.linalg.norm(expected.centres, axis=1)).all()
    np.testing.assert_array_equal(actual.fixed_intrinsics, expected.fixed_intrinsics)


def assert_same_bits(actual: Problem, expected: Problem) -> None:
    """The whole problem equal to the last bit, as a file of binary numbers keeps it."""
    assert_same_problem(actual, expected)
    for name in ("cameras", "fixed_cameras", "fixed_points", "sigma_px", "covariance_px2"):
        np.testing.assert_array_equal(getattr(actual, name), getattr(expected, name), err_msg=name)
    assert_same_metadata(actual, expected)


def assert_same_metadata(actual: Problem, expected: Problem) -> None:
    """Names, sizes, colours and everything extra equal."""
    one, other = actual.metadata, expected.metadata
    assert one.source_format == other.source_format
    assert one.image_names == other.image_names
    for name in ("image_sizes", "point_colors"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    assert one.extra.keys() == other.extra.keys()
    for key, value in other.extra.items():
        np.testing.assert_array_equal(one.extra[key], value, err_msg=key)


def assert_same_residuals(actual: Problem, expected: Problem) -> None:
    """Costs equal to 1e-9 and each residual to 1e-9 of its size, or of a pixel if it is smaller."""
    one, other = residuals(actual), residuals(expected)
    assert np.all(np.abs(one - other) <= 1e-9 * np.maximum(1, np.abs(other)))
    np.testing.assert_allclose(cost(actual), cost(expected), rtol=1e-9)


def assert_valid(problem: Problem) -> None:
    """Assert what a reader may never break."""
    for name in ("cameras", "intrinsics", "points", "pixels"):
        assert np.isfinite(getattr(problem, name)).all(), name
    assert ((problem.camera_index >= 0) & (problem.camera_index < problem.num_cameras)).all()
    assert ((problem.point_index >= 0) & (problem.point_index < problem.num_points)).all()
    assert ((problem.intrinsics_index >= 0) & (problem.intrinsics_index < len(problem.intrinsics))).all()
    pairs = np.stack([problem.camera_index, problem.point_index])
    assert np.unique(pairs, axis=1).shape == pairs.shape
    gram = problem.rotations @ problem.rotations.transpose(0, 2, 1)
    np.testing.assert_allclose(gram, np.broadcast_to(np.eye(3), gram.shape), atol=2e-6)
    assert (np.linalg.det(problem.rotations) > 0).all()
    assert problem.sigma_px is None or (problem.sigma_px > 0).all()


@contextmanager
def no_warnings() -> Iterator[None]:
    """Warnings are errors inside."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def assert_valid_or_refused(path: Path) -> None:
    """Assert that reading gives a valid problem or one DatasetError: no other exception, no warning."""
    problem = error = None
    with no_warnings():
        try:
            problem = read(path)
        except DatasetError as caught:
            error = caught
    if problem is not None:
        assert_valid(problem)
    else:
        assert error is not None
        assert "\n" not in str(error)


def refusal(path: Path) -> DatasetError:
    """Return the DatasetError that reading `path` raises."""
    with no_warnings():
        try:
            problem = read(path)
        except DatasetError as error:
            return error
    raise AssertionError(f"{path} was read as {problem}")


def mutated(data: bytes, seed: int) -> bytes:
    """Random damage: cut, flipped, deleted, repeated, or with a nasty word put in."""
    rng = np.random.default_rng(seed)
    for _ in range(int(rng.integers(1, 4))):
        i, j = sorted(rng.integers(0, len(data) + 1, 2).tolist())
        words = [*_NASTY_WORDS.split(b","), b"\n"]
        word, byte = words[rng.integers(len(words))], bytes([rng.integers(256)])
        choices = [data[:i], data[:i] + byte + data[i + 1 :], data[:i] + data[j:], data[:i] + word + data[i:]]
        choices += [data[:i] + data[i : i + 40] + data[i:], data[:i] + word + data[i + 8 :]]
        choices += [data[:i] + b"%d" % rng.integers(10) + data[i + 1 :]] * 3
        data = choices[rng.integers(len(choices))]
    return data
