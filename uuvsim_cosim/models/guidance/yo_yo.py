"""Yo-yo mission of a glider: it dives and climbs between two depths on a heading.

The glider descends until D_bottom, then climbs until D_top, `yos` times; it then keeps climbing.
In each phase, the buoyancy engine has one volume, and the moving mass one place, which a slow
integral action corrects after the turn:

    dx/dt = k_x (theta - theta_d),  theta_d = -pitch in a descent, +pitch in a climb

It is sampled, as the flight computer of a glider is: once in a cycle of 4 s. The rudder turns to
delta = -k_psi (psi_d - psi) + k_r r, right-handed about z.
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.safe_math import saturate, wrap
from uuvsim_cosim.models.declaration.vectors import ETA, NU

__all__ = ["yo_yo"]


def yo_yo(period: str = "4") -> Model:
    """Declare the mission: volume, place of the mass and rudder of depth, pitch and heading."""
    m = Model("yo_yo", "Yo-yo mission of a glider between two depths", h_max=10.0)
    eta = m.input("eta", 6, unit=ETA, description="of the hull")
    nu = m.input("nu", 6, unit=NU, description="of the hull")
    p = {
        name: m.parameter(name, value, unit=unit, min=low, description=words)
        for name, value, unit, low, words in (
            ("D_top", 4.0, "m", 0.0, "depth at which it begins to dive"),
            ("D_bottom", 40.0, "m", 0.0, "depth at which it begins to climb"),
            ("yos", 3.0, "1", 0.0, "number of dives; after them it climbs on"),
            ("V_dive", 2.4e-6, "m3", 0.0, "volume of the buoyancy engine in a descent"),
            ("V_climb", 4.625e-4, "m3", 0.0, "volume of the buoyancy engine in a climb"),
            ("x_dive", 0.0092, "m", None, "place of the moving mass in a descent, at first"),
            ("x_climb", 0.0017, "m", None, "place of the moving mass in a climb, at first"),
            ("pitch", 0.384, "rad", 0.0, "wanted size of the pitch"),
            ("k_x", 5e-5, "m/(rad.s)", 0.0, "integral gain of the pitch"),
            ("x_range", 0.02, "m", 0.0, "largest correction of the place"),
            ("settling", 40.0, "s", 0.0, "time after a turn without correction"),
            ("psi_d", 0.0, "rad", None, "wanted heading"),
            ("k_psi", 0.5, "1", 0.0, "rudder of the error of heading"),
            ("k_r", 1.0, "s", 0.0, "rudder of the yaw rate"),
        )
    }
    clock = m.clock("cycle", period)
    T = float(clock.period)
    climbs = m.discrete("phase", 0.0, unit="1", description="0: it dives, 1: it climbs")
    turns = m.discrete("turns", 0.0, unit="1", description="descents that have ended")
    since = m.discrete("since", 0.0, unit="s", description="time since the last turn")
    x_down = m.discrete("x_down", 0.0, unit="m", description="correction in descents")
    x_up = m.discrete("x_up", 0.0, unit="m", description="correction in climbs")
    rudder = m.discrete("rudder", 0.0, unit="rad", description="deflection")

    up = climbs > 0.5
    at_bottom = ca.logic_and(ca.logic_not(up), eta[2] >= p["D_bottom"])
    at_top = ca.logic_and(up, ca.logic_and(eta[2] <= p["D_top"], turns + 0.5 < p["yos"]))
    m.update(clock, climbs, ca.if_else(at_bottom, 1.0, ca.if_else(at_top, 0.0, climbs)))
    m.update(clock, turns, turns + ca.if_else(at_bottom, 1.0, 0.0))
    m.update(clock, since, ca.if_else(ca.logic_or(at_bottom, at_top), 0.0, since + T))
    error = eta[4] - ca.if_else(up, p["pitch"], -p["pitch"])
    move = ca.if_else(since > p["settling"], T * p["k_x"] * error, 0.0)
    m.update(clock, x_down, ca.if_else(up, x_down, saturate(x_down + move, p["x_range"])))
    m.update(clock, x_up, ca.if_else(up, saturate(x_up + move, p["x_range"]), x_up))
    m.update(clock, rudder, p["k_r"] * nu[5] - p["k_psi"] * wrap(p["psi_d"] - eta[5]))

    m.output(
        "V_d",
        ca.if_else(up, p["V_climb"], p["V_dive"]),
        unit="m3",
        discrete=True,
        description="wanted volume of the buoyancy engine",
    )
    m.output(
        "x_d",
        ca.if_else(up, p["x_climb"] + x_up, p["x_dive"] + x_down),
        unit="m",
        discrete=True,
        description="wanted place of the moving mass",
    )
    m.output("delta_d", rudder, unit="rad", discrete=True, description="wanted rudder")
    m.output("climbs", climbs, unit="1", discrete=True, description="0: it dives, 1: it climbs")
    m.output("dives", turns, unit="1", discrete=True, description="descents that have ended")
    return m
