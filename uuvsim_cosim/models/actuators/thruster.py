"""Thrusters: a shaft, first-order unless chosen otherwise, and thrust that follows its speed.

All take the command u in [-1, 1] and the supply's voltage, so that each can stand in for another:
`thruster` has a quadratic thrust, `thruster_t200` the rows of a bench, and the thrust of
`thruster_jet` is the momentum of its jet. Flow past the propeller is left out: thrust is bollard
pull. Options, all off by default: `shaft` and `curve` (below), `dead_band` of the command,
`limits` of its rate, `faults` (faults.py), `scale` of a table, and `vehicle` with `number`
(thruster_geometry.py).

Shafts: five models of how the speed n follows the commanded speed n_d.

first    dn/dt = (n_d - n) / T_n
second   d²n/dt² = omega_n² (n_d - n) - 2 zeta omega_n dn/dt
third    n = (b_1 s + a_0) / (s³ + a_2 s² + a_1 s + a_0) n_d: identified for the T200 (von Benzon
         et al. 2022, An Open-Source Benchmark Simulator, J. Mar. Sci. Eng. 10(12), 1898)
yoerger  dn/dt = alpha (|n_d| n_d - |n| n): torque against the propeller's own drag (Yoerger,
         Cooke and Slotine 1990, IEEE J. Oceanic Eng. 15(3), 167-178)
bessa    J dn/dt = k_t / R_m (u V - k_t n) - k_v |n| n: a motor at a voltage that may sag
         (Bessa, Dutra and Kreuzer 2006, with the motor's equation for its lumped constants)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.actuators.bench_rows import read_bench
from uuvsim_cosim.models.actuators.faults import ThrusterFaults, servo, thruster_faults_of
from uuvsim_cosim.models.actuators.thruster_geometry import of_vehicle
from uuvsim_cosim.models.declaration.model import Model, is_on
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.safe_math import abs_, saturate
from uuvsim_cosim.models.declaration.vectors import NU
from uuvsim_cosim.models.intrinsics.table import table2

__all__ = [
    "SHAFTS",
    "ThrusterParameters",
    "largest_thrust",
    "thruster",
    "thruster_jet",
    "thruster_t200",
]


SHAFTS = ("first", "second", "third", "yoerger", "bessa")

FULL_PACK = 16.8  # V, four lithium-ion cells at 4.2 V
_ASSUMED = "assumption, a T200 at 16 V"
_PAIR = "the complex pair of von Benzon et al. (2022)"


@dataclass(frozen=True)
class ThrusterParameters:
    """Parameters of a thruster with quadratic thrust."""

    n_max: float  # rad/s, shaft speed at u = 1
    T_n: float  # s, time constant of the shaft
    K_n: float  # N.s2/rad2, thrust of |n| n
    K_P: float  # W.s3/rad3, electric power of |n|³


# T200 at 16 V full forward: 3533 rpm, 51.485 N, 23.83 A (models/thrusters/t200/bench.yaml).
T200_AT_16_V = ThrusterParameters(n_max=369.97, T_n=0.0287, K_n=3.7614e-4, K_P=7.529e-6)


@of_vehicle
def thruster(
    p: ThrusterParameters = T200_AT_16_V,
    shaft: str = "first",
    curve: str = "quadratic",
    dead_band: bool | str = False,
    limits: bool | str = False,
    faults: bool | str = False,
) -> Model:
    """First-order shaft, quadratic thrust:  dn/dt = (n_max u - n) / T_n,  thrust = K_n |n| n.

    curve="bessa" is a thrust with a dead zone in |n| n, unlike ahead and astern:
    c_r (|n| n - d_r) above d_r,  c_l (|n| n - d_l) below d_l,  0 between (Bessa et al. 2006).
    """
    if curve not in ("quadratic", "bessa"):
        raise InputInvalid(f"curve={curve!r}", "quadratic or bessa")
    m = Model("thruster", "Thruster: first-order shaft, quadratic thrust", h_max=0.01)
    u, voltage = _inputs(m)
    n_max = m.parameter("n_max", p.n_max, unit="rad/s", min=0, description="shaft speed at u = 1")
    T_n = _time_constant(m, p.T_n) if shaft == "first" else None
    K_n = None
    if curve == "quadratic":
        K_n = m.parameter("K_n", p.K_n, unit="N.s2/rad2", description="thrust = K_n |n| n")
    K_P = m.parameter("K_P", p.K_P, unit="W.s3/rad3", description="power = K_P |n|^3")
    f = thruster_faults_of(m, faults)
    c = _command(m, u, dead_band, limits, f)
    n_d, free = n_max * c, 1.0 - f.entangled
    n = _shaft_speed(m, shaft, free * n_d, T_n, free * c, voltage)
    power = free * (K_P * abs_(n) * n * n) + f.entangled * K_P * abs_(n_d) * n_d * n_d
    if K_n is not None:
        thrust = K_n * abs_(n) * n
    else:
        rows = "least squares of the T200's bench rows at 16 V"
        c_r = m.parameter("c_r", 3.786e-4, unit="N.s2/rad2", description=f"slope ahead ({rows})")
        d_r = m.parameter("d_r", 1459.0, unit="rad2/s2", min=0, description=f"dead zone ({rows})")
        c_l = m.parameter("c_l", 3.029e-4, unit="N.s2/rad2", description=f"slope astern ({rows})")
        d_l = m.parameter("d_l", -1749.0, unit="rad2/s2", max=0, description=f"dead zone ({rows})")
        x = abs_(n) * n
        behind = ca.if_else(x < d_l, c_l * (x - d_l), 0.0)
        thrust = ca.if_else(x > d_r, c_r * (x - d_r), behind)
    return _outputs(m, thrust, n, power / voltage, f)


@of_vehicle
def thruster_t200(
    shaft: str = "first",
    dead_band: bool | str = False,
    limits: bool | str = False,
    faults: bool | str = False,
    scale: bool | str = False,
    bench: str = "t200",
) -> Model:
    """Blue Robotics T200 from its bench rows, linear between rows and voltages.

    dn/dt = (n_d(u, voltage) - n) / T_n,  thrust = f(n, voltage),  current = i(u, voltage).
    In steady state each bench row comes back exactly; the dead band is that of the rows. With
    `scale` the thrust is k_T f(n, voltage), as of a propeller in a cage or a worn one.

    `bench` names the rows in models/thrusters: `t200` at 12 and 16 V, `t200_10_20v` at six
    voltages from 10 to 20 V. Above 16 V, up to the 16.8 V of a full pack of four cells, `t200`
    uses its rows at 16 V. A voltage beyond the range is refused where it is set. If the supply
    leaves the range during a run, the nearest rows are used; the run reports the value and the
    time. An FMU in another tool refuses a voltage above the range and reports the first one below.
    """
    rows = read_bench(bench)
    m = Model("thruster_t200", "Blue Robotics T200 thruster from bench rows", h_max=0.01)
    u, voltage = _inputs(m, rows.voltage)
    T_n = _time_constant(m, rows.T_n) if shaft == "first" else None
    u_grid, n_rows = rows.over_u(rows.n)
    _, current_rows = rows.over_u(rows.current)
    n_grid, thrust_rows = rows.thrust_over_n()
    n_d = table2(list(u_grid), rows.voltage, n_rows.tolist())
    current = table2(list(u_grid), rows.voltage, current_rows.tolist())
    thrust = table2(list(n_grid), rows.voltage, thrust_rows.tolist())
    f = thruster_faults_of(m, faults)
    c = _command(m, u, dead_band, limits, f, saturated=True)
    n = _shaft_speed(m, shaft, (1.0 - f.entangled) * n_d(c, voltage), T_n)
    force = thrust(n, voltage)
    if is_on("scale", scale):
        force *= m.parameter(
            "k_T", 1.0, unit="1", min=0, description="factor of the bench's thrust"
        )
    return _outputs(m, force, n, current(c, voltage), f)


def _command(
    m: Model,
    u: ca.SX,
    dead_band: bool | str,
    limits: bool | str,
    f: ThrusterFaults,
    saturated: bool = False,
) -> ca.SX:
    """Return the command at the motor's driver: limited to its range, then as options say."""
    plain = not is_on("limits", limits) and isinstance(f.stuck, float)
    if not (saturated and plain):
        u = saturate(u, 1.0)
    u = servo(m, u, limits, f)
    if not is_on("dead_band", dead_band):
        return u
    u_0 = m.parameter(
        "u_0",
        0.07,
        unit="1",
        min=0,
        max=0.9,
        description="half-width of the dead band (T200 at 16 V: 28 us of 400)",
    )
    beyond = abs_(u) - u_0
    return ca.if_else(beyond > 0.0, ca.sign(u) * beyond / (1.0 - u_0), 0.0)


