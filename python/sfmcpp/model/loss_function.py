"""User-defined robust losses, tabulated for the solvers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp import _core
from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import FloatArray, shaped_array
from sfmcpp.model.checks import require_text

Curve: TypeAlias = Callable[[FloatArray], ArrayLike]

_TERMS = _core.LOSS_TABLE_TERMS
# Where a cell of the table is sampled, and where it is then compared: from 0 to 1.
_NODES = 0.5 - 0.5 * np.cos(np.pi * np.arange(_TERMS) / (_TERMS - 1))
_TESTS = 0.5 * (_NODES[1:] + _NODES[:-1])
_TO_COEFFICIENTS = np.linalg.inv(np.vander(_NODES, increasing=True))
_AT_TESTS = np.vander(_TESTS, _TERMS, increasing=True)
# Where the core refuses weights below zero, by more than a part of the largest coefficient
# (residuals/loss.cpp); half of that part here, as it sums in another order.
_AT_CHECKS = np.vander(np.linspace(0.0, 1.0, 9), _TERMS, increasing=True)
_BELOW_ZERO = 0.5e-9
_OCTAVES = np.concatenate([[0.0], np.exp2(np.arange(-20.0, 101.0))])  # of s, before cells are halved
_TOLERANCE = 1e-12  # of a weight, relative to its cell
# What is left of a weight by cancellation inside the function, where cells of this share of s do not help.
_ROUNDING, _SHARE_OF_ROUNDING = 1e-14, 1 / 32
_NARROWEST = 1e-13  # a cell with a kink or a leap, relative to s
_MOST_CELLS = 20_000
_RHO_TOLERANCE = 1e-6  # of ρ beside the integral of ρ′


class LossFunction(_core.LossTable):
    """Your own robust loss ρ(s) as NumPy functions, for ``solve(loss=…)`` and groups.

    The cost is ``½ Σ c² ρ(‖r‖² / c²)`` with the scale c of the solve or the group, 1 by default, and
    residuals divided by their σ. The derivative is tabulated once, because solvers evaluate single values
    from many threads: polynomials of degree 7 on cells that are halved until they agree with the function to
    1e-12 of its value, or to its rounding; kinks and jumps end in cells of 1e-13 of s. ρ is the integral of
    that table, so cost and gradient are consistent; beyond ``s = 2¹⁰⁰`` it is continued as a line.

    Parameters
    ----------
    rho : callable
        ρ(s) of squared scaled residuals s ≥ 0, from (n,) to (n,); zero at zero. It is compared with the
        integral of `derivative`.
    derivative : callable
        ρ′ = dρ/ds, the weight of an observation: finite and not negative; one at zero if small residuals
        should have full weight.
    name : str
        Its name in summaries. Default: that of `rho`.

    Raises
    ------
    InvalidArgument
        If a function returns another shape or values that are not numbers, a weight is negative, `rho` is not
        the integral of `derivative`, or `derivative` is too rough to be tabulated.
    """

    def __init__(self, rho: Curve, derivative: Curve, name: str = "") -> None:
        for label, function in (("rho", rho), ("derivative", derivative)):
            if not callable(function):
                raise InvalidArgument(f"{label} = {function!r}: must be callable")
        require_text("name", name)
        self.functions = rho, derivative
        knots, coefficients = _tabulated(derivative)
        super().__init__(
            name or getattr(rho, "__name__", "function"), knots.tolist(), coefficients.ravel().tolist()
        )
        _require_integral(self, rho)

    def __str__(self) -> str:
        return self.name

    def __repr__(self) -> str:
        return f"LossFunction({self.name!r})"

    def __reduce__(self) -> tuple[Any, ...]:
        return LossFunction, (*self.functions, self.name)


def _tabulated(derivative: Curve) -> tuple[FloatArray, FloatArray]:
    """Knots (n + 1,), from zero on, and the coefficients (n, terms) between them, of powers from 0 to 1."""
    done: list[tuple[FloatArray, FloatArray]] = []
    begin, end = _OCTAVES[:-1], _OCTAVES[1:]
    while len(begin):
        values = _values("derivative", derivative, begin, end, _NODES)
        tests = _values("derivative", derivative, begin, end, _TESTS)
        coefficients, lines = values @ _TO_COEFFICIENTS.T, np.zeros((len(begin), _TERMS))
        lines[:, 0], lines[:, 1] = values[:, 0], values[:, -1] - values[:, 0]
        # Where a weight falls to zero, between two knots, a polynomial swings below it.
        least, largest = (coefficients @ _AT_CHECKS.T).min(axis=1), np.abs(coefficients).max(axis=1)
        coefficients = np.where((least < -_BELOW_ZERO * largest)[:, None], lines, coefficients)
        error = np.abs(coefficients @ _AT_TESTS.T - tests).max(axis=1)
        rounding = np.where(end - begin <= _SHARE_OF_ROUNDING * end, _ROUNDING, 0.0)
        good = error <= np.maximum(_TOLERANCE * np.abs(tests).max(axis=1), rounding)
        narrow = ~good & (end - begin <= _NARROWEST * end)
        coefficients[narrow] = lines[narrow]  # a polynomial would swing around a leap
        kept = good | narrow
        done.append((begin[kept], coefficients[kept]))
        if sum(len(knots) for knots, _ in done) + len(begin) > _MOST_CELLS:
            worst = begin[np.argmax(error)]
            raise InvalidArgument(f"derivative: too rough to be tabulated, around s = {worst:.3g}")
        middle = 0.5 * (begin[~kept] + end[~kept])
        begin, end = np.concatenate([begin[~kept], middle]), np.concatenate([middle, end[~kept]])
    knots = np.concatenate([part for part, _ in done])
    order = np.argsort(knots)
    return np.append(knots[order], _OCTAVES[-1]), np.concatenate([part for _, part in done])[order]


def _values(name: str, function: Curve, begin: FloatArray, end: FloatArray, places: FloatArray) -> FloatArray:
    """Values (n, places) of a function of s, at places of cells (n,) given as shares of each cell."""
    s = np.clip(begin[:, None] + (end - begin)[:, None] * places, begin[:, None], end[:, None])
    values = np.array(shaped_array(name, function(s.flatten()), (s.size,))).reshape(s.shape)
    bad = ~(np.isfinite(values) & (values >= 0))
    if bad.any():
        raise InvalidArgument(f"{name}({s[bad][0]:.6g}) = {values[bad][0]}: must be finite and not negative")
    return values


def _require_integral(table: _core.LossTable, rho: Curve) -> None:
    s = np.concatenate([[0.0], np.geomspace(1e-4, 1e8, 97)])
    given = shaped_array("rho", rho(s), s.shape)
    expected = _core.loss_terms(table, 1.0, s)[0]
    bad = ~(np.abs(given - expected) <= _RHO_TOLERANCE * np.maximum(np.abs(expected), 1e-4))
    if bad.any():
        k = int(np.argmax(bad))
        raise InvalidArgument(
            f"rho({s[k]:.6g}) = {given[k]}: must be the integral of derivative, {expected[k]:.9g}"
        )
