"""The filter on a lawn-mower path in closed form: 20 runs at once, each with its own errors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from uuvsim_cosim.models.declaration.evaluation import Evaluation
from uuvsim_cosim.models.declaration.kinematics import R, T_zyx, q_of_euler
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.safe_math import clip, smoothstep
from uuvsim_cosim.models.navigation.error_state_filter import N_ERRORS, navigation
from uuvsim_cosim.models.navigation.strapdown import (
    ErrorTransition,
    Inertial,
    corrected,
    mechanised,
    multiply,
    q_of_rotation,
)

Array = NDArray[np.float64]
H = 0.01
N = 20
LONGEST = 50.0  # s, of all flights
PASCAL_PER_METRE = 10076.0
SIGMA_0 = np.array(
    [0.5, 0.5, 0.1, 0.05, 0.05, 0.05, 0.03, 0.03, 0.05]
    + [np.hypot(0.0087, 8.6726e-4)] * 3
    + [np.hypot(0.196, 0.073485)] * 3
    + [np.deg2rad(0.3), 100.0 / PASCAL_PER_METRE]
)


@cache
def motion() -> Any:
    """Theta, nu, nu_dot and velocity in `n` over time: legs at 0.4 m/s, turns of 90 degrees."""
    t = ca.SX.sym("t")
    turns = [(12, 1), (20, 1), (36, -1), (44, -1), (60, 1), (68, 1)]
    psi = sum((0.5 * np.pi * sign * smoothstep((t - at) / 5.0) for at, sign in turns), ca.SX(0))
    Theta = ca.vertcat(0.05 * ca.sin(0.7 * t), 0.04 * ca.sin(0.9 * t), psi)
    rates = ca.jacobian(Theta, t)
    omega = ca.solve(T_zyx(Theta[0], Theta[1]), rates)
    v = ca.vertcat(
        0.4 * smoothstep(clip(t, 0, 4) / 4.0), 0.03 * ca.sin(0.5 * t), 0.02 * ca.sin(0.3 * t)
    )
    nu = ca.vertcat(v, omega)
    q = q_of_euler(Theta[0], Theta[1], Theta[2])
    return ca.Function("motion", [t], [Theta, q, nu, ca.jacobian(nu, t), ca.mtimes(R(q), v)])


@cache
def whole_truth() -> list[dict[str, Array]]:
    """The hull's outputs at each multiple of H; position by Simpson's rule."""
    n = round(LONGEST / H) + 1
    halves = motion().map(2 * n + 1)(0.5 * H * np.arange(2 * n + 1))
    Theta, q, nu, nu_dot, v = (np.array(a).T for a in halves)
    moved = H / 6.0 * (v[:-2:2] + 4.0 * v[1:-1:2] + v[2::2])
    p = np.cumsum([[0.0, 0.0, 5.0], *moved], axis=0)
    return [
        {
            "eta": np.concatenate([p[k], Theta[2 * k]]),
            "q": q[2 * k],
            "nu": nu[2 * k],
            "nu_dot": nu_dot[2 * k],
        }
        for k in range(n)
    ]


def truth(until: float) -> list[dict[str, Array]]:
    """The same until a time."""
    assert until <= LONGEST
    return whole_truth()[: round(until / H) + 1]


@dataclass
class Flight:
    """N vehicles on the same path: their sensors, their filters, each with errors of its own."""

    lanes: Any
    seed: int = 1
    n: int = N
    parameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    start: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.sensors = {
            name: self.lanes(declare(name), self.n, self.seed + i, self.parameters.get(name))
            for i, name in enumerate(("imu", "dvl", "pressure", "compass", "usbl"))
        }
        self.filter = self.lanes(navigation(), self.n, 0, self._drawn_start())

    def _drawn_start(self) -> dict[str, Any]:
        w = np.random.default_rng(self.seed).standard_normal((9, self.n)) * SIGMA_0[:9, None]
        eta_0 = np.zeros((6, self.n))
        eta_0[:3] = truth(0.0)[0]["eta"][:3, None] + w[:3]
        eta_0[3:] = w[6:]
        return {"eta_0": eta_0, "sigma_0": SIGMA_0} | dict(self.start)

    def fly(self, until: float, tamper: Any = None) -> Iterator[tuple[float, dict[str, Array]]]:
        """Step sensors, then filters; gives (time of the estimate, truth then) after each."""
        takes = {
            name: {v.name for v in run.model.of_kind("input")}
            for name, run in [*self.sensors.items(), ("filter", self.filter)]
        }
        gives = {
            name: [(v.name, v.size) for v in sensor.model.of_kind("output")]
            for name, sensor in self.sensors.items()
        }
        for k, hull in enumerate(truth(until)):
            t = k * H
            readings = {}
            for name, sensor in self.sensors.items():
                sensor.step(t, H, **{x: v for x, v in hull.items() if x in takes[name]})
                for output, size in gives[name]:
                    y = sensor[output].reshape(size, -1)
                    readings[output if output == name else f"{name}_{output}"] = y
            if tamper is not None:
                tamper(t, readings)
            known = takes["filter"]
            self.filter.step(t, H, **{x: v for x, v in readings.items() if x in known})
            yield t, hull

    def last(self, until: float, tamper: Any = None) -> dict[str, Array]:
        """Fly to the end; gives the truth there."""
        *_, (_, hull) = self.fly(until, tamper)
        return hull

    def errors(self, hull: Mapping[str, Array]) -> Array:
        """True minus estimated, as the filter defines its 17 errors: (17, n)."""
        z, sensor = self.filter, self.sensors
        q = np.reshape(hull["q"], (4, 1))
        Rnb = np.array(ca.DM(R(ca.DM(hull["q"]))))
        r = z.p[z._place("parameter", "r_imu")][:, 0]
        place = hull["eta"][:3] + Rnb @ r
        v_true = Rnb @ (hull["nu"][:3] + np.cross(hull["nu"][3:], r))
        a = np.reshape(z["q"], (4, -1))
        R_est = [np.array(ca.DM(R(a[:, i]))) for i in range(self.n)]
        zeta = [Ra @ Rnb.T @ v_true - z["v"][:, i] for i, Ra in enumerate(R_est)]
        vector = a[0] * q[1:] - q[0] * a[1:] - np.cross(a[1:], q[1:], axis=0)
        scalar = a[0] * q[0] + np.sum(a[1:] * q[1:], axis=0)
        dtheta = 2.0 * np.sign(scalar) * vector
        eta = [Ra @ dtheta[:, i] for i, Ra in enumerate(R_est)]
        biases = [
            sensor["imu"]["gyro_bias_on"] + sensor["imu"]["gyro_bias"] - z["b_g"],
            sensor["imu"]["acc_bias_on"] + sensor["imu"]["acc_bias"] - z["b_a"],
            sensor["compass"]["bias"] - z["b_s"][:1],
            sensor["pressure"]["bias"] / PASCAL_PER_METRE - z["b_s"][1:],
        ]
        return np.vstack([place[:, None] - z["p"], np.transpose(zeta), np.transpose(eta), *biases])

    def covariance(self) -> Array:
        """Return P of each lane: (n, 17, 17)."""
        upper = self.filter["P"]
        P = np.zeros((self.n, N_ERRORS, N_ERRORS))
        i, j = np.triu_indices(N_ERRORS)
        P[:, i, j] = P[:, j, i] = upper.T
        return P


@dataclass
class Record:
    """What the Monte Carlo run gave, each second: (seconds, ...)."""

    nees: Array  # (s, N), of all 17 errors
    errors: Array  # (s, 17, N)
    nis: Array  # (s, 4, N)
    eigenvalues: Array  # (s, N), the least
    refused: Array  # (4, N)


@pytest.fixture(scope="module")
def monte_carlo(lanes: Any) -> Record:
    flight = Flight(lanes)
    nees, errors, nis, least = [], [], [], []
    for t, hull in flight.fly(50.0):
        nis.append(flight.filter["nis"])
        if round(t / H) % 100 == 50:
            e, P = flight.errors(hull), flight.covariance()
            nees.append([e[:, i] @ np.linalg.solve(P[i], e[:, i]) for i in range(N)])
            errors.append(e)
            least.append(np.linalg.eigvalsh(P)[:, 0])
    return Record(
        np.array(nees), np.array(errors), np.array(nis), np.array(least), flight.filter["refused"]
    )


def test_errors_are_as_large_as_the_filter_says(monte_carlo: Record) -> None:
    """NEES of all 17 errors, averaged over the runs, against chi-square of 17 N."""
    mean = monte_carlo.nees.mean(axis=1)
    low, high = chi2.ppf([0.005, 0.995], N_ERRORS * N) / N
    assert np.mean((mean > low) & (mean < high)) > 0.9
    low, high = chi2.ppf([0.0005, 0.9995], N_ERRORS * N) / N
    assert low < np.mean(mean) < high


def test_innovations_are_as_large_as_the_filter_says(monte_carlo: Record) -> None:
    """NIS of each sensor, averaged over runs and time; USBL, the rarest, has 50 fixes a run."""
    readings = np.array([250 * 4, 500, 500, 48 * 3]) * N
    bound = 4.0 * np.sqrt(2.0 / readings)
    assert np.all(np.abs(monte_carlo.nis[200:].mean(axis=(0, 2)) - 1.0) < bound + 0.03)


def test_errors_have_no_bias_over_the_runs(monte_carlo: Record) -> None:
    last = monte_carlo.errors[-1]
    assert np.all(np.abs(last.mean(axis=1)) < 4.5 * last.std(axis=1) / np.sqrt(N))


def test_position_heading_and_depth_are_found_to_useful_accuracy(monte_carlo: Record) -> None:
    rms = np.sqrt(np.mean(monte_carlo.errors[20:] ** 2, axis=(0, 2)))
    assert np.all(rms[:3] < 0.06)  # m
    assert np.all(rms[3:6] < 0.01)  # m/s
    assert np.all(rms[6:8] < np.deg2rad(1.0))
    assert rms[8] < np.deg2rad(0.6)


def test_covariance_stays_positive_definite(monte_carlo: Record) -> None:
    assert np.min(monte_carlo.eigenvalues) > 0.0


def test_honest_readings_are_not_refused(monte_carlo: Record) -> None:
    """But by chance: beyond 5 deviations are 6e-7 of 43 thousand scalars."""
    assert np.sum(monte_carlo.refused) <= 1.0


def test_filter_reads_sensors_only() -> None:
    sensors = ("imu_", "dvl_", "pressure", "compass_", "usbl_")
    assert all(v.name.startswith(sensors) for v in navigation().of_kind("input"))


def test_filter_stays_below_20_thousand_instructions_a_tick() -> None:
    assert Evaluation(navigation()).updates[0].n_instructions() < 20_000


def test_before_any_reading_it_gives_its_start(lanes: Any) -> None:
    eta_0 = [1.0, 2.0, 3.0, 0.1, -0.2, 2.5]
    run = lanes(navigation(), parameters={"eta_0": eta_0})
    assert run["eta"] == pytest.approx(eta_0, abs=1e-12)
    assert run["sigma"][:3] == pytest.approx([0.5, 0.5, 0.1])
    assert run.step(0.0, H)["eta"] == pytest.approx(eta_0, abs=1e-12)


def test_without_usbl_the_position_drifts_and_the_filter_says_so(lanes: Any) -> None:
    flights = [Flight(lanes, n=2), Flight(lanes, n=2, parameters={"usbl": {"dropout": 1.0}})]
    for flight in flights:
        flight.last(30.0)
    aided, alone = (np.max(flight.filter["sigma"][:2]) for flight in flights)
    assert alone > 0.5  # it never learns where it started
    assert aided < 0.05


def test_a_fix_is_compared_with_where_the_vehicle_was_when_it_was_taken(lanes: Any) -> None:
    """400 m away a fix is 0.54 s old: uncompensated, that is 0.2 m astern."""
    usbl = {"p_transceiver": [0, -400, 0], "sigma_angle": 1e-5, "sigma_range": 0.02, "dropout": 0}
    flight = Flight(lanes, n=8, parameters={"usbl": usbl})
    hull = flight.last(11.0)
    assert hull["nu"][0] > 0.39
    assert abs(np.mean(flight.errors(hull)[0])) < 0.02


def test_one_wild_fix_is_refused(lanes: Any) -> None:
    flight = Flight(lanes, n=2, parameters={"usbl": {"dropout": 0}})

    def tamper(t: float, readings: dict[str, Array]) -> None:
        if 14.9 < t < 15.9:
            readings["usbl_position"] = readings["usbl_position"] + 30.0

    hull = flight.last(16.0, tamper)
    assert np.all(flight.filter["refused"][3] >= 3)
    assert np.max(np.abs(flight.errors(hull)[:3])) < 0.2


def test_a_sensor_that_insists_is_believed(lanes: Any) -> None:
    """Recovery: not one fix but all of them say that the vehicle is 30 m elsewhere."""
    flight = Flight(lanes, n=2)

    def tamper(t: float, readings: dict[str, Array]) -> None:
        if t > 10.0:
            readings["usbl_position"] = readings["usbl_position"] + [[30.0], [0.0], [0.0]]

    hull = flight.last(40.0, tamper)
    assert np.all(flight.errors(hull)[0] < -10.0)


def test_a_reading_that_is_still_shown_is_not_used_again(lanes: Any) -> None:
    run = lanes(navigation())
    shown = {
        "imu_acc": [0, 0, -9.81],
        "imu_valid": 1,
        "compass_psi": 0.0,
        "compass_valid": 1,
        "compass_t_sample": 0.0,
    }
    sigma = []
    for k in range(300):
        run.step(k * H, H, imu_t_sample=k * H, **shown)
        sigma.append(float(run["sigma"][5]))
    assert sigma[0] < 0.05  # the first time it told something
    assert np.all(np.diff(sigma) >= 0)
    assert np.all(np.diff(sigma[::10]) > 0)  # as of the latest correction, every 0.1 s


def test_estimate_carries_the_time_of_the_imu_reading(lanes: Any) -> None:
    run = lanes(navigation())
    run.step(0.50, H, imu_valid=1, imu_t_sample=0.47, imu_acc=[0, 0, -9.81])
    assert run["t_sample"] == pytest.approx([0.47])


def test_small_rotations_become_unit_quaternions_of_that_angle() -> None:
    a = np.array([0.02, -0.03, 0.01])
    q = np.array(ca.DM(q_of_rotation(ca.DM(a)))).ravel()
    angle = np.linalg.norm(a)
    expected = [np.cos(angle / 2), *(np.sin(angle / 2) * a / angle)]
    assert q == pytest.approx(expected, abs=1e-9)


def test_a_wandering_bias_is_expected_to_return_as_its_covariance_says(lanes: Any) -> None:
    """Gauss-Markov, left unobserved for two correlation times: exp(-2) of it remains."""
    parameters = {"tau_aiding": [5.0, 60.0], "sigma_0": SIGMA_0 * np.repeat([0.01, 1.0], [15, 2])}
    run = lanes(navigation(), parameters=parameters)
    level = {"imu_acc": [0, 0, -9.81], "imu_valid": 1, "compass_psi": 0.01}
    for k in range(1200):
        seen = {"compass_valid": 1, "compass_t_sample": k // 10 * 0.1} if k < 200 else {}
        run.step(k * H, H, imu_t_sample=k * H, **level, **seen)
        if k == 199:
            learned = float(run["b_s"][0])
    assert learned > 0.001
    assert float(run["b_s"][0]) / learned == pytest.approx(np.exp(-2.0), rel=0.01)


def test_transition_of_errors_is_the_derivative_of_the_mechanisation() -> None:
    """The difference is of third order in t: ten times the way, a thousand times as much."""
    small, large = (np.max(np.abs(transition_difference(n))) for n in (10, 100))
    assert large / small == pytest.approx(1000.0, rel=0.2)


def test_correcting_takes_the_errors_out_as_they_are_defined() -> None:
    """To first order: what remains is of second order in the errors."""
    e, q = ca.SX.sym("e", 15), q_of_euler(0.1, -0.2, 0.7)
    estimate = Inertial(
        ca.DM([1, 2, 3]), ca.DM([0.4, -0.3, 0.2]), q, ca.DM.zeros(3), ca.DM.zeros(3)
    )
    remains = errors_of(apart_by(estimate, e), corrected(estimate, e))
    slope = np.array(ca.Function("f", [e], [ca.jacobian(remains, e)])(np.zeros(15)))
    assert slope == pytest.approx(np.zeros((15, 15)), abs=1e-12)


def apart_by(x: Inertial, e: Any) -> Inertial:
    """Return the truth at the errors e = (dp, zeta, eta, db_g, db_a) away from the estimate."""
    turn = q_of_rotation(e[6:9])
    v = ca.mtimes(R(turn), x.v + e[3:6])
    return Inertial(x.p + e[:3], v, multiply(turn, x.q), x.b_g + e[9:12], x.b_a + e[12:])


def errors_of(true: Inertial, x: Inertial) -> Any:
    """Return the errors of an estimate, as `strapdown` defines them."""
    turn = multiply(true.q, ca.vertcat(x.q[0], -x.q[1:]))
    zeta = ca.mtimes(R(turn).T, true.v) - x.v
    return ca.vertcat(true.p - x.p, zeta, 2.0 * turn[1:], true.b_g - x.b_g, true.b_a - x.b_a)


def transition_difference(steps: int) -> Array:
    """Return Phi over n steps of 1 ms minus the derivative, in a turn at a slant."""
    g, dt = 9.81, 1e-3
    e, gyro, acc = ca.SX.sym("e", 15), ca.DM([0.3, -0.2, 0.5]), ca.DM([0.4, -0.7, -9.5])
    zero, q = ca.DM.zeros(3), q_of_euler(0.1, -0.2, 0.7)
    start = Inertial(ca.DM([1, 2, 3]), ca.DM([0.4, -0.3, 0.2]), q, zero, zero)
    there, here = apart_by(start, e), start
    for _ in range(steps):
        there = mechanised(there, gyro - there.b_g, acc - there.b_a, g, dt)
        here = mechanised(here, gyro, acc, g, dt)
    errors = errors_of(there, here)
    exact = ca.Function("F", [e], [ca.jacobian(errors, e)], {"cse": True})(np.zeros(15))
    way, mean_R = here.p - start.p, 0.5 * (R(here.q) + R(start.q))
    F = ErrorTransition(steps * dt, way, mean_R, g, ca.DM.zeros(0))(ca.SX.eye(15))
    return np.array(ca.evalf(ca.SX(F))) - np.array(exact)


def test_keeping_station_for_long_the_filter_still_knows_how_little_it_knows() -> None:
    """1500 s of the survey, twelve seeds: heading, roll and pitch against their deviations.

    By the kernel, whose environments have the bits of masters.
    """
    import uuvsim_cosim as uuv
    from uuvsim_cosim.kernels import fuse

    z = []
    with fuse(uuv.load("bluerov2_survey")).batch(12, seeds=0) as batch:
        batch.step(400 * 100)
        while batch.time[0] < 1500.0:
            batch.step(100)
            error = (batch.get("hull.eta") - batch.get("navigation.eta"))[:, 3:]
            wrapped = (error + np.pi) % (2.0 * np.pi) - np.pi
            z.append(wrapped / batch.get("navigation.sigma")[:, 3:6])
    assert np.mean(np.square(z)[..., 2]) < 1.4
    outside = np.mean(np.abs(z) > 3.0, axis=(0, 1))
    assert outside[2] < 0.01
    assert np.all(outside[:2] < 0.03)