def _inputs(m: Model, volts: tuple[float, ...] = ()) -> tuple[ca.SX, ca.SX]:
    """Declare command and supply; `volts` [V] are the voltages at which the rows were measured.

    The rows at 16 V also stand for a full pack of four cells, 16.8 V, if there are none above.
    """
    u = m.input("u", unit="1", min=-1, max=1, description="command; (pwm - 1500 us) / 400 us")
    low, high = (volts[0], max(volts[-1], FULL_PACK)) if volts else (None, None)
    # Importers such as FMPy step once with 0 V before they set the first value, and a battery sags.
    voltage = m.input("voltage", unit="V", start=16.0, min=low, max=high, soft_min=bool(volts),
                      description="of the supply")  # fmt: skip
    m.input("nu_r", 6, unit=NU, description="unused: thrust is bollard pull")
    return u, voltage


def _time_constant(m: Model, value: float) -> ca.SX:
    return m.parameter(
        "T_n", value, unit="s", min=4e-3, description="time constant of the shaft (assumption)"
    )


def _outputs(m: Model, thrust: ca.SX, n: ca.SX, current: ca.SX, f: ThrusterFaults) -> Model:
    m.output("thrust", f.health * thrust, unit="N", description="along the thruster's direction e")
    m.output("n", n, unit="rad/s", description="shaft speed")
    m.output("current", current, unit="A", description="drawn from the supply")
    return m


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
    wanted = (1.0 - f.entangled) * (Q_max * servo(m, saturate(u, 1.0), limits, f))
    m.der(Q, (wanted - Q) / T_Q)
    thrust = f.health * (k * abs_(Q) * Q)
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


