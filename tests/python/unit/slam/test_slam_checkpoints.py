"""A run over frames that was stopped goes on from its checkpoint to the same bits."""

from __future__ import annotations

import gc
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import test_absolute_sensors as absolute
import test_restart as restart
import test_standstill as standstill
import test_stereo as stereo
from sfmcpp import CheckpointFolder, DatasetError, InvalidArgument
from sfmcpp.ba.checkpoints import Checkpoint, CheckpointStore, Where
from sfmcpp.model.frames import Frame, View
from sfmcpp.sensors import Slip
from sfmcpp.sensors.rate_drift import RateDrift
from sfmcpp.slam import (
    Gyroscope,
    MotionSensor,
    Odometer,
    Slam,
    SlamResult,
    SlamSettings,
    TrackSequence,
    WorldMap,
    checkpoints,
    run_slam,
)
from sfmcpp.slam.checkpoints import flatten, unflatten
from sfmcpp.slam.experience import Experience
from sfmcpp.slam.sensor_suite import SensorSuite
from slam_helpers import INTRINSICS, sequence_of
from winding import AT_CAMERA, winding

Run = tuple[TrackSequence, Sequence[MotionSensor]]


def winding_road() -> Run:
    drive = winding()
    return drive.sequence, [Odometer(drive.odometer), Gyroscope(drive.gyro, AT_CAMERA)]


def with_positions() -> Run:
    scene = absolute.bent()
    return sequence_of(scene), [absolute.gps_of(scene.cameras, 0.05)]


def late() -> Run:
    drive = winding()
    return drive.sequence, [
        Odometer(drive.odometer.shifted(0.3)),
        Gyroscope(drive.gyro.shifted(0.3), AT_CAMERA),
    ]


def with_a_bias() -> Run:
    drive = winding()
    biased = replace(drive.gyro, values=drive.gyro.values + np.radians([0.0, 5.0, 0.0]))
    return drive.sequence, [Gyroscope(biased, AT_CAMERA)]


def biased_with_rests() -> Run:
    drive = standstill.with_pauses(0, 50)
    return drive.sequence, standstill.biased(drive)


RUNS: dict[str, Callable[[], Run]] = {
    "torn": lambda: (restart.cut_sequence(blind=3), [restart.odometer()]),
    "winding": winding_road,
    "late": late,
    "bias": with_a_bias,
    "bias at rest": biased_with_rests,
    "positions": with_positions,
    "stereo": lambda: (stereo.sequence(), []),
}
# Those that are begun again without what was wrong.
PASSES = {"late": 2, "bias": 2}
SETTINGS = SlamSettings(final_adjustment="on")


class InMemory:
    """A store that keeps all checkpoints, after every frame."""

    failure = None

    def __init__(self) -> None:
        self.all: list[Checkpoint] = []

    def begin(self, resumed: CheckpointStore | None, least_bytes: int) -> None:
        """Do nothing."""

    def is_due(self) -> bool:
        return True

    def save(self, facts: Mapping[str, Any], where: Where) -> bool:
        self.all.append(Checkpoint("memory", facts, where(), len(self.all) + 1))
        return True

    def load(self) -> Checkpoint:
        return self.all[-1]


def up_to(store: InMemory, count: int) -> InMemory:
    found = InMemory()
    found.all = store.all[:count]
    return found


def bits(result: SlamResult) -> dict[str, bytes]:
    """All that a result holds, but times."""
    for record in result.records:
        record.milliseconds = {}
    result.seconds = 0.0
    return {name: array.tobytes() for name, array in flatten(result).items()}


@pytest.mark.parametrize("name", RUNS)
def test_it_goes_on_to_the_same_bits_from_any_frame(name: str) -> None:
    source, sensors = RUNS[name]()
    store = InMemory()
    whole = bits(run_slam(source, SETTINGS, sensors, checkpoint=store))
    assert len(store.all) == PASSES.get(name, 1) * len(source)
    # Before there is a map, where one run goes on from its first frame; in every pass; and at the last frame.
    first = 1 if name == "winding" else 20
    for count in {*range(first, len(store.all) + 1, 45), len(store.all)}:
        source, sensors = RUNS[name]()
        assert bits(run_slam(source, SETTINGS, sensors, resume=up_to(store, count))) == whole, count


def test_a_run_that_the_callback_ended_goes_on_from_its_folder(tmp_path: Path) -> None:
    source, sensors = RUNS["winding"]()
    whole = bits(run_slam(source, SETTINGS, sensors))
    kept = CheckpointFolder(tmp_path / "kept")
    first = run_slam(source, SETTINGS, sensors, lambda frame, _: frame < 40, checkpoint=kept)
    assert len(first.path.times) == 41
    heard: list[int] = []
    again = run_slam(source, SETTINGS, sensors, lambda frame, _: heard.append(frame), resume=kept)
    assert heard == list(range(41, len(source)))
    assert again.seconds > first.seconds
    assert bits(again) == whole


def test_what_follows_the_last_frame_is_done_again_from_there(tmp_path: Path) -> None:
    source, sensors = RUNS["winding"]()
    kept, heard = CheckpointFolder(tmp_path / "kept", every_s=1e9), list[int]()
    whole = bits(run_slam(source, SETTINGS, sensors, checkpoint=kept))
    other = CheckpointFolder(tmp_path / "other", every_s=1e9)
    run_slam(source, SETTINGS, sensors, lambda frame, _: heard.append(frame), other, kept)
    assert not heard
    assert bits(run_slam(source, SETTINGS, sensors, resume=other)) == whole


