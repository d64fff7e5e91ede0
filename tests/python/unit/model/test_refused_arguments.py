"""Arguments that are none end in an InvalidArgument that names them, not in whatever NumPy stumbles over."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

import numpy as np
import pytest

import sfmcpp
from sfmcpp import ConstraintGroup, DatasetError, InvalidArgument, Problem, sfm
from sfmcpp.doctor import repair
from sfmcpp.map import map_of_problem
from sfmcpp.model import SensorStream, Trajectory
from sfmcpp.model.arguments import checked
from sfmcpp.model.image_tracks import image_tracks
from sfmcpp.sensors import Mounting
from sfmcpp.slam import SlamSettings, View
from sfmcpp.sources.vision import KltSettings, detect_in, follow_features, match

RAGGED = [[1.0], [2.0, 3.0]]
DATES = np.array(["2024-01-01", "2024-01-02"], dtype="datetime64[us]")
MASKED = np.ma.masked_equal(np.arange(300.0), 7).reshape(150, 2)


def scene() -> Problem:
    return sfmcpp.circle_scene(5, 30, seed=0)


def made(**changes: Any) -> Problem:
    problem = scene()
    return Problem(**{f.name: getattr(problem, f.name) for f in fields(Problem)} | changes)


def solved(**changes: Any) -> None:
    problem = scene()
    for name, value in changes.items():
        setattr(problem, name, value)
    sfmcpp.solve(problem, max_iterations=1)


def perturbed(problem: Problem) -> Problem:
    return sfmcpp.perturb(problem, point_sigma_m=0.1, seed=0)


def with_outliers(problem: Problem) -> object:
    return sfmcpp.add_outliers(problem, 0.1, seed=0)


def group(**changes: Any) -> ConstraintGroup:
    return ConstraintGroup(**{"kind": "position", "cameras": [0], "values": np.zeros((1, 3))} | changes)


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda: made(camera_model=None), "camera_model = None: must be one of"),
        (lambda: made(camera_model=[]), r"camera_model = \[\]: must be one of"),
        (lambda: made(cameras=RAGGED), "cameras = .*: must be an array of numbers"),
        (lambda: made(pixels=MASKED), "pixels: 1 entries are masked: must be filled in or left out"),
        (lambda: solved(pixels=MASKED), "pixels: 1 entries are masked"),
        (lambda: group(values=np.ma.masked_all((1, 3))), "values: 3 entries are masked"),
        (lambda: made(camera_index=RAGGED), "camera_index = .*: must be an array of numbers"),
        (lambda: made(fixed_cameras=RAGGED), "fixed_cameras = .*: must be an array of numbers"),
        (lambda: made(fixed_points=[]), r"fixed_points: .*\(0,\), must be \(30\)|cannot be used as bool"),
        (
            lambda: scene().with_observations(np.ones(3, bool)),
            r"chosen: mask of shape \(3,\), must be \(150,\)",
        ),
        (lambda: scene().with_observations([150]), "chosen: must be from 0 to 149"),
        (lambda: scene().with_observations([0.5]), "chosen: float64"),
        (lambda: sfmcpp.check(3), "problem = 3: must be a Problem"),  # type: ignore[arg-type]
        (lambda: sfmcpp.solve(None), "problem = None: must be a Problem"),  # type: ignore[arg-type]
        (lambda: sfmcpp.cost("x"), "problem = 'x': must be a Problem"),  # type: ignore[arg-type]
        (lambda: sfmcpp.check_jacobians([]), r"problem = \[\]: must be a Problem"),  # type: ignore[arg-type]
        (lambda: sfmcpp.circle_scene(2**80), r"num_cameras = \d+: must be at most"),
        (lambda: sfmcpp.circle_scene(True), "num_cameras = True: must be a whole number"),
        (lambda: sfmcpp.circle_scene(radius_m=None), "radius_m = None: must be a number"),  # type: ignore[arg-type]
        (lambda: sfmcpp.circle_scene(cube_m=10**400), "cube_m = 10+: must be a number"),
        (lambda: solved(camera_model=None), "camera_model = None: must be one of"),
        (lambda: solved(camera_index=RAGGED), "camera_index = .*: must be an array of numbers"),
        (lambda: solved(points=None), "points: dtype object cannot be used as float64"),
        (lambda: sfmcpp.solve(scene(), constraints=1), "constraints = 1: must be a sequence"),  # type: ignore[arg-type]
        (lambda: sfmcpp.solve(scene(), callback=3), "callback = 3: must be callable"),  # type: ignore[arg-type]
        (lambda: sfmcpp.check_jacobians(scene(), math.nan), "max_observations = nan: must be a whole number"),  # type: ignore[arg-type]
        (lambda: sfmcpp.linearize(scene()).covariance(cameras=[0.5]), "cameras: float64"),
        (lambda: sfmcpp.linearize(scene()).covariance(cameras=[True] * 5), "cameras: bool"),
        (lambda: sfmcpp.linearize(scene()).covariance(points=["a"]), "points: <U1"),
        (lambda: sfmcpp.linearize(scene()).hat_matrix(2**40), r"group = \d+: must be in \[0, 0\)"),
        (lambda: sfmcpp.linearize(scene()).hat_spectrum("gps"), "group = 'gps': must be a whole number"),  # type: ignore[arg-type]
        (lambda: map_of_problem(scene()).join(3), "other = 3: must be a"),  # type: ignore[call-arg, arg-type]
        (lambda: map_of_problem(scene()).take(None), "local = None: must be a LocalProblem"),  # type: ignore[arg-type]
        (lambda: map_of_problem(scene()).transform([]), r"similarity = \[\]: must be a Similarity"),  # type: ignore[arg-type]
        (lambda: map_of_problem(scene()).seen_from([True] * 5, [10**9]), "points: must be from 0 to 29"),
        (lambda: map_of_problem(scene()).seen_from([0], [1]), "images: dtype int64 cannot be used as bool"),
        (lambda: group(kind=[]), r"kind = \[\]: must be one of"),
        (lambda: group(name=3), "name.* = 3: must be text"),
        (lambda: group(loss=None), "loss.* = None: must be text"),
        (lambda: group(points=3), "points.* = 3: must be a sequence of arrays"),
        (
            lambda: image_tracks(RAGGED, [0, 0], np.zeros((2, 2))),
            "image_index = .*: must be an array",
        ),
        (lambda: image_tracks([0], [0], [[1, 2]], sizes=RAGGED), "sizes = .*: must be an array of numbers"),
        (lambda: SensorStream([0, 1], RAGGED, "velocity"), "must be an array of numbers"),
        (lambda: SlamSettings(window=math.nan), "window = nan: must be a whole number"),  # type: ignore[arg-type]
        (lambda: SlamSettings(window=2.5), "window = 2.5: must be a whole number"),  # type: ignore[arg-type]
        (lambda: SlamSettings(window=None), "window = None: must be a whole number"),  # type: ignore[arg-type]
    ],
)
def test_arguments_that_are_none_are_named(call: Callable[[], object], told: str) -> None:
    with pytest.raises(InvalidArgument, match=told):
        call()


PHOTO = np.zeros((70, 80, 3), np.uint8)


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda: made(metadata={}), r"metadata = \{\}: must be Metadata or None"),
        (lambda: sfmcpp.diagnose(scene(), summary=3), "summary = 3: must be a Summary"),
        (
            lambda: sfmcpp.diagnose(scene(), constraints=np.array(3)),
            r"constraints = array\(3\): must be a seq",
        ),
        (lambda: repair(scene(), constraints=None), "constraints = None: must be"),
        (lambda: repair(3), "problem = 3: must be a Problem"),
        (lambda: sfm.georeference(None, np.zeros((5, 3))), "problem = None: must be a Problem"),
        (lambda: sfm.georeference(scene(), [object()] * 5), "positions = .*: must be an array of numbers"),
        (lambda: sfm.georeference(scene(), np.ones((5, 3)) + 1j), "positions: must be an array of real"),
        (lambda: sfm.georeference(scene(), np.ones((5, 3)), geodetic="no"), "geodetic = 'no': must be True"),
        (
            lambda: sfm.georeference(scene(), np.ones((5, 3)), sigmas_m=RAGGED),
            "sigmas_m = .*: must be an arr",
        ),
        (lambda: sfm.fit_control_points(scene(), {}), r"control = \{\}: must be ControlPoints"),
        (lambda: detect_in("a.jpg"), "color = 'a.jpg': must be an array of numbers"),
        (lambda: detect_in(PHOTO, "a.png"), "mask = 'a.png': must be an array of numbers"),
        (lambda: detect_in(PHOTO, settings=8), "settings = 8: must be a FeatureSettings"),
        (lambda: match(RAGGED, RAGGED), "descriptors_1 = .*: must be an array of numbers"),
        (lambda: match(PHOTO[0], PHOTO[0], mutual=[]), r"mutual = \[\]: must be True or False"),
        (lambda: KltSettings(quality="high"), "quality = 'high': must be"),
        (lambda: KltSettings(max_residual=None), "max_residual = None: must be"),
        (lambda: list(follow_features([[[1, 2]]])), r"frames\[0\] is int64 \(1, 2\): must be uint8"),
        (lambda: Mounting(np.full((3, 3), 1e300), np.zeros(3)), "camera_from_body: is off by inf"),
    ],
)
def test_arguments_of_other_tools_that_are_none_are_named(call: Callable[[], object], told: str) -> None:
    with pytest.raises(InvalidArgument, match=told):
        call()


@pytest.mark.parametrize("use", [map_of_problem, perturbed, with_outliers, lambda problem: problem.copy()])
@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"cameras": None}, "cameras: dtype object cannot be used as float64"),
        ({"cameras": np.ones((5, 3, 4), complex)}, "cameras: dtype complex128 cannot be used"),
        ({"points": np.zeros((3, 2))}, r"points: shape \(3, 2\), must be"),
        ({"sigma_px": np.ones(3)}, r"sigma_px: shape \(3,\), must be \(150\)"),
        ({"metadata": 5}, "metadata = 5: must be Metadata or None"),
    ],
)
def test_fields_of_another_kind_are_named(
    use: Callable[[Problem], object], changes: dict[str, Any], told: str
) -> None:
    problem = scene()
    for name, value in changes.items():
        setattr(problem, name, value)
    with pytest.raises(InvalidArgument, match=told):
        use(problem)


@pytest.mark.parametrize(
    ("names", "told"),
    [
        (np.array(list("abcde")), "metadata image_names: is a ndarray, must be a list of str"),
        (["a", "b", None, "d", "e"], r"metadata image_names\[2\] = None: must be text"),
        ([1, 2, 3, 4, 5], r"metadata image_names\[0\] = 1: must be text"),
    ],
)
def test_names_of_images_that_are_no_texts_are_named(tmp_path: Path, names: Any, told: str) -> None:
    problem = scene()
    problem.metadata.image_names = names
    for name in ("a.npz", "a.nvm", "a.g2o", "a.sfm", "transforms.json", "sfm_data.json", "model"):
        with pytest.raises(DatasetError, match=f"{name}: {told}"):
            sfmcpp.write(problem, tmp_path / name)
    for use in (map_of_problem, lambda problem: problem.with_cameras([0])):
        with pytest.raises(InvalidArgument, match=told):
            use(problem)


def test_sizes_of_images_that_no_map_holds_are_named() -> None:
    problem = scene()
    problem.metadata.image_sizes = np.array([640, 480])
    with pytest.raises(InvalidArgument, match=r"metadata image_sizes: shape \(2,\), must be \(5, 2\)"):
        map_of_problem(problem)


def test_no_observations_can_be_chosen_in_either_way() -> None:
    for chosen in ([], np.zeros(150, dtype=bool)):
        assert scene().with_observations(chosen).num_observations == 0


def test_a_matrix_of_intrinsics_is_told_what_a_row_holds() -> None:
    message = r"intrinsics: shape \(3, 3\), must be \(any, 5\): f, aspect, cx, cy, skew of each row"
    with pytest.raises(InvalidArgument, match=message):
        made(intrinsics=np.eye(3))


def test_arrays_are_taken_while_another_thread_imports_the_module_of_masks(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "numpy.ma", ModuleType("numpy.ma"))  # as it is until its body has run
    assert made(pixels=np.zeros((150, 2))).pixels.shape == (150, 2)


def test_a_group_in_place_of_a_list_is_named_in_short() -> None:
    with pytest.raises(InvalidArgument, match=r"^constraints = .{1,60}: .*\[group\]$"):
        sfmcpp.solve(scene(), constraints=group())  # type: ignore[arg-type]


def test_a_list_in_place_of_names_of_intrinsics_is_told() -> None:
    problem = sfmcpp.circle_scene(4, 20, camera_model="bal")
    for names in ([], ["f", "k1"]):
        with pytest.raises(InvalidArgument, match="must be names one by one, or none to fix all"):
            problem.set_free_intrinsics(names)  # type: ignore[arg-type]
    assert problem.set_free_intrinsics().fixed_intrinsics.all()


def test_integers_beyond_all_numbers_are_named() -> None:
    with pytest.raises(InvalidArgument, match="values: holds an integer beyond all numbers of float64"):
        group(values=[[10**400, 0, 0]])


def test_no_metadata_are_empty_ones() -> None:
    problem = made(metadata=None)
    assert problem.metadata.names(1) == ["image_000001"]
    assert made(metadata=None).metadata is not problem.metadata


def test_ragged_rows_are_named_where_a_row_of_numbers_would_do() -> None:
    with pytest.raises(InvalidArgument, match="must be an array of numbers"):
        SensorStream([0, 1], RAGGED, "speed")
    with pytest.raises(InvalidArgument, match=r"view.pixels = .*must be an array of numbers"):
        View([0, 1], RAGGED)


@pytest.mark.parametrize(
    ("t_s", "change", "told"),
    [
        ([0.0, 1.0, 1.0], None, r"t_s\[2\] = 1.0 s is a duplicate"),
        ([0.0, 2.0, 1.0], None, r"t_s\[2\] = 1.0 s is earlier"),
        ([0.0, 1.0, 2.0], (1, 0, 0, np.nan), r"poses\[1, 0, 0\] = nan"),
        ([0.0, 1.0, 2.0], (1, 0, 0, 5.0), r"poses\[1\]: its first three columns are no rotation"),
        ([0.0, 1.0], None, "poses: shape"),
    ],
)
def test_an_impossible_trajectory_is_refused(
    t_s: list[float], change: tuple[int, int, int, float] | None, told: str
) -> None:
    poses = np.tile(np.eye(3, 4), (3, 1, 1))
    if change is not None:
        poses[change[:3]] = change[3]
    with pytest.raises(InvalidArgument, match=told):
        Trajectory(np.array(t_s), poses)


def test_an_array_is_asked_for_through_an_alias_too() -> None:
    """NumPy's NDArray is an alias from version 2.5 on: what was no array went through."""
    extensions = pytest.importorskip("typing_extensions", reason="aliases of types are of Python 3.12")
    number = TypeVar("number", bound=np.generic)
    alias = extensions.TypeAliasType("alias", np.ndarray[Any, np.dtype[number]], type_params=(number,))

    def first(mask: Any) -> Any:
        return mask[0]

    first.__annotations__["mask"] = alias[np.float64] | None
    assert checked()(first)([7.0]) == 7.0
    with pytest.raises(InvalidArgument, match=r"mask = 'a\.png': must be an array of numbers"):
        checked()(first)("a.png")


@pytest.mark.parametrize("times", [DATES, DATES - DATES[0]])
def test_dates_and_spans_are_refused_as_times_in_seconds(times: Any) -> None:
    """NumPy would take their counts of microseconds."""
    told = rf"t_s: dtype {times.dtype.name[:-4]}\[us\]: must be numbers; seconds are \(times - times\[0\]\)"
    with pytest.raises(InvalidArgument, match=told):
        SensorStream(times, [[1.0], [2.0]], "speed", "odometer")
    seconds = (times - times[0]) / np.timedelta64(1, "s")  # as the message says
    assert SensorStream(seconds, [[1.0], [2.0]], "speed", "odometer").t_s.tolist() == [0.0, 86400.0]
