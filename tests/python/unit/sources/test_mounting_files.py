"""How the camera sits on the sensors' body, by name or from a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sfmcpp.errors import DatasetError
from sfmcpp.sources.mounting_files import mounting_of

ROWS = "0 0 1 0.5\n-1 0 0 0.1\n0 -1 0 -0.2\n"


def test_names_stand_for_the_usual_axes() -> None:
    assert mounting_of(None) is None
    camera, forward = mounting_of("camera"), mounting_of("forward")
    assert camera is not None
    assert forward is not None
    np.testing.assert_array_equal(camera.camera_from_body, np.eye(3))
    # The camera looks along the body's x; the body's z is against the image's y.
    np.testing.assert_array_equal(forward.camera_from_body @ [1, 0, 0], [0, 0, 1])
    np.testing.assert_array_equal(forward.camera_from_body @ [0, 0, 1], [0, -1, 0])


@pytest.mark.parametrize("text", [ROWS, ROWS + "0 0 0 1\n", "# body_from_camera\n" + ROWS.replace(" ", ", ")])
def test_a_file_holds_the_pose_of_the_camera_in_the_body(tmp_path: Path, text: str) -> None:
    file = tmp_path / "mounting.txt"
    file.write_text(text)
    mounting = mounting_of(str(file))
    assert mounting is not None
    np.testing.assert_array_equal(mounting.camera_from_body @ [1, 0, 0], [0, 0, 1])
    np.testing.assert_array_equal(mounting.lever_arm_m, [0.5, 0.1, -0.2])


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("1 2 3\n", "holds 3 numbers: must be 12 or 16"),
        (ROWS + "0 0 1 1\n", "its last row is"),
        (ROWS.replace("-1", "-2"), "body_from_camera holds no rotation"),
        ("a b\n", "not a number|number"),
    ],
)
def test_what_is_no_pose_is_refused_with_the_file_named(tmp_path: Path, text: str, told: str) -> None:
    file = tmp_path / "mounting.txt"
    file.write_text(text)
    with pytest.raises(DatasetError, match=told) as error:
        mounting_of(str(file))
    assert str(file) in str(error.value)


def test_a_missing_file_is_named() -> None:
    with pytest.raises(DatasetError, match=r"nowhere\.txt"):
        mounting_of("nowhere.txt")
