"""Conformance with FMI, SSP and OSP: every FMU and every system in a folder is run and judged.

Each runs in a process of its own (`conformance_run`), so that a crash or a hang of one is its own
result.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Literal, get_args

from uuvsim_cosim._version import __version__
from uuvsim_cosim.errors import InputInvalid, UuvsimError
from uuvsim_cosim.fmus.importer.archive import unpack
from uuvsim_cosim.fmus.importer.safe_xml import read_xml

__all__ = ["TIME_LIMIT", "Judged", "Result", "Subject", "conformance", "markdown", "subjects"]

TIME_LIMIT = 120.0  # [s] for each process
UNTIL = 10.0  # [s] simulated at most
Result = Literal["equal", "runs", "deviates", "refused", "failed"]
INTERFACES = ("CoSimulation", "ModelExchange", "ScheduledExecution")
_WORDS = {
    "CoSimulation": "Co-Simulation", "ModelExchange": "Model Exchange",
    "ScheduledExecution": "Scheduled Execution",
}  # fmt: skip
_LONGEST = 200  # characters of a detail in the table
_OSP = "OspSystemStructure.xml"


@dataclass(frozen=True)
class Subject:
    """One FMU by one of its interfaces, or one system; `interface` is empty for a system."""

    path: Path
    kind: str  # such as "FMI 2.0 Co-Simulation", "SSP", "OSP"
    interface: str = ""


@dataclass(frozen=True)
class Judged:
    """The result of a subject: compared with a reference, only run, or refused with a reason."""

    subject: Subject
    result: Result
    text: str


def subjects(folder: Path) -> Iterator[Subject]:
    """List the FMUs, .ssp and .ssd files, and systems of OSP below a folder, in order of names."""
    for path in sorted(folder.rglob("*")):
        suffix = path.suffix.lower()
        if suffix == ".fmu" and path.is_file():
            yield from _of_fmu(path)
        elif suffix in (".ssp", ".ssd"):
            yield Subject(path, f"SSP ({suffix})")
        elif path.name == _OSP:
            yield Subject(path, "OSP")


def _of_fmu(path: Path) -> Iterator[Subject]:
    try:
        root = read_xml(unpack(path) / "modelDescription.xml", place=str(path))
    except UuvsimError:
        yield Subject(path, "FMU")  # the run reports why it cannot be read
        return
    fmi = f"FMI {root.get('fmiVersion', '?')[:3]}"
    if fmi == "FMI 1.0":  # one interface each, which its Implementation tells
        interface = INTERFACES[root.find("Implementation") is None]
        yield Subject(path, f"{fmi} {_WORDS[interface]}", interface)
        return
    there = [i for i in INTERFACES if root.find(i) is not None]
    for interface in there or [""]:
        yield Subject(path, f"{fmi} {_WORDS.get(interface, '')}".strip(), interface)


def conformance(
    folder: Path,
    *,
    until: float = UNTIL,
    time_limit: float = TIME_LIMIT,
    libcosim: str = "",
    report: Callable[[Judged], None] = lambda judged: None,
) -> list[Judged]:
    """Run all subjects below a `folder`, each for at most `until` s; report each result at once.

    `libcosim` is an interpreter that has libcosimpy; systems are then compared with libcosim.
    Raises InputInvalid if there is none.
    """
    if not folder.is_dir():
        raise InputInvalid(folder, "no such folder", "a folder with FMUs and systems")
    every = list(subjects(folder))
    if not every:
        raise InputInvalid(folder, "nothing to run", f".fmu, .ssp, .ssd or {_OSP} in it")
    found = []
    for subject in every:
        result, text = _run(subject, until, time_limit, libcosim)
        text = text.replace(f"{folder.absolute()}/", "")
        found.append(Judged(subject, result, " ".join(text.split())))
        report(found[-1])
    return found


def _run(subject: Subject, until: float, time_limit: float, libcosim: str) -> tuple[Result, str]:
    """Run one subject in a process of its own."""
    with tempfile.TemporaryDirectory() as scratch:
        file = Path(scratch) / "judged.json"
        module = "uuvsim_cosim.orchestrator.running.conformance_run"
        path = str(subject.path.absolute())
        command = [
            sys.executable, "-m", module, path, subject.interface, str(until), libcosim, str(file),
        ]  # fmt: skip
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, errors="replace", timeout=time_limit,
                check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return "failed", f"did not end within {time_limit:g} s"
        if file.is_file():
            result, text = json.loads(file.read_text(encoding="utf-8"))
            return result, text
    if done.returncode < 0:
        return "failed", f"crashed with signal {-done.returncode}"
    last = (done.stderr.strip().splitlines() or ["no message"])[-1]
    return "failed", f"ended with status {done.returncode}: {last}"


def markdown(folder: Path, judged: Sequence[Judged]) -> str:
    """Return the table of results, and how many there are of each, as Markdown."""
    lines = ["| what | by | result | detail |", "|---|---|---|---|"]
    for each in judged:
        name = each.subject.path.relative_to(folder).as_posix()
        text = each.text.replace("|", "\\|")
        text = text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"
        lines.append(f"| `{name}` | {each.subject.kind} | {each.result} | {text} |")
    counts = Counter(each.result for each in judged)
    listed = ", ".join(f"{counts[r]} {r}" for r in get_args(Result) if counts[r])
    head = f"uuvsim-cosim {__version__}, FMPy {version('fmpy')}: {listed}."
    return "\n".join([head, "", *lines, ""])
