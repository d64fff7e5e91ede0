"""Slow slip of an odometer, by the scale of a map that images alone hold together.

A factor that grows little by little and goes again is followed by a map before there is a conflict. But the
scale of images drifts by what their tracks leave open, which their own covariance tells: a slip stands out
where they hold the scale from before it to after it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import SensorStream
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import ANY, BoolArray, FloatArray
from sfmcpp.sensors.odometer import speeds_of
from sfmcpp.sensors.stream import require_kind

# How much more likely a slip must be than none, as a logarithm. Where the covariance is exact, a drift of
# forty steps comes to more in 3 to 6 of 1,000 cases; beside honest odometers it came to 5.4 on parts of 0001,
# 0027, 0036 and 0039.
_MARGIN = 8.0
# Slips that are told, as logarithms of the factor: smaller ones are not worth it, and a larger one is rather
# a map that has lost its scale.
_LEAST, _LARGEST = 0.08, 0.6
# Shorter ones are no slow slips, nor are those that last for most of a stretch of the map [s].
_SHORTEST_S, _LARGEST_SHARE = 1.5, 0.6
# Ends of slips that are tried [s], and how many of them at most.
_STEP_S, _MOST_ENDS = 0.25, 100
# Share of the squared acceleration that may be left: on parts of 0001, 0027, 0036 and 0039 slips left 0.48 at
# most, and what was none 9,000 times as much.
_LEFT_SHARE = 0.5
# Steps of the map before it, during it and after it.
_FEWEST_BESIDE, _FEWEST_WITHIN = 2, 4


@dataclass(frozen=True)
class Slip:
    """A factor on the distances of an odometer that grows and goes again, as a raised cosine.

    Attributes
    ----------
    start_s, end_s : float
        When it begins and ends [s].
    log_factor : float
        Logarithm of the factor on its distances in the middle.
    sigma : float
        Standard deviation of that logarithm.
    """

    start_s: float
    end_s: float
    log_factor: float
    sigma: float

    def log_factors(self, t_s: FloatArray) -> FloatArray:
        """Logarithms (n,) of the factor at times (n,) [s]."""
        return np.asarray(self.log_factor * np.sin(np.pi * self._phases(t_s)) ** 2)

    def mean_log_factors(self, stamps_s: FloatArray) -> FloatArray:
        """Means (n,) of the logarithms from each of the times (n + 1,), ascending [s], to the next."""
        phases = self._phases(stamps_s)
        lasting_s = self.end_s - self.start_s
        integral_s = lasting_s * (0.5 * phases - np.sin(2 * np.pi * phases) / (4 * np.pi))
        return np.asarray(self.log_factor * np.diff(integral_s) / np.diff(stamps_s))

    @property
    def gain(self) -> float:
        """By how much it is more likely than none, as a logarithm."""
        return 0.5 * (self.log_factor / self.sigma) ** 2

    def _phases(self, t_s: FloatArray) -> FloatArray:
        return np.clip((t_s - self.start_s) / (self.end_s - self.start_s), 0.0, 1.0)

    @property
    def complaint(self) -> str:
        """What it does, in a clause."""
        factor = float(np.exp(self.log_factor))
        return (
            f"it slips from {self.start_s:.2f} to {self.end_s:.2f} s, by the images: its distances are up to "
            f"{factor:.2f} ± {factor * self.sigma:.2f} times the true ones"
        )


@checked(stamps_s=(ANY,), log_ratios=(ANY,), covariance=(ANY, ANY))
def find_slip(stamps_s: FloatArray, log_ratios: FloatArray, covariance: FloatArray) -> Slip | None:
    """Find the stretch in which an odometer's distances differ most from those of a map of images.

    Parameters
    ----------
    stamps_s : (n + 1,) float64
        Times of the keyframes of a stretch that images hold together, ascending [s].
    log_ratios : (n,) float64
        Logarithm of each step by the images over that by the odometer; not a number where there is none. The
        unit of the images is their own.
    covariance : (n, n) float64
        Covariance of the logarithms, by images and odometer.

    Returns
    -------
    Slip or None
        None where nothing, or a drift of the images, explains the ratios about as well.

    Raises
    ------
    InvalidArgument
        If the lengths do not fit together.
    """
    if len(stamps_s) != len(log_ratios) + 1 or covariance.shape != (len(log_ratios),) * 2:
        raise InvalidArgument(
            f"stamps_s, log_ratios, covariance: have {len(stamps_s)}, {len(log_ratios)} and "
            f"{covariance.shape} entries: must be n + 1, n and (n, n)"
        )
    known = np.isfinite(log_ratios)
    slips, courses = _candidates(stamps_s, known)
    if not slips:
        return None
    whiten = _whitening(covariance[np.ix_(known, known)])
    errors, told = whiten @ -log_ratios[known], whiten @ courses
    information = (told**2).sum(axis=0)
    sizes = told.T @ errors / information
    best = int(np.argmax(sizes**2 * information))
    # Where images scatter by more than they may, they are believed less.
    left = (errors - sizes[best] * told[:, best])[courses[:, best] > 0]
    sigma = np.sqrt(max(1.0, np.mean(left**2)) / information[best])
    found = replace(slips[best], log_factor=float(sizes[best]), sigma=float(sigma))
    return found if found.gain >= _MARGIN and _LEAST <= abs(found.log_factor) <= _LARGEST else None


def _candidates(stamps_s: FloatArray, known: BoolArray) -> tuple[list[Slip], FloatArray]:
    """Slips that leave keyframes on either side, and their courses (n, slips) over the known steps."""
    if np.count_nonzero(known) < _FEWEST_WITHIN + 2 * _FEWEST_BESIDE:
        return [], np.zeros((0, 0))
    first_s, last_s = float(stamps_s[_FEWEST_BESIDE]), float(stamps_s[-1 - _FEWEST_BESIDE])
    longest_s = _LARGEST_SHARE * (stamps_s[-1] - stamps_s[0])
    ends_s = np.linspace(first_s, last_s, min(int((last_s - first_s) / _STEP_S) + 2, _MOST_ENDS)).tolist()
    slips = [Slip(a, b, 1.0, 0.0) for a in ends_s for b in ends_s if _SHORTEST_S <= b - a <= longest_s]
    courses = [slip.mean_log_factors(stamps_s)[known] for slip in slips]
    long = [k for k, course in enumerate(courses) if np.count_nonzero(course) >= _FEWEST_WITHIN]
    return [slips[k] for k in long], np.array([courses[k] for k in long]).T


def _whitening(covariance: FloatArray) -> FloatArray:
    """What makes logarithms of that covariance (n, n) white, and takes away the unit of the images."""
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    unit = whiten.sum(axis=1) / np.linalg.norm(whiten.sum(axis=1))
    return np.asarray(whiten - np.outer(unit, unit @ whiten))


@checked()
def without_slip(stream: SensorStream, slip: Slip) -> SensorStream:
    """The stream as it is without a slip.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"speed"``, ``"distance"`` or ``"velocity"``.
    slip : Slip
        What to take away.

    Returns
    -------
    SensorStream
        Distances are those without it from the first sample on.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    require_kind(stream, "speed", "distance", "velocity")
    if stream.kind != "distance":
        return replace(stream, values=stream.values * np.exp(-slip.log_factors(stream.t_s))[:, None])
    ways = np.diff(stream.values[:, 0]) * np.exp(-slip.mean_log_factors(stream.t_s))
    values = stream.values[0, 0] + np.concatenate([[0.0], np.cumsum(ways)])
    return replace(stream, values=values[:, None])


@checked()
def is_easier_without(stream: SensorStream, slip: Slip) -> bool:
    """Whether a slip explains half of the squared acceleration while it lasts, as inertia has it.

    A factor that comes and goes shows in the speed of an odometer that slips. Where the speed is even and it
    is images that lose their scale, a body that did what they say would brake and accelerate.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"speed"``, ``"distance"`` or ``"velocity"``.
    slip : Slip
        What images say.

    Returns
    -------
    bool

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    left = _squared_acceleration(without_slip(stream, slip), slip)
    return left <= _LEFT_SHARE * _squared_acceleration(stream, slip)


def _squared_acceleration(stream: SensorStream, slip: Slip) -> float:
    """Integral of the square of the acceleration while it lasts [m²/s³]."""
    t_s, speeds = speeds_of(stream)
    during = (t_s[1:] >= slip.start_s) & (t_s[:-1] <= slip.end_s)
    return float(np.sum((np.diff(speeds) ** 2 / np.diff(t_s))[during]))
