from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.kinematics import R, R_zyx, q_of_euler
from uuvsim_cosim.models.sensors.imu import imu


def read(lanes: Any, silent: Any, pose: Any = None, **inputs: Any) -> Any:
    m = imu()
    still = silent(m) | dict(pose or {})
    return lanes(m, parameters=still).step(0.0, 0.01, **inputs)


def q(phi: float, theta: float, psi: float) -> np.ndarray:
    return np.array(ca.DM(q_of_euler(phi, theta, psi))).ravel()


def test_at_rest_and_level_it_reads_minus_g_along_z(lanes: Any, silent: Any) -> None:
    run = read(lanes, silent)
    assert run["acc"] == pytest.approx([0, 0, -9.81], abs=1e-12)
    assert run["gyro"] == pytest.approx([0, 0, 0], abs=1e-12)
    assert run["valid"] == 1.0
    assert run["t_sample"] == 0.0


def test_at_rest_and_tilted_it_reads_minus_gravity_in_body_axes(lanes: Any, silent: Any) -> None:
    run = read(lanes, silent, q=q(0.3, -0.2, 1.0))
    expected = -9.81 * np.array([np.sin(0.2), np.cos(0.2) * np.sin(0.3), np.cos(0.2) * np.cos(0.3)])
    assert run["acc"] == pytest.approx(expected, abs=1e-12)


def test_turning_about_z_it_feels_the_centripetal_acceleration(lanes: Any, silent: Any) -> None:
    run = read(lanes, silent, {"r_s": [0.4, 0, 0]}, nu=[0, 0, 0, 0, 0, 2.0])
    assert run["acc"] == pytest.approx([-0.4 * 4.0, 0, -9.81], abs=1e-12)


def test_angular_acceleration_acts_through_the_lever(lanes: Any, silent: Any) -> None:
    run = read(lanes, silent, {"r_s": [0.4, 0, 0]}, nu_dot=[0, 0, 0, 0, 0, 3.0])
    assert run["acc"] == pytest.approx([0, 1.2, -9.81], abs=1e-12)


def test_mounting_turns_both_readings_into_sensor_axes(lanes: Any, silent: Any) -> None:
    Theta = [0.4, -0.3, 2.0]
    R_bs = np.array(ca.DM(R_zyx(*Theta)))
    run = read(lanes, silent, {"Theta_s": Theta, "r_s": [0, 0, 0]}, nu=[0, 0, 0, 0.1, 0.2, 0.3])
    assert run["gyro"] == pytest.approx(R_bs.T @ [0.1, 0.2, 0.3], abs=1e-12)
    assert run["acc"] == pytest.approx(R_bs.T @ [0, 0, -9.81], abs=1e-12)


def test_specific_force_is_the_second_derivative_of_the_sensors_place(
    lanes: Any, silent: Any
) -> None:
    """On p(t) and Theta(t) given in closed form, against differences of the sensor's position."""
    t, r = ca.SX.sym("t"), ca.DM([0.3, -0.2, 0.5])
    p = ca.vertcat(ca.sin(t), ca.cos(0.7 * t), 0.3 * t * t)
    Theta = ca.vertcat(0.3 * ca.sin(t), 0.2 * ca.cos(2 * t), 0.5 * t)
    Rnb = R(q_of_euler(Theta[0], Theta[1], Theta[2]))
    W = ca.mtimes(Rnb.T, ca.reshape(ca.jacobian(ca.vec(Rnb), t), 3, 3))
    omega = ca.vertcat(W[2, 1], W[0, 2], W[1, 0])
    v = ca.mtimes(Rnb.T, ca.jacobian(p, t))
    nu = ca.vertcat(v, omega)
    place = p + ca.mtimes(Rnb, r)
    force = ca.mtimes(Rnb.T, ca.jacobian(ca.jacobian(place, t), t) - ca.vertcat(0, 0, 9.81))
    f = ca.Function("f", [t], [Theta, nu, ca.jacobian(nu, t), force])
    angles, nu_t, nu_dot, expected = (np.array(x).ravel() for x in f(0.8))
    run = read(lanes, silent, {"r_s": [0.3, -0.2, 0.5]}, q=q(*angles), nu=nu_t, nu_dot=nu_dot)
    assert run["acc"] == pytest.approx(expected, abs=1e-12)


def test_errors_have_the_deviation_of_the_figures(lanes: Any) -> None:
    run = lanes(imu(), 3000).step(0.0, 0.01)
    acc = np.std(run["acc"], axis=1)
    gyro = np.std(run["gyro"], axis=1)
    assert acc == pytest.approx([np.sqrt(0.196**2 + 0.073485**2 + 0.004**2 * 100)] * 3, rel=0.06)
    expected = np.sqrt(0.0087**2 + 8.6726e-4**2 + 0.00033939**2 * 100)
    assert gyro == pytest.approx([expected] * 3, rel=0.06)


# ---- presets with scale, misalignment and range -------------------------------------------------


def test_scale_and_misalignment_are_drawn_once_and_act_on_the_reading(lanes: Any) -> None:
    m = imu("stim300")
    quiet = {v.name: 0.0 for v in m.of_kind("parameter") if v.name.endswith(("density", "_tau"))}
    quiet |= {f"{a}_{kind}_sigma": 0.0 for a in ("acc", "gyro") for kind in ("bias", "turn_on")}
    quiet = {k: v for k, v in quiet.items() if not k.endswith("tau")}
    run = lanes(m, 3000, parameters=quiet | {"gyro_scale_sigma": 0.01, "g": 0.0})
    omega = np.array([0.5, 0.0, 0.0])
    first = run.step(0.0, 0.1, nu=[0, 0, 0, *omega])["gyro"]
    assert np.std(first, axis=1) == pytest.approx([0.5 * 0.01, 0.5e-3, 0.5e-3], rel=0.06)
    later = run.step(0.1, 0.1, nu=[0, 0, 0, *(2 * omega)])["gyro"]
    np.testing.assert_allclose(later, 2 * first, rtol=1e-12)


def test_beyond_its_range_it_saturates(lanes: Any, silent: Any) -> None:
    m = imu("mpu6050")
    run = lanes(m, parameters=silent(m)).step(0.0, 0.01, nu=[0, 0, 0, 9.0, -9.0, 0.1])
    assert run["gyro"] == pytest.approx([4.3633, -4.3633, 0.1])


def test_a_preset_without_these_figures_declares_none() -> None:
    names = {v.name for v in imu().variables.values()}
    assert not any("scale" in n or "misalignment" in n or n.endswith("_range") for n in names)


def test_a_bias_instability_that_cannot_be_names_the_file(tmp_path: Path) -> None:
    text = content("models", "sensors", "stim300", "imu.yaml").read_text()
    (tmp_path / "x.yaml").write_text(text.replace("value: 3600", "value: 36"))
    with pytest.raises(ParameterInvalid, match=r"x\.yaml: gyro: bias_tau 36 s.*expected at least"):
        imu(str(tmp_path / "x.yaml"))


def test_a_misspelt_figure_is_refused_with_its_line_and_the_right_name(tmp_path: Path) -> None:
    text = content("models", "sensors", "adis16448", "imu.yaml").read_text()
    (tmp_path / "y.yaml").write_text(
        text + '  gyro_rnage: {value: 1, unit: rad/s, source: "guess"}\n'
    )
    with pytest.raises(
        ParameterInvalid, match=r"y\.yaml:17: parameters\.gyro_rnage.*such as gyro_range"
    ):
        imu(str(tmp_path / "y.yaml"))
