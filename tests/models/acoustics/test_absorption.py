"""Absorption of sound by sea water: values of other programs, agreement, limits, refusals."""

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.acoustics.absorption import ainslie_mccolm, francois_garrison

# kHz, degC, salinity, m, pH: dB/km by franc_garr.m of the Acoustics Toolbox (2019), whose author
# verified it with table IV of Francois and Garrison (1982).
TABLE = [
    (1.0, 10.0, 35.0, 0.0, 8.0, 0.060126),
    (10.0, 4.0, 35.0, 0.0, 8.0, 1.150864),
    (100.0, 4.0, 35.0, 0.0, 8.0, 27.536139),
    (100.0, 10.0, 35.0, 0.0, 8.0, 33.630316),
    (100.0, 10.0, 30.0, 1000.0, 7.8, 25.609634),
    (450.0, 12.0, 33.0, 40.0, 8.1, 108.984966),
    (900.0, 15.0, 35.0, 10.0, 8.0, 278.438916),
    (900.0, 25.0, 36.0, 10.0, 8.0, 289.147418),
    (1000.0, 20.0, 0.0, 0.0, 8.0, 220.000000),
]


@pytest.mark.parametrize(("f", "T", "S", "D", "pH", "dB_per_km"), TABLE)
def test_francois_garrison_equals_another_program(
    f: float, T: float, S: float, D: float, pH: float, dB_per_km: float
) -> None:
    assert 1e3 * francois_garrison(1e3 * f, T, S, D, pH) == pytest.approx(dB_per_km, rel=0.002)


def test_the_two_formulas_agree_within_ten_percent_as_their_authors_state() -> None:
    f = np.geomspace(1e3, 1e6, 40)
    for T in (-1.0, 5.0, 10.0, 20.0):
        for D in (0.0, 500.0, 3000.0):
            ratio = ainslie_mccolm(f, T, 35.0, D) / francois_garrison(f, T, 35.0, D)
            assert abs(ratio - 1.0).max() < 0.11


def test_relaxation_frequencies_of_ainslie_mccolm_are_the_published_ones() -> None:
    # At 10 degC and salinity 35: 0.78 exp(10/26) = 1.146 kHz and 42 exp(10/17) = 75.63 kHz. Half of
    # the loss per wavelength of magnesium sulphate is reached there, so that
    # alpha/f peaks at f_2, once the viscosity is taken away.
    f = np.linspace(40e3, 120e3, 8001)
    water = 1e-3 * 0.00049 * np.exp(-10.0 / 27.0) * (f / 1e3) ** 2
    salts = ainslie_mccolm(f, 10.0, 35.0, 0.0) - water
    assert f[np.argmax(salts / f)] == pytest.approx(75.63e3, rel=0.01)


def test_fresh_water_absorbs_with_the_square_of_the_frequency() -> None:
    half, whole = francois_garrison([5e5, 1e6], 10.0, 0.0, 0.0)
    assert whole / half == pytest.approx(4.0)


def test_warm_polynomial_continues_the_cold_one() -> None:
    f = 900e3
    below, above = francois_garrison(f, 20.0, 35.0, 0.0), francois_garrison(f, 20.001, 35.0, 0.0)
    assert above == pytest.approx(below, rel=0.002)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"frequency": 50.0}, "frequency 50 Hz; expected 200 to 1e+06 Hz"),
        ({"frequency": 2e6}, "frequency 2e+06 Hz; expected 500000 to 1e+06 Hz"),
        ({"temperature": 40.0}, "temperature 40 degC; expected -2 to 22 degC"),
        ({"salinity": 5.0}, "salinity 5; expected 30 to 35"),
        ({"depth": -1.0}, "depth -1 m; expected 0 to 3500 m"),
        ({"pH": 7.0}, "pH 7; expected 7.7 to 8.3"),
        ({"temperature": float("nan")}, "temperature nan degC"),
    ],
)
def test_a_value_beyond_the_range_of_the_formula_is_refused(
    given: dict[str, float], expected: str
) -> None:
    usual = {"frequency": 1e5, "temperature": 10.0, "salinity": 35.0, "depth": 10.0, "pH": 8.0}
    with pytest.raises(InputInvalid) as error:
        francois_garrison(**(usual | given))
    assert expected in str(error.value)
    assert len(error.value.problems) == 1


def test_every_value_beyond_a_range_is_listed() -> None:
    with pytest.raises(InputInvalid) as error:
        ainslie_mccolm(2e6, 50.0, 1.0, 8000.0, 9.0)
    assert [p.read.split()[0] for p in error.value.problems] == [
        "frequency", "temperature", "salinity", "depth", "pH",
    ]  # fmt: skip


def test_brackish_water_is_allowed_by_ainslie_mccolm_alone() -> None:
    assert ainslie_mccolm(1e5, 10.0, 8.0, 10.0) > 0.0
    with pytest.raises(InputInvalid, match="salinity 8"):
        francois_garrison(1e5, 10.0, 8.0, 10.0)
