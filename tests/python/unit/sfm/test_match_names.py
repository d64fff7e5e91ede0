"""Names of images, and what a table of positions calls them."""

from __future__ import annotations

import numpy as np
import pytest

from sfmcpp.errors import InvalidArgument
from sfmcpp.sfm.positions import match_names, positions_of
from sfmcpp.sources.io.named_positions import NamedPositions


def test_names_may_differ_by_folders_and_by_the_case_of_suffixes() -> None:
    images = ["a/1.JPG", "b/1.JPG", "2.JPG", "3.jpg"]
    told = ["/sd/a/1.jpg", r"C:\dcim\b\1.JPG", "x/2.jpeg", "3.jpg", "y/3.JPG"]
    assert match_names(images, told) == {"a/1.JPG": told[0], "b/1.JPG": told[1], "3.jpg": "3.jpg"}
    with pytest.raises(InvalidArgument, match=r"position of 1\.jpg may be that of a/1\.JPG or of b/1\.JPG"):
        match_names(images, ["1.jpg"])
    with pytest.raises(
        InvalidArgument, match=r"positions of m/2\.jpg and of n/2\.jpg may both be those of 2\.JPG"
    ):
        match_names(images, ["n/2.jpg", "m/2.jpg"])


def test_names_may_lack_their_suffix() -> None:
    images = ["a/1.JPG", "a/2.v2.jpg", "3.JPG", "3.DNG"]
    assert match_names(images, ["1", "2.v2"]) == {"a/1.JPG": "1", "a/2.v2.jpg": "2.v2"}
    with pytest.raises(InvalidArgument, match=r"position of 3 may be that of 3\.JPG or of 3\.DNG"):
        match_names(images, ["3"])
    assert match_names(images, ["3.jpg", "2"]) == {"3.JPG": "3.jpg"}


def test_letters_with_accents_may_be_in_either_form_of_unicode() -> None:
    """Folders of macOS have them apart; what looks the same was said to be the name of no image."""
    together, apart = "fl\u00fcge/\u00e9t\u00e9 1.jpg", "flu\u0308ge/e\u0301te\u0301 1.jpg"
    assert match_names([apart], [together]) == {apart: together}
    assert match_names([together], [apart]) == {together: apart}
    assert match_names([together, apart], [apart, together]) == {together: together, apart: apart}


def test_images_that_are_called_the_same_are_refused_where_a_table_has_them() -> None:
    """Both got the position of the one."""
    for table in (["1.jpg"], ["sd/1.JPG"], ["1"]):
        with pytest.raises(InvalidArgument, match=r"2 images are called '1\.jpg': their names must be"):
            match_names(["1.jpg", "2.jpg", "1.jpg"], table)
    assert match_names(["1.jpg", "2.jpg", "1.jpg"], ["2.jpg"]) == {"2.jpg": "2.jpg"}


def test_numbers_tell_images_apart_that_are_called_the_same() -> None:
    names, rows = ["a_001.jpg", "b_002.jpg", "a_001.jpg"], {"0": (1.0, 2.0, 3.0), "2": (7.0, 8.0, 9.0)}
    found = positions_of(names, NamedPositions(rows, False, named_by="index"))
    np.testing.assert_array_equal(found.metres, [rows["0"], [np.nan] * 3, rows["2"]])
    with pytest.raises(InvalidArgument, match=r"2 images are called 'a_001\.jpg'"):
        positions_of(names, NamedPositions({"1": (1.0, 2.0, 3.0)}, True, named_by="photo number"))
