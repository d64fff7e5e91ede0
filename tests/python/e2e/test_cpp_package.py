"""The C++ example builds in a project of C++17, with the installed library and with the sources."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

import sfmcpp

REPOSITORY = Path(__file__).resolve().parents[3]
EXAMPLE = REPOSITORY / "examples/cpp"
OBJECT = "CMakeFiles/bundle_adjustment.dir/bundle_adjustment.cpp.o"


def run(*command: str | Path) -> str:
    return subprocess.run([*map(str, command)], check=True, capture_output=True, text=True).stdout


@pytest.fixture
def built() -> Path:
    """A build folder of this repository that holds the library."""
    if shutil.which("cmake") is None or shutil.which("ninja") is None:
        pytest.skip("no cmake or no ninja")
    for name in ("python", "release"):
        if (REPOSITORY / "build" / name / "cpp/libsfmcpp.a").is_file():
            return REPOSITORY / "build" / name
    pytest.skip("no library in build/python or build/release (make install)")


def test_the_example_runs_with_the_installed_library(built: Path, tmp_path: Path) -> None:
    run("cmake", "--install", built, "--component", "development", "--prefix", tmp_path / "first")
    shutil.move(tmp_path / "first", tmp_path / "moved")
    build = tmp_path / "build"
    run("cmake", "-S", EXAMPLE, "-B", build, "-G", "Ninja", f"-DCMAKE_PREFIX_PATH={tmp_path / 'moved'}")
    run("cmake", "--build", build)
    told = run(build / "bundle_adjustment")
    assert "\nRMS " in told
    assert "\ndepth of point 0: " in told
    resumed = run(build / "own_functions").splitlines()
    assert resumed[1] == "the callback asked to stop"
    assert run(build / "own_camera").splitlines()[1].startswith("converged, RMS ")
    assert_bal_is_solved(build / "bal", tmp_path)


def assert_bal_is_solved(program: Path, folder: Path) -> None:
    """The example that reads BAL ends where Python does."""
    truth = sfmcpp.circle_scene(6, 40, camera_model="bal", pixel_sigma_px=0.5, seed=0)
    start = sfmcpp.perturb(truth, point_sigma_m=0.1, position_sigma_m=0.1, rotation_sigma_deg=1, seed=1)
    sfmcpp.write(start, folder / "start.txt")
    summary = sfmcpp.solve(sfmcpp.read(folder / "start.txt"))
    told = run(program, folder / "start.txt")
    assert f"{summary.initial_cost:.6g} -> {summary.final_cost:.6g}: " in told


def test_the_example_builds_by_pkg_config_and_the_licences_come_along(built: Path, tmp_path: Path) -> None:
    if shutil.which("pkg-config") is None or shutil.which("g++") is None:
        pytest.skip("no pkg-config or no g++")
    run("cmake", "--install", built, "--component", "development", "--prefix", tmp_path / "first")
    moved = shutil.move(tmp_path / "first", tmp_path / "moved")
    (description,) = moved.glob("lib*/**/pkgconfig/sfmcpp.pc")
    flags = run("pkg-config", "--cflags", "--libs", description).split()
    run("g++", "-std=c++20", EXAMPLE / "bundle_adjustment.cpp", *flags, "-o", tmp_path / "a.out")
    assert "depth of point 0" in run(tmp_path / "a.out")
    licences = moved / "share/licenses/sfmcpp"
    assert (licences / "LICENSE").read_bytes() == (REPOSITORY / "LICENSE").read_bytes()
    assert "Mozilla Public License" in (licences / "Eigen.txt").read_text()


@pytest.mark.parametrize("example", ["bundle_adjustment", "bal", "own_camera", "own_functions"])
def test_the_examples_compile_without_warnings(example: str, tmp_path: Path) -> None:
    compiler = shutil.which("g++")
    eigen = next((p for p in ("/usr/include/eigen3", "/usr/local/include/eigen3") if Path(p).is_dir()), None)
    if compiler is None or eigen is None:
        pytest.skip("no g++, or Eigen is elsewhere")
    places = (f"-I{REPOSITORY / 'cpp/include'}", "-isystem", eigen, "-c", EXAMPLE / f"{example}.cpp", "-o")
    run(compiler, "-std=c++20", "-O2", "-Wall", "-Wextra", "-Werror", *places, tmp_path / "a.o")


def test_who_chooses_another_allocator_for_eigen_is_told_by_the_linker(built: Path, tmp_path: Path) -> None:
    compiler, core = shutil.which("g++"), REPOSITORY / "cpp/include"
    eigen = next((p for p in ("/usr/include/eigen3", "/usr/local/include/eigen3") if Path(p).is_dir()), None)
    if compiler is None or eigen is None:
        pytest.skip("no g++, or Eigen is elsewhere")
    sources = (EXAMPLE / "bundle_adjustment.cpp", built / "cpp/libsfmcpp.a")
    command = [compiler, "-std=c++20", f"-I{core}", "-isystem", eigen, *sources, "-lpthread", "-o"]
    command.append(tmp_path / "a.out")
    with pytest.raises(subprocess.CalledProcessError) as caught:
        run(*command, "-DEIGEN_MAX_ALIGN_BYTES=32")  # which no optimisation changes
    assert "CompiledWithTheEigenAllocatorOfTheLibrary<32" in caught.value.stderr
    ours = ["-DEIGEN_MAX_ALIGN_BYTES=16", "-DEIGEN_MALLOC_ALREADY_ALIGNED=1"]
    run(*command, *ours, "-O1", "-mavx2", "-Wall", "-Wextra", "-Werror")
    assert "depth of point 0" in run(tmp_path / "a.out")


def test_the_example_compiles_with_the_sources(built: Path, tmp_path: Path) -> None:
    """Its own file alone: the library, with its sources, would take minutes."""
    run("cmake", "-S", EXAMPLE, "-B", tmp_path, "-G", "Ninja", f"-DSFMCPP_SOURCES={REPOSITORY}")
    run("cmake", "--build", tmp_path, "--target", OBJECT)
    assert (tmp_path / OBJECT).is_file()


def test_sources_are_optimised_in_a_project_that_names_no_build_type(tmp_path: Path) -> None:
    run("cmake", "-S", EXAMPLE, "-B", tmp_path, "-G", "Ninja", f"-DSFMCPP_SOURCES={REPOSITORY}")
    lines = run("ninja", "-C", tmp_path, "-t", "commands", "sfmcpp/cpp/libsfmcpp.a").splitlines()
    (solve,) = (line for line in lines if line.endswith("/src/ba/solve.cpp"))
    assert "-O3" in solve
    assert "-O3" not in run("ninja", "-C", tmp_path, "-t", "commands", OBJECT)


@pytest.mark.parametrize(
    ("version", "told"), [(None, "not found: must"), ("3.3.7", "not found (there is 3.3.7)")]
)
def test_who_has_no_eigen_is_told_which_versions_will_do(
    version: str | None, told: str, tmp_path: Path
) -> None:
    if shutil.which("cmake") is None or shutil.which("ninja") is None:
        pytest.skip("no cmake or no ninja")
    if version is not None:
        (tmp_path / "Eigen3Config.cmake").touch()
        (tmp_path / "Eigen3ConfigVersion.cmake").write_text(
            f'set(PACKAGE_VERSION "{version}")\nset(PACKAGE_VERSION_COMPATIBLE FALSE)\n'
        )
    search = ("-DCMAKE_FIND_ROOT_PATH=/nowhere", "-DCMAKE_FIND_ROOT_PATH_MODE_PACKAGE=ONLY")
    command = ["cmake", "-S", REPOSITORY, "-B", tmp_path / "build", "-G", "Ninja"]
    there = () if version is None else (f"-DEigen3_DIR={tmp_path}",)
    with pytest.raises(subprocess.CalledProcessError) as caught:
        run(*command, *search, *there)
    assert f"Eigen 3.4 or 5 is {told}" in " ".join(caught.value.stderr.split())


def test_who_has_no_header_of_python_is_told_its_package(tmp_path: Path) -> None:
    if shutil.which("cmake") is None or shutil.which("ninja") is None:
        pytest.skip("no cmake or no ninja")
    settings = ("-DSFMCPP_BUILD_PYTHON=ON", "-DPython_INCLUDE_DIR=/nowhere")
    with pytest.raises(subprocess.CalledProcessError) as caught:
        run("cmake", "-S", REPOSITORY, "-B", tmp_path, "-G", "Ninja", *settings)
    told = " ".join(caught.value.stderr.split())
    assert "is not found: must be installed (apt-get install python3-dev)" in told


def test_a_library_without_a_build_type_exports_sfmcpp_with_its_own(tmp_path: Path) -> None:
    """The libraries themselves are not needed."""
    if shutil.which("cmake") is None or shutil.which("ninja") is None:
        pytest.skip("no cmake or no ninja")
    parent, user, prefix = tmp_path / "parent", tmp_path / "user", tmp_path / "there"
    parent.mkdir()
    user.mkdir()
    (parent / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.25)\nproject(parent LANGUAGES CXX)\n"
        f'set(SFMCPP_INSTALL ON)\nadd_subdirectory("{REPOSITORY}" sfmcpp)\n'
    )
    (user / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.25)\nproject(user LANGUAGES CXX)\nfind_package(sfmcpp REQUIRED)\n"
        "file(GENERATE OUTPUT place CONTENT $<TARGET_FILE:sfmcpp::sfmcpp>)\n"
    )
    run("cmake", "-S", parent, "-B", parent / "build", "-G", "Ninja")
    (parent / "build/sfmcpp/cpp/libsfmcpp.a").touch()
    run("cmake", "--install", parent / "build", "--component", "development", "--prefix", prefix)
    run("cmake", "-S", user, "-B", user / "build", "-G", "Ninja", f"-DCMAKE_PREFIX_PATH={prefix}")
    assert Path((user / "build/place").read_text()).is_file()


def test_pkg_config_hands_on_the_camera_model_of_the_build(tmp_path: Path) -> None:
    """In a shell, where quotes in a definition would not survive; the library itself is not needed."""
    if any(shutil.which(tool) is None for tool in ("cmake", "ninja", "pkg-config", "g++")):
        pytest.skip("no cmake, ninja, pkg-config or g++")
    plugin, build = Path(__file__).parent / "division_lens.hpp", tmp_path / "build"
    run("cmake", "-S", REPOSITORY, "-B", build, "-G", "Ninja", f"-DSFMCPP_CAMERA_PLUGIN={plugin}")
    (build / "cpp/libsfmcpp.a").touch()
    run("cmake", "--install", build, "--component", "development", "--prefix", tmp_path / "there")
    (tmp_path / "main.cpp").write_text(
        "#include <sfmcpp/cameras/visit_camera.hpp>\n"
        'static_assert(sfmcpp::enum_name(sfmcpp::CameraModelId::kPlugin) == "division_lens");\n'
        "int main() { return sfmcpp::PluginCamera::kIntrinsics == 4 ? 0 : 1; }\n"
    )
    (description,) = (tmp_path / "there").glob("lib*/**/pkgconfig/sfmcpp.pc")
    flags = f"$(pkg-config --cflags {description})"
    run("sh", "-c", f"g++ -std=c++20 {tmp_path}/main.cpp {flags} -o {tmp_path}/a.out && {tmp_path}/a.out")
