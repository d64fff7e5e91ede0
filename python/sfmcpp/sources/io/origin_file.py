"""The origin of the world of a model whose format has no place for it, in a file of its own in its folder."""

from __future__ import annotations

import json
from pathlib import Path

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.model.metadata import WorldOrigin
from sfmcpp.sources.io.files import read_bytes

ORIGIN = "sfmcpp_origin.json"


def origin_files(problem: Problem) -> dict[str, list[bytes]]:
    """Name and content, in pieces, of the file, if the metadata tell an origin."""
    origin = WorldOrigin.of(problem.metadata)
    return {} if origin is None else {ORIGIN: [json.dumps(origin.to_dict(), indent=1).encode(), b"\n"]}


def with_origin(problem: Problem, folder: Path) -> Problem:
    """Put the origin that a folder tells, if it does, into the metadata.

    Raises
    ------
    DatasetError
        If the file is none of an origin.
    """
    path = folder / ORIGIN
    if not path.exists():
        return problem
    try:
        told = json.loads(read_bytes(path))
        WorldOrigin.from_dict(told if isinstance(told, dict) else {}).put_into(problem.metadata)
    except (ValueError, InvalidArgument) as error:
        raise DatasetError(path, str(error)) from error
    return problem
