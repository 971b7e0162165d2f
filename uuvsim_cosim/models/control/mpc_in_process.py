"""Model predictive control as a Python component: what `mpc.py` declares, with a choice of solver.

It runs in this process and is neither exported nor fused; ipopt, which cannot be, solves here.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.control.control_law import nominal_matrices
from uuvsim_cosim.models.control.mpc import PRESET, Q_UNITS, S_UNITS
from uuvsim_cosim.models.control.mpc_problem import Programme, Solver, packed, programme, solver
from uuvsim_cosim.models.declaration.files_read import shared_until_changed
from uuvsim_cosim.models.declaration.kinematics import R_zyx
from uuvsim_cosim.models.declaration.model import Units
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.vectors import ETA, NU, TAU

__all__ = ["MPC", "IpoptMPC"]

Array = NDArray[np.float64]
_preset = preset("controllers", PRESET, "controller")


@shared_until_changed
def _made(vehicle: str, N: int, h: float, kind: Solver) -> tuple[Programme, ca.Function, Array]:
    of = programme(vehicle, N, h)
    return of, solver(of, kind), np.array(nominal_matrices(vehicle)["M"])


class MPC:
    """MPC of a vehicle (sqpmethod with qrqp); for another one, derive and set `vehicle`.

    Parameters are those of the declaration, in its units.
    """

    vehicle: ClassVar[str] = "bluerov2_heavy"
    N: ClassVar[int] = 10
    h: ClassVar[float] = 0.1  # s, a step of the horizon, and the time between two solutions
    solver: ClassVar[Solver] = "sqpmethod"
    inputs: ClassVar[Mapping[str, tuple[int, Units]]] = {
        "eta_d": (6, ETA),
        "nu_d": (6, NU),
        "eta": (6, ETA),
        "nu": (6, NU),
    }
    outputs: ClassVar[Mapping[str, tuple[int, Units]]] = {"tau_d": (6, TAU)}
    parameters: ClassVar[Mapping[str, tuple[object, str | None]]] = {
        "Q": (_preset.vector("Q", Q_UNITS, 12), None),
        "S": (_preset.vector("S", S_UNITS, 6), None),
        "tau_max": (_preset.vector("tau_max", TAU, 6), None),
        "b_max": (_preset.vector("b_max", TAU, 6), None),
        "b_gain": (_preset.number("b_gain", "1"), "1"),
    }
    Q: Array
    S: Array
    tau_max: Array
    b_max: Array
    b_gain: float

    def __init__(self) -> None:
        self._next = 0  # number of the next solution
        self._tau = np.zeros(6)
        self._b = np.zeros(6)
        self._plan: Array = np.zeros(6 * self.N)
        self._predicted: Array | None = None

    def step(self, t: float, dt: float, u: Mapping[str, Array]) -> dict[str, Array]:
        """Return the force of the latest solution; solve anew when h has passed."""
        if t >= self._next * self.h - 1e-9:
            self._solve(u)
            self._next = int(np.floor(t / self.h + 1e-9)) + 1
        return {"tau_d": self._tau}

    def _solve(self, u: Mapping[str, Array]) -> None:
        of, solve, M = _made(self.vehicle, self.N, self.h, self.solver)
        eta, nu = np.asarray(u["eta"]), np.asarray(u["nu"])
        R = np.array(ca.DM(ca.evalf(R_zyx(*(ca.SX(float(a)) for a in eta[3:])))))
        if self._predicted is not None:
            wrong = self.b_gain * M @ (nu - self._predicted) / self.h
            learnt = self._b + np.concatenate([R @ wrong[:3], wrong[3:]])
            self._b = np.clip(learnt, -np.asarray(self.b_max), self.b_max)
        x = np.concatenate([eta, nu])
        data = packed(x, u["eta_d"], u["nu_d"], self._b, self._tau, self.Q, self.S)
        limit = np.tile(self.tau_max, self.N)
        guess = np.clip(np.concatenate([self._plan[6:], self._plan[-6:]]), -limit, limit)
        found = np.array(solve(x0=guess, p=data, lbx=-limit, ubx=limit)["x"]).ravel()
        if not np.all(np.isfinite(found)):
            raise InputInvalid(
                "mpc",
                (
                    f"the programme has no solution at eta = {eta.round(3).tolist()}, "
                    f"nu = {nu.round(3).tolist()}"
                ),
                "finite values near those of the vehicle",
            )
        self._plan, self._tau = found, np.asarray(found[:6])
        self._predicted = np.array(of.step(x, found[:6], self._b)).ravel()[6:]


class IpoptMPC(MPC):
    """The same, solved to convergence by ipopt: ten times slower."""

    solver: ClassVar[Solver] = "ipopt"
