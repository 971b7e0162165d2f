import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import Uuvsim
from uuvsim_cosim.orchestrator.running.library import load
from uuvsim_cosim.orchestrator.ssp.ssd import write_ssd
from uuvsim_cosim.orchestrator.system.system import System

PARTS = '''
class Tap:
    """Opens at once."""
    inputs = {}
    outputs = {"flow": "m/s"}
    parameters = {"opening": (2.0, "m/s"), "bursts": (1e9, "s")}
    def step(self, t, dt, u):
        return {"flow": float("nan") if t >= self.bursts else self.opening}

class Tank:
    """Fills."""
    inputs = {"flow": "m/s"}
    outputs = {"level": "m"}
    parameters = {"area": (1.0, "m2")}
    level = 0.0
    def step(self, t, dt, u):
        self.level += dt * u["flow"] / self.area
        return {"level": self.level}

class Other:
    """Fits only half."""
    inputs = {"stream": "m/s"}
    outputs = {"level": "m"}
    def step(self, t, dt, u):
        return {"level": u["stream"]}
'''


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
def loop(tmp_path: Path) -> str:
    """A sum that feeds itself: u = 1 - 6 y, y = u."""
    system = System("loop", "0.1").add("a", "function:sum?inputs=1")
    write_ssd(system.connect("a.y", "a.u", factor=-6.0, offset=1.0), tmp_path / "loop.ssd")
    return "loop.ssd"


# ---- what works -----------------------------------------------------------------------------


