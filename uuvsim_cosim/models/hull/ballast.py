"""Variable ballast and a moving mass: weight that is pumped in or out, and weight that is shifted.

    dV/dt = clip((V_d - V) / T, ±V_rate),     dx/dt = clip((x_d - x) / T, ±x_rate)
    f = rho g (V_0 - V) down  at r_V,         m = m_s g (x - x_0) e_s x down

V is the volume that an external bladder displaces: a larger volume lifts the hull. The hull's own
weight includes the mass at x_0, so only the effect of its shift from x_0 is added. Both are the
actuators of a glider: its buoyancy engine, and the battery that sets its pitch. Both are
quasi-static: their effect on M and the reaction to their acceleration are neglected (both are of
second order in their size).
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.kinematics import R, q_of_euler
from uuvsim_cosim.models.declaration.model import Model, is_on
from uuvsim_cosim.models.declaration.preset import Preset, preset
from uuvsim_cosim.models.declaration.safe_math import clip, saturate
from uuvsim_cosim.models.declaration.vectors import ETA, TAU

__all__ = ["ballast", "read_ballast"]

_FIGURES = {
    "V_0": ("m3", 0.0, "volume at which the hull has its own buoyancy"),
    "V_min": ("m3", 0.0, "least volume"),
    "V_max": ("m3", 0.0, "largest volume"),
    "V_rate": ("m3/s", 0.0, "fastest change of volume"),
    "m_s": ("kg", 0.0, "mass that moves"),
    "x_0": ("m", None, "place at which the hull has its own centre of gravity"),
    "x_max": ("m", 0.0, "largest distance from x_0"),
    "x_rate": ("m/s", 0.0, "fastest shift"),
    "T": ("s", 0.02, "time constant of both servos (assumption)"),
    "rho": ("kg/m3", 0.0, "density of the water"),
    "g": ("m/s2", 0.0, "acceleration of gravity"),
}


def ballast(
    id: str = "tethys_lrauv", contact: bool | str = False, stratified: bool | str = False
) -> Model:
    """Declare both, by the figures of the vehicle `id`: its folder/ballast.yaml, or a path.

    With `contact` an input of that name is added to the generalised force. `stratified` adds the
    input density, of the water at the hull (`water_column`).
    """
    figures = read_ballast(id)
    m = Model("ballast", "Variable ballast and moving mass: slow trim in depth and pitch")
    V_d = m.input("V_d", unit="m3", start=figures.number("V_0", "m3"), description="wanted volume")
    x_d = m.input("x_d", unit="m", description="wanted place of the mass along its rail")
    eta = m.input("eta", 6, unit=ETA, description="of the hull")
    p: dict[str, ca.SX] = {
        name: m.parameter(name, figures.number(name, unit), unit=unit, min=low, description=words)
        for name, (unit, low, words) in _FIGURES.items()
    }
    r_V = m.parameter(
        "r_V", figures.vector("r_V", "m", 3), unit="m", description="the bladder from CO in b"
    )
    e_s = m.parameter("e_s", (1, 0, 0), unit="1", description="direction of the rail in b")
    V = m.state("bladder", p["V_0"], unit="m3", description="volume of the bladder")
    x = m.state("place", p["x_0"], unit="m", description="of the mass along its rail")
    V_goal = clip(V_d, p["V_min"], p["V_max"])
    x_goal = p["x_0"] + saturate(x_d - p["x_0"], p["x_max"])
    m.der(V, saturate((V_goal - V) / p["T"], p["V_rate"]))
    m.der(x, saturate((x_goal - x) / p["T"], p["x_rate"]))

    down = R(q_of_euler(eta[3], eta[4], eta[5]))[2, :].T
    rho = p["rho"]
    if is_on("stratified", stratified):
        rho = m.input(
            "density",
            unit="kg/m3",
            start=figures.number("rho", "kg/m3"),
            min=0.0,
            description="of the water at the hull",
        )
    lift = rho * p["g"] * (p["V_0"] - V) * down
    turn = p["m_s"] * p["g"] * (x - p["x_0"]) * ca.cross(e_s, down)
    tau = ca.vertcat(lift, ca.cross(r_V, lift) + turn)
    if is_on("contact", contact):
        tau += m.input("contact", 6, unit=TAU, description="of others, about CO in b, added")
    m.output("tau", tau, unit=TAU, description="X Y Z [N], K M N [N.m] in b")
    m.output("volume", V, unit="m3", description="of the bladder")
    m.output("shift", x, unit="m", description="place of the mass along its rail")
    return m


def read_ballast(id: str) -> Preset:
    """Read the figures of a vehicle, or of a file; raises ParameterInvalid with each mistake."""
    file = preset("vehicles", id, "ballast")
    for name, (unit, low, _) in _FIGURES.items():
        value = file.number(name, unit)
        if low is not None and not value >= low:
            raise ParameterInvalid(f"{file.path}: {name}", f"{value:g} {unit}", f"at least {low:g}")
    file.vector("r_V", "m", 3)
    file.complete()
    return file
