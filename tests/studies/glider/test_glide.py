"""Glide of the Slocum: forces of the hull, equilibrium, and the prediction of a recorded flight."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.parameter_files import parameter_set
from uuvsim_cosim.models.hull.wings import wings
from uuvsim_cosim.studies.glider.flight import GliderFlight, depth_rate, read_flight
from uuvsim_cosim.studies.glider.glide import (
    dynamic_glide,
    fit_glide,
    glide_of,
    lift_and_drag,
    steady_glide,
)
from uuvsim_cosim.studies.glider.judged import Judgement, judge_glide, shared_error, start_of


@cache
def judged(steady: bool = False) -> Judgement:
    return judge_glide(steady=steady)


def constant(pitch: float, volume: float, seconds: int = 300) -> GliderFlight:
    """Return a flight of constant pitch and volume in water of 1025 kg/m3, at 20 m."""
    one = np.ones(seconds)
    depth_pressure = 20.0 * 1025.0 * 9.81
    return GliderFlight(
        np.arange(float(seconds)), depth_pressure * one, pitch * one, volume * one, 1025.0 * one,
        10.0 * one, 0.0 * one, np.nan * one,
    )  # fmt: skip


def test_second_half_is_predicted_by_two_coefficients_of_the_first() -> None:
    """Goals of the trial before: 1.4 cm/s in the rate of depth, 5 cm/s in the speed."""
    j = judged()
    assert j.samples == 3132
    assert j.depth_rate[5] < 0.0142
    assert j.depth_rate[11] < 0.0080
    assert j.speed_samples == 1509
    assert j.speed < 0.040
    assert j.speed_all < 0.040  # turns at depth included
    assert j.speed_median < 0.008


def test_inertia_improves_on_the_equilibrium() -> None:
    steady = judged(True)
    assert judged().depth_rate[11] < 0.97 * steady.depth_rate[11]
    assert judged().depth_rate_first[11] < 0.97 * steady.depth_rate_first[11]
    assert judged().speed_all < 0.8 * steady.speed_all


def test_fitted_drag_is_near_the_published_one() -> None:
    j = judged()
    assert abs(j.glide.C_D_0 - 0.15) < 0.01
    assert j.glide.m / j.glide.nabla == pytest.approx(1005.5, abs=0.2)  # kg/m3


def test_most_of_the_error_is_noise_of_the_pressure_sensor() -> None:
    """Two sensors in one vehicle share what the prediction misses, not their noise."""
    ctd, other, shared = shared_error(read_flight(), judged().motion)
    assert ctd == pytest.approx(0.0165, abs=0.001)
    assert other == pytest.approx(0.0233, abs=0.001)
    assert shared < 0.007


@pytest.mark.parametrize("angle", [0.0, 0.05, -0.05, 0.2, 0.6, -1.5, 3.0])
def test_forces_are_those_of_the_hull(angle: float) -> None:
    g = glide_of("slocum")
    values = {name: ca.SX(q.value) for name, q in parameter_set("slocum").quantities.items()}
    u, w = 0.35 * np.cos(angle), 0.35 * np.sin(angle)
    X, Z = lift_and_drag(g, np.array([1025.0]), np.array([u]), np.array([w]))
    hull = np.array(ca.evalf(wings(values, 1025.0, ca.SX([u, 0, w, 0, 0, 0])))).ravel()
    assert hull[[0, 2]] == pytest.approx([X[0], Z[0]], rel=1e-12, abs=1e-12)


@pytest.mark.parametrize(("pitch", "volume"), [(-0.4, -2.3e-4), (0.4, 2.3e-4), (-0.6, -1e-4)])
def test_integration_ends_at_the_equilibrium(pitch: float, volume: float) -> None:
    flight = constant(pitch, volume)
    g = glide_of("slocum")
    steady, moving = steady_glide(g, flight), dynamic_glide(g, flight)
    assert moving.u[-1] == pytest.approx(steady.u[-1], rel=1e-6)
    assert moving.w[-1] == pytest.approx(steady.w[-1], rel=1e-6)
    assert np.sign(steady.depth_rate[-1]) == -np.sign(pitch)


def test_known_coefficients_are_found_again() -> None:
    flight = read_flight()
    flight = flight.until(3000)
    truth = replace(start_of(read_flight()), C_D_0=0.18)
    motion = steady_glide(truth, flight)
    # a pressure whose rate is that of the motion
    depth = np.concatenate(
        ([20.0], 20.0 + np.cumsum(0.5 * np.diff(flight.t) * (
            motion.depth_rate[1:] + motion.depth_rate[:-1])))
    )  # fmt: skip
    flown = replace(flight, pressure=depth * 9.81 * float(np.mean(flight.density)))
    found = fit_glide(flown, flight.gliding(), replace(truth, C_D_0=0.15), steady=True, samples=1)
    assert abs(found.C_D_0 - 0.18) < 0.003


def test_mean_of_the_measured_rate_keeps_a_constant_rate() -> None:
    flight = constant(-0.4, 0.0)
    sinking = replace(flight, pressure=1025.0 * 9.81 * (10.0 + 0.15 * flight.t))
    for samples in (1, 5, 11):
        assert depth_rate(sinking, samples) == pytest.approx(0.15)


@pytest.mark.parametrize(
    ("text", "place", "words"),
    [
        ("t,x\n", ":1", "pressure_bar"),
        ("", ":1", "no line"),
        ("HEAD\n0,1\n", ":2", "8 numbers"),
        ("HEAD\n0,1,0,0,1000,10,0,\n0,1,0,0,1000,10,0,\n1,1,0,0,1000,10,0,\n", ":3", "rises"),
        ("HEAD\n0,1,0,0,1000,10,0,\n1,1,0,0,,10,0,\n2,1,0,0,1000,10,0,\n", ":3", "density"),
    ],
)
def test_wrong_files_are_refused_with_their_line(
    tmp_path: Path, text: str, place: str, words: str
) -> None:
    head = (
        "t_s,pressure_bar,pitch_rad,volume_cm3,density_kg_m3,temperature_degC,battery_m,speed_m_s"
    )
    file = tmp_path / "flight.csv"
    file.write_text(text.replace("HEAD", head))
    with pytest.raises(InputInvalid, match=words) as refusal:
        read_flight(file)
    assert f"flight.csv{place}" in str(refusal.value)
