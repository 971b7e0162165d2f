"""Reflection coefficients: normal incidence, critical angle, angle of intromission, roughness."""

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.acoustics.materials import materials, reflection_table
from uuvsim_cosim.models.acoustics.reflection import coherent_share, rayleigh

ANGLES = np.linspace(0.0, np.pi / 2, 181)


def test_at_normal_incidence_the_impedances_decide() -> None:
    assert rayleigh(np.pi / 2, 1.845, 1.1782) == pytest.approx(
        (1.845 * 1.1782 - 1.0) / (1.845 * 1.1782 + 1.0)
    )


def test_below_the_critical_angle_all_is_reflected() -> None:
    critical = np.arccos(1.0 / 1.1782)
    size = np.abs(rayleigh(ANGLES, 1.845, 1.1782))
    np.testing.assert_allclose(size[critical - 0.01 > ANGLES], 1.0, rtol=1e-12)
    assert np.all(size[critical + 0.01 < ANGLES] < 0.9)


def test_a_soft_bottom_has_an_angle_of_intromission() -> None:
    """sin² = (1/nu² - 1) / (rho² - 1), where nothing is reflected."""
    rho, nu = 1.3, 0.98
    angle = np.arcsin(np.sqrt((1.0 / nu**2 - 1.0) / (rho**2 - 1.0)))
    assert abs(rayleigh(angle, rho, nu)) < 1e-12


def test_at_grazing_incidence_the_sign_turns() -> None:
    assert rayleigh(1e-9, 1.845, 1.1782) == pytest.approx(-1.0, abs=1e-6)


def test_no_material_reflects_more_than_it_receives() -> None:
    table = reflection_table(materials(), ANGLES)
    assert np.all(np.abs(table) <= 1.0 + 1e-12)
    assert np.all(np.abs(reflection_table(["rigid"], ANGLES)) == 1.0)


def test_roughness_takes_eight_decibel_and_more_with_its_square() -> None:
    k, sine = 100.0, 0.5
    one, two = (coherent_share(np.arcsin(sine), rms, k) for rms in (0.01, 0.02))
    assert one == pytest.approx(np.exp(-0.5 * (2 * k * 0.01 * sine) ** 2))
    assert np.log(two) == pytest.approx(4.0 * np.log(one))
    assert coherent_share(ANGLES, 0.0, k) == pytest.approx(1.0)


@pytest.mark.parametrize(
    "given", [{"rho": 0.0}, {"nu": -1.0}, {"delta": -0.1}, {"nu": float("nan")}]
)
def test_a_bottom_that_cannot_be_is_refused(given: dict[str, float]) -> None:
    with pytest.raises(InputInvalid, match="rho and nu above 0"):
        rayleigh(0.5, **({"rho": 2.0, "nu": 1.5} | given))


@pytest.mark.parametrize("rms", [-0.1, float("inf"), float("nan")])
def test_a_roughness_that_cannot_be_is_refused(rms: float) -> None:
    with pytest.raises(InputInvalid, match="rms height"):
        coherent_share(0.5, rms, 1.0)
