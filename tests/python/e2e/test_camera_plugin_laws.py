"""The example of a plug-in obeys the laws of all camera models, in a build of these laws alone."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).resolve().parents[3] / "examples/plugins"


def run(*command: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*map(str, command)], capture_output=True, text=True)


@pytest.fixture
def configured(tmp_path: Path) -> Path:
    if shutil.which("cmake") is None or shutil.which("ninja") is None:
        pytest.skip("no cmake or no ninja")
    settings = ("-DCMAKE_BUILD_TYPE=Debug", "-DCMAKE_UNITY_BUILD=ON")
    result = run("cmake", "-S", EXAMPLE, "-B", tmp_path, "-G", "Ninja", *settings)
    if "GTest" in result.stderr:
        pytest.skip("no GoogleTest")
    assert result.returncode == 0, result.stderr
    return tmp_path


def test_the_example_obeys_the_laws_of_all_camera_models(configured: Path) -> None:
    built = run("cmake", "--build", configured)
    assert built.returncode == 0, built.stdout
    laws = run(configured / "camera_laws")
    assert laws.returncode == 0, laws.stdout
    assert "CameraLaws/fisheye.AnalyticJacobianIsTheNumericOne" in laws.stdout
    assert "MetricCameraLaws/fisheye.ScalingAboutTheCentreLeavesTheImageUnchanged" in laws.stdout
