"""`--json` and `--quiet`, on every command of the tree."""

import ctypes
import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.conftest import Uuvsim
from uuvsim_cosim.cli import command_tree
from uuvsim_cosim.commands.shared.answer import answer, answering, error_fields
from uuvsim_cosim.commands.shared.common_options import EXAMPLES, walk
from uuvsim_cosim.commands.shared.terminal import line, number, remark, table
from uuvsim_cosim.errors import Problem, SystemInvalid
from uuvsim_cosim.orchestrator.ssp.ssd import write_ssd
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.strict_json import strict

PARTS = '''
class Tap:
    """Opens at once."""
    inputs = {"valve": "m/s"}
    outputs = {"flow": "m/s"}
    parameters = {"opening": (2.0, "m/s"), "bursts": (1e9, "s"), "stops": (1e9, "s")}
    def step(self, t, dt, u):
        if t >= self.stops:
            raise KeyboardInterrupt
        return {"flow": float("nan") if t >= self.bursts else self.opening + u["valve"]}

class Tank:
    """Fills."""
    inputs = {"flow": "m/s"}
    outputs = {"level": "m"}
    level = 0.0
    def step(self, t, dt, u):
        self.level += dt * u["flow"]
        return {"level": self.level}

class Other:
    """Fits nowhere."""
    inputs = {"stream": "m/s"}
    outputs = {"height": "m"}
    def step(self, t, dt, u):
        return {"height": u["stream"]}
'''
STUDY = """
system: tank.ssd
duration: 0.5
seeds: 2
metrics: {level: max(tank.level)}
"""
ACCESS = "anyone: observer\n"
PATHS = [path for path, _ in walk(command_tree())]
LEAVES = [path for path, each in walk(command_tree()) if not getattr(each, "commands", {})]


@pytest.fixture
def tank(tmp_path: Path) -> str:
    (tmp_path / "parts.py").write_text(PARTS)
    system = (
        System("tank", "0.1", base=tmp_path)
        .add("tap", "parts.py:Tap")
        .add("tank", "parts.py:Tank")
        .connect("tap.flow", "tank.flow")
    )
    write_ssd(system, tmp_path / "tank.ssd")
    return "tank.ssd"


@pytest.fixture
def ran(uuvsim: Uuvsim, tank: str) -> str:
    assert uuvsim("run", tank, "--until", "0.5", "--out", "r", "--no-report")[0] == 0
    return "r"


def refuse(constant: str) -> Any:
    raise AssertionError(f"{constant} is not JSON")


def one_object(text: str) -> dict[str, Any]:
    """Read exactly one object, without NaN."""
    found = json.loads(text, parse_constant=refuse)
    assert isinstance(found, dict)
    return found


# ---- every command ----------------------------------------------------------------------------


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path or "uuvsim")
def test_every_command_offers_json_and_quiet_and_shows_an_example(
    uuvsim: Uuvsim, path: str
) -> None:
    status, out, _ = uuvsim(*path.split(), "--help")
    assert status == 0
    assert "--json" in out
    assert "--quiet" in out
    assert "Examples:" in out


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path or "uuvsim")
def test_every_command_refuses_in_json_with_the_same_status(uuvsim: Uuvsim, path: str) -> None:
    plain = uuvsim(*path.split(), "--bogus")
    status, out, err = uuvsim(*path.split(), "--bogus", "--json")
    assert (status, err) == (plain[0], plain[2])
    found = one_object(out)
    assert found["status"] == status == 2
    assert found["command"] == f"uuvsim {path}".strip()
    assert "--bogus" in found["error"]["message"]
    assert set(found["error"]) >= {"place", "value", "expected", "type"}


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path or "uuvsim")
def test_every_example_can_be_parsed(path: str) -> None:
    tree = command_tree()
    assert EXAMPLES[path], path
    for example in EXAMPLES[path]:
        import shlex

        words = shlex.split(example)
        command, context = tree, None
        while getattr(command, "commands", {}) and words and words[0] in command.commands:
            command = command.commands[words.pop(0)]
        context = command.make_context(example, words)
        assert context is not None


