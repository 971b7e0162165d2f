"""A thruster whose thrust is the momentum of its jet, by its volume flow."""

from __future__ import annotations

import math

import casadi as ca

from uuvsim_cosim.models.actuators.faults import servo, thruster_faults_of
from uuvsim_cosim.models.actuators.thruster_set import of_vehicle
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.safe_math import abs_, saturate
from uuvsim_cosim.models.declaration.vectors import NU

__all__ = ["largest_thrust", "thruster_jet"]


@of_vehicle
def thruster_jet(
    id: str = "pool8_jet", limits: bool | str = False, faults: bool | str = False
) -> Model:
    """Declare  dQ/dt = (Q_max u - Q) / T_Q,  thrust = rho |Q| Q / A,  A = pi d_jet² / 4.

    Momentum theory for a jet far behind the propeller, at bollard pull. Its power is
    rho |Q|³ / (2 A²); eta_P of the electric power becomes that. `limits` and `faults`: faults.py.
    """
    p = preset("thrusters", id, "thruster")
    m = Model("thruster_jet", "Thruster: first-order volume flow, thrust of its jet", h_max=0.02)
    u = m.input("u", unit="1", min=-1, max=1, description="command")
    voltage = m.input("voltage", unit="V", start=12.0, description="of the supply, for its current")
    m.input("nu_r", 6, unit=NU, description="unused: thrust is bollard pull")

    def declared(name: str, unit: str, least: float, words: str) -> ca.SX:
        return m.parameter(name, p.number(name, unit), unit=unit, min=least, description=words)

    Q_max = declared("Q_max", "m3/s", 0.0, "volume flow at u = 1")
    d_jet = declared("d_jet", "m", 1e-4, "diameter of the jet (assumption)")
    rho = declared("rho", "kg/m3", 0.0, "density of the water")
    T_Q = declared("T_Q", "s", 1e-2, "time constant of the flow (assumption)")
    eta_P = declared("eta_P", "1", 1e-3, "jet power over electric power (assumption)")
    k = m.derived("k", 4.0 * rho / (math.pi * d_jet * d_jet))
    k_P = m.derived("k_P", 8.0 * rho / (math.pi**2 * d_jet**4 * eta_P))

    Q = m.state("Q", unit="m3/s", description="volume flow; its sign is the thrust's")
    f = thruster_faults_of(m, faults)
    wanted = Q_max * servo(m, saturate(u, 1.0), limits, f)
    if not isinstance(f.entangled, float):
        wanted = (1.0 - f.entangled) * wanted
    m.der(Q, (wanted - Q) / T_Q)
    thrust = k * abs_(Q) * Q
    if not isinstance(f.health, float):
        thrust = f.health * thrust
    m.output("thrust", thrust, unit="N", description="along the thruster's direction e")
    m.output("flow", Q, unit="m3/s", description="volume flow")
    power = k_P * abs_(Q) * Q * Q
    m.output("current", power / voltage, unit="A", description="drawn from the supply")
    return m


def largest_thrust(id: str = "pool8_jet") -> float:
    """Return the steady thrust at u = 1 [N]."""
    p = preset("thrusters", id, "thruster")
    Q, d = p.number("Q_max", "m3/s"), p.number("d_jet", "m")
    return p.number("rho", "kg/m3") * Q * Q / (0.25 * math.pi * d * d)
