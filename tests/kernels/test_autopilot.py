"""A vehicle with fins follows heading, depth and speed, with equal bits in every backend."""

from __future__ import annotations

import numpy as np
import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.kernels import fuse
from uuvsim_cosim.models.control.fin_design import design_fins
from uuvsim_cosim.models.guidance.line_of_sight import MAX_WAYPOINTS, lawn_mower
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten


def straight(vehicle: str) -> uuv.System:
    """Go north from 10 m to 11 m of depth over 400 m, beginning 1 m beside the line."""
    d = design_fins(vehicle)
    speed = float(d.V[2])
    path = {
        "waypoints": [[0.0, 0.0, 10.0], *[[400.0, 0.0, 11.0]] * (MAX_WAYPOINTS - 1)],
        "count": 2, "speed": speed, "acceleration": speed / 10, "lookahead": 10 * d.length,
        "radius": 2 * d.length, "r_max": 0.05, "r_dot_max": 0.02,
    }  # fmt: skip
    start = {
        "eta_0": (-3 * d.length, 1.0, 10.0, 0.0, 0.0, 0.0),
        "nu_0": (speed, 0.0, 0.0, 0.0, 0.0, 0.0),
    }
    system = (
        uuv.System("straight", "0.01")
        .add("guidance", "model:path_following?method=los", path)
        .add("controller", f"model:autopilot?vehicle={vehicle}")
        .add("hull", f"model:{vehicle}", start)
        .add("propeller", f"model:propeller?vehicle={vehicle}")
        .add("fins", f"model:fins?vehicle={vehicle}&contact=true")
        .connect("hull.nu_r", "propeller.nu_r")
        .connect("hull.nu_r", "fins.nu_r")
        .connect("propeller.tau", "fins.contact")
        .connect("fins.tau", "hull.tau")
        .connect("controller.delta_d", "fins.u")
        .connect("controller.u", "propeller.u")
    )
    for name in ("eta", "nu"):
        system = system.connect(f"hull.{name}", f"guidance.{name}")
        system = system.connect(f"hull.{name}", f"controller.{name}")
        system = system.connect(f"guidance.{name}_d", f"controller.{name}_d")
    return system


@pytest.mark.parametrize("vehicle", ["remus100", "lauv", "eca_a9", "npsauv", "tethys_lrauv"])
def test_a_vehicle_follows_heading_depth_and_speed(vehicle: str) -> None:
    plan = flatten(straight(vehicle))
    d = design_fins(vehicle)
    with Master(plan, prepare(plan, "native")) as master:
        master.initialize()
        for _ in range(round(100 * 250 / d.V[2])):
            master.step()
        eta, nu = np.ravel(master.get("hull", "eta")), np.ravel(master.get("hull", "nu"))
    assert abs(eta[1]) < 0.2 * d.length
    assert abs(eta[5]) < 0.05
    assert eta[2] == pytest.approx(10.0 + eta[0] / 400.0, abs=0.1)
    assert nu[0] == pytest.approx(d.V[2], rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", ["remus100", "lauv", "eca_a9", "npsauv", "tethys_lrauv"])
def test_a_vehicle_flies_a_survey_with_turns_in_a_current(vehicle: str) -> None:
    """Four legs, 15 % of the speed from abeam; it begins carried by the water.

    gamma = U / (9 Delta²) damps the adaptation of ALOS by 1.5: s² + U / Delta s + U gamma = 0.
    """
    d = design_fins(vehicle)
    speed, lookahead, R = float(d.V[2]), 10 * d.length, 10 * d.length
    legs = lawn_mower(6 * R, 4 * R, 4, 10.0)
    system = straight(vehicle)
    system = system.replace("guidance", "path_following?method=alos")
    system = system.set("guidance.waypoints", [*legs, *[legs[-1]] * (MAX_WAYPOINTS - len(legs))])
    for name, value in {
        "count": len(legs), "speed": speed, "lookahead": lookahead, "radius": 2 * d.length,
        "gamma": speed / (9 * lookahead**2), "r_max": speed / R, "r_dot_max": 0.5 * speed / R,
    }.items():  # fmt: skip
        system = system.set(f"guidance.{name}", value)
    drift = 0.15 * speed
    system = system.set("hull.v_c", (0.0, drift, 0.0)).set("hull.nu_0", (speed, drift, 0, 0, 0, 0))
    plan = flatten(system)
    deepest, shallowest = 0.0, 100.0
    with Master(plan, prepare(plan, "native")) as master:
        master.initialize()
        for _ in range(round(2 * (24 * R + 12 * R) / speed)):
            for _ in range(100):
                master.step()
            depth = float(np.ravel(master.get("hull", "eta"))[2])
            deepest, shallowest = max(deepest, depth), min(shallowest, depth)
            if float(np.ravel(master.get("guidance", "waypoint"))[0]) == len(legs):
                break
        assert float(np.ravel(master.get("guidance", "waypoint"))[0]) == len(legs)
    assert 9.7 < shallowest < deepest < 10.3


def test_fmu_native_and_kernel_have_the_same_bits() -> None:
    system = straight("remus100")
    plan = flatten(system)
    batch = fuse(system).batch(3)
    with Master(plan, prepare(plan, "native")) as native, Master(plan, prepare(plan)) as fmu:
        for master in (native, fmu):
            master.initialize()
        for _ in range(200):
            batch.step()
            for master in (native, fmu):
                master.step()
        for name in ("hull.eta", "hull.nu", "controller.delta_d", "controller.u"):
            mine = np.ravel(batch.get(name)[2]).astype(float)
            for master in (native, fmu):
                np.testing.assert_array_equal(np.ravel(master.get(*name.split("."))), mine, name)
