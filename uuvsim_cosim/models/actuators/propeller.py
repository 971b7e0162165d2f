"""A propeller in the flow: thrust and torque fall with the speed of advance, in four quadrants.

    dn/dt = (n_max u - n) / T_n,      V_a = (1 - w) (v_r + omega x r)·e
    thrust = (1 - t) (T_nn |n| n - T_nV |n| V_a),      torque = Q_nn |n| n - Q_nV |n| V_a

(Fossen 2021, 2nd ed., chapter 9: K_T and K_Q linear in the advance ratio J = 2 pi V_a / (n D)).
With T_nV = 0 it is bollard pull. w is the wake fraction, t the thrust deduction: the propeller
lowers the pressure at the stern. The torque on the hull is -torque about e, for a propeller that
turns right-handed about e when it pushes ahead; `Q_nn` is negative for a left-handed propeller, and
zero for a contra-rotating pair.

Options, off by default: `limits` and `faults` (faults.py), and `ventilation`. With the centre of
the propeller at the depth h, and its radius R, ventilation multiplies thrust and torque by

    0 below h/R = -0.48,   1 - 0.675 (1 - 0.769 h/R)^1.258,   1 above h/R = 1.3

(attributed to Minsaas, Faltinsen and Persson 1983, in Smogeli 2006, Control of Marine Propellers.
The four figures were not checked against either source; the curve meets 0 and 1 at its two ends
within 0.003).
"""

from __future__ import annotations

from pathlib import Path

import casadi as ca

from uuvsim_cosim.errors import InputInvalid, ParameterInvalid, Problem
from uuvsim_cosim.models.actuators.faults import servo, thruster_faults_of
from uuvsim_cosim.models.actuators.thruster_geometry import thruster_geometry
from uuvsim_cosim.models.declaration.kinematics import R, q_of_euler
from uuvsim_cosim.models.declaration.model import Model, is_on
from uuvsim_cosim.models.declaration.parameter_files import vehicle_folder
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.safe_math import abs_, clip, saturate
from uuvsim_cosim.models.declaration.vectors import ETA, NU, TAU

__all__ = ["propeller"]

_FIGURES = {
    "n_max": ("rad/s", 0.0, "shaft speed at u = 1"),
    "T_n": ("s", 4e-3, "time constant of the shaft"),
    "T_nn": ("N.s2/rad2", 0.0, "thrust = T_nn |n| n at rest"),
    "T_nV": ("N.s2/(m.rad)", 0.0, "loss of thrust with the speed of advance"),
    "Q_nn": ("N.m.s2/rad2", None, "torque = Q_nn |n| n at rest"),
    "Q_nV": ("N.m.s2/(m.rad)", None, "loss of torque with the speed of advance"),
    "w": ("1", 0.0, "wake fraction"),
    "t": ("1", 0.0, "thrust deduction"),
    "eta_P": ("1", 1e-3, "shaft power over electric power"),
}


def propeller(
    vehicle: str = "remus100",
    number: int | str = 1,
    limits: bool | str = False,
    faults: bool | str = False,
    ventilation: bool | str = False,
) -> Model:
    """Declare propeller `number` of a vehicle: folder/propeller.yaml, place in thrusters.yaml."""
    geometry = thruster_geometry(vehicle)
    i, n_all = int(number), len(geometry.names)
    if not 1 <= i <= n_all:
        raise InputInvalid(f"propeller {i} of {vehicle}", f"1 to {n_all}")
    figures = read_propeller(vehicle_folder(vehicle) / "propeller.yaml")
    m = Model("propeller", f"Propeller {geometry.names[i - 1]!r} of {vehicle}", h_max=0.01)
    u = m.input("u", unit="1", min=-1, max=1, description="command: shaft speed over n_max")
    voltage = m.input("voltage", unit="V", start=24.0, description="of the supply, for its current")
    nu_r = m.input("nu_r", 6, unit=NU, description="of the hull, relative to the water")
    r = m.parameter("r", geometry.r[i - 1], unit="m", description="position from CO in b")
    e = m.parameter("e", geometry.e[i - 1], unit="1", description="direction of thrust in b")
    p = {
        name: m.parameter(name, figures[name], unit=unit, min=low, description=words)
        for name, (unit, low, words) in _FIGURES.items()
    }
    f = thruster_faults_of(m, faults)
    n_d = (1.0 - f.entangled) * (p["n_max"] * servo(m, saturate(u, 1.0), limits, f))
    n = m.state("shaft", unit="rad/s", description="shaft speed")
    m.der(n, (n_d - n) / p["T_n"])
    V_a = (1.0 - p["w"]) * ca.dot(nu_r[:3] + ca.cross(nu_r[3:], r), e)
    thrust = (1.0 - p["t"]) * (p["T_nn"] * abs_(n) * n - p["T_nV"] * abs_(n) * V_a)
    torque = p["Q_nn"] * abs_(n) * n - p["Q_nV"] * abs_(n) * V_a
    thrust, torque = f.health * thrust, abs_(f.health) * torque
    if is_on("ventilation", ventilation):
        eta = m.input("eta", 6, start=(0, 0, 5, 0, 0, 0), unit=ETA, description="of the hull")
        R_p = m.parameter(
            "R_p",
            0.07,
            unit="m",
            min=1e-3,
            description="radius of the propeller (REMUS: 0.14 m across)",
        )
        down = R(q_of_euler(eta[3], eta[4], eta[5]))[2, :].T
        h = (eta[2] + ca.dot(r, down)) / R_p
        # Not checked against the source: see the top of this file.
        lost = 0.675 * ca.exp(1.258 * ca.log(1.0 - 0.769 * clip(h, -0.48, 1.3)))
        share = ca.if_else(h >= 1.3, 1.0, clip(1.0 - lost, 0.0, 1.0))
        thrust, torque = share * thrust, share * torque
    force = thrust * e
    m.output("thrust", thrust, unit="N", description="along the direction e")
    m.output("n", n, unit="rad/s", description="shaft speed")
    m.output(
        "current",
        abs_(torque * n) / (p["eta_P"] * voltage),
        unit="A",
        description="drawn from the supply",
    )
    m.output("torque", torque, unit="N.m", description="of the shaft; the hull takes its opposite")
    m.output(
        "tau",
        ca.vertcat(force, ca.cross(r, force) - torque * e),
        unit=TAU,
        description="X Y Z [N], K M N [N.m] in b",
    )
    return m


def read_propeller(path: Path) -> dict[str, float]:
    """Read a propeller's figures, in SI; raises ParameterInvalid with the line of every mistake."""
    file = preset("vehicles", str(path), "propeller")
    found: dict[str, float] = {}
    problems: list[Problem] = []
    for name, (unit, _, _) in _FIGURES.items():
        try:
            found[name] = file.number(name, unit)
        except ParameterInvalid as error:
            problems += error.problems
    try:
        file.complete()
    except ParameterInvalid as error:
        problems += error.problems
    if problems:
        raise ParameterInvalid.of(problems)
    return found
