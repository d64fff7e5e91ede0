"""The parts of the package are loaded when first used, also by threads of a process that forks."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

# The fork comes while a thread is half through loading the public names.
FORKED = """
import faulthandler, os, sys, threading, time
import sfmcpp

thread = threading.Thread(target=lambda: sfmcpp.solve)
thread.start()
while "sfmcpp._public" not in sys.modules:
    time.sleep(0.0001)
child = os.fork()
if child == 0:
    faulthandler.dump_traceback_later(30, exit=True)
    done = sfmcpp.solve(sfmcpp.circle_scene(4, 20, seed=0))
    os._exit(0 if done.termination == "converged" else 2)
thread.join()
sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no forks here")
def test_a_process_forked_while_a_thread_loads_the_package_can_use_it() -> None:
    done = subprocess.run([sys.executable, "-c", FORKED], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
