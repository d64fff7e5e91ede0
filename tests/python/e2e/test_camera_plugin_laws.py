"""The example of a plug-in obeys the laws of all camera models, in a build of these laws alone."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).resolve().parents[3] / "examples/plugins"


def run(*command: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*map(str, command)], capture_output=True, text=True)


def configured(tmp_path: Path, plugin: Path) -> Path:
    if shutil.which("cmake") is None or shutil.which("ninja") is None:
        pytest.skip("no cmake or no ninja")
    debug = ("-DCMAKE_BUILD_TYPE=Debug", "-DCMAKE_CXX_FLAGS_DEBUG=-O0")  # with assertions, for no debugger
    settings = (*debug, "-DCMAKE_UNITY_BUILD=ON", f"-DSFMCPP_CAMERA_PLUGIN={plugin}")
    result = run("cmake", "-S", EXAMPLE, "-B", tmp_path, "-G", "Ninja", *settings)
    if "GTest" in result.stderr:
        pytest.skip("no GoogleTest")
    assert result.returncode == 0, result.stderr
    return tmp_path


@pytest.mark.parametrize(
    "plugin",
    [EXAMPLE / "fisheye.hpp", Path(__file__).parent / "division_lens.hpp"],
    ids=["fisheye", "not linear in its intrinsics"],
)
def test_plugins_obey_the_laws_of_all_camera_models(tmp_path: Path, plugin: Path) -> None:
    folder = configured(tmp_path, plugin)
    built = run("cmake", "--build", folder)
    assert built.returncode == 0, built.stdout
    laws = run(folder / "camera_laws")
    assert laws.returncode == 0, laws.stdout
    assert f"CameraLaws/{plugin.stem}.AnalyticJacobianIsTheNumericOne" in laws.stdout
    assert f"MetricCameraLaws/{plugin.stem}.ScalingAboutTheCentreLeavesTheImageUnchanged" in laws.stdout
