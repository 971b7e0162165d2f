"""Outliers: spikes are found and reported, and motions are no spikes."""

from __future__ import annotations

import numpy as np
import pytest

from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.recording.signals import Signals
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.studies.identification.fitted_model import GreyBox
from uuvsim_cosim.studies.identification.outliers import pulses, residual_outliers, spikes
from uuvsim_cosim.studies.identification.parameters import wanted_parameters
from uuvsim_cosim.studies.identification.signals import Grid, Lookup, grid_of

T = np.arange(0.0, 20.0, 0.1)


@pytest.mark.parametrize("length", [1, 2, 3])
def test_a_spike_is_found_with_its_length(length: int) -> None:
    v = np.sin(T)
    v[50 : 50 + length] = 1e6
    assert np.flatnonzero(spikes(v, 0.05)).tolist() == list(range(50, 50 + length))


def test_steps_turns_and_gaps_are_no_spikes() -> None:
    turned = np.mod(T + np.pi, 2.0 * np.pi) - np.pi
    assert not spikes(turned, 0.02, angle=True).any()
    assert not spikes(np.where(T > 10.0, 100.0, 0.0), 0.02).any()
    assert not spikes(np.where(T % 1.0 < 0.05, np.sin(T), np.nan), 0.02).any()


def test_a_spike_among_missing_samples_is_found() -> None:
    v = np.where(np.arange(200) % 2 == 0, np.sin(T), np.nan)
    v[40] = -1e6
    assert np.flatnonzero(spikes(v, 0.05)).tolist() == [40]


def test_a_pulse_of_an_input_is_named_and_a_usual_one_is_not() -> None:
    tau = np.sin(T)
    assert pulses("tau", T, tau) == []
    tau[30] = 1e6
    (text,) = pulses("tau", T, tau)
    assert "1e+06 at 3.000 s" in text
    assert "used as recorded" in text


def test_residuals_far_beyond_the_others_are_named_with_time_and_z() -> None:
    r = np.random.default_rng(1).normal(size=200)
    assert residual_outliers(["r"], [r], T) == []
    r[70] = 40.0
    (text,) = residual_outliers(["r"], [r], T)
    assert text.startswith("1 of 200 residuals of r are outliers")
    assert "at 7.000 s" in text
    assert "--residuals robust" in text


def test_a_spike_of_a_measurement_is_left_out_of_the_grid_and_reported() -> None:
    plan = flatten(System("dive").add("hull", "model:bluerov2"))
    box = GreyBox(plan, 0, wanted_parameters(plan, 0, ["D_q_66"]), exact=False)
    nu = np.zeros((200, 6))
    nu[:, 5] = 0.3 * np.sin(T)

    def grid(values: np.ndarray) -> Grid:
        signals = Signals(T, np.arange(200), {"nu": values, "tau": np.zeros((200, 6))}, {})
        return grid_of(box, Lookup(signals, {}), h=0.1, first=0.0, last=None)

    plain = grid(nu.copy())
    assert plain.outliers == ()
    nu[77, 5] = 1e6
    spiked = grid(nu)
    assert np.isnan(spiked.y[11]).sum() == 1
    assert np.nanmax(np.abs(spiked.y[11] - plain.y[11])) < 0.01
    (text,) = spiked.outliers
    assert text.startswith("1 outlier of nu[6] left out of the fit: 1e+06 at 7.700 s (robust z")
    assert "--residuals robust" in text
