"""The options of a solve as a value: keyword arguments, equality, pickle, dictionaries."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from sfmcpp import _core
from sfmcpp.errors import InvalidArgument

METHODS: tuple[str, ...] = _core.METHODS
LINE_SEARCHES: tuple[str, ...] = _core.LINE_SEARCHES
LINEAR_SOLVERS: tuple[str, ...] = _core.LINEAR_SOLVERS
LOSSES: tuple[str, ...] = _core.LOSSES
GAUGES: tuple[str, ...] = _core.GAUGES

OPTION_NAMES: tuple[str, ...] = tuple(
    name for name, value in vars(_core.SolveOptions).items() if isinstance(value, property)
)


class SolveOptions(_core.SolveOptions):
    """Options of :func:`sfmcpp.solve`, which describes them; the defaults are those of the core.

    Parameters
    ----------
    **values
        Options by name.

    Raises
    ------
    TypeError
        If there is no option of a name.
    InvalidArgument
        If a value has the wrong type, or names no choice.
    """

    def __init__(self, **values: Any) -> None:
        super().__init__()
        for name, value in values.items():
            self._set(name, value)

    def _set(self, name: str, value: Any) -> None:
        if name not in OPTION_NAMES:
            raise TypeError(f"unexpected keyword argument {name!r}: options are {', '.join(OPTION_NAMES)}")
        try:
            setattr(self, name, value)
        except TypeError:
            raise InvalidArgument(f"{name} = {value!r}: wrong type {type(value).__name__}") from None

    def to_dict(self) -> dict[str, Any]:
        """All options by name, as plain values."""
        return {name: getattr(self, name) for name in OPTION_NAMES}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> SolveOptions:
        """Options from names and values; the others keep their defaults.

        Parameters
        ----------
        values : mapping
            As :meth:`to_dict` gives them; an unknown name is a TypeError.

        Returns
        -------
        SolveOptions
            The options.
        """
        return cls(**values)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SolveOptions) and self.to_dict() == other.to_dict()

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"SolveOptions({', '.join(f'{name}={value!r}' for name, value in self.to_dict().items())})"

    def __reduce__(self) -> tuple[Callable[[Mapping[str, Any]], SolveOptions], tuple[dict[str, Any]]]:
        return (SolveOptions.from_dict, (self.to_dict(),))
