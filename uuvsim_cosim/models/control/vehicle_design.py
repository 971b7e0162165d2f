"""Figures of a vehicle's control that follow from its own files: limits, weights, gains, margins.

The thrusters at full command give the largest force in each axis. An axis is *controlled* if the
thrusters can make a force in it and in no other controlled axis. Roll and pitch that are not
controlled are *passive*; they must be stable by weight and buoyancy. X, Y, Z and N are needed for
station keeping, X, Z and N for a path. The weights of `lqr` follow by Bryson's rule,

    R_i = share · tau_max_i,   e_i = 0.4 L (0.1 rad of roll and pitch, 0.15 rad of yaw),
    v_i = e_i omega_i,   z_i = 3 e_i / omega_i,   omega_i² = R_i / (M_ii e_i)

and `share`, 0.2 at first, falls until every loop has a phase margin of 45° and a gain margin of
6 dB with the lag of the thrusters and 0.04 s of delay (one loop is opened, the others are closed).
If roll or pitch is passive, the loops have to be stable too while the vehicle dives or rises at a
fifth of its top speed: a fast surge loop and a passive pitch upset each other there.

The commands stay within 0.9 of the largest force. Gains do not depend on the net weight (weight
less buoyancy): a system whose thrusters do not carry it is refused when it is built.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.models.actuators.propeller import read_propeller
from uuvsim_cosim.models.actuators.thruster_geometry import (
    NO_THRUSTERS,
    Geometry,
    configuration_matrix,
    thruster_geometry,
    thrusters_file,
)
from uuvsim_cosim.models.analysis.linearize import linear_model
from uuvsim_cosim.models.analysis.operating_point import Coordinates
from uuvsim_cosim.models.control.allocation import command_of_thrust
from uuvsim_cosim.models.control.margins import LoopMargin, margin_of
from uuvsim_cosim.models.declaration.files_read import shared_until_changed
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.parameter_files import (
    parameter_set,
    split_address,
    vehicle_folder,
    vehicle_size,
)
from uuvsim_cosim.models.hull.matrices import nominal, structure

__all__ = [
    "AXES",
    "Thrusters",
    "VehicleDesign",
    "control_design",
    "full_command",
    "propelled_speed",
    "thrusters_of",
    "weight_and_buoyancy",
]

Array = NDArray[np.float64]
AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
DELAY = 0.04  # s, from a measurement to the command: half a period of 0.02 s and three steps
VOLTAGE = 16.0  # V, of a T200
USED = 0.9  # of the largest force, at most
NET_SHARE = 0.25  # of the usable vertical force; a larger net weight is listed
ANGLES = (0.1, 0.1, 0.15)  # rad, wanted largest errors of roll, pitch and yaw
PHASE, GAIN = 45.0, 2.0  # deg and 1, least margins


@dataclass(frozen=True)
class Thrusters:
    """Thrusters of a vehicle: places, thrust at full command, and the axes that they make.

    `T` (6, n) is the force about CO in b per thrust. `forward` and `backward` are the largest
    thrusts [N], `lag` the time constant [s]. `controlled`, `passive` and `missing` are places in
    `AXES`; missing axes are X, Y, Z and N that are not controlled. `tau_max` (6,) is the largest
    force in one axis alone [N, N.m], 0 where not controlled.
    """

    geometry: Geometry
    T: Array
    model: str
    has_set: bool  # whether thrusters.yaml has their figures, of the name of the hull's set
    forward: float
    backward: float
    lag: float
    controlled: tuple[int, ...]
    passive: tuple[int, ...]
    missing: tuple[int, ...]
    tau_max: Array
    assumed: tuple[str, ...]

    @property
    def together(self) -> str:
        """Which thrusters act along one line, so that they count as one; empty if none do."""
        n = self.T.shape[1]
        names = self.geometry.names
        for i in range(n):
            for j in range(i):
                a, b = self.T[:, i], self.T[:, j]
                same, opposed = (np.allclose(a, s * b, atol=1e-6) for s in (1.0, -1.0))
                if same or opposed:
                    against = ", against each other" * opposed
                    return f"{names[j]!r} and {names[i]!r} push along the same line{against}"
        return ""


@dataclass(frozen=True)
class VehicleDesign:
    """Design of `lqr` for a vehicle: weights Q (18) and R (6), gains K (6, 18), limits, margins."""

    thrusters: Thrusters
    Q: Array
    R: Array
    K: Array
    tau_max: Array
    z_max: Array
    poles: NDArray[np.complex128]
    margins: tuple[LoopMargin, ...]
    top_speed: Array  # of each axis at tau_max [m/s, rad/s]
    stable_speed: float  # m/s ahead, up to which the poles of the loops stay stable
    M: Array
    remarks: tuple[str, ...]  # on the vehicle: a large net weight, thrusters along one line
    assumed: tuple[str, ...]


@shared_until_changed
def thrusters_of(vehicle: str) -> Thrusters:
    """Return the thrusters of a `vehicle`, by id or folder, and the axes that they control.

    Raises ParameterInvalid if the vehicle has no thrusters, or if their model has no figures.
    """
    id, _ = split_address(vehicle)
    file = vehicle_folder(id) / "thrusters.yaml"
    if not file.is_file():
        raise ParameterInvalid(file, *NO_THRUSTERS)
    geometry = thruster_geometry(id)
    T = configuration_matrix(geometry)
    model, forward, backward, lag, assumed = full_command(vehicle, thrusters_file(file))
    rank = int(np.linalg.matrix_rank(T, tol=1e-6))
    controlled = [i for i in range(6) if _in_range(T, np.eye(6)[:, i])]
    for i in (0, 1, 2, 5):  # needed axes may push passive ones too, as one vertical thruster does
        rows = sorted({*controlled, i})
        if i not in controlled and np.linalg.matrix_rank(T[rows], tol=1e-6) == len(rows):
            controlled = rows
    assert len(controlled) <= rank
    tau_max = np.zeros(6)
    for i in controlled:
        tau_max[i] = _largest(T[controlled], controlled.index(i), forward, backward)
    return Thrusters(
        geometry=geometry,
        T=T,
        model=model,
        has_set=parameter_set(*split_address(vehicle)).name in thrusters_file(file).get("sets", {}),
        forward=forward,
        backward=backward,
        lag=lag,
        controlled=tuple(controlled),
        passive=tuple(i for i in (3, 4) if i not in controlled),
        missing=tuple(i for i in (0, 1, 2, 5) if i not in controlled),
        tau_max=tau_max,
        assumed=assumed,
    )


def _in_range(T: Array, wanted: Array) -> bool:
    found = np.linalg.lstsq(T, wanted, rcond=None)[0]
    return bool(np.linalg.norm(T @ found - wanted) < 1e-6)


def _largest(rows: Array, axis: int, forward: float, backward: float) -> float:
    """Return the largest force in one axis with none in the other rows, the smaller way [N]."""
    from scipy.optimize import linprog

    n = rows.shape[1]
    found = []
    for sign in (1.0, -1.0):
        wanted = np.zeros((len(rows), 1))
        wanted[axis] = -sign
        done = linprog(
            np.array([0.0] * n + [-1.0]),
            A_eq=np.hstack([rows, wanted]),
            b_eq=np.zeros(len(rows)),
            bounds=[(-backward, forward)] * n + [(0.0, None)],
        )
        found.append(float(done.x[-1]) if done.success and done.x is not None else 0.0)
    return min(found)


def full_command(vehicle: str, file: Any) -> tuple[str, float, float, float, tuple[str, ...]]:
    """Return (model, forward [N], backward [N], lag [s], what was assumed) of each thruster."""
    assumed = []
    id, _ = split_address(vehicle)
    sets = file.get("sets", {})
    chosen = sets.get(parameter_set(*split_address(vehicle)).name) if sets else None
    model = str(file.get("model", "") if chosen is None else chosen["model"])
    if not model:
        model = "thruster_t200"
        assumed.append(f"thrusters.yaml of {id} names no model: thruster_t200")
    if model == "propeller":
        figures = read_propeller(vehicle_folder(id) / "propeller.yaml")
        thrust = (1.0 - figures["t"]) * figures["T_nn"] * figures["n_max"] ** 2
        return model, thrust, thrust, figures["T_n"], tuple(assumed)
    one = declare(model, **({} if chosen is None else {"vehicle": vehicle}))
    if model == "thruster_t200":
        assumed.append(f"thrust of a T200 at {VOLTAGE:g} V")
        thrusts, _ = command_of_thrust("t200", VOLTAGE)
        lag = float(one.variables["T_n"].start.item())
        return model, thrusts[-1], -thrusts[0], lag, tuple(assumed)
    values = {v.name: float(v.start.item()) for v in one.of_kind("parameter") if v.size == 1}
    if model == "thruster_jet":
        thrust = values["rho"] * values["Q_max"] ** 2 / (0.25 * np.pi * values["d_jet"] ** 2)
        return model, thrust, thrust, values["T_Q"], tuple(assumed)
    if model == "thruster" and {"K_n", "n_max", "T_n"} <= values.keys():
        thrust = values["K_n"] * values["n_max"] ** 2
        return model, thrust, thrust, values["T_n"], tuple(assumed)
    raise ParameterInvalid(
        f"thrusters.yaml of {id}", f"model {model}", "propeller, thruster, thruster_t200 or _jet"
    )


@shared_until_changed
def control_design(vehicle: str) -> VehicleDesign:
    """Design the gains of `lqr` for a `vehicle` (``id`` or ``id@set``) with thrusters.

    Weights, limits and margins are as this file's first paragraphs say. Raises ParameterInvalid if
    surge, heave or yaw is not controlled, or if roll or pitch is neither controlled nor stable.
    """
    import control

    thrusters = thrusters_of(vehicle)
    axes = list(thrusters.controlled)
    if lacking := sorted({0, 2, 5} - set(axes)):
        because = f"; {thrusters.together}" if thrusters.together else ""
        n = len(thrusters.geometry.names)
        raise ParameterInvalid(
            f"{vehicle}: {n} thruster{'s' * (n > 1)}",
            f"no force in {' and '.join(AXES[i] for i in lacking)} alone{because}",
            "thrusters (or fins) that make these",
        )
    carried = _carried(vehicle, thrusters)
    spare = (
        (f"thrusters: {thrusters.together}; each runs both ways, so one of them is redundant",)
        if thrusters.together
        else ()
    )
    id, set_ = split_address(vehicle)
    length, assumed = _length(vehicle)
    hull = declare("vehicle", id=id, surface=False, **({"set": set_} if set_ else {}))
    plant = linear_model(hull, inputs=["tau"], outputs=["eta", "nu"])
    A, B = np.array(plant.A[:12, :12]), np.array(plant.B[:12])
    M = np.linalg.inv(B[6:])
    if loose := [AXES[i] for i in thrusters.passive if A[6 + i, i] >= 0]:
        raise InputInvalid(
            f"{vehicle}: {' and '.join(loose)}",
            "neither controlled by thrusters nor stable by weight and buoyancy",
            "thrusters for it, or z_g below z_b",
        )
    # Positions that nothing controls are left out: they have no influence on the rest.
    free = [i for i in (0, 1, 2, 5) if i not in axes]
    kept = [i for i in range(12) if i not in free]
    z = len(axes)
    n = z + len(kept)
    full_A, full_B = np.zeros((n, n)), np.zeros((n, z))
    full_A[z:, z:], full_B[z:] = A[np.ix_(kept, kept)], B[np.ix_(kept, axes)]
    for row, axis in enumerate(axes):
        full_A[row, z + kept.index(axis)] = 1.0
    largest = np.concatenate([np.full(3, 0.4 * length), ANGLES])
    share = np.full(6, 0.2)
    tau_max = USED * thrusters.tau_max
    top = _top_speed(vehicle, tau_max)
    diving = 0.2 * float(top[2])
    for _ in range(30):
        R = np.maximum(share * thrusters.tau_max, 1e-9)
        omega = np.sqrt(R / (np.diag(M) * largest))
        omega[[i for i in range(6) if i not in axes]] = 1.0
        Q = np.concatenate([3.0 * largest / omega, largest, largest * omega])
        places = [*axes, *(6 + i for i in kept)]
        K_, _, poles = control.lqr(full_A, full_B, np.diag(Q[places] ** -2), np.diag(R[axes] ** -2))
        margins = _margins(full_A, full_B, np.array(K_), axes, thrusters.lag)
        poor = {
            AXES.index(m.axis)
            for m in margins
            if m.phase < PHASE or not (m.gain >= GAIN or m.gain <= 1.0 / GAIN)
        }
        if thrusters.passive and not poor:
            dive = full_A.copy()
            for w in (-diving, diving):
                moving = linear_model(hull, {"nu": [0.0, 0.0, w, 0.0, 0.0, 0.0]}, inputs=["tau"])
                dive[z:, z:] = np.array(moving.A[:12, :12])[np.ix_(kept, kept)]
                if np.max(np.linalg.eigvals(dive - full_B @ np.array(K_)).real) > -1e-3:
                    # Pitch couples with surge, roll with sway.
                    poor = {4 - i for i in thrusters.passive} & set(axes)
        if not poor:
            break
        for i in poor:
            share[i] *= 0.75
    K = np.zeros((6, 18))
    K[np.ix_(axes, places)] = np.array(K_)
    shares = ", ".join(f"{AXES[i]} {100 * share[i]:.2g} %" for i in axes)
    words = (
        *thrusters.assumed,
        *assumed,
        f"largest errors that are wanted: {0.4 * length:.3g} m (0.4 lengths), 0.1 rad of roll and "
        "pitch, 0.15 rad of yaw",
        f"force for these errors, of the largest force: {shares}",
        f"{DELAY:g} s from a measurement to the command, and {thrusters.lag:g} s of the thrusters",
    )
    return VehicleDesign(
        thrusters=thrusters,
        Q=Q,
        R=np.where(thrusters.tau_max > 0, R, 1.0),
        K=K,
        tau_max=tau_max,
        z_max=np.where(tau_max > 0, 0.8 * tau_max / np.maximum(np.diag(K[:, :6]), 1e-9), 1.0),
        poles=np.array(poles),
        margins=tuple(margins),
        top_speed=top,
        stable_speed=_stable_speed(hull, K, float(top[0]), free),
        M=M,
        remarks=(*carried, *spare),
        assumed=words,
    )


def weight_and_buoyancy(vehicle: str) -> tuple[float, float]:
    """Return the weight and the buoyancy [N] of a submerged vehicle, of its parameter set."""
    numbers = {k: q.value for k, q in parameter_set(*split_address(vehicle)).quantities.items()}
    _, W, B, *_ = structure(numbers)
    return float(W), float(B)


def _carried(vehicle: str, thrusters: Thrusters) -> tuple[str, ...]:
    """Return a sentence about a large net weight that the vertical thrust carries."""
    weight, buoyancy = weight_and_buoyancy(vehicle)
    net, usable = weight - buoyancy, USED * float(thrusters.tau_max[2])
    if not NET_SHARE * usable < abs(net) <= usable:
        return ()
    which = f"{abs(net):.3g} N {'heavier' if net > 0.0 else 'lighter'}"
    share = 100 * abs(net) / usable
    return (
        f"weight: {which} than the water that it displaces, {share:.2g} % of the usable vertical "
        f"thrust ({usable:.3g} N)",
    )


def _length(vehicle: str) -> tuple[float, tuple[str, ...]]:
    size = vehicle_size(split_address(vehicle)[0])
    if size is not None:
        return max(size.length, size.breadth), ()
    numbers = parameter_set(*split_address(vehicle)).quantities
    length = 2.0 * (numbers["m"].value / 1000.0) ** (1 / 3)
    return length, (f"length {length:.3g} m, of a box of 2:1:1/2 with the vehicle's mass",)


def _margins(A: Array, B: Array, K: Array, axes: Sequence[int], lag: float) -> list[LoopMargin]:
    """Return the margins of each loop, opened at its force while the others are closed."""
    w = np.logspace(-2.5, 2.5, 400)
    n, k = A.shape[0], len(axes)
    s = 1j * w[:, None, None]
    actuator = np.exp(-s * DELAY) / (1.0 + s * lag)
    L = actuator * (K @ np.linalg.solve(s * np.eye(n) - A, np.broadcast_to(B, (len(w), n, k))))
    loops = []
    for i in range(k):
        o = [j for j in range(k) if j != i]
        closed = np.linalg.solve(np.eye(k - 1) + L[:, o][:, :, o], L[:, o, i][..., None])
        loops.append(L[:, i, i] - (L[:, i, o][:, None] @ closed)[:, 0, 0])
    return [margin_of(AXES[axis], w, loop) for axis, loop in zip(axes, loops, strict=True)]


def _top_speed(vehicle: str, tau_max: Array) -> Array:
    """Return the steady speeds [m/s, rad/s] at tau_max with D_l and D_q of the diagonal."""
    _, linear, quadratic = (np.array(v) for v in nominal(vehicle))
    linear, quadratic = np.maximum(linear, 0.0), np.maximum(quadratic, 1e-9)
    root = np.sqrt(linear**2 + 4.0 * quadratic * tau_max)
    return np.array((root - linear) / (2.0 * quadratic))


@shared_until_changed
def propelled_speed(vehicle: str) -> float:
    """Return the speed ahead [m/s] at full command, at which thrust and drag are equal.

    Drag is that of the hull and of its fins at rest; the thrust of a propeller falls with speed.
    """
    from scipy.optimize import brentq

    id, _ = split_address(vehicle)
    thrusters = thrusters_of(vehicle)
    ahead = float(np.sum(np.maximum(thrusters.T[0], 0.0)))
    loss = 0.0
    if thrusters.model == "propeller":
        p = read_propeller(vehicle_folder(id) / "propeller.yaml")
        loss = (1.0 - p["t"]) * p["T_nV"] * p["n_max"] * (1.0 - p["w"])
    hull, fins = _hull_and_fins(vehicle)

    def rate(speed: float) -> float:
        X = ahead * (thrusters.forward - loss * speed)
        if fins is not None:
            y = fins.functions[0](*fins.point({"nu_r[1]": speed}))[1]
            X += float(y[fins.outputs.index("tau[1]")])
        x, u = hull.point({"nu[1]": speed, "tau[1]": X})
        return float(hull.functions[0](x, u)[0][hull.states.index("nu[1]")])

    if not rate(0.0) > 0 > rate(50.0):
        raise ParameterInvalid(
            f"{vehicle}: propulsion",
            f"{thrusters.forward * ahead:.3g} N ahead",
            "a thrust ahead that the drag equals below 50 m/s",
        )
    return float(brentq(rate, 0.0, 50.0))


def _hull_and_fins(vehicle: str) -> tuple[Coordinates, Coordinates | None]:
    id, set_ = split_address(vehicle)
    hull = declare("vehicle", id=id, surface=False, **({"set": set_} if set_ else {}))
    finned = (vehicle_folder(id) / "fins.yaml").is_file()
    return Coordinates(hull), Coordinates(declare("fins", vehicle=id)) if finned else None


def _stable_speed(hull: Model, K: Array, top: float, free: Sequence[int]) -> float:
    """Return the largest speed ahead [m/s], of tenths of `top`, at which the loops are stable.

    A passive pitch is upset by the moment of the added mass, which grows with the speed squared.
    """
    kept = [i for i in range(12) if i not in free]
    columns = [6 + i for i in kept]
    for tenth in range(10, 0, -1):
        speed = 0.1 * tenth * top
        at = {"nu": [speed, 0.0, 0.0, 0.0, 0.0, 0.0]}
        plant = linear_model(hull, at, inputs=["tau"], outputs=["eta", "nu"])
        A = np.array(plant.A[:12, :12])[np.ix_(kept, kept)]
        B = np.array(plant.B[:12])[kept]
        if np.max(np.linalg.eigvals(A - B @ K[:, columns]).real) < -1e-3:
            return speed
    return 0.1 * top
