"""Buoyancy through the surface: closed forms of draught, energy kept, volumes read from files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.declaration.kinematics import R
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.hull.restoring import mean_depth
from uuvsim_cosim.models.hull.vehicle import hull
from uuvsim_cosim.models.shapes.volumes import Volume, sphere, vehicle_volumes
from uuvsim_cosim.models.vehicles.closed_forms import total_mass
from uuvsim_cosim.models.water.seawater import density

SHAPES = {
    "ellipsoid": Volume("ellipsoid", (0, 0, 0), (0.6, 0.3, 0.2)),
    "box": Volume("box", (0, 0, 0), (0.6, 0.3, 0.2)),
    "cylinder": Volume("cylinder", (0, 0, 0), (0.6, 0.3, 0.3), 0),
}
BODY = {
    "m": 10.0,
    "W": 100.0,
    "B": 125.0,
    "z_g": 0.05,
    "x_b": 0.02,
    **{f"I_b_{i}{i}": v for i, v in ((1, 0.2), (2, 0.6), (3, 0.7))},
    **{f"M_A_{i}{i}": v for i, v in enumerate((2.0, 8.0, 9.0, 0.05, 0.3, 0.3), 1)},
}
CATAMARAN = [
    Volume("cylinder", (0.0, -0.3, 0.0), (0.8, 0.12, 0.12), 0),
    Volume("cylinder", (0.0, 0.3, 0.0), (0.8, 0.12, 0.12), 0),
    Volume("box", (0.1, 0.0, -0.1), (0.3, 0.4, 0.1)),
    sphere(0.1, (-0.3, 0.0, 0.05)),
]


def function(shape: str) -> Any:
    v, s = SHAPES[shape], ca.SX.sym("s", 4)
    U = mean_depth(v, 0.5 * ca.DM(v.size), s[0], s[1:])
    return ca.Function("U", [s], [U, ca.gradient(U, s)])


@pytest.mark.parametrize("shape", SHAPES)
def test_the_share_under_water_and_its_middle_are_those_of_points_of_the_volume(shape: str) -> None:
    rng, half = np.random.default_rng(1), 0.5 * np.array(SHAPES[shape].size)
    points = rng.uniform(-1, 1, (200_000, 3))
    if shape != "box":
        across = points if shape == "ellipsoid" else points[:, 1:]
        points = points[np.sum(across**2, axis=1) < 1]
    points *= half
    f = function(shape)
    for down in ([0, 0, 1.0], [1.0, 0, 0], [0.3, -0.5, 0.81], [-0.6, 0.02, -0.8]):
        d = np.array(down) / np.linalg.norm(down)
        for D in (-0.05, 0.0, 0.06):
            U, gradient = (np.array(x).ravel() for x in f([D, *d]))
            depth = D + points @ d
            wet = depth > 0
            assert U[0] == pytest.approx(np.maximum(depth, 0).mean(), abs=6e-4)
            assert gradient[0] == pytest.approx(wet.mean(), abs=5e-3)
            turning = np.cross((points * wet[:, None]).mean(axis=0), d)
            np.testing.assert_allclose(np.cross(gradient[1:], d), turning, atol=1e-3)


@pytest.mark.parametrize("shape", SHAPES)
@settings(max_examples=30, deadline=None, derandomize=True)
@given(
    D=st.floats(-0.5, 0.5),
    angles=st.tuples(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5)),
)
def test_half_is_under_water_at_the_middle_and_each_share_has_its_mirror(
    shape: str, D: float, angles: tuple[float, float]
) -> None:
    f, (a, b) = function(shape), angles
    d = np.array([np.sin(b), np.cos(b) * np.sin(a), np.cos(b) * np.cos(a)])
    shares = [float(f([x, *d])[1][0]) for x in (D, -D, 0.0, D + 1e-6)]
    assert shares[0] + shares[1] == pytest.approx(1.0, abs=1e-9)
    assert shares[2] == pytest.approx(0.5, abs=1e-9)
    assert -1e-9 <= shares[3] - shares[0] < 1e-3, "it rises with depth, without a jump"


def test_a_sphere_floats_at_the_draught_of_its_closed_form() -> None:
    """V (2 + 3 y - y³) / 4 = W / (rho g), y = depth of the middle over the radius."""
    body = {"m": 10.0, "W": 60.0, "B": 100.0, "D_l_33": 80.0}
    body |= {f"I_b_{i}{i}": 1.0 for i in (1, 2, 3)}
    model = hull("ball", body, volumes=[sphere(0.2)])
    start = {"eta_0": [0, 0, 1.0, 0, 0, 0]}
    D = simulate(model, at=[0.0, 40.0], h=0.01, parameters=start)["eta"][-1, 2]
    y = D / 0.2
    assert (2 + 3 * y - y**3) / 4 == pytest.approx(0.6, abs=1e-9)


def test_a_box_floats_level_at_its_share() -> None:
    body = {"m": 10.0, "W": 75.0, "B": 100.0, "D_l_33": 80.0, "z_g": 0.05, "D_l_44": 5.0}
    body |= {f"I_b_{i}{i}": 1.0 for i in (1, 2, 3)} | {"D_l_55": 5.0}
    model = hull("raft", body, volumes=[Volume("box", (0, 0, 0), (1.0, 0.6, 0.4))])
    start = {"eta_0": [0, 0, 0.3, 0.1, -0.1, 0]}
    eta = simulate(model, at=[0.0, 60.0], h=0.01, parameters=start)["eta"][-1]
    np.testing.assert_allclose(eta[2:5], [0.25 * 0.4, 0, 0], atol=1e-6)


def test_a_hull_of_volumes_that_leaps_and_falls_keeps_its_energy() -> None:
    """Kinetic energy, weight and what is displaced, through the surface, tumbling."""
    model = hull("leaper", BODY, volumes=CATAMARAN)
    start = {"eta_0": [0, 0, 0.6, 0.4, 0.7, 0.2], "nu_0": [0.5, 0.2, -1.5, 0.8, -0.6, 0.3]}
    r = simulate(model, until=4.0, h=4e-3, parameters=start)
    total = energy_of(model)
    rows = np.hstack([r["eta"][:, 2:3], r["nu"], r["q"]])[::10]
    energy = [float(total(row)) for row in rows]
    assert min(r["eta"][:, 2]) < 0 < max(r["eta"][:, 2]), "it leaves the water"
    assert np.ptp(energy) / max(energy) < 1e-5


def energy_of(model: Model) -> Any:
    """Return (D, nu, q) -> kinetic energy, less what weight has fallen, plus what is displaced."""
    D, nu, q = ca.SX.sym("D"), ca.SX.sym("nu", 6), ca.SX.sym("q", 4)
    down = R(q)[2, :].T
    shares = np.array([v.displaced for v in CATAMARAN])
    shares /= shares.sum()
    middle = sum(s * np.array(v.r) for s, v in zip(shares, CATAMARAN, strict=True))
    U = ca.SX(0.0)
    for share, v in zip(shares, CATAMARAN, strict=True):
        at = ca.DM(np.array(v.r) - middle + np.array([BODY["x_b"], 0, 0]))
        U += share * mean_depth(v, 0.5 * ca.DM(v.size), D + ca.dot(at, down), down)
    kinetic = 0.5 * ca.dot(nu, ca.mtimes(ca.DM(total_mass(model)), nu))
    height = D + BODY["z_g"] * down[2]
    E = kinetic - BODY["W"] * height + BODY["B"] * U
    return ca.Function("E", [ca.vertcat(D, nu, q)], [E])


def test_under_water_the_volumes_make_no_difference() -> None:
    rows = []
    for surface in (False, "volumes"):
        start = {"eta_0": [0, 0, 30, 0.3, -0.2, 1.0], "nu_0": [0.4, 0.1, 0.1, 0.2, 0.1, 0.2]}
        model = declare("bluerov2_heavy", surface=surface)
        rows.append(simulate(model, at=[0.0, 3.0], h=0.01, parameters=start)["eta"][-1])
    np.testing.assert_allclose(rows[0], rows[1], atol=1e-9)


@pytest.mark.parametrize("id", ["bluerov2_heavy", "remus100", "sphere"])
def test_an_outline_gives_one_equivalent_volume(id: str) -> None:
    assert len(vehicle_volumes(id)) == 1
    assert declare(id, surface="volumes").variables["volume_size"].shape == (1, 3)


LISTED = """volumes:
  unit: mm
  source: "typed for a test"
  of:
    - {shape: sphere, r: [0, 0, 0], diameter: 200}
    - {shape: cylinder, r: [0, 100, 0], axis: z, diameter: 50, length: 300}
    - {shape: box, r: [0, -100, 0], size: [100, 200, 300]}
