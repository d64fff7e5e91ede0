"""Data classes that take no attributes but their fields, and which known name an unknown one is close to."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import fields
from difflib import get_close_matches
from typing import Any, ClassVar


class NamedFields:
    """Base of data classes whose fields may be set, and nothing else: a misspelt one would have no effect.

    No field can be deleted: what reads it would fail. Properties and names that begin with an underscore are
    left to Python.
    """

    __dataclass_fields__: ClassVar[dict[str, Any]]

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in self.__dataclass_fields__ or name.startswith("_") or self._is_property(name)):
            known = [field.name for field in fields(self)]
            kind = type(self).__name__
            raise AttributeError(f"{kind} has no field {name!r}{meant(name, known)}", name=name)
        super().__setattr__(name, value)

    def _is_property(self, name: str) -> bool:
        return isinstance(getattr(type(self), name, None), property)

    def __delattr__(self, name: str) -> None:
        if name in self.__dataclass_fields__:
            kind = type(self).__name__
            raise AttributeError(f"{kind}: the field {name!r} cannot be deleted", name=name)
        super().__delattr__(name)


def meant(name: str, known: Collection[str]) -> str:
    """End of a message about an unknown name: the known one that it is close to, or else all.

    Parameters
    ----------
    name : str
        What was given.
    known : collection of str
        What might have been.

    Returns
    -------
    str
        Begins with a semicolon or a colon.
    """
    close = get_close_matches(name, known, 1)
    return f"; did you mean {close[0]!r}?" if close else f": must be one of {', '.join(known)}"
