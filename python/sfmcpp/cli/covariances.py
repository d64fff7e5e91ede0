"""The option `--covariances`: computed after a solve, written and reported."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sfmcpp.ba import Summary, linearize
from sfmcpp.cli.interrupts import stoppable
from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.model.residual_group import Group

if TYPE_CHECKING:
    from sfmcpp.study.covariance_files import Covariances

# A state that is no minimum has no covariances.
_NO_MINIMUM = ("interrupted", "numerical_failure")
# One where a limit ended the solve may be one: --max-iterations 0 leaves that of an earlier solve as it is.
_PERHAPS_NO_MINIMUM = ("max_iterations", "max_seconds", "stalled")


class Precision:
    """How well the result of a solve is known, once :meth:`write` was called."""

    def __init__(self) -> None:
        self._found: Covariances | None = None
        self._reason = self._doubt = ""
        self.is_interrupted = self.is_written = False

    def write(
        self,
        path: Path,
        problem: Problem,
        summary: Summary,
        groups: Sequence[Group],
        options: dict[str, Any],
        is_stopped: Callable[[], bool],
    ) -> None:
        """Write covariances with the loss, the gauge and the constraints of the solve, unless it is stopped.

        Raises
        ------
        DatasetError
            If nothing determines a parameter, or the file cannot be written.
        """
        from sfmcpp.study.covariance_files import Covariances, write_covariances

        if summary.termination in _NO_MINIMUM:
            self._reason = f"not written: the solve ended by {summary.termination}, at no minimum"
            return
        if summary.termination in _PERHAPS_NO_MINIMUM:
            self._doubt = f"are right at a minimum alone, and the solve ended by {summary.termination}"

        def found() -> Covariances:
            model = linearize(
                problem,
                constraints=groups,
                loss=summary.loss,
                loss_scale_px=summary.loss_scale_px,
                gauge=options.get("gauge", "auto"),
                threads=options.get("threads", 0),
            )
            return Covariances.of(problem, model)

        try:
            self._found = stoppable(found, is_stopped)
        except KeyboardInterrupt:
            self.is_interrupted, self._reason = True, "not written: interrupted"
            return
        except InvalidArgument as error:
            raise DatasetError(path, f"no covariances: {error}") from error
        write_covariances(path, self._found)
        self.is_written = True

    def to_report(self) -> dict[str, Any]:
        """Entries of the report of a solve; a file that was asked for and is not written has its reason."""
        if self._found is None and not self._reason:
            return {}
        told = {"written": self.is_written} | ({} if self._found is None else self._found.to_dict())
        told |= {name: text for name, text in (("reason", self._reason), ("doubt", self._doubt)) if text}
        return {"covariances": told}

    @property
    def loss(self) -> str:
        """What is to be said of a solve that came to no minimum; empty where nothing is missing."""
        return "the covariances are not written" if self._reason else ""

    def rows(self) -> Iterator[tuple[str, str]]:
        """Rows of the table at the end of a solve."""
        if self._reason:
            yield "covariances", self._reason
        if self._found is None:
            return
        yield "covariances", f"refer to {self._found.gauge}"
        if self._doubt:
            yield "covariances", self._doubt
        if not self._found.has_points:
            yield "covariances", "of cameras alone: the points are too many, or none is estimated"
        factor = self._found.variance_factor
        if factor == factor:
            guess = f"if the σ of observations is a guess, multiply standard deviations by {factor**0.5:.3g}"
            yield "variance factor", f"{factor:.4g}: {guess}"
