"""Check of an .fmu: archive, description, a run, and the features that a master may use."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from uuvsim_cosim.errors import FmuError
from uuvsim_cosim.fmus.check.inspect_fmu import reliance
from uuvsim_cosim.fmus.check.trial_run import LOOKS
from uuvsim_cosim.fmus.codegen.toolchain import host
from uuvsim_cosim.fmus.importer.fmu_library import library_of
from uuvsim_cosim.fmus.importer.read_description import FmuArchive, read_fmu
from uuvsim_cosim.fmus.importer.safe_xml import read_xml
from uuvsim_cosim.fmus.sandbox.sandbox import only_web_assembly

__all__ = ["TIME_LIMIT", "Finding", "Look", "check", "examine", "relied_on"]

TIME_LIMIT = 120.0  # [s] for each process of the trial
Result = Literal["ok", "finding", "not applicable"]
# FMI's structured names, less those with quotes: FMPy reads the latter.
_PART = r"[_A-Za-z][_A-Za-z0-9]*(\[[0-9]+(,[0-9]+)*\])?"
_STRUCTURED = re.compile(rf"{_PART}(\.{_PART})*|der\({_PART}(\.{_PART})*(,[0-9]+)?\)")


@dataclass(frozen=True)
class Finding:
    """A finding about an FMU: the name of the check, and the problem."""

    check: str
    text: str

    def __str__(self) -> str:
        """Return the line for the user."""
        return f"{self.check}: {self.text}"


@dataclass(frozen=True)
class Look:
    """One look at an FMU: its result, and the finding, a summary, or why it was not made."""

    check: str
    result: Result
    text: str


def check(path: Path, *, time_limit: float = TIME_LIMIT) -> list[Finding]:
    """List the findings about an .fmu; a good FMU has none. See `examine`."""
    looks = examine(path, time_limit=time_limit)
    return [Finding(look.check, look.text) for look in looks if look.result == "finding"]


def examine(path: Path, *, time_limit: float = TIME_LIMIT) -> list[Look]:
    """Make all looks at an .fmu: rules, binary, run, determinism, reset, state, reference.

    FMPy checks schema and rules. The other looks run the FMU by this package's importer, in another
    process: if the FMU crashes or hangs, that is a finding of this look, and the others continue.
    Raises FmuError if the file is no FMU.
    """
    fmu = read_fmu(path)
    texts = [" ".join(text.split()) for text in _broken_rules(fmu)]
    looks = [Look("rules", "finding", text) for text in texts]
    looks = looks or [Look("rules", "ok", "schema and rules of the model description")]
    platform = host()
    here = sorted({platform.fmi2, platform.fmi3} & set(fmu.binaries))
    there = ", ".join(fmu.binaries) or "none"
    if not here and fmu.sources is not None:
        try:
            library_of(fmu)
        except FmuError as error:
            looks.append(Look("binary", "finding", str(error)))
            return looks + _skipped(list(LOOKS), "no binary for this machine")
        others = f"; there: {there}" if fmu.binaries else ""
        text = f"none for {platform.fmi2}: its sources were compiled{others}"
        looks.append(Look("binary", "ok", text))
        return looks + _trial(path, time_limit)
    if only_web_assembly(fmu):
        text = f"none for {platform.fmi2}: its WebAssembly was run; there: {there}"
        return [*looks, Look("binary", "ok", text), *_trial(path, time_limit)]
    if not here:
        text = f"none for {platform.fmi2}, so it was not run; there: {there}"
        looks.append(Look("binary", "finding", text))
        return looks + _skipped(list(LOOKS), "no binary for this machine")
    looks.append(Look("binary", "ok", there))
    return looks + _trial(path, time_limit)


def _broken_rules(fmu: FmuArchive) -> list[str]:
    """Return the problems that FMPy reports.

    FMPy needs 10 ms to check a structured name, so that simple ones are checked here instead.
    """
    from fmpy.model_description import ValidationError, read_model_description
    from fmpy.validation import validate_fmu

    root = read_xml(fmu.folder / "modelDescription.xml", place=str(fmu.path))
    names = [v.get("name", "") for v in root.iterfind("ModelVariables/*")]
    structured = root.get("variableNamingConvention") == "structured"
    with zipfile.ZipFile(fmu.path) as archive:
        slashes = any("\\" in member.orig_filename for member in archive.filelist)
    if slashes or not structured or not all(map(_STRUCTURED.fullmatch, names)):
        return list(validate_fmu(str(fmu.path)))
    try:
        read_model_description(str(fmu.path), validate=True, validate_model_structure=True)
    except ValidationError as error:
        return list(error.problems)
    except Exception as error:
        return [str(error)]
    return []


def relied_on(path: Path, looks: Sequence[Look]) -> dict[str, str]:
    """Return the features that a master may use: those declared, except those that failed."""
    fmu: FmuArchive = read_fmu(path)
    summary = reliance(fmu)
    failed = {look.check for look in looks if look.result == "finding"}
    passed = {look.check for look in looks if look.result == "ok"}
    if "run" in failed:
        summary["run"] = "no: see the findings"
    if "state" in failed and fmu.description.can_get_and_set_state:
        for topic in ("reset", "snapshot", "iterated groups"):
            summary[topic] = "not as declared: its state was not restored, see the findings"
    summary["FMI's own reset"] = _word("reset", passed, failed)
    summary["same bits each time"] = _word("determinism", passed, failed)
    return summary


def _word(check: str, passed: set[str], failed: set[str]) -> str:
    return "yes, tried" if check in passed else "no, tried" if check in failed else "not tried"


def _trial(path: Path, time_limit: float) -> list[Look]:
    """Make the looks that run the FMU; after a crash, a new process makes the remaining ones."""
    looks: list[Look] = []
    pending = list(LOOKS)
    with tempfile.TemporaryDirectory() as folder:
        while pending:
            done = _process(path, Path(folder) / f"{len(pending)}.jsonl", pending, time_limit)
            looks += done
            over = {look.check for look in done}
            if "run" in over and not over - {"run"} and len(pending) == len(LOOKS):
                return looks + _skipped(pending[1:], "it did not run")
            pending = [name for name in pending if name not in over]
    return looks


def _process(path: Path, file: Path, looks: Sequence[str], time_limit: float) -> list[Look]:
    """Make looks in one process until all are made or it ends; return at least one result."""
    command = [
        sys.executable,
        "-m",
        "uuvsim_cosim.fmus.check.trial_run",
        str(path),
        str(file),
        *looks,
    ]
    ended = "ended without a result"
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, errors="replace", timeout=time_limit,
            check=False,
        )  # fmt: skip
        if done.returncode < 0:
            ended = f"crashed with signal {-done.returncode}"
        elif done.returncode:
            last = (done.stderr.strip().splitlines() or ["no message"])[-1]
            ended = f"ended with status {done.returncode}: {last}"
    except subprocess.TimeoutExpired:
        ended = f"did not end within {time_limit:g} s"
    except OSError as error:
        raise FmuError(f"{path}: the trial run cannot be started ({error.strerror})") from error
    lines = file.read_text(encoding="utf-8").splitlines() if file.is_file() else []
    entries = [json.loads(line) for line in lines if line.endswith("}")]
    made = [Look(**e) for e in entries if e["result"] != "begun"]
    begun = [e["check"] for e in entries if e["result"] == "begun"] or [looks[0]]
    if begun[-1] not in {look.check for look in made}:
        made.append(Look(begun[-1], "finding", ended))
    return made


def _skipped(names: Sequence[str], why: str) -> list[Look]:
    return [Look(name, "not applicable", why) for name in names]