QUICK = {
    "run": "run TANK --until 0.5 --out again --no-report",
    "serve": "serve TANK --until 0.3 --port 0 --tcp-port 0 --http-port 0 --no-record",
    "report": "report RUN",
    "export": "export RUN -o x.csv",
    "compare": "compare RUN RUN",
    "verify": "verify TANK --steps 3",
    "systems missions": "systems missions bluerov2 --until 1",
    "systems new": "systems new my_rov --vehicle bluerov2",
    "systems show": "systems show TANK",
    "systems slot": "systems slot TANK tank",
    "models show": "models show battery",
    "models check": "models check --source closed_form",
    "models picture": "models picture remus100 -o x.svg",
    "models mesh": "models mesh sphere -o x.glb",
    "models speeds": "models speeds tethys_lrauv",
    "models new": "models new my_rov",
    "cite": "cite bluerov2_hold",
    "analyse": "analyse bluerov2_hold --break controller.tau_d[3] --at 1",
    "lint": "lint study.yaml",
    "envs": "envs",
    "fmu inspect": "fmu inspect FMU",
    "fmu compare": "fmu compare FMU FMU",
    "fmu conformance": "fmu conformance conforming --until 0.2",
    "new": "new tank --for TANK",
    "study": "study study.yaml",
    "access password": "access password",
    "access certificates": "access certificates pki",
    "access check": "access check access.yaml",
    "matlab": "matlab",
    "doctor": "doctor",
}
# Each needs minutes, a network or a recording of its own; a refusal of theirs is tested.
LONG = {
    "view": "view nowhere",
    "film": "film nowhere -o x.webp",
    "map": "map nowhere",
    "terrain": "terrain none.000",
    "identify": "identify none.csv --system model:bluerov2 --parameters D_q_11",
    "train": "train no_such_task",
    "train-offline": "train-offline none.npz",
    "collect": "collect no_such_task -o x.npz",
    "evaluate": "evaluate none.npz",
    "play": "play no_such_task",
    "export-policy": "export-policy none.npz -o x.fmu",
    "reproduce": "reproduce fig0",
    "models import": "models import none.stl",
    "access token": "access token --port 1",
    "fmu build": "fmu build nosuch",
    "fmu check": "fmu check FMU",
    "pack": "pack nosuch -o x.ssp",
    "fmu system": "fmu system nosuch",
    "fmu client": "fmu client nosuch",
    "fmu container": "fmu container nosuch",
}


def test_every_command_is_called() -> None:
    assert set(QUICK) | set(LONG) == set(LEAVES)
    assert not set(QUICK) & set(LONG)


