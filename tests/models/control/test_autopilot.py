from __future__ import annotations

from pathlib import Path
from shutil import copytree
from typing import Any

import numpy as np
import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.content import content
from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.control.fin_design import (
    DELAY,
    OMEGA,
    Plane,
    design_fins,
    fin_margins,
    net_weight_of_level_flight,
)
from uuvsim_cosim.models.control.margins import margin_of
from uuvsim_cosim.models.declaration.library import declare

H = 0.02
VEHICLES = ("remus100", "lauv", "eca_a9", "npsauv", "tethys_lrauv")


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_every_loop_is_stable_with_servo_and_delay_at_every_speed(vehicle: str) -> None:
    design = design_fins(vehicle)
    for plane in (design.depth, design.heading, design.roll):
        for i in range(len(design.V) if plane is not None else 0):
            assert plane is not None
            assert np.max(plane.poles(i).real) < 0


def test_an_x_tail_and_a_cross_mix_roll_and_a_tail_on_shared_shafts_does_not() -> None:
    assert design_fins("remus100").roll is not None
    assert design_fins("eca_a9").roll is not None
    assert design_fins("tethys_lrauv").roll is None


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_level_flight_is_the_command_when_nothing_is_in_error(lanes: Any, vehicle: str) -> None:
    """delta_d = mix (0, delta_0, 0) and u = u_0 at a speed of the design."""
    d = design_fins(vehicle)
    i = 2
    at = [0, 0, 10, 0, d.theta[i], 0.3]
    nu = [d.V[i], 0, 0, 0, 0, 0]
    run = lanes(declare("autopilot", vehicle=vehicle))
    run.step(0.0, H, eta=at, eta_d=[0, 0, 10, 0, 0, 0.3], nu=nu, nu_d=nu)
    assert run["delta_d"] == pytest.approx(d.mix[:, 1] * d.delta[i], abs=1e-5)
    assert float(run["u"][0]) == pytest.approx(d.u[i], abs=1e-5)


def test_an_emergency_ascent_takes_full_thrust_and_raises_the_bow(lanes: Any) -> None:
    run = lanes(declare("autopilot", vehicle="remus100"))
    level = {"eta": [0, 0, 30, 0, 0, 0], "eta_d": [0, 0, 30, 0, 0, 0], "nu": [2, 0, 0, 0, 0, 0]}
    for k in range(400):
        run.step(k * H, H, ascend=1.0, **level)
    assert float(run["u"][0]) == 1.0
    assert float(run["theta_d"][0]) == pytest.approx(np.radians(25.0))


def test_a_weight_that_fins_cannot_carry_is_left_out_of_the_gains(tmp_path: Path) -> None:
    folder = copytree(content("models", "vehicles", "lauv"), tmp_path / "lauv")
    file = folder / "parameters.yaml"
    file.write_text(file.read_text("utf-8").replace("m: {value: 18", "m: {value: 36", 1), "utf-8")
    design = design_fins(str(folder))
    assert "gains without the net weight of 176 N, which level flight" in design.remarks[0]
    assert design.V[0] == pytest.approx(design_fins("lauv").V[0], rel=0.02)


def test_net_weights_of_level_flight_grow_with_the_square_of_the_speed() -> None:
    rows = np.array(net_weight_of_level_flight("lauv"))
    assert rows[:, 1] == pytest.approx(rows[:, 2], rel=1e-2)  # up and down alike
    per_square = rows[:, 2] / rows[:, 0] ** 2  # at low speed, pitch is a part of it by z_g
    assert per_square == pytest.approx(np.full(len(rows), per_square[-1]), rel=0.3)


def test_a_vehicle_without_fins_is_refused() -> None:
    with pytest.raises(ParameterInvalid, match="no fins of 'bluerov2'"):
        declare("autopilot", vehicle="bluerov2")


def test_the_wave_filter_takes_out_the_waves_frequency(lanes: Any) -> None:
    """Pitch and heading at omega_e reach the fins by zeta_n; the rest of the law is the same."""
    sizes = {}
    for on in (False, True):
        run = lanes(declare("autopilot", vehicle="remus100", wave_filter=on))
        found = []
        for k in range(3000):
            wave = 0.02 * np.sin(0.8 * k * H)
            run.step(k * H, H, eta=[0, 0, 5, 0, wave, wave], eta_d=[0, 0, 5, 0, 0, 0],
                     nu=[2, 0, 0, 0, 0, 0], nu_d=[2, 0, 0, 0, 0, 0])  # fmt: skip
            found.append(np.array(run["delta_d"]))
        sizes[on] = np.ptp(np.array(found[-400:]), axis=0).max()
    assert sizes[True] < 0.15 * sizes[False]


