"""Validation of the arguments of public functions by their annotations.

`checked` reads what a function's annotations say and refuses what is something else; a shape that matters is
named beside it. What the values must be, ranges and the like, stays the function's own to check.
"""

from __future__ import annotations

import functools
import inspect
import os
import reprlib
import types
from collections.abc import Callable, Collection, Hashable, Iterable, Mapping, Sequence
from numbers import Real
from typing import Any, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import ANY, number_array, shaped_array
from sfmcpp.model.checks import require_count, require_one_of, require_seed

Function = TypeVar("Function", bound=Callable[..., Any])
# Gives the value that the function is to see, or raises InvalidArgument.
Rule = Callable[[str, Any], Any]
Shape = tuple[int | str, ...]

_UNIONS = (Union, types.UnionType)
# Runs and maps would fill pages of an error.
_LONGEST = 500


def checked(**shapes: Shape) -> Callable[[Function], Function]:
    """Refuse arguments that are not what a function's annotations say.

    Parameters
    ----------
    **shapes : tuple of int or str
        Shapes of arguments that are arrays of numbers, which arrive as float64. `ANY` stands for any length,
        a text for one that is the same wherever it stands.

    Returns
    -------
    decorator
        Its functions raise InvalidArgument that names the argument and its value. Missing and unknown
        arguments stay TypeErrors. Numbers arrive as float, arrays as arrays.
    """

    def decorated(function: Function) -> Function:
        signature = inspect.signature(function)

        @functools.cache
        def rules() -> dict[str, Rule]:  # as late as the first call: annotations may name what comes later
            hints = get_type_hints(function)
            return {
                name: _rule_of(name, hints.get(name, Any), shapes)
                for name, parameter in signature.parameters.items()
                if parameter.kind not in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD)
            }

        @functools.wraps(function)
        def call(*args: Any, **named: Any) -> Any:
            bound = signature.bind(*args, **named)
            for name, rule in rules().items():
                if name in bound.arguments:
                    bound.arguments[name] = rule(name, bound.arguments[name])
            _require_same_lengths(bound.arguments, shapes)
            return function(*bound.args, **bound.kwargs)

        return cast(Function, call)

    return decorated


def _require_same_lengths(arguments: Mapping[str, Any], shapes: Mapping[str, Shape]) -> None:
    first: dict[str, tuple[str, int]] = {}
    for name, shape in shapes.items():
        array = arguments.get(name)
        for size, length in zip(shape, () if array is None else array.shape, strict=False):
            if isinstance(size, str):
                other, wanted = first.setdefault(size, (name, length))
                if length != wanted:
                    raise InvalidArgument(f"{name}: {length} entries, must be {wanted} as {other}")


def check_fields(record: Any, *names: str) -> None:
    """Raise InvalidArgument unless the named fields of a data class are what its annotations say."""
    hints = _hints_of(cast(Hashable, type(record)))
    for name in names:
        _rule_of(name, hints[name], {})(name, getattr(record, name))


@functools.cache
def _hints_of(cls: Hashable) -> dict[str, Any]:
    return get_type_hints(cls)


def _rule_of(name: str, hint: Any, shapes: Mapping[str, Shape]) -> Rule:
    optional = type(None) in get_args(hint)
    if name in _BY_NAME:
        return lambda name, value: value if optional and value is None else _BY_NAME[name](name, value)
    if name in shapes:
        shape = tuple(ANY if isinstance(size, str) else size for size in shapes[name])
        return lambda name, value: None if optional and value is None else shaped_array(name, value, shape)
    return _rule(hint)


def _rule(hint: Any) -> Rule:
    """Rule that follows from an annotation; any value passes where none can be derived."""
    if hint is Any:
        return lambda name, value: value
    if hint == ArrayLike:
        return _array
    hint = _without_alias(hint)
    origin = get_origin(hint)
    if origin in _UNIONS:
        return _any_rule(get_args(hint))
    if hint in _SCALARS:
        return _SCALARS[hint]
    if origin is np.ndarray:
        return _array
    if origin is Literal:
        return _one_of_rule(get_args(hint))
    if origin is Callable:
        return _refusing_rule("callable", callable)
    if origin is tuple and Ellipsis in get_args(hint):
        return _container_rule(Sequence, [_rule(get_args(hint)[0])])
    if origin is tuple:
        return _tuple_rule([_rule(entry) for entry in get_args(hint)])
    if origin in _CONTAINERS:
        return _container_rule(origin, [_rule(entry) for entry in get_args(hint)])
    if origin is os.PathLike:
        return _path
    if inspect.isclass(hint) and not _is_plain_protocol(hint):
        return _instance_rule(hint)
    return lambda name, value: value


def _without_alias(hint: Any) -> Any:
    """What an alias stands for, without its parameters; NumPy's NDArray is one from version 2.5 on."""
    while hasattr(alias := get_origin(hint) or hint, "__value__"):
        hint = alias.__value__
    return hint


