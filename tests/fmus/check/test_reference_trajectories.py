"""The exported hull against published trajectories, simulated by FMPy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from uuvsim_cosim.content import content
from uuvsim_cosim.fmus.export.fmu_file import build_fmu
from uuvsim_cosim.models.declaration.library import declare

FOLDER = content("models", "vehicles", "bluerov2_heavy", "reference")
# FMPy is given start values only: the force must be constant, and the water at rest.
REFERENCES = [f for k in ("const_surge", "release_tilt") for f in sorted(FOLDER.glob(f"*{k}.csv"))]


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("reference", REFERENCES, ids=lambda p: p.stem)
def test_the_exported_hull_follows_the_reference_within_1e_5(reference: Path, fmi: int) -> None:
    import fmpy

    rows = [r for r in reference.read_text().splitlines() if not r.startswith("#")]
    columns = np.array([[float(x) for x in r.split(",")] for r in rows[1:]])
    time, state, tau = columns[:, 0], columns[:, 1:13], columns[:, 13:19]
    assert np.ptp(tau, axis=0).max() == 0.0, "the force is held over a step: constant only"
    published = "wu_2018" if "wu_2018" in reference.stem else "von_benzon_2022"
    fmu = build_fmu(declare(f"bluerov2_heavy@{published}"), fmi=fmi)
    if fmi == 2:
        start = {f"eta_0[{i + 1}]": state[0, i] for i in range(6)}
        start |= {f"nu_0[{i + 1}]": state[0, 6 + i] for i in range(6)}
        start |= {f"tau[{i + 1}]": tau[0, i] for i in range(6)}
        names = [f"{v}[{i}]" for v in ("eta", "nu") for i in range(1, 7)]
    else:
        start = {"eta_0": state[0, :6], "nu_0": state[0, 6:], "tau": tau[0]}
        names = ["eta", "nu"]
    result = fmpy.simulate_fmu(
        str(fmu),
        stop_time=float(time[-1]),
        output_interval=float(time[1] - time[0]),
        start_values=start,
        output=names,
        fmi_type="CoSimulation",
    )
    found = np.column_stack([np.asarray(result[n]).reshape(len(time), -1) for n in names])
    assert np.abs(found - state).max() < 1e-5
