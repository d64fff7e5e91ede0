"""Marks that do not show their points are named before they are believed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from sfmcpp.ba import residuals_px
from sfmcpp.errors import InvalidArgument
from sfmcpp.sfm import fit_control_points
from sfmcpp.sources.io.control_points import ControlPoints, Mark
from test_control_points import scene

Change = Callable[[np.ndarray], np.ndarray]


def remarked(control: ControlPoints, change: Change, only: int | None = None) -> ControlPoints:
    """The survey with the pixels of all its marks changed, or of one."""
    marks = [
        replace(mark, pixel=tuple(change(np.array(mark.pixel)).tolist())) if only in (None, k) else mark
        for k, mark in enumerate(control.marks)
    ]
    return replace(control, marks=marks)


@pytest.mark.parametrize(
    "change", [lambda p: 1.1 * p, lambda p: 0.5 * p, lambda p: p[::-1], lambda p: p * [0.0, 1.0]]
)
def test_marks_of_other_images_are_told_from_marks(change: Change) -> None:
    _, model, control = scene()
    warnings = fit_control_points(model, remarked(control, change)).outcome.warnings
    (told,) = (warning for warning in warnings if warning.startswith("the marks are"))
    assert "are they of images of another size, or of other images" in told


@pytest.mark.parametrize("aside_px", [10.0, 100.0])
def test_a_wrong_mark_is_named_with_its_image(aside_px: float) -> None:
    _, model, control = scene()
    wrong = control.marks[5]
    warnings = fit_control_points(model, remarked(control, lambda p: p + aside_px, only=5)).outcome.warnings
    assert warnings[0].startswith(f"the mark of 'p{wrong.point}' in {wrong.image!r} is 1")


@pytest.mark.parametrize("sigma_px", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("apart", [1, 10])
def test_marks_that_are_set_by_hand_are_not_named(sigma_px: float, apart: int) -> None:
    _, model, control = scene()
    rng = np.random.default_rng(0)
    some = [mark for mark in control.marks if (int(mark.image[:3]) + mark.point) % apart == 0]
    noisy = remarked(replace(control, marks=some), lambda p: p + rng.normal(0, sigma_px, 2))
    assert not fit_control_points(model, noisy).outcome.warnings


def test_keypoints_without_errors_make_no_mistake_of_marks() -> None:
    """Rendered keypoints are exact; marks within a pixel are right all the same."""
    _, model, control = scene()
    model.pixels[:] -= residuals_px(model)
    assert not fit_control_points(model, control).outcome.warnings


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda p: 2.0 * p, r"is far outside of the image of 640 × 480 px: must be in it"),
        (lambda p: p - [320.0, 240.0], "is far outside of the image of 640 × 480 px"),
        (lambda p: p + 1e19, r"pixel 1e\+19: must be at most 2147483646"),
    ],
)
def test_marks_outside_of_their_images_are_refused(change: Change, told: str) -> None:
    _, model, control = scene()
    with pytest.raises(InvalidArgument, match=rf"control: mark of 'p.' in '.*jpg': .*{told}"):
        fit_control_points(model, remarked(control, change))


def test_marks_are_taken_as_they_are_where_no_size_is_known() -> None:
    _, model, control = scene()
    model.metadata.image_sizes = None
    warnings = fit_control_points(model, remarked(control, lambda p: 2.0 * p)).outcome.warnings
    assert any(warning.startswith("the marks are") for warning in warnings)


def test_marks_in_images_that_the_model_has_not_are_counted() -> None:
    _, model, control = scene()
    more = [*control.marks, Mark(0, "other.jpg", (3.0, 4.0)), Mark(1, "other.jpg", (5.0, 6.0))]
    (told,) = fit_control_points(model, replace(control, marks=more)).outcome.warnings
    assert told == "marks in images that the model does not have are not used: 2 (other.jpg)"


def test_a_survey_in_millimetres_or_without_a_place_is_refused() -> None:
    _, model, control = scene()
    far = [(1e3 * x, 1e3 * y, 1e3 * z) for x, y, z in control.positions]
    with pytest.raises(InvalidArgument, match=r"must be at most 1e\+08 m; are they millimetres"):
        fit_control_points(model, replace(control, positions=far))
    lost = [(0.0, 0.0, 0.0), *control.positions[1:]]
    with pytest.raises(InvalidArgument, match="control: point 'p0' is at 0, 0, far from the others"):
        fit_control_points(model, replace(control, positions=lost))
