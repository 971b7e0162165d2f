"""Absorption of sound by sea water, as two published formulas compute it.

They are those of Francois and Garrison (1982), Part II, and of Ainslie and McColm (1998). Both add
the relaxation of boric acid, that of magnesium sulphate, and the viscosity of water:

    alpha = A_1 P_1 f_1 f² / (f_1² + f²) + A_2 P_2 f_2 f² / (f_2² + f²) + A_3 P_3 f²

with the frequency f, the relaxation frequencies f_1 and f_2, and factors P of the pressure.
`absorption` is the same for CasADi's expressions, of a component whose water may change.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import log
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.acoustics.valid_range import Valid, refuse_outside

__all__ = [
    "ABSORPTION_RANGES",
    "absorption",
    "absorption_range",
    "ainslie_mccolm",
    "francois_garrison",
]

Array = NDArray[np.float64]
LN10 = log(10.0)

# Where each formula holds. Below 500 kHz, Francois and Garrison give 30 to 35 for the salinity;
# at 500 kHz and above, where the viscosity of water dominates, they give 0 to 40.
ABSORPTION_RANGES = {
    "Francois and Garrison (1982)": {
        "frequency": Valid(200.0, 1e6, "Hz"),
        "temperature": Valid(-2.0, 22.0, "degC"),
        "salinity": Valid(30.0, 35.0, ""),
        "depth": Valid(0.0, 3500.0, "m"),
        "pH": Valid(7.7, 8.3, ""),
    },
    "Francois and Garrison (1982), above 500 kHz": {
        "frequency": Valid(5e5, 1e6, "Hz"),
        "temperature": Valid(0.0, 30.0, "degC"),
        "salinity": Valid(0.0, 40.0, ""),
        "depth": Valid(0.0, 10_000.0, "m"),
        "pH": Valid(7.7, 8.3, ""),
    },
    "Ainslie and McColm (1998)": {
        "frequency": Valid(100.0, 1e6, "Hz"),
        "temperature": Valid(-6.0, 35.0, "degC"),
        "salinity": Valid(5.0, 50.0, ""),
        "depth": Valid(0.0, 7000.0, "m"),
        "pH": Valid(7.7, 8.3, ""),
    },
}


def francois_garrison(
    frequency: ArrayLike, temperature: float, salinity: float, depth: float, pH: float = 8.0
) -> Array:
    """Return alpha [dB/m] at each frequency [Hz]; Francois and Garrison (1982), Part II.

    `temperature` in degC, practical `salinity`, `depth` in m. Raises `InputInvalid` outside of
    the range that the authors state (`ABSORPTION_RANGES`).

    Example: 100 kHz in 10 degC, salinity 35, at the surface.

    >>> from uuvsim_cosim.models.acoustics.absorption import francois_garrison
    >>> round(float(francois_garrison(100e3, 10.0, 35.0, 0.0)), 4)
    0.0336
    """
    f = np.asarray(frequency, float)
    _refuse(_range_of("francois_garrison", f), f, temperature, salinity, depth, pH)
    return np.asarray(_francois_garrison(f, temperature, salinity, depth, pH))


def _francois_garrison(f: Any, T: Any, S: Any, D: Any, pH: Any) -> Any:
    theta = 273.0 + T
    c = 1412.0 + 3.21 * T + 1.19 * S + 0.0167 * D
    A_1 = 8.86 / c * _exp(LN10 * (0.78 * pH - 5.0))
    f_1 = 2.8 * (S / 35.0) ** 0.5 * _exp(LN10 * (4.0 - 1245.0 / theta))
    A_2 = 21.44 * S / c * (1.0 + 0.025 * T)
    P_2 = 1.0 - 1.37e-4 * D + 6.2e-9 * D**2
    f_2 = 8.17 * _exp(LN10 * (8.0 - 1990.0 / theta)) / (1.0 + 0.0018 * (S - 35.0))
    cold = 4.937e-4 - 2.59e-5 * T + 9.11e-7 * T**2 - 1.50e-8 * T**3
    warm = 3.964e-4 - 1.146e-5 * T + 1.45e-7 * T**2 - 6.5e-10 * T**3
    A_3 = ca.if_else(T <= 20.0, cold, warm) if isinstance(T, ca.SX) else cold if T <= 20.0 else warm
    P_3 = 1.0 - 3.83e-5 * D + 4.9e-10 * D**2
    return _sum(f / 1e3, A_1, f_1, A_2 * P_2, f_2, A_3 * P_3)


def ainslie_mccolm(
    frequency: ArrayLike, temperature: float, salinity: float, depth: float, pH: float = 8.0
) -> Array:
    """Return alpha [dB/m] at each frequency [Hz]; Ainslie and McColm (1998).

    The formula is simpler than that of Francois and Garrison, deviates from it by up to 10 %, and
    holds for brackish water too. Raises `InputInvalid` outside of the range that the authors
    state (`ABSORPTION_RANGES`).

    Example: 100 kHz in 10 degC, salinity 35, at the surface.

    >>> from uuvsim_cosim.models.acoustics.absorption import ainslie_mccolm
    >>> round(float(ainslie_mccolm(100e3, 10.0, 35.0, 0.0)), 4)
    0.0343
    """
    f = np.asarray(frequency, float)
    _refuse(_range_of("ainslie_mccolm", f), f, temperature, salinity, depth, pH)
    return np.asarray(_ainslie_mccolm(f, temperature, salinity, depth, pH))


def _ainslie_mccolm(f: Any, T: Any, S: Any, D: Any, pH: Any) -> Any:
    z = D / 1e3
    f_1 = 0.78 * (S / 35.0) ** 0.5 * _exp(T / 26.0)
    f_2 = 42.0 * _exp(T / 17.0)
    A_1 = 0.106 * _exp((pH - 8.0) / 0.56)
    A_2 = 0.52 * (1.0 + T / 43.0) * (S / 35.0) * _exp(-z / 6.0)
    A_3 = 0.00049 * _exp(-(T / 27.0 + z / 17.0))
    return _sum(f / 1e3, A_1, f_1, A_2, f_2, A_3)


def absorption_range(formula: str, frequency: float) -> Mapping[str, Valid]:
    """Return the range of a formula, francois_garrison or ainslie_mccolm, at a frequency [Hz].

    Raises `InputInvalid` for a frequency outside of it, and for another formula.
    """
    if formula not in _FORMULAS:
        raise InputInvalid("absorption", f"formula {formula!r}", ", ".join(_FORMULAS))
    name = _range_of(formula, np.asarray(frequency, float))
    valid = ABSORPTION_RANGES[name]
    refuse_outside(f"absorption by {name}", valid, {"frequency": frequency})
    return valid


def absorption(formula: str, frequency: float, *water: ca.SX) -> ca.SX:
    """Return alpha [dB/m] of a formula as an expression of temperature, salinity, depth and pH.

    Only the frequency is checked: hold the water within `absorption_range`.

    Example: 100 kHz in 10 degC, salinity 35, at the surface.

    >>> import casadi as ca
    >>> from uuvsim_cosim.models.acoustics.absorption import absorption
    >>> water = ca.SX([10.0, 35.0, 0.0, 8.0])
    >>> round(float(absorption("francois_garrison", 100e3, *ca.vertsplit(water))), 4)
    0.0336
    """
    absorption_range(formula, frequency)
    return ca.SX(_FORMULAS[formula](frequency, *water))


_FORMULAS = {"francois_garrison": _francois_garrison, "ainslie_mccolm": _ainslie_mccolm}


def _range_of(formula: str, f: Array) -> str:
    if formula == "ainslie_mccolm":
        return "Ainslie and McColm (1998)"
    high = f.size > 0 and float(f.min()) >= 5e5
    return "Francois and Garrison (1982)" + (", above 500 kHz" if high else "")


def _exp(x: Any) -> Any:
    return ca.exp(x) if isinstance(x, ca.SX) else np.exp(x)


def _refuse(name: str, f: Array, T: float, S: float, D: float, pH: float) -> None:
    given: dict[str, ArrayLike] = {
        "frequency": f,
        "temperature": T,
        "salinity": S,
        "depth": D,
        "pH": pH,
    }
    refuse_outside(f"absorption by {name}", ABSORPTION_RANGES[name], given)


def _sum(f: Any, A_1: Any, f_1: Any, A_2: Any, f_2: Any, A_3: Any) -> Any:
    """Return the sum of the three contributions [dB/m]; frequencies in kHz, A in dB/km."""
    f2 = f * f
    return 1e-3 * f2 * (A_1 * f_1 / (f_1**2 + f2) + A_2 * f_2 / (f_2**2 + f2) + A_3)
