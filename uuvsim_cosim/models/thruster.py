"""Thrusters: a first-order shaft, and thrust that follows its speed.

Both take the command u in [-1, 1] and the supply's voltage, so that either can stand in for the
other. Flow past the propeller is left out: thrust is bollard pull.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from uuvsim_cosim.models.bench import read_bench
from uuvsim_cosim.models.model import Model
from uuvsim_cosim.models.safe_math import abs_, saturate
from uuvsim_cosim.models.table import table2
from uuvsim_cosim.models.vectors import NU

__all__ = ["ThrusterParameters", "thruster", "thruster_t200"]


@dataclass(frozen=True)
class ThrusterParameters:
    """What a thruster with quadratic thrust is described by."""

    n_max: float  # rad/s, shaft speed at u = 1
    T_n: float  # s, time constant of the shaft
    K_n: float  # N.s2/rad2, thrust of |n| n
    K_P: float  # W.s3/rad3, electric power of |n|³


# T200 at 16 V full forward: 3533 rpm, 51.485 N, 23.83 A (models/thrusters/t200/bench.yaml).
T200_AT_16_V = ThrusterParameters(n_max=369.97, T_n=0.0287, K_n=3.7614e-4, K_P=7.529e-6)


def thruster(p: ThrusterParameters = T200_AT_16_V) -> Model:
    """First-order shaft, quadratic thrust:  dn/dt = (n_max u - n) / T_n,  thrust = K_n |n| n."""
    m = Model("thruster", "Thruster: first-order shaft, quadratic thrust", h_max=0.01)
    u, voltage = _inputs(m)
    n_max = m.parameter("n_max", p.n_max, unit="rad/s", min=0, description="shaft speed at u = 1")
    T_n = _time_constant(m, p.T_n)
    K_n = m.parameter("K_n", p.K_n, unit="N.s2/rad2", description="thrust = K_n |n| n")
    K_P = m.parameter("K_P", p.K_P, unit="W.s3/rad3", description="power = K_P |n|^3")
    n = m.state("shaft", unit="rad/s", description="shaft speed")
    m.der(n, (n_max * saturate(u, 1.0) - n) * m.derived("rate", 1.0 / T_n))
    return _outputs(m, K_n * abs_(n) * n, n, K_P * abs_(n) * n * n / voltage)


def thruster_t200() -> Model:
    """Blue Robotics T200 from its bench rows at 12 and 16 V, linear between rows and voltages.

    dn/dt = (n_d(u, voltage) - n) / T_n,  thrust = f(n, voltage),  current = i(u, voltage).
    In steady state each bench row comes back exactly; the dead band is that of the rows.
    Voltages outside the bench's range count as its edge.
    """
    bench = read_bench("t200")
    m = Model("thruster_t200", "Blue Robotics T200 thruster from bench rows", h_max=0.01)
    u, voltage = _inputs(m)
    T_n = _time_constant(m, bench.T_n)
    u_grid, n_rows = bench.over_u(bench.n)
    _, current_rows = bench.over_u(bench.current)
    n_grid, thrust_rows = bench.thrust_over_n()
    n_d = table2(list(u_grid), bench.voltage, n_rows.tolist())
    current = table2(list(u_grid), bench.voltage, current_rows.tolist())
    thrust = table2(list(n_grid), bench.voltage, thrust_rows.tolist())
    n = m.state("shaft", unit="rad/s", description="shaft speed; its sign is the thrust's")
    m.der(n, (n_d(u, voltage) - n) * m.derived("rate", 1.0 / T_n))
    return _outputs(m, thrust(n, voltage), n, current(u, voltage))


def _inputs(m: Model) -> tuple[Any, Any]:
    u = m.input("u", unit="1", min=-1, max=1, description="command; (pwm - 1500 us) / 400 us")
    voltage = m.input("voltage", unit="V", start=16.0, description="of the supply")
    m.input("nu_r", 6, unit=NU, description="unused: thrust is bollard pull")
    return u, voltage


def _time_constant(m: Model, value: float) -> Any:
    return m.parameter(
        "T_n", value, unit="s", min=4e-3, description="time constant of the shaft (assumption)"
    )


def _outputs(m: Model, thrust: Any, n: Any, current: Any) -> Model:
    m.output("thrust", thrust, unit="N", description="along the thruster's direction e")
    m.output("n", n, unit="rad/s", description="shaft speed")
    m.output("current", current, unit="A", description="drawn from the supply")
    return m