def test_help_imports_nothing_heavy() -> None:
    program = (
        "import sys; from uuvsim_cosim.cli import status_of; s = status_of(['--help']); "
        "heavy = {'casadi', 'pyarrow', 'scipy', 'fmpy', 'numpy'} & set(sys.modules); "
        "sys.exit(s or (f'imports {heavy}' if heavy else 0))"
    )
    arguments = [sys.executable, "-c", program]
    done = subprocess.run(arguments, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for command in ("run", "export", "systems", "models", "fmu", "pack", "new", "doctor"):
        assert command in done.stdout


def test_every_command_has_help(uuvsim: Uuvsim) -> None:
    for words in ("run", "export", "report", "systems show", "systems slot", "models show",
                  "models check", "fmu build", "fmu inspect", "fmu check", "pack", "new",
                  "doctor"):  # fmt: skip
        status, out, _ = uuvsim(*words.split(), "--help")
        assert status == 0
        assert "Usage" in out


def test_the_version_is_said(uuvsim: Uuvsim) -> None:
    from uuvsim_cosim import __version__

    assert uuvsim("--version")[:2] == (0, f"uuvsim-cosim {__version__}\n")


def test_a_run_ends_with_a_table_of_what_was_written(uuvsim: Uuvsim, tank: str) -> None:
    status, out, err = uuvsim("run", tank, "--until", "2", "--out", "r", "--seed", "7")
    assert (status, err) == (0, "")
    for said in ("tank, seed 7", "real-time factor", "r/signals.parquet", "r/report.html"):
        assert said in out
    assert Path("r/report.html").stat().st_size < 2e6


def test_set_rate_and_record_every_reach_the_run(uuvsim: Uuvsim, tank: str) -> None:
    from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals

    options = ("--set", "tap.opening=3", "--rate", "tank=0.2", "--record-every", "2")
    status, _, err = uuvsim("run", tank, "--until", "2", "--out", "r", "--no-report", *options)
    assert (status, err) == (0, "")
    signals = read_signals("r")
    assert len(signals.time) == 11
    assert signals["tank.level"][-1] == pytest.approx(3 * (2.0 - 0.2))


def test_a_second_run_says_that_it_went_beside(uuvsim: Uuvsim, tank: str) -> None:
    uuvsim("run", tank, "--until", "1", "--no-report")
    _, out, _ = uuvsim("run", tank, "--until", "1", "--no-report")
    assert "was written beside" in out
    assert Path("runs/tank-0-2/signals.parquet").is_file()


def test_a_mapped_replacement_takes_the_slot(uuvsim: Uuvsim, tank: str) -> None:
    swap = ("--replace", "tank=parts.py:Other", "--map", "tank.flow=stream")
    status, out, err = uuvsim("run", tank, "--until", "1", "--out", "r", *swap)
    assert (status, err) == (0, ""), out


@pytest.mark.parametrize("ending", ["csv", "mat", "mcap"])
def test_a_recording_is_exported(uuvsim: Uuvsim, tank: str, ending: str) -> None:
    uuvsim("run", tank, "--until", "1", "--out", "r", "--no-report")
    status, _, err = uuvsim("export", "r", "-o", f"x.{ending}")
    assert (status, err) == (0, "")
    assert Path(f"x.{ending}").stat().st_size > 0


def test_a_single_fmu_is_simulated_into_a_csv(uuvsim: Uuvsim, first_order_fmi3: Path) -> None:
    status, _, err = uuvsim("run", str(first_order_fmi3), "--until", "1", "-o", "out.csv")
    assert (status, err) == (0, "")
    assert Path("out.csv").read_text().startswith("time,")


def test_a_slot_is_printed_and_a_diagram_drawn(uuvsim: Uuvsim, tank: str) -> None:
    status, out, _ = uuvsim("systems", "slot", tank, "tank")
    assert status == 0
    assert "from tap.flow" in out
    status, out, err = uuvsim("systems", "show", tank, "-o", "d.svg")
    assert (status, err) == (0, "")
    assert Path("d.svg").read_text().startswith("<")


# ---- what is refused --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("run nosuch", "there is no system 'nosuch'"),
        ("run bluerov2_surve", "did you mean bluerov2_survey"),
        ("run TANK --set speed", "expected component.parameter=value"),
        ("run TANK --set speed=3", "expected component.parameter=value"),
        ("run TANK --set tap.opening=", "expected component.parameter=value"),
        ("run TANK --set tap.opning=3", "opening"),
        ("run TANK --set tap.opening=wide", "'wide'"),
        ("run TANK --set tap.opening=1 --set tap.opening=2", "twice"),
        ("run TANK --until -2", "--until -2"),
        ("run TANK --until 0", "more than 0"),
        ("run TANK --until nan", "more than 0"),
        ("run TANK --record-every 0", "1 or more"),
        ("run TANK --rate tank=0.15", "0.15"),
        ("run TANK --rate tnk=0.2", "no such component"),
        ("run TANK --replace tank", "component=source"),
        ("run TANK --replace tank=none.fmu", "none.fmu"),
        ("run TANK --replace tank=parts.py:Other", "flow"),
        ("run TANK --replace tnk=parts.py:Other", "tnk"),
        ("run TANK --map tank.flow=stream", "--replace tank=SOURCE"),
        ("run TANK --waypoints bad.csv", "bad.csv:2: "),
        ("run TANK --waypoints none.csv", "no such file"),
        ("run TANK --input x.csv", "x.csv: cannot be read"),
        ("run TANK --input tank.flow", "[+]component.variable:step"),
        ("run TANK --input tank.flow:step,value=1", "expected +tank.flow"),
        ("run TANK --input tank.level:step,value=1", "expected +tank.level"),
        ("run TANK --input +tank.lvl:step,value=1", "lvl"),
        ("run TANK --input +tank.flow:ramp,value=1", "step, chirp, prbs"),
        ("run TANK --input +tank.flow:step", "without value"),
        ("run TANK --step 0.1", "--rate component=step"),
        ("run TANK --until ten", "'1.5 min'"),
        ("run TANK --until 3m", "is in m"),
        ("run TANK --rate tank=2weeks", "weeks"),
        ("run TANK --seed ten", "--seed ten: expected a whole number"),
        ("compare TANK TANK --tol -1", "0 or more"),
        ("compare nowhere nowhere", "no recording"),
        ("run TANK --out parts.py", "is a file"),
        ("run TANK --out /proc/nowhere/r", "cannot be made"),
        ("run TANK --bogus", "No such option"),
        ("run TANK --until soon", "--until"),
        ("run", "Missing argument"),
        ("run none.fmu", "no such file"),
        ("run broken.fmu", "broken.fmu"),
        ("run broken.ssp", "broken.ssp"),
        ("run broken.ssd", "broken.ssd"),
        ("runn TANK", "No such command"),
        ("export nowhere -o x.csv", "no recording"),
        ("export nowhere -o x.xls", ".csv, .mat, .mcap"),
        ("report nowhere", "no recording"),
        ("models show nosuch", "no model 'nosuch'"),
        ("models check bluerov2_heavy --reference none.csv", "no such file"),
        ("fmu build nosuch", "no model 'nosuch'"),
        ("fmu build battery --fmi 4", "expected 2 or 3"),
        ("fmu build battery --platform amiga", "unknown platform 'amiga'"),
        ("fmu inspect none.fmu", "none.fmu"),
        ("fmu check broken.fmu", "broken.fmu"),
        ("pack TANK -o x.zip", ".ssp"),
        ("new tank --for TANK --as rust", "python, pythonfmu3, c"),
        ("new tnk --for TANK", "tnk"),
        ("systems slot TANK tnk", "tnk"),
        ("systems show TANK -o x.png", ".svg"),
    ],
)
def test_a_wrong_input_is_one_sentence_with_status_2_and_leaves_nothing(
    uuvsim: Uuvsim, tank: str, arguments: str, said: str
) -> None:
    Path("bad.csv").write_text("0,0,5\n1,oops,5\n")
    for name in ("broken.fmu", "broken.ssp", "broken.ssd"):
        Path(name).write_text("this is no archive and no XML")
    before = set(os.listdir())
    status, _, err = uuvsim(*arguments.replace("TANK", tank).split())
    assert status == 2
    assert said in err
    assert err.startswith("uuvsim: ")
    assert "Traceback" not in err
    assert {name for name in os.listdir() if name != "__pycache__"} <= before


