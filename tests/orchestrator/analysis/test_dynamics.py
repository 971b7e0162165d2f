"""`uuv.dynamics` and `uuv.optimal_control` against the master, closed forms and refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.errors import InputInvalid


@pytest.fixture(scope="module")
def driven() -> uuv.System:
    """A hull on its thrusts, without clocks."""
    return (
        uuv.System("driven", "0.01")
        .add("hull", "bluerov2_heavy?surface=0")
        .add("wrench", "model:wrench")
        .connect("wrench.tau", "hull.tau")
    )


def test_the_rates_of_a_system_are_those_of_its_parts(driven: uuv.System) -> None:
    """Of hull and wrench: the wrench's tau by hand, into the hull's own f."""
    whole, hull = uuv.dynamics(driven), uuv.dynamics("bluerov2_heavy")
    random = np.random.default_rng(1)
    x = whole.x_0 + random.normal(0, 0.3, 12)
    u = whole.u_0.copy()
    thrust = random.normal(0, 20, 8)
    u[whole.index("wrench.thrust")] = thrust
    tau = np.array(whole.h(x, u)).ravel()[whole.index("wrench.tau")]
    of_hull = hull.u_0.copy()
    of_hull[hull.index("tau")] = tau
    assert np.array(whole.f(x, u)) == pytest.approx(np.array(hull.f(x, of_hull)), rel=1e-12)
    assert np.linalg.norm(tau) > 1
    names = [(e.name, e.unit, e.frame) for e in whole.states]
    assert names[2] == ("hull.eta[3]", "m", "n")
    assert names[11] == ("hull.nu[6]", "rad/s", "b")


def test_the_map_of_a_sampled_system_follows_the_master(tmp_path: Path) -> None:
    """Fifty periods of the hold, thrusters, samples and delays included."""
    d = uuv.dynamics("bluerov2_hold")
    x = d.x_0
    for _ in range(50):
        x = d.f(x, d.u_0)
    run = uuv.run("bluerov2_hold", until=1.0, backend="native", out=tmp_path / "hold").signals()
    assert d.period == 0.02
    eta = np.array(x).ravel()[d.index("hull.eta")]
    assert eta == pytest.approx(run["hull.eta"][-1], abs=1e-9)


def test_a_slower_component_shows_its_outputs_at_the_end_of_its_step(tmp_path: Path) -> None:
    """The map and the master agree if the controller steps every second tick."""
    system = uuv.load("bluerov2_hold").set("hull.eta_0", [0.5, -0.3, 4.8, 0, 0, 0.4])
    kept = system.components["controller"].source
    slower = system.replace("controller", kept, rate="0.04")
    d = uuv.dynamics(slower)
    x = d.x_0
    for _ in range(round(1.0 / d.period)):
        x = d.f(x, d.u_0)
    run = uuv.run(slower, until=1.0, backend="native", out=tmp_path / "slower").signals()
    eta = np.array(x).ravel()[d.index("hull.eta")]
    assert eta == pytest.approx(run["hull.eta"][-1], abs=1e-9)
    plain = uuv.run(system, until=1.0, backend="native", out=tmp_path / "plain").signals()
    assert np.abs(eta - plain["hull.eta"][-1]).max() > 1e-6


def test_an_algebraic_loop_and_a_sampled_component_alone_are_refused() -> None:
    with pytest.raises(InputInvalid, match="dynamics: controller samples"):
        uuv.dynamics("controller")
    with pytest.raises(InputInvalid, match=r"system\.set"):
        uuv.dynamics("bluerov2_hold", parameters={"m": 1.0})


def test_the_shortest_time_of_a_double_integrator_is_that_of_the_closed_form() -> None:
    """A sphere without drag: T = 2 sqrt(d M / F), full force ahead, then astern."""
    hull = uuv.System("still", "0.01").add("hull", "sphere?surface=0", {"D_q_11": 0.0, "z_g": 0.0})
    d = uuv.dynamics(hull)
    M = 1.0 / float(d.f(d.x_0, np.eye(len(d.u_0))[d.index("hull.tau[1]")[0]])[6])  # kg
    plan = uuv.optimal_control(
        hull, (1.0, 60.0), end={"hull.eta[1]": 5.0, "hull.nu": 0.0},
        inputs={"hull.tau[1]": (-20.0, 20.0)}, cost="time", intervals=60,
    )  # fmt: skip
    assert plan.t[-1] == pytest.approx(2 * np.sqrt(5.0 * M / 20.0), rel=0.01)
    assert plan["hull.tau[1]"].max() == pytest.approx(20.0, abs=0.01)


def test_a_plan_is_flown_within_half_a_percent(driven: uuv.System, tmp_path: Path) -> None:
    """Forward, down and a quarter turn at once, open loop, on the equations that are simulated."""
    plan = uuv.optimal_control(
        driven, 10.0, end={"hull.eta": [4, 2, 6, 0, 0, np.pi / 2], "hull.nu": 0.0},
        inputs={"wrench.thrust": (-40.0, 40.0)},
    )  # fmt: skip
    file = plan.write(tmp_path / "plan.csv")
    end = uuv.run(driven, until=10.0, inputs=[str(file)], out=tmp_path / "flown").signals()
    distance = np.linalg.norm([4.0, 2.0, 1.0])
    assert np.linalg.norm(end["hull.eta"][-1][:3] - [4, 2, 6]) < 0.005 * distance
    assert plan.leads["wrench.thrust[1]"] == pytest.approx(0.015)


def test_a_plan_keeps_its_distance_and_its_bounds(driven: uuv.System) -> None:
    def outside(v: dict[str, object]) -> object:
        return (v["hull.eta[1]"] - 2) ** 2 + (v["hull.eta[2]"] - 0.1) ** 2 - 1.0  # type: ignore[operator]

    plan = uuv.optimal_control(
        driven, 15.0, end={"hull.eta[1]": 4.0, "hull.eta[2]": 0.0},
        inputs={"wrench.thrust": (-40.0, 40.0)}, bounds={"hull.eta[3]": (4.9, 5.1)}, keep=outside,
    )  # fmt: skip
    away = np.hypot(plan["hull.eta[1]"] - 2, plan["hull.eta[2]"] - 0.1)
    assert away.min() == pytest.approx(1.0, abs=1e-3)
    assert plan["hull.eta[3]"].min() >= 4.9 - 1e-6


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"until": 0.0}, r"until: 0.0 s; expected 0 < low <= high"),
        ({"inputs": {}}, "no input is chosen"),
        ({"inputs": {"tau[1]": (1.0, -1.0)}}, "low <= high"),
        ({"inputs": {"nu[1]": (-1.0, 1.0)}}, "is no input"),
        ({"inputs": {"tau[1]": (-1.0, float("nan"))}}, "low <= high"),
        ({"end": {"eta[7]": 1.0}}, "there is no signal 'eta.7.'"),
        ({"end": {"tau[1]": 1.0}}, "is no state"),
        ({"end": {"nu": [1.0, 2.0]}}, "6 finite numbers"),
        ({"cost": "time"}, "the time is fixed"),
        ({"cost": "fuel"}, "cost: 'fuel'; expected 'effort', 'time', or a function"),
        ({"end": {"eta[1]": 1e6}}, "IPOPT ended with .*an end that can be reached"),
    ],
)
def test_a_problem_that_cannot_be_solved_is_refused(changes: dict[str, object], words: str) -> None:
    problem: dict[str, object] = {
        "until": 4.0, "end": {"eta[1]": 1.0}, "inputs": {"tau[1]": (-20.0, 20.0)}, "intervals": 8,
    }  # fmt: skip
    with pytest.raises(InputInvalid, match=words):
        uuv.optimal_control("sphere", **(problem | changes))  # type: ignore[arg-type]


def test_a_system_that_samples_is_refused_for_planning() -> None:
    with pytest.raises(InputInvalid, match="a component samples"):
        uuv.optimal_control("bluerov2_hold", 1.0, inputs={"hull.v_c": (-1, 1)})
