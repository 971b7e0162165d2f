"""REMUS 100: every coefficient that Prestero's thesis lists, from the equations that are simulated.

This includes combined coefficients: Munk moment, body lift, fins and strips must add up to the
published value.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.models.checks.comparison import Checked, compared
from uuvsim_cosim.models.checks.compiled_run import end_of, prepared
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.parameter_files import parameter_set

__all__ = ["coefficients"]

Array = NDArray[np.float64]
PRINTED = {
    "Xuu": -1.62, "Xwq": -35.5, "Xqq": -1.93, "Xvr": 35.5, "Xrr": -1.93,
    "Yrr": 0.632, "Yuv": -28.6, "Ywp": 35.5, "Ypq": 1.93, "Yur": 5.22,
    "Zww": -131.0, "Zqq": -0.632, "Zuw": -28.6, "Zvp": -35.5, "Zrp": 1.93, "Zuq": -5.22,
    "Kpp": -0.130, "Mww": 3.18, "Muq": -2.0, "Muw": 24.0, "Mvp": -1.93, "Mrp": 4.86,
    "Nvv": -3.18, "Nur": -2.0, "Nuv": -24.0, "Nwp": -1.93, "Npq": -4.86,
}  # fmt: skip
DISPUTED = {
    "prestero_2001": {"Yvv": -131.0, "Mqq": -9.40, "Nrr": -9.40},
    "prestero_2001_printed": {"Yvv": -1310.0, "Mqq": -188.0, "Nrr": -94.0},
    "scrimmage": {"Yvv": -131.0, "Mqq": -9.40, "Nrr": -9.40, "Kpp": -0.0013},
    "sgarioto_2011": {"Yvv": -1310.0, "Zww": -1310.0, "Xuu": -2.93550},
}


def coefficients() -> Iterator[Checked]:
    """Yield the worst coefficient of each set, and the derivatives of the fins."""
    unit = np.eye(6)
    for name, disputed in DISPUTED.items():
        force, printed = _force_of_water(name), PRINTED | disputed
        found = []
        for key in printed:
            row, a, b = "XYZKMN".index(key[0]), "uvwpqr".index(key[1]), "uvwpqr".index(key[2])
            both = unit[a] if a == b else unit[a] + unit[b]
            alone = 0.0 if a == b else force(unit[a])[row] + force(unit[b])[row]
            found.append(force(both)[row] - alone)
        what = f"{len(printed)} printed coefficients out of the equations"
        theirs = list(printed.values())
        yield compared("prestero", f"remus100@{name}", what, found, theirs, 1e-8)
    fins = declare("fins", vehicle="remus100")
    delta, u = 1e-4, 1.5
    slopes = []
    for at, rows in (([1, 1, 0, 0], [1, 5]), ([0, 0, 1, 1], [2, 4])):
        inputs: dict[str, Any] = {"u": delta * np.array(at), "nu_r": [u, 0, 0, 0, 0, 0]}
        slopes.append(end_of(fins, 8.0, 0.02, inputs)["tau"][rows] / (delta * u * u))
    pairs = [[9.64, -6.15], [-9.64, -6.15]]
    what = "Yuudr, Nuudr, Zuuds, Muuds of the fins"
    yield compared("prestero", "remus100", what, slopes, pairs, 1e-6, relative=True)


def _force_of_water(set: str) -> Callable[[Array], Array]:
    """Return nu -> the force of the water alone: M nu_dot + C_RB(nu) nu, weightless."""
    model = declare(f"remus100@{set}", surface=False)
    f, p, d, x = prepared(model, {"W": 0.0, "B": 0.0})
    u = f.values_of("input", {})
    q = {k: v.value for k, v in parameter_set("remus100", set).quantities.items()}
    m, z_g = q["m"], q["z_g"]
    r_g, inertia = np.array([0, 0, z_g]), np.diag([q[f"I_b_{i}{i}"] for i in (1, 2, 3)])
    S = np.array([[0, -z_g, 0], [z_g, 0, 0], [0, 0, 0]])
    M = np.block([[m * np.eye(3), -m * S], [m * S, inertia]])
    M += np.diag([q[f"M_A_{i}{i}"] for i in range(1, 7)])
    for i, j in ((1, 5), (2, 4)):
        M[[i, j], [j, i]] += q[f"M_A_{i + 1}{j + 1}"]

    def force(nu: Array) -> Array:
        x[7:13] = nu
        nu_dot = np.array(f.rhs(0.0, u, p, d, x, [])).ravel()[7:13]
        v, w = nu[:3], nu[3:]
        push = m * (np.cross(w, v) + np.cross(w, np.cross(w, r_g)))
        turn = np.cross(w, inertia @ w) + m * np.cross(r_g, np.cross(w, v))
        return np.asarray(M @ nu_dot + np.concatenate([push, turn]))

    return force