def test_a_failed_component_is_status_3_and_keeps_the_recording(uuvsim: Uuvsim, tank: str) -> None:
    status, _, err = uuvsim("run", tank, "--set", "tap.bursts=1", "--until", "3", "--out", "r")
    assert status == 3
    assert "'tap' failed at t = " in err
    assert "recording up to that time is in r" in err
    assert Path("r/signals.parquet").is_file()


def test_an_interrupted_run_is_status_130_with_a_closed_recording(
    uuvsim: Uuvsim, tank: str
) -> None:
    text = PARTS.replace("        self.level +=", "        if t > 1: raise KeyboardInterrupt\n"
                         "        self.level +=")  # fmt: skip
    Path("parts.py").write_text(text)
    status, out, err = uuvsim("run", tank, "--until", "3", "--out", "r")
    assert status == 130
    assert "interrupted at t = 1" in err
    assert "r/signals.parquet" in out


LISTED = "uuvsim_cosim.commands.shared.listings.listed_systems"  # what `uuvsim systems` calls


def test_what_cannot_go_on_says_that_it_was_interrupted(
    uuvsim: Uuvsim, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(_: str) -> list[str]:
        raise KeyboardInterrupt

    monkeypatch.setattr(LISTED, interrupted)
    assert uuvsim("systems") == (130, "", "uuvsim: interrupted\n")


def test_an_unexpected_error_asks_to_be_reported(
    uuvsim: Uuvsim, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(LISTED, None)
    status, _, err = uuvsim("systems")
    assert status == 1
    assert "please report it" in err
    assert "Traceback" not in err
    monkeypatch.setenv("UUVSIM_DEBUG", "1")
    assert "Traceback" in uuvsim("systems")[2]


def test_an_error_in_code_that_is_not_ours_is_told_with_its_line(
    uuvsim: Uuvsim, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(_: str) -> list[str]:
        raise RuntimeError("cause")

    monkeypatch.setattr(LISTED, broken)
    status, _, err = uuvsim("systems")
    assert (status, err) == (
        2,
        f"uuvsim: {__file__}:{broken.__code__.co_firstlineno + 1}: RuntimeError: cause\n",
    )


# ---- starting points ----------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["python", "pythonfmu3", "c"])
def test_a_starting_point_flies_the_survey_as_it_is_written(uuvsim: Uuvsim, kind: str) -> None:
    status, _, err = uuvsim("new", "controller", "--as", kind)
    assert (status, err) == (0, "")
    source = "my_controller.py:MyController"
    if kind == "pythonfmu3":
        command = [sys.executable, "-m", "pythonfmu3", "build", "-f", "my_controller_fmu.py"]
        subprocess.run(command, check=True, capture_output=True)
        source = "MyController.fmu"
    elif kind == "c":
        subprocess.run([sys.executable, "my_controller/build.py"], check=True, capture_output=True)
        source = "my_controller/my_controller.fmu"
    swap = ("--replace", f"controller={source}", "--until", "25", "--no-report", "--out", "r")
    status, out, err = uuvsim("run", "bluerov2_survey", *swap)
    assert (status, err) == (0, ""), out
    from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals

    eta = read_signals("r")["hull.eta"][-1]
    assert abs(eta[1]) < 0.5  # on the first leg, which leads north at 5 m
    assert abs(eta[2] - 5.0) < 0.5
    assert eta[0] > 1.0


def test_a_starting_point_is_never_written_over(uuvsim: Uuvsim) -> None:
    assert uuvsim("new", "controller")[0] == 0
    status, _, err = uuvsim("new", "controller")
    assert status == 2
    assert "exist already" in err


def test_the_shipped_systems_are_listed(uuvsim: Uuvsim) -> None:
    _, out, _ = uuvsim("systems")
    assert "bluerov2_survey" in out
    assert load("bluerov2_survey").name == "bluerov2_survey"


# ---- algebraic loops --------------------------------------------------------------------------


def test_run_iterates_an_algebraic_loop(uuvsim: Uuvsim, loop: str) -> None:
    status, out, _ = uuvsim("run", loop, "--until", "1", "--native", "--no-report", "-o", "r")
    assert status == 0
    assert "iterated loop: a.y -> a.u" in out
    assert "coupling residual" not in out


def test_run_reports_what_a_delayed_loop_becomes(uuvsim: Uuvsim, loop: str) -> None:
    status, out, _ = uuvsim(
        "run", loop, "--until", "10", "--native", "--no-report", "-o", "r", "--loops", "delay"
    )
    assert status == 0
    assert "largest coupling residual" in out
    assert "its estimated gain is -6" in out
    assert "the loop may diverge" in out
    written = json.loads(Path("r/run.json").read_text())
    assert written["coupling_residual"]["target"] == "a.u"
    assert written["loops"] == "delay"


def test_run_refuses_a_loop_by_name_gain_and_remedy(uuvsim: Uuvsim, loop: str) -> None:
    status, _, err = uuvsim("run", loop, "--until", "1", "--loops", "refuse")
    assert status == 2
    assert "algebraic loop a.y -> a.u: its estimated gain is -6" in err
    assert "--loops iterate" in err
    status, _, err = uuvsim("run", loop, "--until", "1", "--loops", "dealy")
    assert status == 2
    assert "'dealy'; expected iterate, refuse or delay" in err


def test_show_says_what_becomes_of_a_loop(uuvsim: Uuvsim, loop: str) -> None:
    assert "iterated at each communication point: a.y -> a.u" in uuvsim("systems", "show", loop)[1]
    refused = Path(loop).read_text().replace("<uuvsim:System", '<uuvsim:System loops="refuse"')
    Path(loop).write_text(refused)
    status, out, _ = uuvsim("systems", "show", loop)
    assert status == 0
    assert 'the loop policy is "refuse"' in out
