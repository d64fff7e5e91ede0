"""What a diagnosis is: ranked, repeatable, exact about the gauge, and an answer to any valid problem."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import sfmcpp
from faults import centres_for_translations, halves, quaternions_xyzw
from sfmcpp import (
    CameraFunction,
    ConstraintGroup,
    Problem,
    ResidualGroup,
    circle_scene,
    diagnose,
    linearize,
    perturb,
)
from sfmcpp.doctor import SEVERITIES, repair
from sfmcpp.doctor.case import Case
from sfmcpp.doctor.connections import parts
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.residual_group import Group


def scene(**options: object) -> Problem:
    return circle_scene(8, 60, seed=3, **options)


def freedoms(problem: Problem, constraints: list[Group] | None = None) -> float:
    found = [
        f for f in diagnose(problem, constraints=constraints or []).findings if f.code == "gauge-freedoms"
    ]
    return found[0].measures["freedoms"] if found else 0


def fixed(problem: Problem, cameras: int = 0, points: int = 0) -> Problem:
    problem.fixed_cameras[:cameras] = True
    problem.fixed_points[:points] = True
    return problem


def positions(problem: Problem, cameras: list[int]) -> ConstraintGroup:
    return ConstraintGroup("position", cameras, problem.centres[cameras])


@pytest.mark.parametrize(
    ("cameras", "points", "positioned", "left"),
    [(0, 0, 0, 7), (1, 0, 0, 1), (2, 0, 0, 0), (0, 1, 0, 4), (0, 2, 0, 1), (0, 3, 0, 0),
     (0, 0, 1, 4), (0, 0, 2, 1), (0, 0, 3, 0), (1, 1, 0, 0), (1, 0, 1, 1)],
)  # fmt: skip
def test_the_freedoms_left_are_those_that_geometry_says(
    cameras: int, points: int, positioned: int, left: int
) -> None:
    problem = fixed(scene(), cameras, points)
    groups = [positions(problem, list(range(positioned)))] if positioned else []
    assert freedoms(problem, groups) == left


@pytest.mark.parametrize("camera_model", ["calibrated", "perspective", "bal"])
@pytest.mark.parametrize(("cameras", "points"), [(1, 0), (0, 2), (1, 1), (2, 0)])
def test_the_freedoms_left_are_the_null_space_of_the_normal_matrix(
    camera_model: str, cameras: int, points: int
) -> None:
    problem = fixed(scene(camera_model=camera_model), cameras, points)
    normal = linearize(problem).normal_matrix().toarray()
    size = np.sqrt(np.diag(normal))
    values = np.linalg.eigvalsh(normal / np.outer(size, size))
    assert freedoms(problem) == np.count_nonzero(values < 1e-11)


def test_other_weights_and_units_leave_the_same_freedoms() -> None:
    problem = scene()
    problem.points *= 1e3
    problem.centres[:] *= 1e3
    group = positions(problem, [0, 1])
    group.weight = 1e-8
    assert freedoms(problem, [group]) == 1


def test_freedoms_that_are_meant_are_a_note_and_others_a_warning() -> None:
    alone = diagnose(fixed(scene(), cameras=1)).findings
    on_a_line = diagnose(scene(), constraints=[positions(scene(), [0, 1])]).findings
    assert [f.severity for f in (*alone, *on_a_line)] == ["note", "warning"]


def test_translations_that_are_all_alike_are_those_of_cameras_that_look_at_one_point() -> None:
    problem = scene()
    turned = np.swapaxes(problem.rotations, 1, 2).copy()
    problem.centres[:] = -np.einsum("cij,cj->ci", turned, problem.centres)
    translations = problem.copy()
    assert np.ptp(translations.centres, axis=0).max() < 1e-9
    assert diagnose(translations).codes[0] == "translations-for-centres"
    problem.rotations[:] = turned
    assert diagnose(problem).codes[0] == "inverse-poses"


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        (centres_for_translations, "centres-for-translations"),
        (quaternions_xyzw, "quaternions-xyzw"),
    ],
)
@pytest.mark.parametrize("shape", ["circle", "photo-collection"])
def test_poses_of_files_that_were_written_by_hand_are_told_before_outliers(
    shape: str, wrong: Callable[..., Problem], code: str
) -> None:
    truth = sfmcpp.SCENES[shape](15, 300, camera_model="perspective", seed=11)
    start = perturb(truth, point_sigma_m=0.1, position_sigma_m=0.1, rotation_sigma_deg=1, seed=11)
    assert diagnose(wrong(start, np.random.default_rng(0))).codes[0] == code


def test_errors_come_before_warnings_and_these_before_notes() -> None:
    problem = scene()
    problem.pixels[problem.camera_index == 2] += 300.0
    again = np.r_[np.arange(problem.num_observations), 5]
    found = diagnose(problem.with_observations(again)).findings
    ranks = [SEVERITIES.index(f.severity) for f in found]
    assert ranks == sorted(ranks)
    assert {f.severity for f in found} == set(SEVERITIES)


def test_a_diagnosis_is_the_same_in_every_run_and_leaves_the_problem_alone() -> None:
    problem = perturb(scene(), point_sigma_m=0.2, seed=1)
    before = problem.copy()
    assert diagnose(problem).to_dict() == diagnose(problem).to_dict()
    for name in ("cameras", "points", "pixels", "intrinsics"):
        np.testing.assert_array_equal(getattr(problem, name), getattr(before, name))


@pytest.mark.parametrize(("share", "loss"), [(0.05, "cauchy"), (0.3, "auto"), (0.5, "auto")])
def test_many_outliers_are_told_with_the_loss_that_finds_them(share: float, loss: str) -> None:
    start = perturb(scene(), point_sigma_m=0.1, position_sigma_m=0.1, rotation_sigma_deg=1.0, seed=4)
    found = diagnose(sfmcpp.add_outliers(start, share, seed=5)[0]).findings[0]
    assert found.code == "outliers"
    assert f"--loss {loss}" in found.advice.replace("huber or ", "")
    assert found.measures["share"] == pytest.approx(share, abs=0.1 * share)


def test_fields_that_were_set_since_are_taken_as_a_solve_takes_them() -> None:
    problem = circle_scene(8, 60, camera_model="bal", seed=1)
    expected = diagnose(problem.copy())
    for name in ("fixed_cameras", "fixed_points"):
        setattr(problem, name, getattr(problem, name).tolist())
    assert str(diagnose(problem)) == str(expected)
    assert isinstance(problem.fixed_cameras, list)


def test_cameras_are_named_by_number_and_image() -> None:
    problem = scene()
    problem.metadata.image_names = [f"img_{k}.jpg" for k in range(8)]
    rows = np.flatnonzero(problem.camera_index == 2)
    problem.pixels[rows] = problem.pixels[np.roll(rows, 7)]
    finding = diagnose(problem).findings[0]
    assert (finding.code, finding.cameras) == ("camera-contradicts", (2,))
    assert "img_2.jpg" in finding.where


def empty(points: int = 0, cameras: int = 0) -> Problem:
    k = np.tile([500.0, 1.0, 320.0, 240.0, 0.0], (cameras, 1))
    none = np.zeros(0, dtype=np.int32)
    poses = np.tile(np.eye(3, 4), (cameras, 1, 1))
    return Problem("calibrated", poses, k, np.ones((points, 3)), none, none, np.zeros((0, 2)))


def all_fixed() -> Problem:
    problem = fixed(scene(), cameras=8, points=60)
    problem.fixed_intrinsics[:] = True
    return problem


def one_camera() -> Problem:
    problem = scene()
    return problem.with_observations(problem.camera_index == 0)


def one_point() -> Problem:
    problem = scene()
    return problem.with_observations(problem.point_index == 0)


def behind_everywhere() -> Problem:
    problem = scene()
    problem.points[:] = problem.centres[0]
    return problem


def wide_metadata() -> Problem:
    problem = scene()
    problem.metadata.image_sizes = np.ones((3, 2), dtype=np.int64)
    problem.metadata.image_names = ["one"]
    return replace(problem, pixels=problem.pixels[:, ::-1].copy())


WEIRD = {
    "nothing": lambda: empty(),
    "points alone": lambda: empty(points=3),
    "cameras alone": lambda: empty(cameras=3),
    "no observations": lambda: empty(points=3, cameras=2),
    "no observations with a σ": lambda: replace(empty(points=3, cameras=2), sigma_px=np.zeros(0)),
    "all fixed": all_fixed,
    "one camera": one_camera,
    "one point": one_point,
    "projective": lambda: sfmcpp.as_projective(scene()),
    "points at a centre": behind_everywhere,
    "metadata of other lengths": wide_metadata,
    "points at the origin": lambda: replace(scene(), points=np.zeros((60, 3))),
    "equal pixels": lambda: replace(scene(), pixels=np.zeros((480, 2))),
    "far pixels": lambda: replace(scene(), pixels=np.full((480, 2), 1e300)),
    "huge world": lambda: replace(scene(), points=scene().points * 1e200),
}


@pytest.mark.parametrize("name", WEIRD)
def test_every_valid_problem_gets_an_answer(name: str) -> None:
    problem = WEIRD[name]()
    diagnosis = diagnose(problem)
    assert str(diagnosis)
    assert repair(problem).problem.num_observations <= problem.num_observations


def test_a_large_problem_is_judged_by_a_part_and_that_is_said() -> None:
    problem = sfmcpp.city_blocks_scene(300, seed=2)
    diagnosis = diagnose(problem)
    assert diagnosis.is_healthy, str(diagnosis)
    assert any("cameras" in reason and "of 300" in reason for reason in diagnosis.skipped)


def test_after_a_solve_the_least_certain_cameras_are_named() -> None:
    problem = perturb(scene(), point_sigma_m=0.2, seed=1)
    few = np.flatnonzero(problem.camera_index == 4)[8:]
    problem = problem.with_observations(np.delete(np.arange(problem.num_observations), few))
    summary = sfmcpp.solve(problem)
    diagnosis = diagnose(problem, summary=summary)
    assert diagnosis.is_healthy, str(diagnosis)
    worst = next(f for f in diagnosis.findings if f.code == "worst-cameras")
    assert worst.cameras[0] == 4


def test_a_minimum_turned_inside_out_is_told_from_the_better_one() -> None:
    from sfmcpp.doctor.solution import depth_reversed

    truth = circle_scene(8, 60, radius_m=40, focal_px=4000.0, seed=3)
    near = truth.with_observations(truth.camera_index < 3)
    inside_out = depth_reversed(near)
    summary = sfmcpp.solve(inside_out)
    codes = diagnose(inside_out, summary=summary).codes
    assert codes[0] == "better-basin"
    right = near.copy()
    assert "better-basin" not in diagnose(right, summary=sfmcpp.solve(right)).codes


def test_ctrl_c_during_an_adjustment_ends_the_diagnosis(monkeypatch: pytest.MonkeyPatch) -> None:
    summary = replace(sfmcpp.solve(scene()), termination="interrupted")
    monkeypatch.setattr("sfmcpp.doctor.trial.adjust", lambda *_: summary)
    with pytest.raises(KeyboardInterrupt):
        diagnose(scene())


def test_a_solve_cut_short_is_named() -> None:
    problem = perturb(scene(), point_sigma_m=0.5, position_sigma_m=0.5, seed=1)
    summary = sfmcpp.solve(problem, max_iterations=1)
    assert "not-converged" in diagnose(problem, summary=summary).codes


def own_positions(problem: Problem) -> ResidualGroup:
    places = problem.centres.copy()
    return ResidualGroup(lambda poses: (poses[:, :, 3] - places) / 0.1, np.arange(problem.num_cameras))


def test_own_residuals_leave_the_freedoms_that_a_constraint_leaves() -> None:
    problem = circle_scene(8, 60, seed=0)
    gps = ConstraintGroup("position", np.arange(8), problem.centres.copy(), weight=100.0)
    found = [diagnose(problem, constraints=[group]).codes for group in (own_positions(problem), gps)]
    assert found[0] == found[1]
    assert "gauge-freedoms" not in found[0]


@pytest.mark.parametrize(("known", "left"), [([0], 4), ([0, 1], 1), ([0, 1, 2], 0)])
def test_known_points_hold_the_world(known: list[int], left: int) -> None:
    problem = circle_scene(8, 60, seed=0)
    places = problem.points[known].copy()
    group = ResidualGroup(lambda points: (points - places) / 0.1, points=known)
    assert freedoms(problem, [group]) == left


def test_a_residual_of_a_camera_and_a_point_ties_the_camera_to_those_that_see_it() -> None:
    problem = halves(circle_scene(20, 300, seed=0), 0)
    assert "disconnected-parts" in diagnose(problem).codes
    apart = parts(Case(problem, [], None))
    camera = int(np.flatnonzero(apart == 1)[0])
    point = int(problem.point_index[apart[problem.camera_index] == 0][0])
    depth = ResidualGroup(lambda poses, x: x[:, 2:] - poses[:, 2:, 3], [camera], points=[point])
    assert "disconnected-parts" not in diagnose(problem, constraints=[depth]).codes


def test_a_diagnosis_shows_itself_in_one_line_and_in_a_notebook_as_its_list() -> None:
    problem = sfmcpp.circle_scene(6, 40, seed=0)
    found = sfmcpp.diagnose(problem)
    assert repr(found) == "Diagnosis(note gauge-freedoms)"
    opening = '<pre style="white-space: pre-wrap">1. note: gauge-freedoms: all 7 gauge freedoms'
    assert found._repr_html_().startswith(opening)


@pytest.mark.parametrize("kind", ["focal", "principal-point", "orientation", "displacement-rotation"])
def test_parts_stay_apart_where_a_constraint_says_nothing_of_places(kind: str) -> None:
    problem = halves(scene(), 0)
    cameras = np.arange(problem.num_cameras)
    turns = np.swapaxes(problem.rotations[:-1], 1, 2) @ problem.rotations[1:]
    groups = {
        "focal": ConstraintGroup("focal", cameras, problem.intrinsics[:, 0]),
        "principal-point": ConstraintGroup("principal-point", cameras, problem.intrinsics[:, 2:4]),
        "orientation": ConstraintGroup("orientation", cameras, problem.rotations),
        "displacement-rotation": ConstraintGroup(
            "displacement-rotation", np.stack([cameras[:-1], cameras[1:]], axis=1), turns
        ),
    }
    assert "disconnected-parts" in diagnose(problem, constraints=[groups[kind]]).codes
    places = positions(problem, cameras.tolist())
    assert "disconnected-parts" not in diagnose(problem, constraints=[groups[kind], places]).codes


def test_images_of_unknown_size_say_nothing_of_their_middle_or_edge() -> None:
    problem = circle_scene(12, 200, pixel_sigma_px=0.5, seed=0)
    problem.metadata.image_sizes = np.zeros((12, 2), dtype=np.int64)  # as COLMAP and tracks have it
    assert diagnose(problem).codes == ["gauge-freedoms"]
    problem.pixels[:, 1] = 2 * problem.intrinsics[0, 3] - problem.pixels[:, 1]
    assert diagnose(problem).codes[0] == "mirrored-y"


def test_a_convention_is_found_where_it_explains_the_images_to_the_last_bit() -> None:
    rng = np.random.default_rng(0)
    points = np.c_[rng.integers(-4, 5, (60, 2)), rng.choice([4, 8], 60)].astype(np.float64)
    cameras = np.tile(np.eye(3, 4), (6, 1, 1))
    cameras[:, :2, 3] = rng.integers(-2, 3, (6, 2))
    camera, point = np.divmod(np.arange(360), 60)
    offset = points[point] - cameras[camera, :, 3]
    pixels = 512 * offset[:, :2] / offset[:, 2:] + [320, 240]
    intrinsics = np.tile([512.0, 1.0, 320.0, 240.0, 0.0], (6, 1))
    problem = Problem("calibrated", cameras, intrinsics, points, camera, point, pixels)
    assert not sfmcpp.residuals(problem).any()
    problem.pixels = np.ascontiguousarray(pixels[:, ::-1])
    assert diagnose(problem).codes[0] == "swapped-pixels"


def far_away(problem: Problem) -> Problem:
    """The whole scene far from the origin."""
    problem.points += 1e9
    problem.cameras[:, :, 3] += 1e9
    return problem


def twice_seen(problem: Problem) -> Problem:
    """The first observation again."""
    return problem.with_observations(np.r_[0, np.arange(problem.num_observations)])


def pinhole_by_function(problem: Problem) -> Problem:
    """The same cameras as a function, of which no rays are known."""

    def project(points: FloatArray, intrinsics: FloatArray) -> FloatArray:
        f, aspect, cx, cy = intrinsics.T[:4]
        x, y, z = points.T
        return np.stack([f * x / z + cx, f * aspect * y / z + cy], axis=1)

    model = CameraFunction(project, ("f", "aspect", "cx", "cy", "skew"), name="own", free_by_default=())
    return replace(problem, camera_model=model, fixed_intrinsics=np.ones_like(problem.fixed_intrinsics))


@pytest.mark.parametrize(
    ("fault", "code"),
    [
        (lambda problem: problem, "gauge-freedoms"),
        (lambda problem: halves(problem, 0), "disconnected-parts"),
        (far_away, "far-from-origin"),
        (twice_seen, "duplicate-observations"),
    ],
)
def test_what_needs_no_rays_is_found_with_a_camera_function_too(
    fault: Callable[[Problem], Problem], code: str
) -> None:
    problem = fault(scene())
    (known,) = [f.what for f in diagnose(problem).findings if f.code == code]
    found = diagnose(pinhole_by_function(problem))
    assert [f.what for f in found.findings if f.code == code] == [known]
    assert found.skipped == ["calibration, conventions, outliers, angles: no rays are known of 'own' cameras"]


def test_a_solution_of_a_camera_function_is_examined() -> None:
    problem = pinhole_by_function(scene(pixel_sigma_px=0.5))
    summary = sfmcpp.solve(problem)
    assert [f.code for f in diagnose(problem, summary=summary).findings] == [
        "worst-cameras",
        "gauge-freedoms",
    ]
