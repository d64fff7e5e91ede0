"""YAML, JSON and XML documents, with line numbers for error messages."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.parsers import expat

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.files import failures_named, read_text_bytes
from sfmcpp.sources.io.number_text import number_of

DOCUMENTS = (".yaml", ".yml", ".json", ".xml")
_LARGEST_BYTES = 1 << 20
_DEEPEST = 50
_TOO_DEEP = f"nests more than {_DEEPEST} parts"
# OpenCV's first line, which YAML spells otherwise.
_OPENCV_DIRECTIVE = re.compile(rb"\A%YAML:[\d.]+")


@dataclass(frozen=True, eq=False)
class Node:
    """Part of a document.

    Attributes
    ----------
    path : Path
        The file.
    line : int
        Where it begins, counted from 1.
    value : str, list of Node or dict of str to Node
        A text, a sequence or named parts.
    """

    path: Path
    line: int
    value: str | list[Node] | dict[str, Node]

    def part(self, *names: str) -> Node | None:
        """Find the part of the first of these names that there is."""
        parts = self.value if isinstance(self.value, dict) else {}
        return next((parts[name] for name in names if name in parts), None)

    def numbers(self) -> list[float]:
        """All numbers of a sequence, of rows of them, or of a matrix in the form of OpenCV.

        Raises
        ------
        DatasetError
            If anything is not a finite number.
        """
        if isinstance(self.value, dict):
            data = self.part("data")
            if data is None:
                raise self.error(f"holds {', '.join(self.value)}: must be numbers, or a matrix with data")
            return data.numbers()
        if isinstance(self.value, list):
            return [number for item in self.value for number in item.numbers()]
        return [self._number(word) for word in self.value.split()]

    def error(self, reason: str) -> DatasetError:
        """Make a DatasetError at its line."""
        return DatasetError(self.path, reason, self.line)

    def _number(self, word: str) -> float:
        number = number_of(word)
        if not math.isfinite(number):
            raise self.error(f"{word[:40]!r} is not a finite number")
        return number


def read_document(path: Path) -> Node:
    """Read a file of YAML, of JSON, which is YAML but for tabs, or, by its suffix, XML.

    Raises
    ------
    DatasetError
        If it cannot be read or is not what its suffix says; it names the line.
    """
    with failures_named(path):
        data = read_text_bytes(path)
    if len(data) > _LARGEST_BYTES:
        raise DatasetError(path, f"holds {len(data)} bytes: must be {_LARGEST_BYTES} at most")
    if path.suffix.lower() == ".xml":
        return _read_xml(path, data)
    return _read_yaml(path, data.replace(b"\t", b" ") if path.suffix.lower() == ".json" else data)


def _read_yaml(path: Path, data: bytes) -> Node:
    yaml = _load_yaml(path)
    text = _OPENCV_DIRECTIVE.sub(b"", data)
    # The loader in C takes a tenth of the time: that in Python takes a minute for a megabyte.
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        _require_plain(path, yaml, yaml.parse(text, Loader=loader))
        # A message that ROS prints ends as if another one followed.
        roots = [root for root in yaml.compose_all(text, Loader=loader) if not _is_empty(yaml, root)]
        if len(roots) > 1:
            line = roots[1].start_mark.line + 1
            raise DatasetError(path, f"holds {len(roots)} documents: must be one", line)
        return _node_of_yaml(path, yaml, roots[0] if roots else None)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else None
        # libyaml has a limit of its own, since 0.2.6, and reads ahead of the events it returns.
        if "nesting depth" in str(error.problem):
            raise DatasetError(path, _TOO_DEEP, line) from None
        raise DatasetError(path, f"is no YAML: {error.problem}", line) from None
    except (yaml.YAMLError, UnicodeError, RecursionError) as error:
        raise DatasetError(path, f"is no YAML: {str(error).splitlines()[0]}") from None


def _require_plain(path: Path, yaml: ModuleType, events: Iterable[Any]) -> None:
    """Refuse aliases and deep nesting; only as many events are parsed as that takes."""
    depth = 0
    for event in events:
        line = event.start_mark.line + 1
        if isinstance(event, yaml.AliasEvent):  # a few of them stand for any number of parts
            raise DatasetError(path, f"alias {event.anchor!r}: must be written out", line)
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > _DEEPEST:
            raise DatasetError(path, _TOO_DEEP, line)


def _load_yaml(path: Path) -> ModuleType:
    try:
        import yaml
    except ModuleNotFoundError:
        raise DatasetError(path, "YAML needs PyYAML: pip install 'sfmcpp[vision]'") from None
    module: ModuleType = yaml
    return module


def _is_empty(yaml: ModuleType, node: Any) -> bool:
    return isinstance(node, yaml.ScalarNode) and node.value == ""


def _node_of_yaml(path: Path, yaml: ModuleType, node: Any) -> Node:
    if node is None:
        return Node(path, 1, "")
    line = node.start_mark.line + 1
    if isinstance(node, yaml.ScalarNode):
        return Node(path, line, node.value)
    if isinstance(node, yaml.SequenceNode):
        return Node(path, line, [_node_of_yaml(path, yaml, item) for item in node.value])
    return Node(path, line, {str(key.value): _node_of_yaml(path, yaml, value) for key, value in node.value})


@dataclass
class _Element:
    """An element of XML that is being read."""

    line: int
    parts: dict[str, Node] = field(default_factory=dict)
    text: str = ""


def _read_xml(path: Path, data: bytes) -> Node:
    parser = expat.ParserCreate()
    open_elements = [_Element(1)]

    def start(name: str, attributes: dict[str, str]) -> None:
        open_elements.append(_Element(parser.CurrentLineNumber))
        if len(open_elements) > _DEEPEST:
            raise DatasetError(path, f"nests {_DEEPEST} elements", parser.CurrentLineNumber)

    def end(name: str) -> None:
        done = open_elements.pop()
        open_elements[-1].parts[name] = Node(path, done.line, done.parts or done.text.strip())

    def take(text: str) -> None:
        open_elements[-1].text += text

    parser.StartElementHandler, parser.EndElementHandler, parser.CharacterDataHandler = start, end, take
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise DatasetError(path, f"is no XML: {expat.ErrorString(error.code)}", error.lineno) from None
    except DatasetError:
        raise
    except (ValueError, LookupError) as error:  # encodings that the parser does not know
        raise DatasetError(path, f"is no XML: {error}") from None
    (root,) = open_elements[0].parts.values()
    return root
