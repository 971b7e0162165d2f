"""A component that ends the process does not count as success, and is named."""

from __future__ import annotations

import csv
import json
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from uuvsim_cosim.errors import ComponentFailed
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.orchestrator.running.run import run
from uuvsim_cosim.orchestrator.system.system import System

EXIT, ABORT, SEGFAULT = 10, 3, 9
FUNCTION = {1: "fmiDoStep", 2: "fmi2DoStep", 3: "fmi3DoStep"}
MORE = [('max="6"', 'max="10"')]
CFmu = Callable[..., Path]


def fmu_of(c_fmu: CFmu, version: int) -> Path:
    return c_fmu(version, edits=MORE if version == 2 else [])


def uuvsim(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "uuvsim_cosim", *arguments],
        capture_output=True, text=True, check=False,
    )  # fmt: skip


def system_of(fmu: Path, fault: int, folder: Path) -> Path:
    system = System("s", "0.01").add("bad", str(fmu), start={"fault": fault, "fault_time": 0.5})
    system = system.add("good", str(fmu)).connect("bad.y", "good.u")
    system.write(folder / "s.ssd")
    return folder / "s.ssd"


@pytest.mark.parametrize("version", [2, 3])
def test_exit_0_in_a_single_fmu_is_a_failure_that_keeps_the_rows(
    c_fmu: CFmu, tmp_path: Path, version: int
) -> None:
    table = tmp_path / "out.csv"
    fault = ["--set", f"fault={EXIT}", "--set", "fault_time=0.5"]
    done = uuvsim(
        "run",
        str(fmu_of(c_fmu, version)),
        "--until",
        "1",
        "--step",
        "0.1",
        "-o",
        str(table),
        *fault,
    )
    assert done.returncode == 3
    assert f"component 'first_order' called exit() in fmi{version}DoStep" in done.stderr
    assert "the values up to that time are in" in done.stderr
    assert [row[0] for row in csv.reader(table.read_text().splitlines())][-1] == "0.5"


@pytest.mark.parametrize("version", [2, 3])
def test_exit_0_in_a_system_is_a_failure_that_keeps_the_recording(
    c_fmu: CFmu, tmp_path: Path, version: int
) -> None:
    file = system_of(fmu_of(c_fmu, version), EXIT, tmp_path)
    done = uuvsim("run", str(file), "--until", "1", "-o", str(tmp_path / "r"))
    assert done.returncode == 3
    assert f"component 'bad' called exit() in fmi{version}DoStep" in done.stderr
    assert "the recording up to t = 0.5 s is in" in done.stderr
    assert read_signals(tmp_path / "r").time[-1] == 0.5
    assert not (tmp_path / "r" / "signals.arrows").exists()
    told = json.loads((tmp_path / "r" / "run.json").read_text())
    assert (told["interrupted"], told["steps"]) == ("component 'bad' called exit()", 50)


@pytest.mark.parametrize(("fault", "number"), [(ABORT, signal.SIGABRT), (SEGFAULT, signal.SIGSEGV)])
@pytest.mark.parametrize("version", [1, 2, 3])
def test_a_crash_names_component_and_function_and_dies_as_before(
    c_fmu: CFmu, tmp_path: Path, version: int, fault: int, number: signal.Signals
) -> None:
    file = system_of(fmu_of(c_fmu, version), fault, tmp_path)
    done = uuvsim("run", str(file), "--until", "1", "-o", str(tmp_path / "r"))
    assert done.returncode == -number
    assert f"component 'bad' crashed in {FUNCTION[version]} ({number.name})" in done.stderr


def test_exit_0_in_an_isolated_component_is_told_by_its_name(c_fmu: CFmu, tmp_path: Path) -> None:
    from uuvsim_cosim.orchestrator.running.library import load

    system = load(system_of(fmu_of(c_fmu, 3), EXIT, tmp_path))
    with pytest.raises(ComponentFailed) as failed:
        run(system, until=1.0, out=tmp_path / "r", isolate=["bad"])
    reason = "its process died (status 3): component 'bad' called exit() in fmi3DoStep"
    assert failed.value.reason == reason
    assert read_signals(tmp_path / "r").time[-1] == 0.5


def test_exit_0_in_a_call_from_python_is_a_failure(c_fmu: CFmu, tmp_path: Path) -> None:
    file = system_of(fmu_of(c_fmu, 3), EXIT, tmp_path)
    calls = tmp_path / "calls.csv"
    done = uuvsim(
        "run", str(file), "--until", "1", "-o", str(tmp_path / "r"), "--trace-fmi", str(calls)
    )
    assert done.returncode == 3
    assert "component 'bad' called exit() in fmi3DoStep" in done.stderr
    assert read_signals(tmp_path / "r").time[-1] == 0.5


def test_an_exit_of_python_stays_what_it_is(c_fmu: CFmu) -> None:
    """Also while another thread is inside a component."""
    script = (
        "import sys, threading\n"
        "from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu\n"
        "from pathlib import Path\n"
        "c = instantiate_fmu(Path(sys.argv[1]), 'c')\n"
        "c.set(c.description.variables['fault'], 6)\n"
        "c.enter_initialization_mode(0.0, None)\n"
        "c.exit_initialization_mode()\n"
        "threading.Thread(target=c.do_step, args=(0.0, 0.1), daemon=True).start()\n"
        "sys.exit(7)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(fmu_of(c_fmu, 3))],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (7, "")


def test_a_crash_elsewhere_names_no_component(c_fmu: CFmu) -> None:
    script = (
        "import ctypes, sys\n"
        "from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu\n"
        "from pathlib import Path\n"
        "c = instantiate_fmu(Path(sys.argv[1]), 'c')\n"
        "ctypes.string_at(0)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(fmu_of(c_fmu, 3))],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == -signal.SIGSEGV
    assert "component" not in done.stderr
