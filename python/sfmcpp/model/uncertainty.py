"""Uncertainty of observations: standard deviations, covariances, or 1 px for all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import BoolArray, FloatArray

# As in the core (cpp/src/residuals/whitening.cpp): less is rounding.
_LEAST_INDEPENDENCE, _MOST_ASYMMETRY = 1e-12, 1e-9


def require_one_uncertainty(sigma_px: FloatArray | None, covariance_px2: FloatArray | None) -> None:
    """Raise InvalidArgument if both standard deviations and covariances are given."""
    if sigma_px is not None and covariance_px2 is not None:
        raise InvalidArgument("covariance_px2: given beside sigma_px, must be one of them")


def first_bad_covariance(covariances: FloatArray) -> tuple[int, str] | None:
    """Find the first of (M, 2, 2) that is no covariance: its number, and what it must be."""
    uu, uv, vu, vv = covariances.reshape(-1, 4).T
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        asymmetry = np.abs(uv - vu) / (np.sqrt(np.abs(uu)) * np.sqrt(np.abs(vv)))
        spread = _variance_given_u(covariances) / vv
    rules: dict[str, BoolArray] = {
        "finite": np.asarray(np.isfinite(covariances).all(axis=(1, 2))),
        "symmetric": (uv == vu) | (asymmetry <= _MOST_ASYMMETRY),
        "positive definite": (uu > 0) & (vv > 0) & (spread > _LEAST_INDEPENDENCE),
    }
    for worst in np.flatnonzero(~np.all(list(rules.values()), axis=0)):
        return int(worst), next(rule for rule, holds in rules.items() if not holds[worst])
    return None


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Uncertainties of a problem: standard deviations (M,), or covariances (M, 2, 2), or neither for 1 px."""

    sigma_px: FloatArray | None = None
    covariance_px2: FloatArray | None = None

    @classmethod
    def of_covariances(cls, covariances: FloatArray) -> Uncertainty:
        """Standard deviations if all of (M, 2, 2) are σ² I, else the covariances."""
        uu = covariances[:, 0, 0]
        if (covariances == uu[:, None, None] * np.eye(2)).all():
            return cls(sigma_px=np.sqrt(uu))
        return cls(covariance_px2=covariances)

    def of_some(self, chosen: NDArray[Any]) -> Uncertainty:
        """Uncertainty of some observations, by number or mask."""
        return Uncertainty(
            None if self.sigma_px is None else self.sigma_px[chosen],
            None if self.covariance_px2 is None else self.covariance_px2[chosen],
        )

    def as_sigmas(self, count: int) -> FloatArray:
        """Standard deviations (M,) [px] of `count` observations without covariances."""
        return np.ones(count) if self.sigma_px is None else self.sigma_px

    def as_covariances(self, count: int) -> FloatArray:
        """Covariances (M, 2, 2) [px²] of `count` observations."""
        if self.covariance_px2 is not None:
            return self.covariance_px2
        return self.as_sigmas(count)[:, None, None] ** 2 * np.eye(2)

    def followed_by(self, sigma_px: FloatArray, count: int) -> Uncertainty:
        """Uncertainty of `count` observations, and of others after them with these σ (k,) [px]."""
        if self.covariance_px2 is not None:
            more = Uncertainty(sigma_px).as_covariances(len(sigma_px))
            return Uncertainty(covariance_px2=np.concatenate([self.covariance_px2, more]))
        return Uncertainty(sigma_px=np.concatenate([self.as_sigmas(count), sigma_px]))


def _cross(covariances: FloatArray) -> FloatArray:
    return np.asarray(0.5 * (covariances[:, 0, 1] + covariances[:, 1, 0]))


def _variance_given_u(covariances: FloatArray) -> FloatArray:
    cross = _cross(covariances)
    return np.asarray(covariances[:, 1, 1] - cross / covariances[:, 0, 0] * cross)


@dataclass(frozen=True, eq=False)
class Whitener:
    """The factor ``L = [1 0; shear stretch] / σ_u`` of each observation, with ``LᵀL = Σ⁻¹``.

    Attributes
    ----------
    sigma_px : (M,) float64, or (1,) of ones
        Standard deviation of u [px], and of v too where there are no covariances.
    shear, stretch : (M,) float64 or None
        Where there are covariances.
    """

    sigma_px: FloatArray
    shear: FloatArray | None = None
    stretch: FloatArray | None = None

    @classmethod
    def of(cls, sigma_px: FloatArray | None, covariance_px2: FloatArray | None) -> Whitener:
        """Of standard deviations (M,) or covariances (M, 2, 2); of 1 px without either."""
        if covariance_px2 is None:
            return cls(np.ones(1) if sigma_px is None else sigma_px)
        sigma_u = np.sqrt(covariance_px2[:, 0, 0])
        stretch = sigma_u / np.sqrt(_variance_given_u(covariance_px2))
        return cls(sigma_u, -_cross(covariance_px2) / covariance_px2[:, 0, 0] * stretch, stretch)

    def finish(self, scaled: FloatArray) -> FloatArray:
        """What has been divided by `sigma_px`, (M, 2, …), turned into what L gives."""
        if self.shear is None or self.stretch is None:
            return scaled
        places = (-1,) + (1,) * (scaled.ndim - 2)
        second = self.shear.reshape(places) * scaled[:, 0] + self.stretch.reshape(places) * scaled[:, 1]
        return np.stack([scaled[:, 0], second], axis=1)
