"""Tethys against what LRAUV's system tests assert: accelerating, diving, released nose-up, shifted.

Hull, propeller and fins are stepped one after the other at 20 ms, each with the others' outputs of
the communication point before, as a master does by default (Jacobi).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.models.checks.comparison import Checked, compared, reference_values
from uuvsim_cosim.models.checks.compiled_run import outputs_by_name, prepared
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.model import Model

__all__ = ["mass_forward", "tethys"]

Array = NDArray[np.float64]
N_MAX = 47.1238898038  # rad/s, of the shipped propeller
H = 0.02
EQUAL = partial(compared, "lrauv", "tethys_lrauv@tethys_gazebo")


def tethys() -> Iterator[Checked]:
    """Yield each assertion; where they bound a value on one side, `off` is how far it is beyond."""
    case = reference_values("published_checks.yaml")["lrauv"]
    ahead, action = case["forward_300rpm"], case["propeller_action"]
    eta, nu = _driven(ahead["omega_rad_s"] / N_MAX, 0.0)
    speed = nu[-1, 0]
    what = "speed after 45 s at 300 rpm, with fins"
    yield EQUAL(what, speed, ahead["speed_mps"], ahead["tol"])
    yield EQUAL(f"{what} (their second test)", speed, action["speed_mps"], action["tol"])
    yield EQUAL("heave meanwhile", nu[-1, 2], 0.0, ahead["abs_w_max"])
    yield EQUAL("depth meanwhile", eta[-1, 2], -action["z"], action["tol_z"])
    yield EQUAL("roll meanwhile", eta[-1, 3], 0.0, action["roll_tol"])
    yield EQUAL("pitch and yaw meanwhile", eta[-1, 4:], [0, 0], action["pitch_yaw_tol"])
    eta, _ = _driven(ahead["omega_rad_s"] / N_MAX, case["elevator"]["angle_rad"])
    beyond = [max(eta[-1, 4], 0.0), max(1.5 - eta[-1, 2], 0.0), max(-0.01 - eta[:, 2].min(), 0.0)]
    what = "elevator: nose down, deeper than 1.5 m, never above 0.01 m"
    yield EQUAL(what, beyond, [0, 0, 0], 1e-9)
    start = case["restoring"]
    hull = _Part(declare("tethys_lrauv", surface=False),
                 {"eta_0": [0, 0, 10, 0, start["pitch0_rad"], 0]})  # fmt: skip
    rows = _stepped(hull.start, 1200, lambda x: hull.step(x, {}, 0.05)[0], hull.of("eta"))
    pitch, drift = rows[:, 4], np.abs(np.diff(rows[:, :2], axis=0)).max()
    beyond = [max(np.abs(pitch).max() - start["max_pitch_ever"], 0.0), max(pitch.min(), 0.0)]
    what = "released nose-up, it swings through level and never beyond"
    yield EQUAL(what, beyond, [0, 0], 1e-9)
    yield EQUAL("drift per step meanwhile", drift, 0.0, start["xy_drift_per_step"])


def mass_forward() -> Iterator[Checked]:
    """Yield its mass 1 cm forward for 60 s: the nose goes below -0.15 rad."""
    case = reference_values("published_checks.yaml")["lrauv"]["mass_shifter"]
    shifter = _Part(declare("ballast"))
    hull = _Part(declare("tethys_lrauv", surface=False), {"eta_0": [0, 0, 10, 0, 0, 0]})
    n, h = len(hull.start), 0.05

    def step(s: Any) -> Any:
        x, eta = hull.step(s[:n], {"tau": s[-6:]}, h)[0], hull.of("eta")(s[:n])
        y, moved = shifter.step(s[n:-6], {"x_d": case["shift_m"], "eta": eta}, h)
        return ca.vertcat(x, y, moved["tau"])

    start = np.r_[hull.start, shifter.start, np.zeros(6)]
    pitch = _stepped(start, round(60 / h), step, lambda s: hull.of("eta")(s[:n]))[:, 4]
    beyond = max(float(pitch.min()) + case["pitch_reached_rad"], 0.0)
    yield EQUAL("mass 1 cm forward: nose below -0.15 rad", beyond, 0.0, 1e-9)


def _driven(u: float, elevator: float) -> tuple[Array, Array]:
    """Return eta and nu (n, 6) of 45 s with propeller and fins, from rest at 0.5 m."""
    hull = _Part(declare("tethys_lrauv", surface=False), {"eta_0": [0, 0, 0.5, 0, 0, 0]})
    fins = _Part(declare("fins", vehicle="tethys_lrauv", contact=True))
    propeller = _Part(declare("propeller", vehicle="tethys_lrauv"))
    parts = (hull, fins, propeller)
    a, b, c = np.cumsum([len(part.start) for part in parts])

    def step(s: Any) -> Any:
        tau, pushed, nu_r = s[c : c + 6], s[c + 6 : c + 12], s[c + 12 : c + 18]
        x, of_hull = hull.step(s[:a], {"tau": tau}, H)
        given = {"u": ca.DM([0, elevator]), "nu_r": nu_r, "contact": pushed}
        y, of_fins = fins.step(s[a:b], given, H)
        z, of_propeller = propeller.step(s[b:c], {"u": u, "nu_r": nu_r}, H)
        return ca.vertcat(x, y, z, of_fins["tau"], of_propeller["tau"], of_hull["nu_r"])

    start = np.r_[hull.start, fins.start, propeller.start, np.zeros(18)]
    outputs = lambda s: ca.vertcat(hull.of("eta")(s[:a]), hull.of("nu")(s[:a]))  # noqa: E731
    table = _stepped(start, round(45 / H), step, outputs)
    return table[:, :6], table[:, 6:]


def _stepped(
    start: Array, n: int, step: Callable[[Any], Any], outputs: Callable[[Any], Any]
) -> Array:
    """Return the outputs after each of n steps, as one CasADi function."""
    s = ca.SX.sym("s", len(start))
    run = ca.Function("step", [s], [step(s)]).mapaccum(n)(start)
    return np.array(ca.Function("outputs", [s], [outputs(s)]).map(n)(run)).T


class _Part:
    """A model without clocks, one step of it as an expression of its state and its inputs."""

    def __init__(self, model: Model, parameters: dict[str, Any] | None = None) -> None:
        self.model = model
        self.f, self.p, self.d, self.start = prepared(model, parameters)

    def step(self, x: Any, inputs: dict[str, Any], h: float) -> tuple[Any, dict[str, Any]]:
        """Return the state a step of h [s] later, and the outputs there; inputs are held."""
        known = self.model.of_kind("input")
        u = ca.vertcat(*(ca.SX(inputs.get(v.name, np.asarray(v.start))) for v in known))
        x = self.f.rk4.call([0.0, h, u, u, u, self.p, self.d, x, []], True, False)[0]
        y = self.f.outputs.call([0.0, u, self.p, self.d, x, []], True, False)[0]
        return x, outputs_by_name(self.model, y)

    def of(self, output: str) -> Callable[[Any], Any]:
        """Return an output as a function of the state, inputs at their start values."""
        u = self.f.values_of("input", {})

        def value(x: Any) -> Any:
            y = self.f.outputs.call([0.0, u, self.p, self.d, x, []], True, False)[0]
            return outputs_by_name(self.model, y)[output]

        return value
