"""`uuvsim models show VEHICLE` says what the numbers amount to."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

from uuvsim_cosim.commands.models.models import app
from uuvsim_cosim.models.vehicles.vehicle_figures import ambiguous_numbers, vehicle_figures


def test_a_torpedo_is_shown_with_its_figures_and_its_disputed_numbers() -> None:
    done = CliRunner().invoke(app, ["show", "remus100"])
    assert done.exit_code == 0, done.output
    for words in (
        "north east down", "rises at", "natural period", "stability derivatives",
        "prestero_2001_printed", "1310", "Verification of a Six-Degree", "tau",
    ):  # fmt: skip
        assert words in " ".join(done.output.split()), words


def test_figures_are_those_of_closed_forms() -> None:
    f = vehicle_figures("remus100", 1.5)
    assert f.drift == pytest.approx(-np.sqrt((306 - 299) / 131), rel=1e-6)
    assert f.speeds[0, 0] == pytest.approx(np.sqrt(2.99 / 1.62), rel=1e-6)
    softness = np.linalg.inv(f.M)[3]  # sway and yaw give way; W - B pulls sideways
    stiffness = softness[3] * 299 * 0.0196 - softness[1] * (299 - 306)
    assert f.roll.period == pytest.approx(2 * np.pi / np.sqrt(stiffness))
    # Prestero's combined coefficients, times u: Muw 24, Nuv -24, Nur -2, Yur 5.22.
    d = f.derivatives / 1.5
    assert d[4, 2] == pytest.approx(24.0, abs=1e-6)
    assert d[5, 1] == pytest.approx(-24.0, abs=1e-6)
    assert d[5, 5] == pytest.approx(-2.0, abs=1e-6)
    assert d[1, 5] == pytest.approx(5.22, abs=1e-6)


def test_disputed_numbers_are_found_in_all_sets() -> None:
    found = {a.name: dict(a.values) for a in ambiguous_numbers("remus100")}
    assert found["D_q_22"] == {
        131.0: "prestero_2001, scrimmage",
        1310.0: "prestero_2001_printed, sgarioto_2011",
    }