def test_roll_gets_the_deflection_that_pitch_and_yaw_leave(lanes: Any) -> None:
    """With pitch and yaw at their limits, the fins make both moments, whatever the roll angle."""
    d = design_fins("remus100")
    run = lanes(declare("autopilot", vehicle="remus100"))
    at, nu = [0, 0, 5, 1.0, 0, 0], [2, 0, 0, 2, 2, 2]
    for k in range(5):
        run.step(k * H, H, eta=at, eta_d=[0, 0, 5, 0, 0, 0], nu=nu, nu_d=nu)
    made = np.linalg.lstsq(d.mix, np.array(run["delta_d"]), rcond=None)[0]
    assert np.abs(made[1:]) == pytest.approx(d.limit[1:], rel=1e-4)
    assert np.all(np.abs(run["delta_d"]) <= d.delta_max + 1e-9)


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_each_loop_has_a_phase_margin_of_20_degrees(vehicle: str) -> None:
    margins = fin_margins(design_fins(vehicle))
    assert min(m.phase for m in margins) >= 20.0
    assert {m.axis for m in margins} >= {"depth", "heading", "speed"}


def test_the_margins_of_a_plane_without_fins_in_the_state_are_those_of_the_closed_form() -> None:
    """L = e^(-0.04 s) / (s (1 + T s)) K_x with K = (0, K_x, 0): an integrator on a servo."""
    lag, K = 0.24, 1.5
    plane = Plane(np.zeros((1, 1, 1)), np.ones((1, 1)), np.array([[0.0, K, 0.0]]), lag)
    m = margin_of("yaw", OMEGA, plane.response(0, None))
    T = lag - DELAY
    w = np.sqrt((np.sqrt(1 + 4 * (K * T) ** 2) - 1) / (2 * T * T))  # |L| = 1
    assert m.crossover == pytest.approx(w, rel=1e-4)
    assert np.radians(m.phase) == pytest.approx(np.pi / 2 - np.arctan(w * T) - DELAY * w, rel=1e-4)


def test_the_margins_of_depth_are_those_of_the_generated_system() -> None:
    """Opened at the planes' command, which is one element, by `analyse`: within 2 deg and 3 %."""
    system = uuv.system_of("tethys_lrauv")
    d = design_fins("tethys_lrauv")
    speed = float(np.asarray(system.components["guidance"].start["speed"]))
    found = uuv.analyse(system, "controller.delta_d[2]", at=5.0)[0].margins
    loops = [m for m in fin_margins(d) if m.axis == "depth"]
    phase = float(np.interp(speed, d.V, [m.phase for m in loops]))
    crossover = float(np.interp(speed, d.V, [m.crossover for m in loops]))
    assert np.degrees(found.phase) == pytest.approx(phase, abs=2.0)
    assert found.crossover == pytest.approx(crossover, rel=0.03)


def rudder_of_tethys(system: uuv.System, at: float) -> tuple[float, float]:
    """Return phase margin [deg] and crossover [rad/s] of the heading, opened at the rudder."""
    found = uuv.analyse(system, "controller.delta_d[1]", at=at)[0].margins
    return float(np.degrees(found.phase)), found.crossover


def test_the_margins_of_heading_are_those_of_the_generated_system_on_a_straight_course() -> None:
    """Without guidance, whose loop takes some degrees: within 2 deg and 3 %."""
    loiter = uuv.system_of("tethys_lrauv")
    speed = float(np.asarray(loiter.components["guidance"].start["speed"]))
    straight = (
        loiter.remove("guidance")
        .set("controller.eta_d", [0, 0, 5, 0, 0, 0])
        .set("controller.nu_d", [speed, 0, 0, 0, 0, 0])
    )
    phase, crossover = rudder_of_tethys(straight, 5.0)
    d = design_fins("tethys_lrauv")
    loops = [m for m in fin_margins(d) if m.axis == "heading"]
    assert phase == pytest.approx(np.interp(speed, d.V, [m.phase for m in loops]), abs=2.0)
    assert crossover == pytest.approx(np.interp(speed, d.V, [m.crossover for m in loops]), rel=0.03)


def test_a_turn_damps_the_hull_and_raises_the_margin_of_heading() -> None:
    """On its circle of 26 m; 57 deg by the design for straight flight."""
    phase, crossover = rudder_of_tethys(uuv.system_of("tethys_lrauv"), 120.0)
    assert 75.0 < phase < 85.0
    assert crossover < 0.5


def test_the_margins_of_speed_are_those_of_the_generated_system() -> None:
    """The speed loop, opened at the propeller's command, by `analyse`: within 5 deg and 10 %."""
    system = uuv.system_of("remus100")
    d = design_fins("remus100")
    speed = float(np.asarray(system.components["guidance"].start["speed"]))
    found = uuv.analyse(system, "controller.u", at=5.0)[0].margins
    loops = [m for m in fin_margins(d) if m.axis == "speed"]
    expected = float(np.interp(speed, d.V, [m.phase for m in loops]))
    crossover = float(np.interp(speed, d.V, [m.crossover for m in loops]))
    assert np.degrees(found.phase) == pytest.approx(expected, abs=5.0)
    assert found.crossover == pytest.approx(crossover, rel=0.1)
