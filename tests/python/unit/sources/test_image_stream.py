"""Images are looked at ahead of who asks for them: the same ones, however fast either is."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from sfmcpp.errors import DatasetError
from sfmcpp.sources.image_stream import _taken_ahead


def test_the_next_images_are_looked_at_while_the_caller_works_on_one() -> None:
    made: list[int] = []

    def images() -> Iterator[int]:
        for number in range(10):
            made.append(threading.get_ident())
            yield number

    ahead = _taken_ahead(images(), 2)
    assert [next(ahead), next(ahead)] == [0, 1]
    ahead.close()  # type: ignore[attr-defined]
    assert len(made) == 4  # however long they take
    assert set(made) != {threading.get_ident()}
    assert list(_taken_ahead(images(), 2)) == list(range(10))
    assert list(_taken_ahead(iter(()), 2)) == []


def test_an_error_comes_where_its_image_would() -> None:
    def images() -> Iterator[int]:
        yield from (1, 2)
        raise DatasetError(Path("x.png"), "no picture")

    ahead = _taken_ahead(images(), 5)
    assert [next(ahead), next(ahead)] == [1, 2]
    with pytest.raises(DatasetError, match="no picture"):
        next(ahead)
