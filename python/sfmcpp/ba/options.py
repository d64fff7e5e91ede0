"""The options of a solve, as the core lists them: a value, keyword arguments and their documentation."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, TypeVar

from sfmcpp import _core
from sfmcpp.errors import InvalidArgument
from sfmcpp.model.named_fields import meant
from sfmcpp.model.threads import default_threads

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from sfmcpp._core import SolveKeywords

OPTIONS: dict[str, _core.SolveOption] = {option.name: option for option in _core.SOLVE_OPTIONS}

Solver = TypeVar("Solver", bound=Callable[..., Any])


def choices(option: str) -> tuple[str, ...]:
    """Names that an option can have.

    Parameters
    ----------
    option : str
        Name of an option.

    Returns
    -------
    tuple of str
        The names; none if it is no choice.
    """
    return tuple(name for name, _ in OPTIONS[option].choices)


METHODS, LINE_SEARCHES, LINEAR_SOLVERS = choices("method"), choices("line_search"), choices("linear_solver")
LOSSES, GAUGES = choices("loss"), choices("gauge")


def signature_with_options(
    own: inspect.Signature, annotation: Callable[[_core.SolveOption], Any]
) -> inspect.Signature:
    """Signature of a function that ends in ``**options``, with all of them by name.

    Parameters
    ----------
    own : inspect.Signature
        As it is written.
    annotation : callable
        Annotation of an option.

    Returns
    -------
    inspect.Signature
        The options in place of ``**options``.
    """
    kept = [p for p in own.parameters.values() if p.kind is not p.VAR_KEYWORD]
    added = [
        inspect.Parameter(o.name, inspect.Parameter.KEYWORD_ONLY, default=o.default, annotation=annotation(o))
        for o in OPTIONS.values()
    ]
    return own.replace(parameters=[*kept, *added])


def takes_options(function: Solver) -> Solver:
    """Let a function that ends in ``**options`` show all of them in its signature and its docstring.

    Parameters
    ----------
    function : callable
        Its docstring describes ``**options`` in a line that holds just these, indented as parameters are.

    Returns
    -------
    callable
        The same function.
    """
    function.__signature__ = signature_with_options(inspect.signature(function), _annotation)  # type: ignore[attr-defined]
    _describe_options(function)
    return function


def _describe_options(documented: Callable[..., Any]) -> None:
    if documented.__doc__:  # not under python -OO
        lines = [line and "    " + line for option in OPTIONS.values() for line in _entry(option)]
        documented.__doc__ = documented.__doc__.replace("    **options", "\n".join(lines), 1)


def _annotation(option: _core.SolveOption) -> str:
    other = "" if not option.optional else " | str" if option.unset else " | None"
    return option.type + other


def _entry(option: _core.SolveOption) -> list[str]:
    """Lines of a numpydoc docstring."""
    what = option.type
    if option.choices:
        what = "{" + ", ".join(f'"{name}"' for name, _ in option.choices) + "}"
    elif option.optional:
        what += f' or "{option.unset}"' if option.unset else ", optional"
    first, *more = option.description.split(";")
    rule = [f" must be {option.rule}"] if option.rule else []
    text = ";".join([f"{first} [{option.unit}]" if option.unit else first, *more, *rule])
    meanings = [f'    - "{name}": {meaning}.' for name, meaning in option.choices]
    return [f"{option.name} : {what}", f"    {text}.", *(["", *meanings] if meanings else [])]


class SolveOptions(_core.SolveOptions):
    """Options of :func:`sfmcpp.solve`; the defaults are those of the core.

    Parameters
    ----------
    **options

    Raises
    ------
    TypeError
        If there is no option of a name.
    InvalidArgument
        If a value has the wrong type, or names no choice.
    """

    def __init__(self, **options: Unpack[SolveKeywords]) -> None:
        super().__init__()
        for name, value in {"threads": default_threads(), **options}.items():
            if name not in OPTIONS:
                raise TypeError(f"unexpected keyword argument {name!r}{meant(name, OPTIONS)}")
            setattr(self, name, value)

    def __setattr__(self, name: str, value: Any) -> None:
        if name not in OPTIONS:
            raise AttributeError(f"SolveOptions has no option {name!r}{meant(name, OPTIONS)}")
        try:
            super().__setattr__(name, value)
        except TypeError:
            too_large = OPTIONS[name].type == "int" and isinstance(value, int)
            rule = "must have 32 bits" if too_large else f"wrong type {type(value).__name__}"
            raise InvalidArgument(f"{name} = {value!r}: {rule}") from None

    def to_dict(self) -> dict[str, Any]:
        """All options by name, as plain values."""
        return {name: getattr(self, name) for name in OPTIONS}

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


_describe_options(SolveOptions)
takes_options(SolveOptions.__init__)
