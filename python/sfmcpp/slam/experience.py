"""Knowledge about a sensor gained during a run: its σ where undeclared, and its conflicts."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from itertools import takewhile

import numpy as np

from sfmcpp.model import Gap
from sfmcpp.model.weight_selection import ConflictReport
from sfmcpp.slam.measurement import METRIC_KINDS, PLACE_KINDS, Measurement
from sfmcpp.weighting.conflict import chi_square_median

# Keyframes whose innovations give a standard deviation.
KEYFRAMES_OF_SIGMA = 6
# It is at least this share of what sensor and images differ by: less cannot be told from the images' noise.
_LEAST_SHARE = 0.1
# Fewer points than this agree on a wrong pose now and then, and say nothing against a sensor: on the tuning
# drives, with all tracks and with a third to a half of them, a fault-free odometer was off by five standard
# deviations at 2.0 % of the keyframes with fewer and at 0.2 % of the others.
_FEWEST_POINTS = 22
# As many keyframes in a row disagree where one of both is wrong: fault-free sensors came to five (the map
# drifts, and its points count as exact), a bias, a slip or a clock of three tenths of a second to seven and
# more.
_FEWEST_IN_A_ROW = 6
# Or they disagree by so much together, in squares of what is usual on the run. On parts of the tuning drives
# fault-free sensors came to 46, a bias of 5 deg/s to more in 15 of 16 runs, a slow slip of 40 % in 9 of 16;
# with a third to a half of their tracks fault-free ones came to more in 1 run of 44.
_STRONG = 64.0
# Both are for as many judged keyframes, those of some three hundred frames. More give chance more trials: of
# the conflicts with fault-free sensors half or fewer last for one keyframe more, and their squares have an
# exponential tail of 7 (drives for tuning) to 15 (simulated ones of 5,000 frames, with a GPS).
_TYPICAL_KEYFRAMES = 100
_SHARE_ONE_LONGER, _SQUARES_TAIL = 0.5, 12.0
# With fewer points the map gives no pose, as where tracks die while the camera stands; the next points take
# over what a bridged step leaves of the scale, or images alone where a sensor is silent. So many keyframes
# later the sensors have restored it: all conflicts of an odometer on 15,000 simulated fault-free frames came
# before.
_LOST_POINTS = 10
_RESTORED_AFTER = 4
# Keyframes beside a conflict belong to it from so many standard deviations on, and so much time beside these:
# a fault is there before it is noticed [s].
_LEADING_SIGMAS, _MARGIN_S = 1.5, 0.5
# Fault-free sensors came to no more in the median of a run; what lasts for half of it is usual itself.
_LARGEST_USUAL = 3.0
# The error of a speed grows no faster without a leap that its stream shows: a body brakes by no more, and a
# slip to 0.6 or 1.4 that lasts for two seconds makes as much of 13 m/s.
_LARGEST_GROWTH_M_S2 = 8.0
# A shorter step does not tell by how much a speed is off [s].
_SHORTEST_S = 0.1
# Median of the absolute value of a standard normal number.
_MEDIAN_SIGMAS = 0.6745


@dataclass
class Experience:
    """How one sensor compared with the images so far.

    Attributes
    ----------
    reports : list of ConflictReport
        One of each keyframe.
    stretches : list of Gap
        The time that each is of [s].
    explained : set of int
        Places of the reports in conflicts that ended as the map was moved to the sensor.
    refuted : set of int
        Places of the reports that say nothing against the sensor, as the images were wrong.
    sigma : float or None
        Standard deviation estimated from the innovations of the first keyframes, where none is declared: the
        errors at the poses of the images alone, less what the noise of the images makes of them. Medians, so
        that a few wrong ones do not matter. None before there are as many.
    """

    reports: list[ConflictReport] = field(default_factory=list)
    stretches: list[Gap] = field(default_factory=list)
    sigma: float | None = None
    explained: set[int] = field(default_factory=set)
    refuted: set[int] = field(default_factory=set)

    def add(self, report: ConflictReport, stretch: Gap, *, refuted: bool = False) -> None:
        """Take the next keyframe, and the time from the one before to it; `refuted`: its images are wrong."""
        if refuted:
            self.refuted.add(len(self.reports))
        self.reports.append(report)
        self.stretches.append(stretch)
        undeclared = report.sensor_sigma is None
        if undeclared and self.sigma is None and len(self.reports) >= KEYFRAMES_OF_SIGMA:
            self.sigma = _sigma_of(self.reports)

    def explain(self) -> None:
        """Note that the map has been moved to the sensor, which ends the conflict there is."""
        for k in range(len(self.reports) - 1, -1, -1):
            if not self.reports[k].conflicting:
                break
            self.explained.add(k)

    def describe(self, name: str) -> list[str]:
        """Messages about the sensor of that name, one sentence each."""
        sentences = []
        if self.sigma is not None:
            sentences.append(
                f"{name}: no standard deviation is declared; {self.sigma:.2g} {self.reports[0].unit} was "
                f"estimated from the images at its first {KEYFRAMES_OF_SIGMA} keyframes"
            )
        places = self._worst_conflict()
        if places:
            worst = [self.reports[k] for k in places]
            sentences.append(
                f"{name}: disagrees with the images at {_keyframes(len(worst))}, by up to "
                f"{max(report.sigmas for report in worst):.0f} σ and "
                f"{max(report.discrepancy for report in worst):.2g} {worst[0].unit}: {self._told_of(places)}"
            )
        return sentences

    def _told_of(self, conflict: list[int]) -> str:
        if self.explained.issuperset(conflict):
            return "the images drifted, or it is wrong; the map was moved to it"
        return "one of them is wrong"

    @property
    def is_denied(self) -> bool:
        """Whether the latest keyframes contradict it for so long, or so strongly, that it is no chance."""
        backwards = (k for k in reversed(range(len(self.reports))) if self._is_judged(k))
        latest = [*takewhile(lambda k: self.reports[k].conflicting, backwards)][::-1]
        if not latest:  # as a rule: this is asked at every keyframe
            return False
        judged = self._judged()
        power = _strength(self.reports, latest, _usual_sigmas(self.reports, judged))
        return _is_no_chance(len(latest), power, len(judged))

    @property
    def denied(self) -> Gap | None:
        """Time span of the worst conflict, with its onset and end; None where there is none."""
        worst = self._worst_conflict()
        if not worst:
            return None
        first, last = worst[0], worst[-1]
        while first > 0 and self.reports[first - 1].sigmas > _LEADING_SIGMAS:
            first -= 1
        while last + 1 < len(self.reports) and self.reports[last + 1].sigmas > _LEADING_SIGMAS:
            last += 1
        return Gap(self.stretches[first].start_s - _MARGIN_S, self.stretches[last].end_s + _MARGIN_S)

    def reach_m(self, start_s: float, end_s: float) -> float:
        """How far a step of an odometer between two times can be off, beside noise [m].

        A body has inertia, and a stream that leaps has no weight: an odometer that agreed with the images at
        the keyframe before is not off by metres at the next. One in conflict has no bound, unless it is the
        images that are wrong: until they agree again, nothing they say counts against it.
        """
        if not self.reports:
            return math.inf
        last, stretch = self.reports[-1], self.stretches[-1]
        if last.conflicting:
            return 0.0 if len(self.reports) - 1 in self.refuted else math.inf
        off_m_s = last.discrepancy / max(stretch.end_s - stretch.start_s, _SHORTEST_S)
        off_m_s += _LARGEST_GROWTH_M_S2 * max(start_s - stretch.end_s, 0.0)
        step_s = end_s - start_s
        return off_m_s * step_s + 0.5 * _LARGEST_GROWTH_M_S2 * step_s**2

    def _worst_conflict(self) -> list[int]:
        """The worst stretch of reports in conflict, by their places; empty if none is long or strong enough.

        One that is not explained is worse than those that are.
        """
        judged = self._judged()
        stretches: list[list[int]] = [[]]
        for k in judged:
            if self.reports[k].conflicting:
                stretches[-1].append(k)
            elif stretches[-1]:
                stretches.append([])
        usual = _usual_sigmas(self.reports, judged)
        conflicts = [
            (not self.explained.issuperset(stretch), power, stretch)
            for stretch in stretches
            if _is_no_chance(len(stretch), power := _strength(self.reports, stretch, usual), len(judged))
        ]
        return max(conflicts)[2] if conflicts else []

    def _judged(self) -> list[int]:
        """Places of the reports that count."""
        return [k for k in range(len(self.reports)) if self._is_judged(k)]

    def _is_judged(self, k: int) -> bool:
        """Whether a report is of enough points, which are right and have not lost their scale just before."""
        if self.reports[k].observations < _FEWEST_POINTS or k in self.refuted:
            return False
        just_before = range(max(k - _RESTORED_AFTER, 0), k + 1)
        return self.reports[k].unit != "m" or all(map(self._holds_scale, just_before))

    def _holds_scale(self, k: int) -> bool:
        """Whether the map has held its scale up to a report: by its points, and not without the sensor."""
        follows = k == 0 or self.stretches[k].start_s <= self.stretches[k - 1].end_s
        return follows and self.reports[k].observations >= _LOST_POINTS


def informed(measurement: Measurement, known: Experience, start_s: float, end_s: float) -> Measurement:
    """A measurement between two times [s], with what is known of its sensor: σ, and how far it can be off."""
    of_motion = measurement.kind in METRIC_KINDS and measurement.kind not in PLACE_KINDS
    reach = known.reach_m(start_s, end_s) if of_motion else math.inf
    sigma = known.sigma if measurement.sigma is None else measurement.sigma
    return replace(measurement, sigma=sigma, reach=reach)


def _sigma_of(reports: list[ConflictReport]) -> float:
    freedom = np.array([max(report.degrees_of_freedom, 1) for report in reports])
    squares = [report.discrepancy**2 for report in reports]
    apart = float(np.median(squares / chi_square_median(freedom)))
    from_images = float(np.median([report.images_sigma**2 for report in reports]))
    return float(np.sqrt(max(apart - from_images, _LEAST_SHARE**2 * apart)))


def _keyframes(count: int) -> str:
    return "1 keyframe" if count == 1 else f"{count} consecutive keyframes"


def _is_no_chance(in_a_row: int, power: float, judged: int) -> bool:
    """Whether conflicts in a row, of such strength, are more than chance makes of so many reports."""
    fewest, strong = _limits(judged)
    return in_a_row >= fewest or power >= strong


def _usual_sigmas(reports: list[ConflictReport], judged: list[int]) -> float:
    """What a standard deviation of the `judged` reports really is on the run; at least one."""
    median = float(np.median([reports[k].sigmas for k in judged])) if judged else 0.0
    return float(np.clip(median / _MEDIAN_SIGMAS, 1.0, _LARGEST_USUAL))


def _strength(reports: list[ConflictReport], stretch: list[int], usual: float) -> float:
    """Sum of the squares of conflicts in a row, in units of what is usual."""
    return float(np.sum((np.array([reports[k].sigmas for k in stretch]) / usual) ** 2))


def _limits(count: int) -> tuple[float, float]:
    """Length and strength from which the largest of as many judged keyframes is no chance."""
    more = math.log(max(count / _TYPICAL_KEYFRAMES, 1.0))
    return _FEWEST_IN_A_ROW - more / math.log(_SHARE_ONE_LONGER), _STRONG + more * _SQUARES_TAIL
