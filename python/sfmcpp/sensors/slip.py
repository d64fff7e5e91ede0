"""Slow slip of an odometer, by comparison with a map that was adjusted without it.

The scale of a map follows an odometer whose distances are wrong by a slowly growing factor, so that images
and odometer do not come into conflict. Without the odometer, the scale of the map drifts only as far as the
covariance of the images allows: a slip is significant where the ratio of both distances changes by more.
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

# Least log-likelihood ratio of a slip against none. Under an exact covariance, a drift of forty steps exceeds
# it in 3 to 6 of 1,000 cases; with fault-free odometers the largest was 5.4, on parts of KITTI's 0001, 0027,
# 0036 and 0039.
SLIP_MARGIN = 8.0
# Logarithms of the factor: a smaller slip is not worth a correction, a larger one is rather a map that has
# lost its scale.
_LEAST, _LARGEST = 0.08, 0.6
# Shortest slip [s], and longest, as a share of the stretch of the map: one of most of it is not slow slip.
_SHORTEST_S, _LARGEST_SHARE = 1.5, 0.6
# Candidates begin and end at times so far apart [s], of which there are so many at most.
_STEP_S, _MOST_ENDS = 0.25, 100
# Share of the squared acceleration that may remain after a slip is corrected: on parts of 0001, 0027, 0036
# and 0039 it was 0.48 at most after true slips, and 9,000 times as much after false ones.
_LEFT_SHARE = 0.5
# Least number of steps of the map on either side of a slip, and during it.
_FEWEST_BESIDE, _FEWEST_WITHIN = 2, 4
# A map may begin or end during a slip: where none within it is found, those that begin or end so much beyond
# it are tried [s].
_BEYOND_S = 2.0


@dataclass(frozen=True)
class Slip:
    """A factor on the distances of an odometer whose logarithm rises and falls as a raised cosine.

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
        """Log-likelihood ratio against no slip."""
        return 0.5 * (self.log_factor / self.sigma) ** 2

    def _phases(self, t_s: FloatArray) -> FloatArray:
        return np.clip((t_s - self.start_s) / (self.end_s - self.start_s), 0.0, 1.0)

    @property
    def complaint(self) -> str:
        """A clause that describes it."""
        factor = float(np.exp(self.log_factor))
        return (
            f"it slips from {self.start_s:.2f} to {self.end_s:.2f} s, by the images: its distances are up to "
            f"{factor:.2f} ± {factor * self.sigma:.2f} times the true ones"
        )


@checked(stamps_s=(ANY,), log_ratios=(ANY,), covariance=(ANY, ANY))
def find_slip(stamps_s: FloatArray, log_ratios: FloatArray, covariance: FloatArray) -> Slip | None:
    """Find the stretch in which an odometer's distances differ most from those of a map of images.

    It may begin up to two seconds before the map, or end as much after it.

    Parameters
    ----------
    stamps_s : (n + 1,) float64
        Times of the keyframes of a stretch that images connect, ascending [s].
    log_ratios : (n,) float64
        Logarithm of the length of each step by the images over that by the odometer; not a number where there
        is none. The scale of the images is arbitrary.
    covariance : (n, n) float64
        Covariance of the logarithms, of images and odometer together.

    Returns
    -------
    Slip or None
        None where the drift of the images explains the ratios about as well, or there are too few steps.

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
    if np.count_nonzero(known) < _FEWEST_WITHIN + 2 * _FEWEST_BESIDE:
        return None
    whiten = _whitening(covariance[np.ix_(known, known)])
    # One that the images see whole comes first: of others they tell less.
    found = (_likeliest(whiten, log_ratios, *_candidates(stamps_s, known, b)) for b in (0.0, _BEYOND_S))
    return next((slip for slip in found if slip is not None), None)


def _likeliest(
    whiten: FloatArray, log_ratios: FloatArray, slips: list[Slip], courses: FloatArray
) -> Slip | None:
    """The slip, of some with these courses (n, slips), that explains most, if that is enough."""
    if not slips:
        return None
    errors, told = whiten @ -log_ratios[np.isfinite(log_ratios)], whiten @ courses
    information = (told**2).sum(axis=0)
    sizes = told.T @ errors / information
    best = int(np.argmax(sizes**2 * information))
    # Where the residuals scatter by more than the covariance says, it is scaled up.
    left = (errors - sizes[best] * told[:, best])[courses[:, best] > 0]
    sigma = np.sqrt(max(1.0, np.mean(left**2)) / information[best])
    found = replace(slips[best], log_factor=float(sizes[best]), sigma=float(sigma))
    return found if found.gain >= SLIP_MARGIN and _LEAST <= abs(found.log_factor) <= _LARGEST else None


def _candidates(stamps_s: FloatArray, known: BoolArray, beyond_s: float) -> tuple[list[Slip], FloatArray]:
    """Slips within the stretch, or up to `beyond_s` beyond it, and the logarithms of their factors.

    The latter (n, slips) at known steps.
    """
    beside = 0 if beyond_s else _FEWEST_BESIDE
    first_s, last_s = float(stamps_s[beside]) - beyond_s, float(stamps_s[-1 - beside]) + beyond_s
    longest_s = _LARGEST_SHARE * (stamps_s[-1] - stamps_s[0] + 2 * beyond_s)
    ends_s = np.linspace(first_s, last_s, min(int((last_s - first_s) / _STEP_S) + 2, _MOST_ENDS)).tolist()
    slips = [Slip(a, b, 1.0, 0.0) for a in ends_s for b in ends_s if _SHORTEST_S <= b - a <= longest_s]
    courses = [slip.mean_log_factors(stamps_s)[known] for slip in slips]
    long = [k for k, course in enumerate(courses) if np.count_nonzero(course) >= _FEWEST_WITHIN]
    return [slips[k] for k in long], np.array([courses[k] for k in long]).T


def _whitening(covariance: FloatArray) -> FloatArray:
    """Matrix (n, n) that whitens logarithms of that covariance and removes their mean, the unknown scale."""
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
        The slip to correct.

    Returns
    -------
    SensorStream
        Distances are integrated anew from the first sample.

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
    """Whether correcting a slip removes half of the squared acceleration while it lasts.

    A vehicle has inertia. If the odometer slips, its speed rises and falls with the factor, and is steadier
    when corrected; if it is the images that lose their scale, the corrected speed is the less steady one.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"speed"``, ``"distance"`` or ``"velocity"``.
    slip : Slip
        As found from the images.

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
