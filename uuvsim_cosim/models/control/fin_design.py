"""Gains of an autopilot, from the linear model of a hull with its fins at several speeds.

At each speed V of a grid the vehicle is trimmed for level flight: at pitch theta_0 and heave w_0,
fins and propeller keep speed and depth. The linear model there falls apart into

    depth     x = (z, D, theta, w, q)    stern planes,  dz/dt = D - D_d
    heading   x = (z, psi, v, r)         rudders,       dz/dt = psi - psi_d
    roll      x = (z, phi, p)            fins against each other, where they make a moment in roll

and each gets the gains K of an LQR (Fossen 2021, 2nd ed., chapter 16) with Bryson's weights, of the
plane with one lag for servo and delay: its state is (x, delta). w, v and delta are not measured:
the autopilot predicts them by their own rows of the linear model (a reduced observer without
correction: its poles are A_ww, A_vv and the lag's). `fin_margins` opens each loop at its command,
with this prediction. The fastest speed of the schedule falls until each loop has a phase margin of
`PHASE`.

Many torpedo-shaped hulls are unstable in yaw and pitch: a steady turn needs opposite rudder, and
one that needs more than the largest deflection cannot be ended. So wanted yaw and pitch rates stay
within `TURN_SHARE` of the steady turn that the largest deflection holds.

Mixing: the pseudo-inverse of the moments K, M, N per deflection, each column scaled to 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.actuators.fins import fin_geometry
from uuvsim_cosim.models.actuators.propeller import read_propeller
from uuvsim_cosim.models.actuators.thruster_geometry import thruster_geometry
from uuvsim_cosim.models.analysis.operating_point import Coordinates
from uuvsim_cosim.models.control.margins import LoopMargin, margin_of
from uuvsim_cosim.models.control.vehicle_design import weight_and_buoyancy
from uuvsim_cosim.models.declaration.files_read import shared_until_changed
from uuvsim_cosim.models.declaration.kinematics import R, q_of_euler
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.parameter_files import (
    split_address,
    vehicle_folder,
    vehicle_size,
)

__all__ = ["FinDesign", "Plane", "design_fins", "fin_margins", "net_weight_of_level_flight"]

Array = NDArray[np.float64]
GRID = 6  # speeds of the schedule
DELTA_MAX = np.radians(20.0)  # larger deflections are not used, whatever the file allows
TRIM_SHARE = 0.7  # of the deflection, that level flight may need at the slowest speed
LEVEL_FROM = 0.9  # of the top speed: level flight has to be possible from there on
FASTEST = 0.97  # of the speed at full command
ATTACK = 0.35  # largest w / u of level flight
TURN_SHARE = 0.5  # of the steady turn at the largest deflection
RATE_MAX = 0.5  # largest rate, times length over speed: turns of 2 lengths
PHASE = 20.0  # deg, least phase margin: an unstable hull on slow servos reaches no more
DELAY = 0.04  # s, from a measurement to the command of a servo
SPEED = 0.4  # rad/s, both poles of the speed loop; slower with a slow shaft
THETA_MAX = np.radians(25.0)  # assumption: no file of a vehicle states one
OMEGA = np.logspace(-3, 2, 1500)  # rad/s
PREDICTED = {"depth": 2, "heading": 1}  # place of w or v in x


@dataclass(frozen=True)
class Plane:
    """One plane at each speed: A (n, k, k), B (n, k), K (n, k + 2) of (integral, x, delta)."""

    A: Array
    B: Array
    K: Array
    lag: float

    def poles(self, i: int) -> NDArray[np.complex128]:
        """Return the poles [1/s] of the closed loop at speed `i`, with servo and delay."""
        A, b = _with_servo(self.A[i], self.B[i], self.lag)
        return np.linalg.eigvals(A - b * self.K[i]).astype(complex)

    def response(self, i: int, predicted: int | None) -> NDArray[np.complex128]:
        """Return the opened loop at speed `i` and `OMEGA`; x[predicted] and delta are predicted."""
        s, A, B, K = 1j * OMEGA, self.A[i], self.B[i], self.K[i]
        G = np.linalg.solve(s[:, None, None] * np.eye(len(A)) - A, B[:, None])[..., 0].T
        gains = K[1:-1, None] * np.ones_like(s)
        gains[0] += K[0] / s
        fins = K[-1] * np.ones_like(s)
        if predicted is not None:
            share = K[1 + predicted] / (s - A[predicted, predicted])
            gains[predicted] = 0.0
            others = np.where(np.arange(len(A)) == predicted, 0.0, A[predicted])
            gains += share * others[:, None]
            fins += share * B[predicted]
        servo = np.exp(-s * DELAY) / (1.0 + s * (self.lag - DELAY))
        return np.asarray(servo * np.sum(gains * G, axis=0) / (1.0 + fins / (1.0 + s * self.lag)))


@dataclass(frozen=True)
class FinDesign:
    """Schedule of an autopilot over the speeds `V` (n,) [m/s] through the water.

    `mix` (fins, 3) turns roll, pitch and yaw commands [rad] into deflections; a column of zeros
    means that the fins make no moment there. `limit` (3,) bounds these commands, and `delta_max`
    each fin [rad]. `theta`, `w`, `delta` and `u` (n,) are pitch [rad], heave [m/s], pitch command
    [rad] and propeller command of level flight; `b_u` (n,) is the surge acceleration per u, `a_u`
    per speed, and `K_u` (n, 2) the gains [s/m] and [1/m] of the speed's error and of its integral.
    `turn` (n, 2): sway [m/s] and yaw command [rad] per yaw rate. `rates` (n, 2) bounds
    pitch and yaw rate [rad/s]. `shaft` and `lag` are in s.
    """

    vehicle: str
    length: float
    V: Array
    mix: Array
    limit: Array
    delta_max: Array
    theta: Array
    w: Array
    delta: Array
    u: Array
    a_u: Array
    b_u: Array
    K_u: Array
    turn: Array
    rates: Array
    depth: Plane
    heading: Plane
    roll: Plane | None
    shaft: float
    lag: float
    remarks: tuple[str, ...] = ()  # what the gains leave out

    @property
    def assumed(self) -> tuple[str, ...]:
        """Return the figures that no file states, and the range of the schedule."""
        return (
            f"autopilot: gains at {len(self.V)} speeds from {self.V[0]:.3g} to {self.V[-1]:.3g} "
            "m/s through the water",
            f"autopilot: {DELAY:g} s from a measurement to the command, and servos of "
            f"{self.lag - DELAY:.2g} s",
            f"autopilot: fins within {np.degrees(self.delta_max.min()):.3g} deg, wanted pitch "
            f"within {np.degrees(THETA_MAX):.0f} deg",
            *(() if self.roll else ("autopilot: roll is left to weight and buoyancy",)),
            *self.remarks,
        )


class _Point(NamedTuple):
    V: float
    theta: float
    w: float
    delta: float
    X: float  # N, thrust


def _with_servo(A: Array, B: Array, lag: float) -> tuple[Array, Array]:
    """Return the plane of (integral, x, delta) with one lag, and its column of the command."""
    k = len(A)
    full, b = np.zeros((k + 2, k + 2)), np.zeros((k + 2, 1))
    full[0, 1] = 1.0
    full[1:-1, 1:-1], full[1:-1, -1] = A, B
    full[-1, -1], b[-1] = -1.0 / lag, 1.0 / lag
    return full, b


@shared_until_changed
def design_fins(vehicle: str) -> FinDesign:
    """Design the autopilot of a `vehicle` (``id``, ``id@set`` or a folder) with fins.

    If the fins cannot carry the net weight in level flight, the gains are those of the neutrally
    buoyant vehicle. Raises ParameterInvalid if fins or propeller are missing,
    if the fins make no moment in pitch or yaw, or if that vehicle does not fly level either.

    Example:

    >>> from uuvsim_cosim.models.control.fin_design import design_fins
    >>> design = design_fins("remus100")
    >>> f"level flight from {design.V[0]:.1f} to {design.V[-1]:.1f} m/s"
    'level flight from 1.5 to 3.3 m/s'
    """
    plant = _Plant(vehicle)
    slowest, top = plant.speeds()
    length = plant.length
    planes = {"depth": ([0, 2, 6, 8], 1), "heading": ([3, 5, 9], 2), "roll": ([1, 7], 0)}
    while True:
        points = [p for V in np.linspace(slowest, top, GRID) if (p := plant.level(float(V)))]
        slopes = [plant.linear(p) for p in points]
        loops = {
            name: _plane(plant, points, slopes, name, rows, column)
            for name, (rows, column) in planes.items()
            if np.any(plant.mix[:, column])
        }
        weakest = min(
            (margin_of(name, OMEGA, plane.response(i, PREDICTED.get(name))).phase, name)
            for name, plane in loops.items()
            for i in range(len(points))
        )
        if weakest[0] >= PHASE:
            break
        top *= 0.9
        if top < 1.2 * slowest:
            raise ParameterInvalid(
                f"{vehicle}: {weakest[1]}",
                f"a phase margin of {weakest[0]:.2g} deg at {slowest:.2g} m/s or more",
                "faster servos, or larger fins",
            )
    turn, dive = (
        np.array([
            -np.linalg.solve(np.column_stack([a[i:, i], b[i:]]), a[i:, i + 1])
            for a, b in zip(loops[name].A, loops[name].B, strict=True)
        ])
        for name, i in (("heading", 1), ("depth", 2))
    )  # fmt: skip
    V, theta, w, delta, _ = np.array(points).T
    held = np.abs(np.column_stack([dive[:, 1], turn[:, 1]]))
    fastest = RATE_MAX * V[:, None] / length
    rates = np.minimum(TURN_SHARE * plant.limit[1:] / np.maximum(held, 1e-9), fastest)
    u = np.array([plant.command(p.V, p.X) for p in points])
    A_surge = np.array([A[4, 4] for A, _, _ in slopes])
    B_surge = np.array([B[4] for _, _, B in slopes])
    h, pairs = 1e-4, list(zip(V, u, strict=True))
    per_V = np.array([plant.thrust(v + h, c) - plant.thrust(v - h, c) for v, c in pairs])
    per_u = np.array([plant.thrust(v, c + h) - plant.thrust(v, c - h) for v, c in pairs])
    a_u = A_surge + B_surge * per_V / (2 * h)
    b_u = B_surge * per_u / (2 * h)
    shaft = plant.propeller["T_n"]
    omega = min(SPEED, 0.3 / shaft)
    k_u = np.maximum(2.0 * omega + a_u, 0.2 * omega) / b_u
    return FinDesign(
        vehicle=vehicle,
        length=length,
        V=V,
        mix=plant.mix,
        limit=plant.limit,
        delta_max=plant.delta_max,
        theta=theta,
        w=w,
        delta=delta,
        u=u,
        a_u=a_u,
        b_u=b_u,
        K_u=np.column_stack([k_u, omega**2 / b_u]),
        turn=turn,
        rates=rates,
        depth=loops["depth"],
        heading=loops["heading"],
        roll=loops.get("roll"),
        shaft=shaft,
        lag=plant.lag,
        remarks=plant.remarks,
    )


@shared_until_changed
def net_weight_of_level_flight(vehicle: str) -> tuple[tuple[float, float, float], ...]:
    """Return (speed [m/s], largest net weight of a light and of a heavy vehicle [N]) by speed.

    The vehicle flies level with the net weights between the two; both are >= 0.
    """
    plant = _Plant(vehicle)
    _, top = plant.speeds()
    own = plant.weight - plant.buoyancy
    rows = []
    for V in np.linspace(0.25 * top, top, 2 * GRID):
        ends = []
        for sign in (-1.0, 1.0):
            low, high = 0.0, plant.weight
            for _ in range(14):
                middle = 0.5 * (low + high)
                plant.added = sign * middle - own
                low, high = (middle, high) if plant.level(float(V)) else (low, middle)
            ends.append(low)
        rows.append((float(V), ends[0], ends[1]))
    return tuple(rows)


def _plane(
    plant: _Plant,
    points: Sequence[_Point],
    slopes: Sequence[tuple[Array, Array, Array]],
    name: str,
    rows: Sequence[int],
    column: int,
) -> Plane:
    from scipy.linalg import solve_continuous_are

    found = []
    for p, (A, B, _) in zip(points, slopes, strict=True):
        a, b = A[np.ix_(rows, rows)], (B @ plant.mix[:, column])[rows]
        full, c = _with_servo(a, b, plant.lag)
        rate = 0.5 * p.V / plant.length
        largest = {
            "depth": [4.0 * plant.length / p.V, 0.5 * plant.length, 0.25, 0.5 * p.V, rate],
            "heading": [2.0 * plant.length / p.V, 0.25, 0.5 * p.V, rate],
            "roll": [0.6, 0.2, 1.0],
        }[name]
        R = (0.5 * float(plant.limit[column])) ** -2.0
        Q = np.diag([*np.array(largest) ** -2.0, 0.0])
        found.append((a, b, (c.T @ solve_continuous_are(full, c, Q, [[R]]) / R).ravel()))
    A_all, B_all, K_all = (np.array(v) for v in zip(*found, strict=True))
    return Plane(A_all, B_all, K_all, plant.lag)


def fin_margins(design: FinDesign) -> tuple[LoopMargin, ...]:
    """Return the margins of depth, heading, roll and speed at each speed of the design.

    Each loop is opened at its command, with the lag of the servos or of the shaft, with the delay,
    and with w and v predicted from the commands, as the autopilot does.

    Example:

    >>> from uuvsim_cosim.models.control.fin_design import design_fins, fin_margins
    >>> sorted({m.axis for m in fin_margins(design_fins("remus100"))})
    ['depth', 'heading', 'roll', 'speed']
    """
    s = 1j * OMEGA
    planes = {"depth": design.depth, "heading": design.heading, "roll": design.roll}
    found = [
        margin_of(name, OMEGA, plane.response(i, PREDICTED.get(name)), float(V))
        for name, plane in planes.items()
        if plane is not None
        for i, V in enumerate(design.V)
    ]
    for V, a, b, (K_p, K_i) in zip(design.V, design.a_u, design.b_u, design.K_u, strict=True):
        L = np.exp(-s * DELAY) / (1.0 + s * design.shaft) * (K_p + K_i / s) * b / (s - a)
        found.append(margin_of("speed", OMEGA, L, float(V)))
    return tuple(found)


class _Plant:
    """Hull, fins and propeller of a vehicle: state s = (D phi theta psi u v w p q r), level."""

    def __init__(self, vehicle: str) -> None:
        id, set_ = split_address(vehicle)
        g = fin_geometry(id)
        self.weight, self.buoyancy = weight_and_buoyancy(vehicle)
        self.added = 0.0  # N, weight that is added to the hull's own at CO
        self.remarks: tuple[str, ...] = ()
        file = vehicle_folder(id) / "propeller.yaml"
        if not file.is_file():
            raise ParameterInvalid(f"{vehicle}: no propeller", f"a file {file}")
        self.vehicle = vehicle
        self.propeller = read_propeller(file)
        self.ahead = float(np.sum(thruster_geometry(id).e[:, 0]))
        size = vehicle_size(id)
        self.length = 1.0 if size is None else float(size.length)
        self.lag = float(np.max(g.figures["T_delta"])) + DELAY
        options = {"set": set_} if set_ else {}
        hull = Coordinates(declare("vehicle", id=id, surface=False, **options))
        fins = Coordinates(declare("fins", vehicle=id))
        n = len(g.names)
        s, delta, X = ca.SX.sym("s", 10), ca.SX.sym("delta", n), ca.SX.sym("X")
        added = ca.SX.sym("added")
        y = fins.functions[0](delta, ca.vertcat(ca.SX.zeros(n), s[4:]))[1]
        tau = y[[i for i, name in enumerate(fins.outputs) if name.startswith("tau[")]]
        x, u = ca.SX(ca.DM(hull.x_0)), ca.SX(ca.DM(hull.u_0))
        x[2:12] = s
        first = hull.inputs.index("tau[1]")
        down = R(q_of_euler(s[1], s[2], s[3]))[2, :].T
        u[first : first + 6] = tau + ca.vertcat(ca.vertcat(X, 0, 0) + added * down, 0, 0, 0)
        rates = hull.functions[0](x, u)[0][2:12]
        slopes = [ca.densify(ca.jacobian(rates, v)) for v in (s, delta, X)]
        self.rates = ca.Function("rates", [s, delta, X, added], [rates])
        self.slopes = ca.Function("slopes", [s, delta, X, added], slopes)
        per_delta = ca.densify(ca.jacobian(tau, delta))
        moments = np.array(ca.Function("moments", [s, delta], [per_delta])(_state(1.0), [0] * n))
        self.delta_max = np.minimum(g.figures["delta_max"], DELTA_MAX)
        self.mix = mix = _mixing(vehicle, moments[3:])
        # Pitch and yaw together saturate no fin; roll may use half of the deflection.
        shared = float(np.max(np.sum(np.abs(mix[:, 1:]), axis=1)))
        least = float(np.min(self.delta_max))
        self.limit = least * np.array([0.5 * np.any(mix[:, 0]), 1.0 / shared, 1.0 / shared])

    def thrust(self, V: float, u: float) -> float:
        """Return the thrust ahead [N] at a speed [m/s], of the propeller's command."""
        p, n = self.propeller, u * self.propeller["n_max"]
        each = p["T_nn"] * n - p["T_nV"] * (1.0 - p["w"]) * V
        return self.ahead * (1.0 - p["t"]) * n * each

    def command(self, V: float, X: float) -> float:
        """Return the propeller's command for a thrust X ahead: the root of  a n² - b n = X."""
        p = self.propeller
        factor = self.ahead * (1.0 - p["t"])
        a, b = factor * p["T_nn"], factor * p["T_nV"] * (1.0 - p["w"]) * V
        return float((b + np.sqrt(b * b + 4.0 * a * max(X, 0.0))) / (2.0 * a) / p["n_max"])

    def level(self, V: float) -> _Point | None:
        """Return level flight, or None where it takes too much deflection or angle of attack."""
        from scipy.optimize import fsolve

        def left(v: Array) -> Array:
            w, d, X = v
            s = _state(V, float(w), float(np.arctan2(w, V)))
            rates = self.rates(s, self.mix[:, 1] * d, X, self.added)
            return np.array(rates).ravel()[[4, 6, 8]]

        found, _, done, _ = fsolve(left, [0.0, 0.0, self.thrust(V, 1.0)], full_output=True)
        w, d, X = map(float, found)
        if done != 1 or abs(d) > TRIM_SHARE * self.limit[1] or abs(w) > ATTACK * V:
            return None
        return _Point(V, float(np.arctan2(w, V)), w, d, X)

    def linear(self, p: _Point) -> tuple[Array, Array, Array]:
        """Return (A, B, B_X) of s by itself (10, 10), by the fins (10, n) and by thrust (10,)."""
        s = _state(p.V, p.w, p.theta)
        A, B, B_X = (np.array(j) for j in self.slopes(s, self.mix[:, 1] * p.delta, p.X, self.added))
        return A, B, B_X[:, 0]

    def speeds(self) -> tuple[float, float]:
        """Return the slowest and the fastest speed of level flight [m/s]."""
        from scipy.optimize import brentq

        def spare(V: float) -> float:
            still = 0 * self.mix[:, 1]
            return float(self.rates(_state(V), still, self.thrust(V, 1.0), 0.0)[4])

        if not spare(0.05) > 0 > spare(20.0):
            raise ParameterInvalid(f"{self.vehicle}: propeller", "no steady speed below 20 m/s")
        top = FASTEST * float(brentq(spare, 0.05, 20.0))
        slowest = self._slowest(top)
        if slowest > LEVEL_FROM * top:
            self.added = self.buoyancy - self.weight
            slowest = self._slowest(top)
            self.remarks = (
                f"autopilot: gains without the net weight of {-self.added:.3g} N, which level "
                "flight does not carry",
            )
        if slowest > LEVEL_FROM * top:
            raise ParameterInvalid(
                f"{self.vehicle}: level flight below {LEVEL_FROM * top:.2g} m/s",
                f"it needs more than {TRIM_SHARE:g} of the fins' deflection, even if weight and "
                "buoyancy are equal",
                "larger fins",
            )
        return slowest, top

    def _slowest(self, top: float) -> float:
        """Return the slowest speed of level flight below the `top` speed [m/s]."""
        slowest = top
        for V in np.linspace(top, 0.25 * top, 40):
            if self.level(float(V)) is None:
                break
            slowest = float(V)
        return slowest


def _state(V: float, w: float = 0.0, theta: float = 0.0) -> list[float]:
    return [20.0, 0.0, theta, 0.0, V, 0.0, w, 0.0, 0.0, 0.0]  # 20 m: below any waterline


def _mixing(vehicle: str, moments: Array) -> Array:
    """Return (fins, 3): the deflections of one unit of roll, pitch and yaw command."""
    largest = np.max(np.abs(moments))
    rows = [i for i in range(3) if np.linalg.norm(moments[i]) > 1e-3 * largest]
    if lacking := [name for i, name in ((1, "pitch"), (2, "yaw")) if i not in rows]:
        raise ParameterInvalid(
            f"{vehicle}: fins", f"no moment in {' and '.join(lacking)}", "fins that make them"
        )
    if np.linalg.matrix_rank(moments[rows], tol=1e-4 * largest) < len(rows):
        rows = [1, 2]
    mix = np.zeros((moments.shape[1], 3))
    mix[:, rows] = np.linalg.pinv(moments[rows])
    mix[np.abs(mix) < 1e-9 * np.max(np.abs(mix))] = 0.0
    for i in rows:
        mix[:, i] /= np.max(np.abs(mix[:, i]))
    return mix
