"""Each shipped vehicle: a whole folder, published geometry, its picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from uuvsim_cosim.content import content
from uuvsim_cosim.models.actuators.thruster_geometry import configuration_matrix, thruster_geometry
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.parameter_files import (
    parameter_set,
    propelled_ids,
    read_yaml,
    vehicle_folder,
    vehicle_ids,
    vehicle_sets,
    vehicle_size,
)
from uuvsim_cosim.models.shapes.ellipsoid import added_mass
from uuvsim_cosim.models.vehicles.closed_forms import closed_forms, total_mass
from uuvsim_cosim.models.vehicles.outline import outline_svg

DRAWN = [id for id in vehicle_ids() if vehicle_size(id) is not None]
EXPECTED = {
    "rexrov",
    "rexrov2",
    "bluerov2",
    "bluerov2_heavy",
    "pool8",
    "sphere",
    "remus100",
    "lauv",
    "eca_a9",
    "npsauv",
    "desistek_saga",
    "tethys_lrauv",
    "slocum",
}
FLU = np.diag([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])


def test_the_vehicles_that_were_promised_are_there() -> None:
    assert set(vehicle_ids()) >= EXPECTED


@pytest.mark.parametrize("id", vehicle_ids())
def test_a_vehicles_folder_is_whole(id: str) -> None:
    folder = vehicle_folder(id)
    text = (folder / "README.md").read_text()
    for name in vehicle_sets(id):
        assert f"{id}@{name}" in text, "every set is explained"
        assert parameter_set(id, name).vehicle == id
    assert "Errata" in text
    if id in propelled_ids():
        assert len(thruster_geometry(id).names) >= 1
    if id in DRAWN:
        assert "outline.svg" in text
        assert "Validity" in text


@pytest.mark.parametrize("id", DRAWN)
def test_a_vehicles_picture_is_that_of_its_files(id: str) -> None:
    """Write them anew by `write_outlines` of uuvsim_cosim.models.vehicles.outline."""
    assert (vehicle_folder(id) / "outline.svg").read_text() == outline_svg(id)


@pytest.mark.parametrize(
    "path",
    sorted(content("models", "vehicles").glob("*/published.yaml")),
    ids=lambda p: p.parent.name,
)
def test_the_interval_of_each_number_holds_every_set_that_lists_it(path: Path) -> None:
    """Each number that is drawn is a parameter of some set, and spans two values or more."""
    data = read_yaml(path, "published.schema.json")
    known = {
        n for s in vehicle_sets(path.parent.name) for n in parameter_set(data["id"], s).quantities
    }
    assert data["id"] == path.parent.name
    for name, values in data["parameters"].items():
        assert name in known, name
        assert len({float(v["value"]) for v in values}) >= 2, name


def test_the_recorded_moments_of_saga_have_the_wrong_sign_in_pitch() -> None:
    """Forces and yaw agree with its TAM.yaml (astern is positive there); row M is its negative."""
    ours = FLU @ configuration_matrix(thruster_geometry("desistek_saga"))
    recorded = np.array([[-1, -1, 0], [0, 0, 0], [0, 0, 1], [0, 0, 0],
                         [-0.0061828, -0.0061828, 0.067], [-0.1192, 0.1192, 0]])  # fmt: skip
    recorded[:, :2] *= -1
    recorded[4] *= -1
    np.testing.assert_allclose(ours, recorded, atol=1e-12)


@pytest.mark.parametrize(
    ("set", "r", "rho"), [("analytic", 0.2, 1000), ("uuv_simulator_test", 0.1, 1028)]
)
def test_the_sphere_is_what_its_rules_say(set: str, r: float, rho: float) -> None:
    q = {k: v.value for k, v in parameter_set("sphere", set).quantities.items()}
    assert q["m"] == pytest.approx(4 / 3 * np.pi * rho * r**3, rel=1e-11)
    assert q["M_A_22"] == pytest.approx(added_mass(r, r, r, rho)[1], rel=1e-9)
    assert q["D_q_33"] == pytest.approx(0.25 * rho * np.pi * r * r, rel=1e-11)
    assert q["I_g_11"] == pytest.approx(0.4 * q["m"] * r * r, rel=1e-11)


def test_added_mass_of_a_spheroid_is_fossens_lamb() -> None:
    """remus100.py's k-factors of 1.6 x 0.19 m at 1026 kg/m3, as the shipped set has them."""
    q = parameter_set("remus100", "fossen_2021").quantities
    ours = added_mass(0.8, 0.095, 0.095, 1026)
    for i in (0, 1, 4):
        assert ours[i] == pytest.approx(q[f"M_A_{i + 1}{i + 1}"].value, rel=1e-9)


def test_total_mass_of_rexrov_agrees_with_uuv_simulator() -> None:
    M = total_mass(declare("rexrov@uuv_simulator"))
    assert M[3, 5] == pytest.approx(54.429, abs=1e-9)
    assert M[2, 5] == pytest.approx(10.774, abs=1e-12)
    assert M[5, 2] == pytest.approx(10.775, abs=1e-12)


def test_products_of_inertia_are_turned_with_the_frame() -> None:
    """FLU to FRD turns y and z round: I_xy and I_xz change sign, I_yz does not."""
    turned, kept = (parameter_set("rexrov", s).quantities for s in ("berg_2012", "uuv_simulator"))
    signs = [turned[n].value / kept[n].value for n in ("I_g_12", "I_g_13", "I_g_23")]
    assert signs == [-1, -1, 1]


# ---- the closed forms themselves ----------------------------------------------------------------


def failing(name: str, **values: float) -> set[str]:
    model = declare(name, surface=False, values=values)
    return {c.name for c in closed_forms(model) if c.off > c.tolerance}


def test_a_sound_hull_breaks_no_closed_form() -> None:
    assert failing("bluerov2_heavy") == set()


@pytest.mark.parametrize(
    ("claim", "values"),
    [
        ("M is positive definite", {"M_A_33": -40.0}),
        ("M is symmetric", {"M_A_15": 1.0, "M_A_51": -1.0}),
        ("water takes energy only", {"D_q_11": -141.0}),
        ("level is neutral", {"x_g": 0.05}),
        ("upright is stable", {"z_b": 0.01}),
        ("weight is near buoyancy", {"nabla": 0.02}),
    ],
)
def test_each_closed_form_finds_what_breaks_it(claim: str, values: dict[str, float]) -> None:
    assert claim in failing("bluerov2_heavy", **values)
