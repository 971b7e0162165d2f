"""Does an .fmu keep FMI's rules, and does it run? Each doubt is a finding."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from uuvsim_cosim.errors import FmuError
from uuvsim_cosim.fmus.read_description import read_fmu
from uuvsim_cosim.fmus.toolchain import host

__all__ = ["TIME_LIMIT", "Finding", "check"]

TIME_LIMIT = 120.0  # seconds that an FMU may take for the trial run


@dataclass(frozen=True)
class Finding:
    """One doubt about an FMU: what was looked at, and what was found."""

    check: str
    text: str

    def __str__(self) -> str:
        """Give the line that a user reads."""
        return f"{self.check}: {self.text}"


def check(path: Path, *, time_limit: float = TIME_LIMIT) -> list[Finding]:
    """Check an .fmu and list what is wrong; an empty list is a good FMU.

    Schema and rules by FMPy; a run with start values by FMPy; outputs that are no numbers; a
    step repeated from a serialized state; and the reference result, where the archive has
    ``documentation/reference.csv``. The run happens in a process of its own, so that an FMU
    that crashes or hangs is a finding. Raises FmuError if the file is no FMU at all.
    """
    from fmpy.validation import validate_fmu

    fmu = read_fmu(path)
    findings = [Finding("rules", " ".join(text.split())) for text in validate_fmu(str(path))]
    platform = host()
    if not {platform.fmi2, platform.fmi3} & set(fmu.binaries):
        there = ", ".join(fmu.binaries) or "none"
        findings.append(
            Finding("binary", f"none for {platform.fmi2}, so it was not run; there: {there}")
        )
        return findings
    return findings + _trial(path, time_limit)


def _trial(path: Path, time_limit: float) -> list[Finding]:
    command = [sys.executable, "-m", "uuvsim_cosim.fmus.trial_run", str(path)]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=time_limit, check=False
        )
    except subprocess.TimeoutExpired:
        return [Finding("run", f"did not end within {time_limit:g} s")]
    except OSError as error:
        raise FmuError(f"{path}: the trial run cannot be started ({error.strerror})") from error
    if done.returncode < 0:
        return [Finding("run", f"crashed with signal {-done.returncode}")]
    lines = done.stdout.splitlines()
    if done.returncode != 0 or not lines:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        return [Finding("run", f"ended with status {done.returncode}: {last}")]
    # The FMU may have printed as well; the findings are the last line.
    return [Finding(**entry) for entry in json.loads(lines[-1])]
