"""Predictions of a declared model from points of a recording."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from uuvsim_cosim.orchestrator.recording.signals import Signals
from uuvsim_cosim.orchestrator.running.run import run
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.studies.water import model_predictions
from uuvsim_cosim.studies.water.model_predictions import Predictor

AT = np.array([80, 120])
SYSTEM = System("sinking").add("hull", "model:bluerov2@wu_2018")


@cache
def recording() -> Signals:
    """Return 30 s of a hull that rises and rolls, with its pose alone."""
    moved = SYSTEM.set("hull.eta_0", [0, 0, 20, 0.3, 0, 0])
    signals = run(moved, until=30, out="rising", backend="native").signals()
    eta = np.array(signals["hull.eta"])
    values = {"hull.eta": eta, "hull.tau": np.zeros((len(eta), 6))}
    return Signals(np.array(signals.time), np.array(signals.ticks), values, {})


@pytest.fixture(autouse=True)
def folder(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path_factory.mktemp("water"))


def test_the_model_of_the_recording_predicts_it() -> None:
    predictor = Predictor(SYSTEM, "hull", recording(), 0.1, (0.0, 30.0))
    found = predictor.predict(AT, 100)[:, -1]
    truth = predictor.grid.y[:, AT + 100].T
    assert found[:, 2] == pytest.approx(truth[:, 2], abs=2e-3)
    assert found[:, 3] == pytest.approx(truth[:, 3], abs=5e-3)


def test_no_sample_later_than_two_steps_after_the_point_is_used() -> None:
    """A measurement at a point of the grid is a mean that its neighbours correct (signals.py)."""
    signals = recording()
    eta = signals["hull.eta"].copy()
    eta[np.asarray(signals.time) > 12.16] += 1.0
    other = replace(signals, values_by_name={**signals.values_by_name, "hull.eta": eta})
    one, two = (Predictor(SYSTEM, "hull", s, 0.1, (0.0, 30.0)).predict(AT, 50)
                for s in (signals, other))  # fmt: skip
    assert two == pytest.approx(one, abs=1e-12)


def test_a_parameter_that_drifts_is_estimated_with_the_state() -> None:
    wrong = SYSTEM.set("hull.B", 118.0)
    errors = []
    for adapted in ({}, {"hull.B": 5.0}):
        predictor = Predictor(wrong, "hull", recording(), 0.1, (0.0, 30.0), adapted=adapted)
        found = predictor.predict(AT, 50)[:, -1, 2]
        errors.append(np.abs(found - predictor.grid.y[2, AT + 50]).max())
    assert errors[1] < 0.2 * errors[0]


def test_a_damping_too_strong_for_the_step_is_integrated_in_shorter_steps(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    damped = SYSTEM.set("hull.D_q_33", 8_000.0)
    far = []
    for shorter in ((1,), model_predictions._SHORTER):
        monkeypatch.setattr(model_predictions, "_SHORTER", shorter)
        predictor = Predictor(damped, "hull", recording(), 0.1, (0.0, 30.0))
        found = predictor.predict(AT, 50)
        far.append(not np.abs(found).max() < 100.0)
    assert far == [True, False]
