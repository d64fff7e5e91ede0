"""`bench/sfm/degraded.py`: what is done to photos, and how the truth of turned ones is turned."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import sfmcpp
from bench_programs import BENCH, as_module
from sfmcpp.sources.synthetic import circle_scene

COUNT, SIZE, DOT, FOCAL = 6, (320, 240), (220, 70), 300.0
SIDE = """
import json, pathlib, shutil, sys
job = json.loads(pathlib.Path(sys.argv[1]).read_text())
assert job["matrix"] is None
folder = pathlib.Path(job["folder"])
shutil.copytree({model!r}, folder / "model", dirs_exist_ok=True)
(folder / "run.json").write_text(json.dumps(dict(models=[len(job["names"])], warnings=["a", "b"])))
"""


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """The program as a module."""
    pytest.importorskip("PIL")
    yield from as_module(monkeypatch, BENCH / "sfm", "degraded")


def photos(folder: Path) -> list[Path]:
    """Grey photos with a white dot of 9 px at `DOT`."""
    from PIL import Image

    folder.mkdir()
    levels = np.full((SIZE[1], SIZE[0], 3), 90, np.uint8)
    levels[DOT[1] - 4 : DOT[1] + 5, DOT[0] - 4 : DOT[0] + 5] = 255
    for number in range(COUNT):
        Image.fromarray(levels).save(folder / f"{number}.png")
    return sorted(folder.iterdir())


def dot_from_middle(path: Path) -> tuple[np.ndarray, tuple[int, int]]:
    """Where the dot is from the middle of the image [px], x to the right and y down; size of the image."""
    from PIL import Image

    with Image.open(path) as image:
        levels = np.asarray(image.convert("L"), dtype=np.float64)
    bright = np.where(levels > 170, levels, 0.0)
    rows, columns = np.indices(levels.shape)
    place = np.array([(bright * columns).sum(), (bright * rows).sum()]) / bright.sum() + 0.5
    return place - np.array(levels.shape[::-1]) / 2, levels.shape[::-1]


@pytest.mark.parametrize("name", ["half", "rolled", "turned"])
def test_a_camera_turned_like_its_picture_sees_the_dot_where_it_was(
    bench: ModuleType, tmp_path: Path, name: str
) -> None:
    from degrading import camera_turns, degrade

    rolls = degrade(photos(tmp_path / "in"), name, tmp_path / "out")
    assert set(rolls.values()) == {"half": {0.0}, "rolled": {-15.0, 0.0, 15.0}, "turned": {0.0, 90.0}}[name]
    before = (np.array(DOT) + 0.5 - np.array(SIZE) / 2) / 2
    for copy, turn in zip(rolls, camera_turns(list(rolls.values())), strict=True):
        place, _ = dot_from_middle(tmp_path / "out" / copy)
        np.testing.assert_allclose((turn @ [*place, 300.0])[:2], before, atol=0.6)


def test_what_copies_are(bench: ModuleType, tmp_path: Path) -> None:
    from degrading import degrade

    originals = photos(tmp_path / "in")
    matrix = [[FOCAL, 0, 149.5], [0, FOCAL, 129.5], [0, 0, 1]]
    assert len(degrade(originals, "alternate", tmp_path / "alternate")) == COUNT // 2
    assert degrade(originals, "centred", tmp_path / "none") == {}
    degrade(originals, "centred", tmp_path / "centred", matrix=matrix)
    place, size = dot_from_middle(tmp_path / "centred/0.jpg")
    assert size == (150, 110)
    np.testing.assert_allclose(place, (np.array(DOT) - [149.5, 129.5]) / 2, atol=0.6)
    sizes = [
        dot_from_middle(tmp_path / "sizes" / name)[1]
        for name in degrade(originals, "sizes", tmp_path / "sizes")
    ]
    assert sizes[:3] == [(213, 160), (160, 120), (128, 96)]


def test_noise_is_that_of_the_seed_and_of_the_photo_alone(bench: ModuleType, tmp_path: Path) -> None:
    from PIL import Image

    from degrading import degrade

    originals = photos(tmp_path / "in")
    for folder, seed, some in (("a", 0, originals), ("b", 0, originals[:2]), ("c", 1, originals)):
        degrade(some, "noise20", tmp_path / folder, seed=seed)
    one, again, other = ((tmp_path / folder / "1.jpg").read_bytes() for folder in "abc")
    assert one == again != other
    assert one != (tmp_path / "a/0.jpg").read_bytes()
    levels = np.asarray(Image.open(tmp_path / "a/1.jpg").convert("L"), dtype=np.float64)[60:, :50]
    # 20 levels on each colour, of which grey has 0.299, 0.587 and 0.114.
    assert levels.std() == pytest.approx(13.4, rel=0.1)


def test_each_copy_is_measured_against_its_turned_truth(
    bench: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import running

    truth = circle_scene(COUNT, 40, camera_model="perspective", seed=3)
    truth.metadata.image_names = [f"{number}.jpg" for number in range(COUNT)]
    photos(tmp_path / "photos")
    sfmcpp.write(truth, tmp_path / "photos/truth")
    (tmp_path / "fake_side.py").write_text(SIDE.format(model=str(tmp_path / "photos/truth")))
    monkeypatch.setattr(running, "SIDES", {"sfmcpp": "fake_side"})
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    out = tmp_path / "out"
    bench.main([str(tmp_path / "photos"), "--out", str(out), "--copies", "half,turned"])
    half, turned = json.loads((out / "degraded.json").read_text())["rows"]
    assert half["truth"]["rotation_error_deg"]["max"] < 1e-5
    angles = [image["rotation_error_deg"] for image in turned["truth"]["per_image"].values()]
    np.testing.assert_allclose(angles, [0, 90] * (COUNT // 2), atol=1e-5)
    assert "| photos | half | 6 / 6 |" in (out / "degraded.md").read_text()


def test_what_is_no_copy_is_refused(
    bench: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        bench.main([str(tmp_path), "--copies", "nosuch"])
    assert "no copy nosuch: must be of half, quarter" in capsys.readouterr().err


def test_a_straight_drive_is_told_from_a_walk_around(bench: ModuleType) -> None:
    from sfmcpp.study.evaluation import ImagePoses

    poses = np.tile(np.eye(3, 4), (9, 1, 1))
    poses[:, 2, 3], poses[:, 0, 3] = np.arange(9), 0.05 * np.arange(9) ** 2 / 9
    names = tuple(f"{number}.jpg" for number in range(9))
    assert bench.is_straight(ImagePoses(names, poses))
    poses[:, 0, 3] *= 20
    assert not bench.is_straight(ImagePoses(names, poses))