def test_another_run_is_refused_by_name(tmp_path: Path) -> None:
    source, sensors = RUNS["winding"]()
    kept = CheckpointFolder(tmp_path / "kept")
    run_slam(source, SETTINGS, sensors, lambda frame, _: frame < 10, checkpoint=kept)
    with pytest.raises(DatasetError, match="other options: window = 8, this is 6"):
        run_slam(source, replace(SETTINGS, window=6), sensors, resume=kept)
    with pytest.raises(DatasetError, match="another problem: sensor 'gyro' differ"):
        run_slam(source, SETTINGS, sensors[:1], resume=kept)
    other, _ = RUNS["stereo"]()
    with pytest.raises(DatasetError, match="another problem: frames: begin, frames: pixels"):
        run_slam(other, SETTINGS, sensors, resume=kept)


@pytest.mark.parametrize("cls", [SlamResult, Experience, WorldMap])
def test_a_checkpoint_whose_classes_have_another_name_now_is_refused(tmp_path: Path, cls: type) -> None:
    source, sensors = RUNS["winding"]()
    kept = CheckpointFolder(tmp_path / "kept")
    name, cls.__name__ = cls.__name__, "CalledOtherwise"
    try:
        run_slam(source, SETTINGS, sensors, lambda frame, _: frame < 3, checkpoint=kept)
    finally:
        cls.__name__ = name
    with pytest.raises(DatasetError, match=r"checkpoint-.\.npz: was written by another version"):
        run_slam(source, SETTINGS, sensors, resume=kept)


def test_a_checkpoint_whose_objects_have_other_attributes_now_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, sensors = RUNS["winding"]()
    kept = CheckpointFolder(tmp_path / "kept")
    run_slam(source, SETTINGS, sensors, lambda frame, _: frame < 3, checkpoint=kept)
    before = WorldMap.__init__

    def with_another(self: Any, intrinsics: Any) -> None:
        before(self, intrinsics)
        self.later_added = True

    monkeypatch.setattr(WorldMap, "__init__", with_another)
    with pytest.raises(DatasetError, match="was written by another version"):
        run_slam(source, SETTINGS, sensors, resume=kept)


def test_images_that_have_changed_are_found_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source, sensors = RUNS["winding"]()
    monkeypatch.setattr(
        TrackSequence, "identity", lambda self: {}
    )  # as for images, which are not read before
    kept = CheckpointFolder(tmp_path / "kept")
    run_slam(source, SETTINGS, sensors, lambda frame, _: frame < 10, checkpoint=kept)
    source._pixels[source._begin[10]] += 1e-9
    with pytest.raises(DatasetError, match="of other images: frame 10 sees something else"):
        run_slam(source, SETTINGS, sensors, resume=kept)


def test_faults_that_are_found_at_the_end_are_kept_for_the_run_without_them() -> None:
    (odometer, gyro), again = winding_road()[1], SensorSuite(winding_road()[1])
    suite = SensorSuite([odometer, gyro])
    suite.slips[odometer.name] = Slip(1.0, 3.0, 0.2, 0.01)
    suite.drifts[gyro.name] = RateDrift(2.0, np.zeros(3), np.array([0.0, 0.01, 0.0]), 4.0)
    again.restore(unflatten(flatten(suite.state()), checkpoints._CLASSES))
    assert again.slips == suite.slips
    (found,) = again.drifts.values()
    assert found.complaint == suite.drifts[gyro.name].complaint


def test_objects_are_flattened_and_made_again_with_their_cycles_and_orders() -> None:
    world = WorldMap(INTRINSICS)
    frame = Frame(3, 0.5, View(np.arange(4, dtype=np.int32), np.asfortranarray(np.ones((4, 2)))))
    world.add(frame, np.eye(3, 4))
    value = {1: world, "x": (None, True, np.float64(0.1), [np.inf], frozenset("ba")), "frame": frame}
    classes = (WorldMap, Frame, View, *map(type, (world.keyframes[0], world._right, world._tracks)))
    again = unflatten(flatten(value), classes)
    assert again[1].keyframes[0].world is again[1]
    assert again[1].poses.tobytes() == world.poses.tobytes()
    assert again["frame"].view.pixels.flags.f_contiguous
    assert again["x"] == value["x"]
    assert type(again["x"][2]) is np.float64
    again[1].add(frame, np.eye(3, 4))
    assert len(again[1].poses) == 2


def test_flattening_leaves_the_garbage_collector_nothing_to_look_at() -> None:
    """It would look at all that a run of an hour has, again and again: longer than the flattening takes."""
    value = {k: (k, np.zeros(3)) for k in range(20_000)}
    gc.collect()
    before = gc.get_stats()[0]["collections"]
    flatten(value)
    assert gc.get_stats()[0]["collections"] - before < 10


def test_only_named_classes_are_made() -> None:
    with pytest.raises(InvalidArgument, match="View"):
        unflatten(flatten(View(np.arange(3, dtype=np.int32), np.ones((3, 2)))), [Frame])
    with pytest.raises(InvalidArgument, match="hold no such object"):
        unflatten({"tree": np.frombuffer(b'["array", "float64", 0, [9], "C"]', np.uint8)}, [])


def test_a_run_without_a_folder_is_not_asked_for_its_state(monkeypatch: pytest.MonkeyPatch) -> None:
    """All that was learnt so far is copied for it: after an hour more than a frame changes."""
    source, sensors = RUNS["winding"]()
    asked = []
    state = Slam.state
    monkeypatch.setattr(Slam, "state", lambda self: (asked.append(1), state(self))[1])
    run_slam(source, SETTINGS, sensors, lambda frame, _: frame < 5)
    assert len(asked) == 1