default:"""


def written(folder: Path, text: str) -> str:
    file = content("models", "vehicles", "sphere", "parameters.yaml").read_text()
    (folder / "parameters.yaml").write_text(file.replace("default:", text, 1))
    return str(folder)


def test_volumes_are_read_in_their_unit(tmp_path: Path) -> None:
    ball, tube, box = vehicle_volumes(written(tmp_path, LISTED))
    assert ball.displaced == pytest.approx(4 / 3 * np.pi * 0.1**3)
    assert tube.displaced == pytest.approx(np.pi / 4 * 0.05**2 * 0.3)
    assert (tube.axis, box.displaced) == (2, pytest.approx(0.006))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("diameter: 200", "size: [1, 1, 1]", "diameter"),
        ("axis: z", "axis: w", "x, y or z"),
        ("unit: mm", "unit: kg", "volumes: unit 'kg'"),
        ("size: [100, 200, 300]", "size: [100, 200, -3]", "above 0"),
    ],
)
def test_a_mistake_in_a_volume_is_named_with_its_line(
    old: str, new: str, message: str, tmp_path: Path
) -> None:
    folder = written(tmp_path, LISTED.replace(old, new))
    with pytest.raises(InputInvalid, match=rf"parameters\.yaml:\d+: .*{message}"):
        vehicle_volumes(folder)


def test_an_option_that_is_neither_true_nor_false_is_refused() -> None:
    with pytest.raises(InputInvalid, match="expected true, false, volumes"):
        declare("sphere", surface="maybe")


def test_a_neutral_hull_in_denser_water_below_swings_at_its_buoyancy_frequency() -> None:
    """B (1 + beta D) = W at D_0, and small swings about it have omega² = beta B / (m + A_33)."""
    beta, B, W = 0.01, 100.0, 101.0
    body = {"m": 10.0, "W": W, "B": B, "M_A_33": 9.0, "beta_rho": 0.012, "beta_nabla": 0.002}
    body |= {f"I_b_{i}{i}": 1.0 for i in (1, 2, 3)}
    period = 2 * np.pi / np.sqrt(beta * B / 19.0)
    model = hull("float", body, surface=False)
    start = {"eta_0": [0, 0, 1.2, 0, 0, 0]}
    D = simulate(model, at=[0.0, period / 2, period], h=0.02, parameters=start)["eta"][:, 2]
    np.testing.assert_allclose(D, [1.2, 0.8, 1.2], atol=1e-6)


def test_the_option_adds_the_density_of_sea_water() -> None:
    model = declare("remus100", compressible=True)
    at = 1000.0
    p = density(35.0, 10.0) * 9.81 * at
    rise = density(35.0, 10.0, p) / density(35.0, 10.0) - 1
    assert float(model.variables["beta_rho"].start[0]) * at == pytest.approx(rise, rel=0.02)