def _is_plain_protocol(hint: type) -> bool:
    return getattr(hint, "_is_protocol", False) and not getattr(hint, "_is_runtime_protocol", False)


def _any_rule(hints: Sequence[Any]) -> Rule:
    optional = type(None) in hints
    paths = any(get_origin(hint) is os.PathLike for hint in hints)  # the rule of which is for texts, too
    rules = [_rule(hint) for hint in hints if hint is not type(None) and not (paths and hint is str)]

    def rule(name: str, value: Any) -> Any:
        if optional and value is None:
            return None
        for one in rules[:-1]:
            try:
                return one(name, value)
            except InvalidArgument:
                continue
        return rules[-1](name, value)

    return rule


def require_instance(name: str, value: Any, cls: type) -> Any:
    """`value`; InvalidArgument, with what makes a `cls` of it, if it is none."""
    if not isinstance(value, cls):
        article = "an" if cls.__name__[0] in "AEIOU" else "a"
        way = getattr(type(value), "made_into", {}).get(cls.__name__)
        hint = "" if way is None else f", which {way} makes of it"
        raise InvalidArgument(f"{name} = {_in_short(value)}: must be {article} {cls.__name__}{hint}")
    return value


def _in_short(value: Any) -> str:
    whole = repr(value)
    return whole if len(whole) <= _LONGEST else reprlib.repr(value)


def _instance_rule(cls: type) -> Rule:
    return lambda name, value: require_instance(name, value, cls)


def _tuple_rule(rules: Sequence[Rule]) -> Rule:
    def rule(name: str, value: Any) -> Any:
        if not isinstance(value, Sequence | np.ndarray) or len(value) != len(rules):
            raise InvalidArgument(f"{name} = {value!r}: must be {len(rules)} values")
        return tuple(rules[k](f"{name}[{k}]", entry) for k, entry in enumerate(value))

    return rule


def _container_rule(kind: type, rules: Sequence[Rule]) -> Rule:
    """Rule of something to loop over; entries are looked at where that does not use them up."""

    def rule(name: str, value: Any) -> Any:
        is_list_like = kind is Sequence and isinstance(value, np.ndarray) and value.ndim > 0
        if not (isinstance(value, kind) or is_list_like) or isinstance(value, str | bytes):
            raise InvalidArgument(f"{name} = {value!r}: must be a {kind.__name__.lower()}")
        if kind is not Iterable and not isinstance(value, Mapping) and len(rules) == 1:
            for number, entry in enumerate(value):
                rules[0](f"{name}[{number}]", entry)
        return value

    return rule


def _one_of_rule(known: Sequence[Any]) -> Rule:
    def rule(name: str, value: Any) -> Any:
        require_one_of(name, value, known)
        return value

    return rule


def _refusing_rule(what: str, is_one: Callable[[Any], bool]) -> Rule:
    def rule(name: str, value: Any) -> Any:
        if not is_one(value):
            raise InvalidArgument(f"{name} = {value!r}: must be {what}")
        return value

    return rule


# Whole numbers below it are floats, too; NumPy takes larger ones for objects.
_EXACT = 2**53


def _number(name: str, value: Any) -> int | float:
    try:
        if isinstance(value, int | Real) or (isinstance(value, np.ndarray) and value.ndim == 0):
            return value if isinstance(value, int) and abs(value) < _EXACT else float(value)
    except (TypeError, ValueError, OverflowError):
        pass
    raise InvalidArgument(f"{name} = {value!r}: must be a number")


def _array(name: str, value: Any) -> Any:
    array = number_array(name, value)
    if array.dtype.kind not in "biuf":
        raise InvalidArgument(f"{name} = {value!r}: must be an array of numbers")
    return array


def _seed(name: str, value: Any) -> Any:
    require_seed(value)
    return value


def _threads(name: str, value: Any) -> Any:
    require_count(name, value, at_least=0)
    return value


def _path(name: str, value: Any) -> Any:
    if not isinstance(value, str | os.PathLike) or not isinstance(os.fspath(value), str):
        raise InvalidArgument(f"{name} = {value!r}: must be a path")
    if not os.fspath(value):  # of which pathlib would make the working directory
        raise InvalidArgument(f"{name} = {value!r}: must not be empty")
    return value


_SCALARS: dict[Any, Rule] = {
    bool: _refusing_rule("True or False", lambda value: isinstance(value, bool | np.bool_)),
    int: _refusing_rule(
        "a whole number", lambda value: isinstance(value, int | np.integer) and not isinstance(value, bool)
    ),
    float: _number,
    str: _refusing_rule("text", lambda value: isinstance(value, str)),
}
_BY_NAME: dict[str, Rule] = {"seed": _seed, "threads": _threads}
_CONTAINERS = {Sequence: Sequence, Collection: Collection, Iterable: Iterable, Mapping: Mapping, list: list}
