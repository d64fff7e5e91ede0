"""Biases of the gyroscopes of a run: where the camera stands, and by pairs of images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sfmcpp.model import Gap, SensorStream
from sfmcpp.sensors import Mounting, RateBias, Turn, bias_at_rest, find_bias, without_bias
from sfmcpp.slam.standstill import Standstill

# Estimates of a bias that differ by less count as the same [rad/s].
_SAME_RAD_S = float(np.radians(0.1))
_NONE = RateBias(np.zeros(1), np.zeros((1, 3)))


@dataclass(frozen=True, eq=False)
class RatesAtRest:
    """What the rests of the body say of angular rates.

    Attributes
    ----------
    rests : int
        Number of these rests.
    bias : RateBias or None
        The bias by them.
    stream : SensorStream
        The rates without it.
    """

    rests: int
    bias: RateBias | None
    stream: SensorStream

    @classmethod
    def of(cls, stream: SensorStream, rests: Sequence[Gap]) -> RatesAtRest:
        """Of a stream, with the rests in the order of time."""
        bias = bias_at_rest(stream, rests)
        return cls(len(rests), bias, stream if bias is None else without_bias(stream, bias))


@dataclass
class RateBiases:
    """What a run has learnt of the biases of its gyroscopes.

    Attributes
    ----------
    known : dict of RateBias
        What is to be taken from the rates, by name.
    at_start : dict of RateBias
        The same as the map began: by that nothing is bent.
    standstill : Standstill
        The frames in a row in which the camera stands.
    rests : list of Gap
        When it stood, in the order of time.
    """

    known: dict[str, RateBias] = field(default_factory=dict)
    at_start: dict[str, RateBias] = field(default_factory=dict)
    standstill: Standstill = field(default_factory=Standstill)
    rests: list[Gap] = field(default_factory=list)

    def learn(self, name: str, at_rest: RatesAtRest, mounting: Mounting, turns: Sequence[Turn]) -> bool:
        """Estimate the bias of the gyroscope of that name anew; whether it has changed."""
        found = _bias_of(at_rest, mounting, turns)
        if found is None or not found.differs_from(self.known.get(name), _SAME_RAD_S):
            return False
        self.known[name] = found
        return True

    def begin(self) -> None:
        """Note what is known as the map begins."""
        self.at_start = dict(self.known)

    @property
    def late(self) -> list[str]:
        """Names of the gyroscopes whose bias was learnt, or has changed, after the map began."""
        return [name for name, bias in self.known.items() if bias is not self.at_start.get(name)]


def _bias_of(at_rest: RatesAtRest, mounting: Mounting, turns: Sequence[Turn]) -> RateBias | None:
    """The bias at rest, and what pairs of images show beside it."""
    more = find_bias(at_rest.stream, mounting, turns)
    return at_rest.bias if more is None else (at_rest.bias or _NONE).plus(more)
