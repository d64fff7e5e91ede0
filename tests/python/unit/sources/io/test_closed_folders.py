"""What lies in a folder that the process may not search is refused by name, wherever a path is given."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

import sfmcpp
from sfmcpp import DatasetError
from sfmcpp.cli.main import main
from sfmcpp.sources.drives import open_drive
from sfmcpp.sources.mounting_files import mounting_of
from sfmcpp.sources.vision import open_frames, open_photos


@pytest.fixture
def closed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that nobody may search, not even root, whom permissions do not bind."""
    folder = tmp_path / "closed"
    folder.mkdir()
    stat = Path.stat

    def refuse_inside(self: Path, **how: bool) -> object:
        if folder in self.absolute().parents:
            raise PermissionError(13, "Permission denied", str(self))
        return stat(self, **how)

    monkeypatch.setattr(Path, "stat", refuse_inside)
    return folder


def circle() -> sfmcpp.Problem:
    return sfmcpp.circle_scene(4, 20, seed=0)


@pytest.mark.parametrize(
    "use",
    [
        lambda path: sfmcpp.solve(circle(), checkpoint=sfmcpp.CheckpointFolder(path)),
        lambda path: sfmcpp.solve(circle(), resume=sfmcpp.CheckpointFolder(path)),
        lambda path: sfmcpp.write(circle(), path / "model.npz"),
        lambda path: mounting_of(path / "mounting"),
        lambda path: sfmcpp.sfm.reconstruct(path),
        lambda path: sfmcpp.sfm.reconstruct(path.parent.parent, camera=str(path / "K.txt")),
        open_photos,
        open_frames,
        open_drive,
        sfmcpp.slam.run,
    ],
)
def test_an_error_names_what_is_closed(closed: Path, use: Callable[[Path], object]) -> None:
    with pytest.raises(DatasetError, match=r"inside.*: permission denied"):
        use(closed / "inside")


@pytest.mark.parametrize(
    "words",
    [
        ("info", "{}/a.txt"),
        ("convert", "start.npz", "{}/model"),
        ("reconstruct", "start.npz", "-o", "{}/out"),
        ("slam", "start.npz", "-o", "{}/out"),
        ("solve", "start.npz", "--gps", "{}/gps.csv"),
        ("solve", "start.npz", "--checkpoint", "{}/kept"),
        ("solve", "start.npz", "--checkpoint", "{}/kept", "--resume", "{}/kept"),
    ],
)
def test_a_command_says_so_as_of_any_file(
    closed: Path, words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(closed.parent)
    sfmcpp.write(circle(), "start.npz")
    assert main([word.format("closed") for word in words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "closed/" in line
    assert "permission denied" in line
    assert "Errno" not in line