@pytest.mark.parametrize("path", sorted({**QUICK, **LONG}))
def test_every_command_answers_with_one_object_and_is_silent_when_quiet(
    uuvsim: Uuvsim, ran: str, tank: str, first_order_fmi3: Path, path: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    import io

    Path("study.yaml").write_text(STUDY)
    Path("access.yaml").write_text(ACCESS)
    Path("conforming").mkdir()
    Path("conforming/x.fmu").write_bytes(first_order_fmi3.read_bytes())
    text = {**QUICK, **LONG}[path]
    for old, new in (("TANK", tank), ("RUN", ran), ("FMU", str(first_order_fmi3))):
        text = text.replace(old, new)
    words = text.split()
    monkeypatch.setattr("sys.stdin", io.StringIO("a password\n"))
    status, out, err = uuvsim(*words, "--json")
    found = one_object(out)
    assert status == (2 if path in LONG else 0), err
    # `serve` answers as soon as clients can connect.
    assert found["status"] == (None if path == "serve" else status)
    assert ("error" in found) == (status != 0)
    if status == 0:
        assert set(found) > {"command", "status"}, "nothing was reported"
        for made in ("my_rov", "my_rov.ssd", "pki", "my_tank.py"):
            if Path(made).exists():
                Path(made).rename(f"{made}-1")
    else:
        assert err.startswith("uuvsim: ")
    monkeypatch.setattr("sys.stdin", io.StringIO("a password\n"))
    status, out, err = uuvsim(*words, "--quiet")
    assert status == (2 if path in LONG else 0), err
    assert out == ""
    assert bool(err) == bool(status)


# ---- what the object holds ----------------------------------------------------------------------


def test_the_figures_of_a_run_are_in_run_json_and_in_the_answer(uuvsim: Uuvsim, tank: str) -> None:
    out = uuvsim("run", tank, "--until", "0.5", "--out", "r", "--json")[1]
    answered = one_object(out)
    kept = one_object(Path("r/run.json").read_text())["metrics"]
    assert answered["metrics"] == kept
    assert kept["simulated"] == {
        "value": 0.5, "unit": "s", "label": "simulated", "note": "5 steps of 0.1 s",
    }  # fmt: skip
    assert {Path(w["file"]).name for w in answered["written"]} >= {"run.json", "report.html"}
    assert all(w["bytes"] == Path(w["file"]).stat().st_size for w in answered["written"])


def test_a_single_fmu_reports_rows_and_times(uuvsim: Uuvsim, first_order_fmi3: Path) -> None:
    out = uuvsim("run", str(first_order_fmi3), "--until", "1", "-o", "out.csv", "--json")[1]
    found = one_object(out)
    rows = Path("out.csv").read_text().splitlines()
    assert found["rows"] == len(rows) - 1
    assert (found["begin"], found["end"], found["asked_to_end"]) == (0.0, 1.0, False)
    assert Path(found["written"][0]["file"]).name == "out.csv"


def test_a_second_run_into_the_same_folder_reports_both_folders(uuvsim: Uuvsim, ran: str) -> None:
    out = uuvsim("run", "tank.ssd", "--until", "0.5", "--out", ran, "--json", "--no-report")[1]
    found = one_object(out)
    assert Path(found["asked"]).name == "r"
    assert Path(found["folder"]).name == "r-2"


def test_a_refusal_names_place_value_and_what_was_expected(uuvsim: Uuvsim, tank: str) -> None:
    found = one_object(uuvsim("run", tank, "--until", "-2", "--json")[1])
    assert found["error"]["place"] == "--until"
    assert found["error"]["value"] == "-2"
    assert found["error"]["expected"] == "more than 0 seconds"


def test_a_system_that_does_not_fit_names_the_place(uuvsim: Uuvsim, tank: str) -> None:
    found = one_object(uuvsim("run", tank, "--replace", "tank=parts.py:Other", "--json")[1])
    (problem,) = found["error"]["problems"]
    assert problem["place"] == "tank.flow"
    assert "stream" in problem["value"]
    assert problem["expected"].startswith("an input in m/s")


def test_every_problem_of_a_system_is_listed() -> None:
    two = SystemInvalid([Problem("a.x", "missing", "an input"), Problem("b.y", "in m", "s")])
    assert error_fields(two, str(two), 2)["problems"] == [
        {"place": "a.x", "value": "missing", "expected": "an input"},
        {"place": "b.y", "value": "in m", "expected": "s"},
    ]


def test_a_failed_component_is_named_with_its_time(uuvsim: Uuvsim, tank: str) -> None:
    status, out, _ = uuvsim("run", tank, "--set", "tap.bursts=0.3", "--until", "1", "--json")
    error = one_object(out)["error"]
    assert status == 3
    assert (error["component"], error["type"]) == ("tap", "ComponentFailed")
    assert error["time"] == pytest.approx(0.4)  # where the step that burst ends


def test_an_interrupted_run_answers_with_status_130_and_its_figures(
    uuvsim: Uuvsim, tank: str
) -> None:
    status, out, _ = uuvsim("run", tank, "--set", "tap.stops=0.3", "--until", "1", "--json")
    found = one_object(out)
    assert status == found["status"] == 130
    assert found["interrupted"].startswith("interrupted at t = 0.3")
    assert found["error"]["type"] == "KeyboardInterrupt"
    assert found["metrics"]["simulated"]["value"] == pytest.approx(0.3)
    assert "metrics" in one_object((Path(found["folder"]) / "run.json").read_text())


def test_what_is_no_number_becomes_null_and_is_listed() -> None:
    given = {"a": [1.0, math.nan, {"b": -math.inf}], "n": np.array([1, 2]), "p": Path("x")}
    found, replaced = strict(given)
    assert found == {"a": [1.0, None, {"b": None}], "n": [1, 2], "p": "x"}
    assert replaced == {"a[1]": "nan", "a[2].b": "-inf"}
    assert strict(np.float64("inf")) == (None, {"": "inf"})
    assert strict(2**64 - 1)[0] == 2**64 - 1


def test_values_of_tables_are_numbers(capsys: pytest.CaptureFixture[str]) -> None:
    with answering("json"):
        table(("what it is", "value"), [("x", number(1 / 3, ".2f"))], key="found")
        table(("", ""), [("the name", number(math.nan, "g"))], key="facts")
        remark("warning", "careful")
        line("said")
        print("from elsewhere")
    said = capsys.readouterr()
    assert json.loads(said.out) == {
        "found": [{"what_it_is": "x", "value": 1 / 3}],
        "facts": {"the_name": None},
        "warnings": ["careful"],
        "text": ["said"],
        "not_finite": {"facts.the_name": "nan"},
    }
    assert said.err == "from elsewhere\n"
    assert answer().mode == "text"


def test_a_warning_is_written_in_a_quiet_command(capsys: pytest.CaptureFixture[str]) -> None:
    with answering("quiet"):
        line("said")
        remark("note", "by the way")
        remark("warning", "careful")
    said = capsys.readouterr()
    assert (said.out, said.err) == ("", "uuvsim: warning: careful\n")


def test_what_compiled_code_prints_does_not_reach_stdout(tmp_path: Path) -> None:
    program = (
        "import ctypes, os, sys; from uuvsim_cosim.commands.shared.answer import answering\n"
        "with answering('json') as found:\n"
        "    found.put('x', 1); print('python'); os.system('echo child')\n"
        "    c = ctypes.CDLL(None); c.puts(b'compiled')  # into a buffer\n"
        "print('after')\n"
    )
    assert ctypes.CDLL(None)
    buffered = {k: v for k, v in os.environ.items() if k != "PYTHONUNBUFFERED"}
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, env=buffered
    )
    document, _, rest = done.stdout.rpartition("}\n")
    assert json.loads(document + "}") == {"x": 1}
    assert rest == "after\n"
    assert {"python", "child", "compiled"} <= set(done.stderr.split())


# ---- completion ---------------------------------------------------------------------


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_completion_script_is_shown(shell: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "uuvsim_cosim", "--show-completion", shell],
        capture_output=True, text=True, check=False,
        env={**os.environ, "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "_UUVSIM_COMPLETE" in done.stdout


def test_commands_and_options_are_completed() -> None:
    def completed(words: str, number: int) -> str:
        variables = {
            "_UUVSIM_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(number),
        }  # fmt: skip
        return subprocess.run(
            [sys.executable, "-m", "uuvsim_cosim"], capture_output=True, text=True, check=False,
            env={**os.environ, **variables},
        ).stdout  # fmt: skip

    assert "compare" in completed("uuvsim\ncomp", 1).split()
    assert {"--json", "--quiet"} <= set(completed("uuvsim\nrun\n--", 2).split())
