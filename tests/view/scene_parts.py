"""A recording made by hand, beside the file of a system: no simulation is needed to see it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from uuvsim_cosim.orchestrator.recording.mcap import write_mcap
from uuvsim_cosim.orchestrator.recording.signals import Signals
from uuvsim_cosim.orchestrator.running.library import load
from uuvsim_cosim.orchestrator.ssp.ssd import write_ssd

BOTTOM = 25.0  # m, of the survey's DVL


def survey_signals(samples: int = 121) -> Signals:
    """A vehicle on a circle that heels and turns; thrusters pull in turn; one echo is missing."""
    t = np.arange(samples) * 0.1
    turn = t / 3.0
    eta = np.column_stack([
        8 * np.cos(turn), 8 * np.sin(turn), 4 + 0 * t, 0.2 * np.sin(t), 0.1 * np.cos(t),
        turn + np.pi / 2,
    ])  # fmt: skip
    values = {
        "hull.eta": eta,
        "hull.nu": np.zeros((samples, 6)),
        "navigation.eta": eta + 0.1,
        "navigation.sigma": np.ones((samples, 6)),
        "dvl.range": np.full((samples, 4), 20.0),
        "dvl.beam_valid": np.ones((samples, 4)),
    }
    values["dvl.beam_valid"][:, 3] = 0.0
    for i in range(1, 9):
        values[f"thruster_{i}.thrust"] = 20.0 * np.sin(t + i)
    units = dict.fromkeys(values, "1")
    return Signals(
        t, np.arange(samples), values, units, metadata={"tick": "1/10", "system": "bluerov2_survey"}
    )


def survey_folder(folder: Path, signals: Signals) -> Path:
    """Write survey.mcap and system.ssd, as a run's folder has them; gives the recording."""
    write_ssd(load("bluerov2_survey"), folder / "system.ssd")
    write_mcap(signals, folder / "survey.mcap")
    return folder / "survey.mcap"
