"""Every reader on files damaged at random: a short run of `make fuzz`."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import pytest
from conftest import REPOSITORY

from cli_helpers import TIMEOUT_S

pytest.importorskip("PIL", reason="Pillow is not installed: pip install 'sfmcpp[vision]'")
pytest.importorskip("yaml", reason="PyYAML is not installed: pip install 'sfmcpp[vision]'")

TOOL = REPOSITORY / "tools" / "mutate_inputs.py"
# Inputs that came to branches of a reader that no damaged file had come to (`make fuzz-guided`), cut short.
FOUND = {
    "tracks.csv": (
        b"#intrinsics:",
        b"#intrinsics:\x01\x00 f\x1d\n# intrinsics:",
        b"#intrinsics: f=-1e-32 cx=3 cy=2",
        b"# intrinsics: f=7 cx=3 cy=2\nt_s,frame,track,u,v\n0,0,1,me,\x00:3",
        b"# intrinsics: f=7 cx=3 cy=2\nt_s,frame,track,u,v\n0,0,1,_2,3\n0.1,1,,,\n",
        b"#\n# intrinsics: f=7 cx=3 cy=2\nt_s,frame,track,u,v\n0,9223372084,1,2,3\n0.1,1,,,\n",
        b"# intrinsics: f=7 cx=3 cy=0\nt_s,frame,track,u,v\n1,0,-11,2,3\n0.1,1,,,\n",
    ),
    "sensors.csv": (
        b"t[s],ts",
        b"t [s],speed [km/h],t [s],speed [Ns],speedh",
        b"t [s],speed [km/h],wx [deg/s],wy [ews],wy \n",
        b"t [s],speed [km/h],wx [deg/s],wy [deg/s],wz [deg/s]\n0,,30,0,0,1\n",
        b"t [s],speed [km/h],wx [deg/s],wy [deg/s],wz [deg/s]\n0,8,,,\n0.,,0,,0 \n",
        b"t [s],speed [km/h]\n0.4,306\n0.,30\n",
    ),
    "gps.csv": (
        b'name,lat,lon,height\n"',
        b'name,,lat,lon,height\n"a\n"\x12\ne308',
        b"name,lat,lon,height\n~a9.25,1=cg,\n",
        b'name,lat,lon,height\n"a.jpg",45,9.25,12.5\n,6,\n',
        b'name,lat,lon,height\n"a",46.5,9.25,1e308c.naj',
    ),
    "kalibr.yaml": (
        b"\t",
        b"cam0:\n c ma",
        b"cam0:\n  ca\nN  camera_model:\n  riins",
        b"cam0:\n  camera_model: pinhole\n  intrinsics: [458.0, 457.0, 36S.0, 248.0del: pinhole\n  , 480]\n",
        b"cam0:\n  camera_model: pinhole\n  intrinsics: [92233720368547758080, 248.0]\n",
        b"cam5:\n  camera_model: pinhole\n  intrinsics: [458.0=, 48.-10]\n  *distortio-infdel: rtoulion",
    ),
    "opencv.xml": (
        b"<e>\n",
        b"\n<opeag>\n<a_m>\n <rows>\xbe</r _m",
        b"<m>\n  <rows>3</rows>\n  <cols>3</cols>  <co",
        b'<?xml version="1.0"?>\n<e>\n<camera_matrix t="-m">\n  <rows>1</rows>\n  <dt>d </dt>1e308 0. 0.<\n',
    ),
}


def tool() -> ModuleType:
    specification = spec_from_file_location("mutate_inputs", TOOL)
    assert specification is not None
    assert specification.loader is not None
    module = module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", FOUND)
def test_inputs_that_were_found_are_read_or_refused(name: str, tmp_path: Path) -> None:
    fuzz = tool()
    path, reader = fuzz.seeds(tmp_path)[name]
    assert fuzz.outcome(path, reader) == "read"
    for data in FOUND[name]:
        path.write_bytes(data)
        assert fuzz.outcome(path, reader) in {"read", "refused"}, data


def test_damaged_files_are_read_or_refused_by_name() -> None:
    command = [sys.executable, TOOL, "--inputs", "3000", "--seed", "1"]
    told = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
    assert told.returncode == 0, told.stdout + told.stderr
