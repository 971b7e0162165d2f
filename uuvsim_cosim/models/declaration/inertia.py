"""Inertia of a hull from its parameters: M_RB and M_A about CO, and whether they are positive.

Fossen (2021), 2nd ed., section 3.3 (M_RB). A parameter that is not given is structurally zero.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping

import casadi as ca
import numpy as np

from uuvsim_cosim.models.declaration.expression import Number
from uuvsim_cosim.models.declaration.hull_parameters import ELEMENT
from uuvsim_cosim.models.declaration.kinematics import S, sparse

__all__ = [
    "M_RB",
    "elements",
    "inertia_about_CO",
    "not_positive",
    "parameter_vector",
    "rigid_mass",
    "symmetric",
]


def inertia_about_CO(m: Number, I_g: ca.SX, r_g: ca.SX) -> ca.SX:
    """Return I_b = I_g - m S²(r_g): the inertia about CO [kg.m2] of the one about CG."""
    return I_g - m * ca.mtimes(S(r_g), S(r_g))


def M_RB(m: Number, I_b: ca.SX, r_g: ca.SX) -> ca.SX:
    """Return the 6x6 rigid-body mass of m [kg], I_b about CO [kg.m2], CG at r_g [m] from CO."""
    mS = m * S(r_g)
    return ca.blockcat([[m * ca.SX.eye(3), -mS], [mS, I_b]])


def rigid_mass(p: Mapping[str, Number]) -> ca.SX:
    """Return M_RB (6, 6) about CO."""
    r_g, inertia = parameter_vector(p, "g"), symmetric(p, "I_b")
    if not inertia.nnz():
        inertia = inertia_about_CO(p["m"], symmetric(p, "I_g"), r_g)
    return M_RB(p["m"], inertia, r_g)


def parameter_vector(p: Mapping[str, Number], point: str) -> ca.SX:
    """Return the vector x_, y_, z_ of a point (`g`: CG, `b`: CB) [m], sparse where not given."""
    at = {(i, 0): p[f"{a}_{point}"] for i, a in enumerate("xyz") if f"{a}_{point}" in p}
    return sparse(3, 1, at)


def elements(p: Mapping[str, Number], kind: str, size: int) -> ca.SX:
    """Return the matrix of the parameters `kind`_ij, sparse where none is given."""
    found = {}
    for name, symbol in p.items():
        match = ELEMENT.match(name)
        if match is not None and match[1] == kind:
            found[int(match[2]) - 1, int(match[3]) - 1] = symbol
    return sparse(size, size, found)


def symmetric(p: Mapping[str, Number], kind: str) -> ca.SX:
    """Return the symmetric matrix of the parameters `kind`_ij, sparse where there is none."""
    out = elements(p, kind, 3 if kind.startswith("I") else 6)
    rows, columns = out.sparsity().get_triplet()
    for i, j in list(zip(rows, columns, strict=True)):
        if not out.sparsity().has_nz(j, i):
            out[j, i] = out[i, j]
    return ca.SX(out)


_OF_MASS = re.compile(r"(m|[xyz]_g|(I_b|I_g)_[1-3][1-3]|M_A_[1-6][1-6])$")


def not_positive(names: Collection[str], numbers: Mapping[str, float]) -> Iterator[tuple[str, str]]:
    """Yield (parameter, sentence) for each mass of a set that is not positive definite.

    `numbers` are those of `names` that could be read. M_A is checked if all of it could, M_RB if
    mass, inertia and CG could, else the inertia alone, whatever else is wrong.
    """
    asked = {n for n in names if _OF_MASS.match(n)}
    unread = {n[:3] for n in asked - numbers.keys()}
    added = np.array(ca.evalf(ca.densify(symmetric(numbers, "M_A"))))
    if "M_A" not in unread:
        yield from _indefinite("added mass", "M_A", added, -1e-9, asked)
    if any(n.startswith("I") for n in unread) or not any(
        n.endswith("_11") for n in asked - {"M_A_11"}
    ):
        return
    what, body = "mass and inertia about CG", numbers
    if "m" not in numbers or unread - {"M_A"}:  # without mass or CG the inertia alone
        what = "inertia"
        body = {"m": 1.0} | {n: x for n, x in numbers.items() if n.startswith("I_")}
    rigid = np.array(ca.evalf(ca.densify(ca.SX(rigid_mass(body)))))
    yield from _indefinite(what, "M_RB", rigid, 1e-9, asked)


def _indefinite(
    what: str, name: str, matrix: np.ndarray, least: float, names: Collection[str]
) -> Iterator[tuple[str, str]]:
    size = np.sqrt(np.maximum(np.abs(np.diag(matrix)), 1e-12))
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T) / np.outer(size, size))
    if values[0] >= least:
        return
    i, j = sorted((np.argsort(-np.abs(vectors[:, 0]))[:2] + 1).tolist())
    k = int(np.argmax(np.abs(vectors[:, 0]))) + 1
    if name == "M_A":
        near = [f"M_A_{i}{j}", f"M_A_{j}{i}", f"M_A_{k}{k}"]
    else:
        of = [
            f"{kind}_{a - 3}{b - 3}" for a, b in ((i, j), (j, i), (k, k)) for kind in ("I_g", "I_b")
        ]
        near = of if k > 3 else ["m"]
    if matrix[k - 1, k - 1] < 0:
        near.reverse()
    place = next((n for n in near if n in names), "")
    yield (
        place,
        f"{what} ({name}) has the eigenvalue {values[0]:.3g} (relative); expected a "
        "positive definite matrix: no negative diagonal, and off-diagonals that are small enough",
    )
