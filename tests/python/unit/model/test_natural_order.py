"""The order of names of images: numbers by their value."""

from __future__ import annotations

from sfmcpp.model.photos import natural_order


def test_numbers_in_names_count_by_their_value() -> None:
    assert sorted(["a10", "a9", "a09", "b1"], key=natural_order) == ["a09", "a9", "a10", "b1"]


def test_digits_of_other_scripts_are_text() -> None:
    """They were taken for numbers with all that follows: names of full-width digits ended in a traceback."""
    names = ["\u0663\u0664b.jpg", "\uff11\uff12.jpg", "\uff12.jpg", "1.jpg"]
    assert sorted(names[::-1], key=natural_order) == names
