"""The swap, from the command line: controllers that other tools made fly the shipped survey."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import uuvsim_cosim as uuv


def survey(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "uuvsim_cosim", "run", "bluerov2_survey", "--until", "30"]
    return subprocess.run(
        [*command, "--no-report", "--out", "r", *options],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("made_by", ["pythonfmu2_controller", "pythonfmu3_controller"])
def test_a_controller_made_by_another_tool_flies_the_survey(
    made_by: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    fmu = request.getfixturevalue(made_by)
    done = survey(
        tmp_path, "--replace", f"controller={fmu}", "--rate", "controller=0.02",
        "--set", "controller.Kp=1.2", "--set", "controller.Ki=0.2",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "controller: no unit given; those of the slot are used" in done.stdout
    signals = uuv.read_signals(tmp_path / "r")
    eta, wanted = signals["hull.eta"], signals["guidance.eta_d"]
    late = signals.time > 20.0
    assert np.abs(eta[late, 2] - wanted[late, 2]).max() < 0.3
    assert np.linalg.norm((eta - wanted)[late, :2], axis=1).max() < 1.0
    # The rate: its output changes at every second communication point only.
    changed = np.any(np.diff(signals["controller.tau_d"], axis=0) != 0.0, axis=1)
    assert not np.any(changed[::2] & changed[1::2])


def test_outputs_of_other_names_are_mapped_element_by_element(
    pythonfmu2_controller: Path, tmp_path: Path
) -> None:
    fmu = ["--replace", f"controller={pythonfmu2_controller}"]
    crossed = [f"controller.tau_d[{i}]=tau_d[{j}]" for i, j in ((1, 2), (2, 1))]
    same = [f"controller.tau_d[{i}]=tau_d[{i}]" for i in range(3, 7)]
    maps = [x for m in (*crossed, *same) for x in ("--map", m)]
    assert survey(tmp_path, *fmu, *maps).returncode == 0
    signals = uuv.read_signals(tmp_path / "r")
    surge, sway = signals["controller.tau_d"][5, :2]
    # What the FMU calls surge arrives as sway: the thrusters' force is the crossed one.
    assert abs(surge) + abs(sway) > 0.0
    body = signals["wrench.tau"][-1, :2]
    asked = signals["controller.tau_d"][-1, 1::-1]
    assert np.abs(body - asked).max() < np.abs(body - asked[::-1]).max() + 1e-9


def test_what_does_not_fit_is_refused_with_what_is_missing_and_what_was_there(
    pythonfmu2_lag: Path, tmp_path: Path
) -> None:
    done = survey(tmp_path, "--replace", f"controller={pythonfmu2_lag}")
    assert done.returncode == 2
    for name in ("controller.eta_d", "controller.tau_d"):
        assert f"{name}: missing in" in done.stderr
    assert "inputs u and outputs y" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "r").exists()
