"""Faults and slew limits of actuators.

Faults are tunable parameters, so that a scenario, a tool or a script can change them at run time:

    stuck       1: the actuator holds the command that it has reached; 0: it follows the command
    health      factor of the thrust: 1 healthy, 0.4 weak, 0 lost, -1 wired with wrong polarity
    entangled   share of the shaft speed lost to a line around the shaft; the power is still drawn

Limits and `stuck` act on a servo state c in the command's unit,

    dc/dt = clip((u - c) / T_u, ±rate).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from uuvsim_cosim.models.declaration.expression import Number
from uuvsim_cosim.models.declaration.model import Model, is_on
from uuvsim_cosim.models.declaration.safe_math import saturate

__all__ = ["ThrusterFaults", "servo", "thruster_faults", "thruster_faults_of"]

T_U = 0.02  # s, of the servo that limits and faults need


@dataclass(frozen=True)
class ThrusterFaults:
    """The symbols of a thruster's faults; numbers where it has none."""

    stuck: Number = 0.0
    health: Number = 1.0
    entangled: Number = 0.0


def thruster_faults_of(m: Model, faults: bool | str) -> ThrusterFaults:
    """Declare the fault parameters of a thruster, if it has the option."""
    if not is_on("faults", faults):
        return ThrusterFaults()
    return ThrusterFaults(
        m.parameter("stuck", 0.0, unit="1", min=0, max=1, description="1 holds the command"),
        m.parameter(
            "health",
            1.0,
            unit="1",
            min=-1,
            max=1,
            description="factor of the thrust: 0 lost, 0.4 weak, -1 reversed",
        ),
        m.parameter(
            "entangled",
            0.0,
            unit="1",
            min=0,
            max=1,
            description="share of the speed that a line around the shaft takes",
        ),
    )


def servo(
    m: Model, u: ca.SX, limits: bool | str, faults: ThrusterFaults, rate: float = 5.0
) -> ca.SX:
    """Return the command after slew limit and `stuck`; u itself where it has neither option."""
    limited = is_on("limits", limits)
    if not limited and isinstance(faults.stuck, float):
        return u
    command = m.state("command", unit="1", description="the command as far as it went")
    change = (u - command) / T_U
    if limited:
        rate_max = m.parameter(
            "rate_max", rate, unit="1/s", min=0, description="fastest change of u (assumption)"
        )
        change = saturate(change, rate_max)
    m.der(command, (1.0 - faults.stuck) * change)
    return command


def thruster_faults(thrusters: int | str = 8) -> Model:
    """Weaken thrusters:  thrust_i = e_i thrust_in_i  from t_i on, and thrust_in_i before."""
    n = int(thrusters)
    m = Model("thruster_faults", f"{n} thrusters, each of which may grow weak or fail")
    given = m.input("thrust_in", n, unit="N", description="as healthy thrusters give it")
    e = m.parameter(
        "efficiency", (1.0,) * n, (n,), unit="1", min=0, max=2, description="0: fails; 1: whole"
    )
    t = m.parameter("t", (0.0,) * n, (n,), unit="s", description="when each changes")
    now = ca.vertcat(*(ca.if_else(m.t >= t[i], e[i], 1.0) for i in range(n)))
    m.output("thrust", now * given, unit="N", description="as it reaches the hull")
    m.output("health", now, unit="1", description="share of the thrust that is left")
    return m
