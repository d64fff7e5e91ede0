"""Which image a number of a table of a drone is."""

from __future__ import annotations

import pytest

from sfmcpp.errors import InvalidArgument
from sfmcpp.sfm.photo_numbers import match_photo_numbers


@pytest.mark.parametrize(
    ("image", "number"),
    [
        ("DJI_0012.JPG", "12"),
        ("100_0004/100_0004_0012.JPG", "12"),
        ("DJI_20221103150859_0012_V.JPG", "12"),
        ("DJI_20221103150859_0012_MS_NIR.TIF", "12"),
        ("DJI_20221103150859.JPG", None),
        ("DJI_0013.JPG", None),
        ("garden.jpg", None),
    ],
)
def test_the_number_is_at_the_end_of_the_name(image: str, number: str | None) -> None:
    numbers = ["1", "3", "12", "4"]
    found = match_photo_numbers([image, "x_0001.jpg"], numbers)
    assert found == {"x_0001.jpg": "1"} | ({} if number is None else {image: number})


def test_cameras_of_one_moment_have_one_position() -> None:
    images = ["DJI_20221103150859_0012_T.JPG", "DJI_20221103150900_0012_V.JPG"]
    assert match_photo_numbers(images, ["12"]) == dict.fromkeys(images, "12")


def test_photos_of_two_flights_are_refused() -> None:
    with pytest.raises(InvalidArgument, match=r"photo 12 may be a/DJI_0012\.JPG or b/DJI_0012\.JPG"):
        match_photo_numbers(["a/DJI_0012.JPG", "b/DJI_0012.JPG"], ["12"])


def test_numbers_of_other_photos_are_said() -> None:
    with pytest.raises(InvalidArgument, match=r"numbers, 1 to 12, are not .*\(DJI_0700\.JPG, IMG\.JPG\)"):
        match_photo_numbers(["DJI_0700.JPG", "IMG.JPG"], ["12", "1", "3"])
