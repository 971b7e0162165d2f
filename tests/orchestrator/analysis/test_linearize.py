"""`uuv.linearize` and `uuv.trim` from outside: names, systems, and the swap that they are for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten


@pytest.fixture(scope="module")
def held() -> uuv.System:
    """A hull held by a controller without thrusters between them: smooth where it rests."""
    return (
        uuv.System("held", "0.01")
        .add("law", "lqr")
        .add("hull", "bluerov2_heavy?surface=0", {"nu_0": (0.2, 0.1, 0.1, 0, 0, 0.1)})
        .connect("hull.eta", "law.eta")
        .connect("hull.nu", "law.nu")
        .connect("law.tau_d", "hull.tau")
        .set("law.eta_d", (0.1, 0.0, 5.0, 0.0, 0.0, 0.1))
    )


def test_a_linear_system_answers_as_the_master_does(held: uuv.System) -> None:
    """The response of the master to a small current, over four steps, delays included."""
    at, push = 1.0, 1e-5
    linear = uuv.linearize(held, at, inputs=["hull.v_c"], outputs=["hull.eta", "hull.nu"])
    assert linear.dt == 0.02
    assert linear.input_labels == ["hull:v_c[1]", "hull:v_c[2]", "hull:v_c[3]"]
    plan = flatten(held)
    ends = []
    with Master(plan, prepare(plan, "native")) as master:
        master.initialize()
        for _ in range(100):
            master.step()
        snapshot = master.snapshot()
        for sign in (1.0, -1.0):
            master.restore(snapshot)
            master.set("hull", "v_c", [0.0, sign * push, 0.0])
            for _ in range(2):
                master.step()
            ends.append(np.concatenate([master.get("hull", "eta"), master.get("hull", "nu")]))
    of_master = (ends[0] - ends[1]) / (2 * push)
    one = np.array(linear.C) @ np.array(linear.B)[:, 1]
    assert one == pytest.approx(of_master, abs=1e-6)
    assert np.linalg.norm(one) > 1e-3


def test_a_loop_that_holds_has_no_pole_outside_the_circle(held: uuv.System) -> None:
    """One pole at 1 is of the quaternion's length; what the law learns dies out."""
    moduli = np.sort(np.abs(uuv.linearize(held, 20.0).poles()))[::-1]
    assert moduli[0] == pytest.approx(1.0, abs=1e-6)
    assert moduli[1] < 0.9999


def test_a_component_whose_equations_are_not_known_is_named(tmp_path: Path) -> None:
    (tmp_path / "law.py").write_text(
        "class Law:\n    inputs = {}\n    outputs = {'x': (1, 'm')}\n\n"
        "    def step(self, t, dt, u):\n        return {'x': 0.0}\n"
    )
    system = uuv.System("s", "0.01").add("mine", f"{tmp_path / 'law.py'}:Law")
    with pytest.raises(InputInvalid, match=r"linearize: mine is Python .* declarations alone"):
        uuv.linearize(system)


def test_linearize_and_trim_find_models_and_systems_by_name() -> None:
    assert uuv.linearize("sphere", inputs=["tau[1]"], outputs=["nu[1]"]).nstates == 12
    with pytest.raises(InputInvalid, match=r"'remus10' \(did you mean remus100"):
        uuv.trim("remus10")
    with pytest.raises(InputInvalid, match="applies to one component"):
        uuv.trim("bluerov2_hold")
    with pytest.raises(InputInvalid, match="a time applies to systems"):
        uuv.linearize("sphere", 3.0)
    with pytest.raises(InputInvalid, match="`at` is a time"):
        uuv.linearize("bluerov2_hold", {"nu": 1.0})


def test_a_bare_name_stands_for_a_model_with_its_options() -> None:
    system = uuv.load("bluerov2_hold")
    assert system.replace("controller", "lqr").components["controller"].source == "model:lqr"
    assert "K_d" in system.replace("controller", "backstepping").describe("controller").variables
    other = system.replace("guidance", "path_following?method=los")
    assert "LOS" in other.describe("guidance").description
    with pytest.raises(uuv.UuvsimError, match=r"there is no model 'lqg' \(did you mean lqr"):
        system.replace("controller", "lqg")


@pytest.mark.parametrize("name", ["bluerov2_hold", "bluerov2_survey"])
def test_every_controller_guidance_and_allocation_fits_the_shipped_systems(name: str) -> None:
    system = uuv.load(name)
    for slot, sources in {
        "controller": ("pid", "lqr", "feedback_linearisation", "backstepping", "sliding_mode",
                       "mpc", "mpc_ipopt"),
        "guidance": ("path_following", "path_following?method=ilos", "trajectory"),
        "allocation": ("allocation_qp",),
    }.items():  # fmt: skip
        for source in sources:
            flatten(system.replace(slot, source))
