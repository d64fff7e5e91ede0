"""Every public function and class says what it does, and describes each of its parameters by name."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import pytest

import sfmcpp

# The command line documents itself by --help.
UNDOCUMENTED = ("sfmcpp.cli", "sfmcpp._core")
SECTION = re.compile(r"^(Parameters|Attributes)\n-+\n(.*?)(?=^\w[\w ]*\n-+$|\Z)", re.MULTILINE | re.DOTALL)
ENTRY = re.compile(r"^(\*{0,2}\w+(?:, *\*{0,2}\w+)*)\s*(?::.*)?$", re.MULTILINE)


def public_modules() -> Iterator[ModuleType]:
    """The package, its modules, and its packages at any depth, where they name their public names."""
    yield sfmcpp
    for info in pkgutil.walk_packages(sfmcpp.__path__, "sfmcpp."):
        public = info.ispkg or info.name.count(".") == 1
        if (
            public
            and not info.name.startswith(UNDOCUMENTED)
            and not info.name.rpartition(".")[2].startswith("_")
        ):
            yield importlib.import_module(info.name)


def public_names() -> dict[str, Any]:
    """Public functions and classes by dotted name, each once."""
    found: dict[int, tuple[str, Any]] = {}
    for module in public_modules():
        for name in getattr(module, "__all__", []):
            value = getattr(module, name)
            if inspect.isclass(value) or inspect.isroutine(value):
                found.setdefault(id(value), (f"{module.__name__}.{name}", value))
    return dict(found.values())


def own_parameters(value: Any) -> set[str]:
    """Names of the parameters of a function, or of a class that defines how it is made."""
    if inspect.isclass(value) and not any("__init__" in vars(c) for c in value.__mro__ if is_ours(c)):
        return set()
    try:
        parameters = inspect.signature(value).parameters
    except ValueError:  # compiled code: its docstring holds the signature
        return set()
    return {name for name in parameters if not name.startswith("_")}


def is_ours(value: type) -> bool:
    return value.__module__.startswith(("sfmcpp", __name__))


def documented_parameters(docstring: str) -> set[str]:
    """Names of the entries of the sections Parameters and Attributes of a numpydoc docstring."""
    sections = (body for _, body in SECTION.findall(inspect.cleandoc(docstring)))
    entries = (entry for body in sections for entry in ENTRY.findall(body))
    return {name.strip().lstrip("*") for entry in entries for name in entry.split(",")}


def complaints(value: Callable[..., Any]) -> list[str]:
    """What the docstring of a public function or class lacks."""
    docstring = value.__doc__ or ""
    if not docstring.strip():
        return ["has no docstring"]
    missing = own_parameters(value) - documented_parameters(docstring)
    return [f"does not describe {name}" for name in sorted(missing)]


@pytest.mark.parametrize("name", public_names())
def test_every_parameter_of_a_public_name_is_described(name: str) -> None:
    assert complaints(public_names()[name]) == []


def test_a_missing_parameter_is_found() -> None:
    def scale(points: object, factor: float) -> None:
        """Scale the points.

        Parameters
        ----------
        points : (N, 3) float64
            Mentions factor : but does not describe it.

        Raises
        ------
        factor
            A name outside of the section.
        """

    assert complaints(scale) == ["does not describe factor"]


def test_names_that_share_an_entry_are_found_described() -> None:
    def shift(x: float, y: float, *rest: float, **options: object) -> None:
        """Shift.

        Parameters
        ----------
        x, y : float
            Both.
        *rest, **options
            The others.
        """

    assert complaints(shift) == []


def test_a_dataclass_may_describe_its_fields_as_attributes() -> None:
    @dataclass
    class Size:
        """Size of an image.

        Attributes
        ----------
        width : int
            Width [px].
        """

        width: int
        height: int

    assert complaints(Size) == ["does not describe height"]


def test_a_missing_docstring_is_found() -> None:
    def undocumented() -> None:
        pass

    assert complaints(undocumented) == ["has no docstring"]