def _shaft_speed(
    m: Model,
    shaft: str,
    n_d: ca.SX,
    T_n: ca.SX | None,
    u: ca.SX | None = None,
    voltage: ca.SX | None = None,
) -> ca.SX:
    """Declare a shaft; return its speed n [rad/s]. `u` and `voltage` are for bessa."""
    if shaft not in SHAFTS or (shaft == "bessa" and u is None):
        known = [s for s in SHAFTS if s != "bessa" or u is not None]
        raise InputInvalid(f"shaft={shaft!r}", ", ".join(known))
    if shaft == "third":
        source = "von Benzon et al. (2022)"
        a_0 = _parameter(m, "a_0", 108700.0, "1/s3", source)
        a_1 = _parameter(m, "a_1", 9258.0, "1/s2", source)
        a_2 = _parameter(m, "a_2", 89.0, "1/s", source)
        b_1 = _parameter(m, "b_1", 6136.0, "1/s2", source)
        units = ("rad/s", "rad/s2", "rad/s3")
        x = m.state("shaft", (0.0, 0.0, 0.0), unit=units, description="chain of integrators")
        m.der(x, ca.vertcat(x[1], x[2], a_0 * (n_d - x[0]) - a_1 * x[1] - a_2 * x[2]))
        return x[0] + b_1 / a_0 * x[1]
    n = m.state("shaft", unit="rad/s", description="shaft speed; its sign is the thrust's")
    if shaft == "first":
        assert T_n is not None
        m.der(n, (n_d - n) * m.derived("rate", 1.0 / T_n))
    elif shaft == "second":
        omega_n = _parameter(m, "omega_n", 90.9, "rad/s", f"natural frequency ({_PAIR})")
        zeta = _parameter(m, "zeta", 0.417, "1", f"damping ratio ({_PAIR})")
        turn = m.state("shaft_rate", unit="rad/s2", description="rate of the shaft speed")
        m.der(n, turn)
        m.der(turn, omega_n * (omega_n * (n_d - n) - 2.0 * zeta * turn))
    elif shaft == "yoerger":
        alpha = _parameter(m, "alpha", 0.0471, "1/rad", "1 / (2 n_max T_n) (assumption)")
        m.der(n, alpha * (abs_(n_d) * n_d - abs_(n) * n))
    else:
        J = _parameter(m, "J", 1.6e-4, "kg.m2", f"inertia of shaft and water ({_ASSUMED})")
        k_t = _parameter(m, "k_t", 0.0195, "N.m/A", f"torque constant ({_ASSUMED})")
        R_m = _parameter(m, "R_m", 0.238, "Ohm", f"resistance ({_ASSUMED})")
        k_v = _parameter(m, "k_v", 5.27e-6, "N.m.s2/rad2", f"torque of |n| n ({_ASSUMED})")
        assert u is not None
        assert voltage is not None
        m.der(n, (k_t / R_m * (u * voltage - k_t * n) - k_v * abs_(n) * n) / J)
    return n


def _parameter(m: Model, name: str, value: float, unit: str, words: str) -> ca.SX:
    return m.parameter(name, value, unit=unit, min=1e-9, description=words)
