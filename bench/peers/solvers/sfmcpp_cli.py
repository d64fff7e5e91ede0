"""sfmcpp through its command line and the report it writes."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from harness.bal_file import State, read_bal
from harness.process_memory import interpreter_bytes
from harness.protocol import Job, Outcome, Peer, Variant


class SfmcppCli(Peer):
    """``python -m sfmcpp solve`` with its defaults."""

    name = "sfmcpp"
    title = "sfmcpp"

    def missing(self, build_folder: Path) -> str | None:
        """Whether the command answers."""
        done = subprocess.run([*_sfmcpp(), "--help"], capture_output=True, text=True, check=False)
        lines = done.stderr.strip().splitlines()
        return None if done.returncode == 0 else f"`sfmcpp solve --help` fails: {(lines or ['silently'])[-1]}"

    def variants(self, threads: int) -> list[Variant]:
        """As it comes: the linear solver is its own choice."""
        return [Variant("", {"linear-solver": "auto"})]

    def command(self, job: Job, variant: Variant) -> list[str]:
        """Solve; write the result only where the state is checked, to measure the memory of solving."""
        options = {
            **variant.settings,
            "threads": job.threads,
            "max-iterations": job.rule.max_iterations,
            "function-tolerance": job.rule.function_tolerance,
            "report": job.folder / "report.json",
        }
        words = [word for key, value in options.items() for word in (f"--{key}", str(value))]
        output = ["-o", str(job.folder / "solved.txt")] if job.keep_state else []
        return [*_sfmcpp(), str(job.bal_path), *words, "--quiet", *output]

    def outcome(self, job: Job) -> Outcome:
        """From the report; the peak includes reading the file, which cannot be told apart."""
        report = json.loads((job.folder / "report.json").read_text())
        iterations = report["iterations"]
        return Outcome(
            trace=[(entry["seconds"], entry["cost"]) for entry in iterations],
            seconds_total=iterations[-1]["seconds"],
            own_cost=report["final_cost"],
            message=f"{report['termination']}; {report['linear_solver']} linear solver",
            start_bytes=interpreter_bytes("import sfmcpp"),
            inputs_bytes=-1,
            peak_bytes=report["peak_memory_bytes"],
        )

    def final_state(self, job: Job) -> State:
        """The solved problem as written, in BAL's format."""
        solved = read_bal(job.folder / "solved.txt")
        return State.from_parameters(solved.cameras, solved.points)


def _sfmcpp() -> list[str]:
    return [sys.executable, "-m", "sfmcpp", "solve"]


PEER = SfmcppCli()
