"""Backscatter of surfaces: closed forms, Kirchhoff's integral, published inputs, refusals."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from scipy.integrate import quad

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.acoustics import backscatter
from uuvsim_cosim.models.acoustics.backscatter import Sediment, apl_uw, grain_size, lambert

ROCK = Sediment(2.5, 2.5, 0.01374, 0.002, 0.01862)
SAND, MUD = grain_size(1.5), grain_size(6.5)
THETA = np.radians(np.linspace(1.0, 90.0, 90))


def decibels(sigma: np.ndarray) -> np.ndarray:
    return 10.0 * np.log10(sigma)


def test_a_lambert_surface_that_reflects_all_scatters_all_that_it_receives() -> None:
    # Bistatic: mu sin(in) sin(out), integrated over the half space, is sin(in) for mu = 1/pi.
    out = quad(lambda t: np.sin(t) * np.cos(t), 0.0, pi / 2)[0] * 2.0 * pi
    assert lambert(pi / 2, 1.0 / pi) * out == pytest.approx(1.0)


# Rows of table 2: M_z, rho, nu, delta, sigma_2, w_2.
TABLE_2 = [
    (-1.0, 2.492, 1.3370, 0.01705, 0.002, 0.012937),
    (0.0, 2.314, 1.2778, 0.01630, 0.002, 0.008602),
    (1.5, 1.845, 1.1782, 0.01624, 0.002, 0.004446),
    (3.0, 1.339, 1.0800, 0.01728, 0.002, 0.002070),
    (6.5, 1.148, 0.9861, 0.00306, 0.001, 0.000518),
    (9.0, 1.145, 0.9800, 0.00148, 0.001, 0.000518),
]


@pytest.mark.parametrize("row", TABLE_2)
def test_the_inputs_by_grain_size_are_those_of_table_2(row: tuple[float, ...]) -> None:
    p = grain_size(row[0])
    assert (p.rho, p.nu, p.delta, p.sigma_2, p.w_2) == pytest.approx(row[1:], rel=0.003)


@pytest.mark.parametrize("M_z", [1.5, 2.5, 3.5])
def test_normal_incidence_on_a_smooth_bottom_is_kirchhoffs_integral(M_z: float) -> None:
    # sigma = |R|² / (8 pi) times the integral of u exp(-q u^(2 alpha)) over u from 0 to infinity.
    p, k = grain_size(M_z), 2.0 * pi * 40e3 / 150e3
    alpha = p.gamma / 2.0 - 1.0
    q = backscatter._q_c(k, alpha, p.w_2)
    integral = quad(lambda u: u * np.exp(-q * u ** (2.0 * alpha)), 0.0, np.inf, limit=500)[0]
    R = (p.rho * p.nu - 1.0) / (p.rho * p.nu + 1.0)
    without_volume = replace(p, sigma_2=0.0)
    sigma = apl_uw(pi / 2, 40e3, without_volume)
    assert decibels(sigma) == pytest.approx(decibels(R**2 / (8.0 * pi) * integral), abs=0.15)


def test_the_structure_constant_is_that_of_the_relief_spectrum() -> None:
    # D(x) = 2 times the integral of (1 - cos K.x) W(K) over the plane = C_h² x^(2 alpha).
    from scipy.special import j0

    alpha, k, w_2 = 0.625, 1.7, 0.004
    x, gamma = 1.0, 2.0 * alpha + 2.0
    near = quad(lambda K: (1.0 - j0(K * x)) * K ** (1.0 - gamma), 0.0, 200.0, limit=2000)[0]
    far = 200.0 ** (2.0 - gamma) / (gamma - 2.0)  # j0 vanishes on average
    D = 4.0 * pi * w_2 * (near + far)
    q = D * 2.0 ** (1.0 - 2.0 * alpha) * k ** (2.0 * (1.0 - alpha))
    assert backscatter._q_c(k, alpha, w_2) == pytest.approx(q, rel=1e-3)


def test_the_mean_of_lamberts_law_over_slopes_follows_the_slopes() -> None:
    # sin² averaged over a normal angle of deviation s: (1 - exp(-s²) cos 2 theta) / 2, where s² is
    # the variance of the angle that the quadrature has, half that of its doubled argument.
    s, theta = 0.1, np.array([0.8])
    mean = backscatter._over_slopes(theta, s, lambda t: np.sin(t) ** 2)
    assert mean == pytest.approx(0.5 * (1.0 - np.exp(-(s**2)) * np.cos(2.0 * theta)), rel=1e-4)


def test_the_strength_falls_towards_grazing_incidence() -> None:
    for p in (ROCK, SAND, MUD):
        assert np.all(np.diff(decibels(apl_uw(THETA[:40], 40e3, p))) > -0.2)


def test_rock_scatters_more_than_sand_and_sand_more_than_mud() -> None:
    t = np.radians([10.0, 20.0, 30.0, 45.0])
    rock, sand, mud = (decibels(apl_uw(t, 40e3, p)) for p in (ROCK, SAND, MUD))
    assert np.all(rock > sand + 6.0)
    assert np.all(sand > mud)


def test_the_strength_is_continuous_over_angle() -> None:
    fine = np.radians(np.linspace(1.0, 90.0, 8901))
    for p in (ROCK, SAND, MUD, grain_size(3.0)):
        for f in (10e3, 40e3, 100e3):
            assert abs(np.diff(decibels(apl_uw(fine, f, p)))).max() < 0.5


def test_zero_grazing_angle_has_the_strength_of_a_thousandth_of_a_degree() -> None:
    assert apl_uw(0.0, 40e3, SAND) == apl_uw(np.radians(0.001), 40e3, SAND) > 0.0


@pytest.mark.parametrize(
    ("frequency", "c", "theta", "expected"),
    [
        (900e3, 1500.0, 0.5, "frequency 900000 Hz; expected 10000 to 100000 Hz"),
        (40e3, 340.0, 0.5, "speed of sound 340 m/s; expected 1400 to 1600 m/s"),
        (40e3, 1500.0, 2.0, "grazing angle 2 rad"),
        (40e3, 1500.0, np.nan, "grazing angle nan rad"),
    ],
)
def test_a_value_beyond_the_range_of_the_model_is_refused(
    frequency: float, c: float, theta: float, expected: str
) -> None:
    with pytest.raises(InputInvalid, match="APL-UW TR 9407") as error:
        apl_uw(theta, frequency, SAND, c)
    assert expected in str(error.value)


def test_a_sediment_beyond_the_range_of_the_model_is_refused() -> None:
    with pytest.raises(InputInvalid, match=r"nu 5; expected 0.8 to 3"):
        apl_uw(0.5, 40e3, replace(SAND, nu=5.0))
    with pytest.raises(InputInvalid, match=r"M_z 12 phi; expected -1 to 9 phi"):
        grain_size(12.0)
