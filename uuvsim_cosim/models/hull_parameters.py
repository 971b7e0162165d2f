"""The names that a hull's parameters may have, their units, and the matrices made of them.

Names are Fossen's letters with the element's indices from 1: `M_A_15`, `D_q_11`, `I_b_12`, `z_g`.
A parameter that a set does not list is structurally zero: it costs nothing and cannot be set.
A listed zero is a parameter like any other. `M_A_15` stands for `M_A_51` too unless that is
listed; inertia is symmetric, indices rising; damping is not, both elements count. `D_u` and
`D_f` are in lift.py, SNAME's products such as `Y_pq` in products.py, `C_D_y` in cross_flow.py.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

import casadi as ca

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.kinematics import sparse
from uuvsim_cosim.models.model import Model
from uuvsim_cosim.models.products import product_of
from uuvsim_cosim.models.rigid_body import M_RB, inertia_about_CO

__all__ = [
    "Meaning",
    "declare_parameters",
    "elements",
    "mass_of_water",
    "meaning_of",
    "missing",
    "near_names",
    "not_positive",
    "rigid_mass",
    "structure",
    "symmetric",
]


@dataclass(frozen=True)
class Meaning:
    """What a parameter of some name is: its unit, a least value, and words for it."""

    unit: str
    words: str
    min: float | None = None


_SCALARS = {
    "m": Meaning("kg", "mass", 1e-9),
    "W": Meaning("N", "weight", 0.0),
    "B": Meaning("N", "buoyancy of the submerged hull", 0.0),
    "rho": Meaning("kg/m3", "density of the water", 0.0),
    "nabla": Meaning("m3", "volume of the submerged hull", 0.0),
    "g": Meaning("m/s2", "acceleration of gravity", 0.0),
    "height": Meaning("m", "height of the hull, over which buoyancy is lost", 1e-6),
    **{f"{a}_g": Meaning("m", f"{a} of the centre of gravity from CO") for a in "xyz"},
    **{f"{a}_b": Meaning("m", f"{a} of the centre of buoyancy from CO") for a in "xyz"},
    "x_bow": Meaning("m", "x of the bow from CO, where the strips of cross-flow begin"),
    "x_stern": Meaning("m", "x of the stern from CO, where the strips of cross-flow end"),
    "C_D_y": Meaning("1", "cross-flow drag coefficient of the hull seen from the side", 0.0),
    "C_D_z": Meaning("1", "cross-flow drag coefficient of the hull seen from above", 0.0),
    "h_y": Meaning("m", "mean height of the hull seen from the side", 0.0),
    "b_z": Meaning("m", "mean breadth of the hull seen from above", 0.0),
    "U_f": Meaning("m/s", "speed over which the damping D_f fades", 1e-6),
    "beta_rho": Meaning("1/m", "relative rise of the water's density with depth"),
    "beta_nabla": Meaning("1/m", "relative loss of the hull's volume with depth"),
}
_ELEMENT = re.compile(r"(I_b|I_g|M_A|D_l|D_q|D_u|D_f)_([1-6])([1-6])$")
_STRIPS = {"C_D_y", "h_y", "C_D_z", "b_z", "x_bow", "x_stern"}
_MASS = ("kg", "kg.m", "kg.m", "kg.m2")
_LINEAR = ("N.s/m", "N.s/rad", "N.m.s/m", "N.m.s/rad")
_QUADRATIC = ("N.s2/m2", "N.s2/rad2", "N.m.s2/m2", "N.m.s2/rad2")
_WITH_U = ("N.s2/m2", "N.s2/(m.rad)", "N.m.s2/m2", "N.m.s2/(m.rad)")


def meaning_of(name: str) -> Meaning | None:
    """Give what a hull's parameter of this name is; None if there is none of this name."""
    if name in _SCALARS:
        return _SCALARS[name]
    product = product_of(name)
    if product is not None:
        return Meaning(product.unit, product.words)
    match = _ELEMENT.match(name)
    if match is None:
        return None
    kind, i, j = match[1], int(match[2]), int(match[3])
    block = 2 * (i > 3) + (j > 3)
    if kind in ("I_b", "I_g"):
        point = "CO" if kind == "I_b" else "CG"
        return Meaning("kg.m2", f"inertia about {point}") if i <= j <= 3 else None
    if kind == "M_A":
        return Meaning(_MASS[block], "added mass")
    if kind == "D_l":
        return Meaning(_LINEAR[block], "linear damping")
    if kind == "D_f":
        return Meaning(_LINEAR[block], "linear damping that fades with speed")
    if kind == "D_u":
        return Meaning(_WITH_U[block], "damping that grows with |u|: lift of body and fins")
    return Meaning(_QUADRATIC[block], "quadratic damping")


def missing(names: Collection[str], surface: bool = True) -> Iterator[str]:
    """Give a sentence for each contradiction or gap among the names of a set."""
    if "m" not in names:
        yield "m is missing; expected the mass"
    by_force, by_volume = {"W", "B"}, {"rho", "nabla", "g"}
    given = set(names)
    strips = given & _STRIPS
    if strips:
        yield from _gaps_of_strips(given)
        if not given & {"nabla", "g"}:
            given -= {"rho"}  # of the drag, not of the buoyancy
    if given & by_force and given & by_volume:
        both = ", ".join(sorted(given & (by_force | by_volume)))
        yield f"{both} are given; expected either W and B, or rho, nabla and g, never both"
    elif not (by_force <= given or by_volume <= given):
        yield "weight and buoyancy are incomplete; expected either W and B, or rho, nabla and g"
    kinds = {k for k in ("I_b", "I_g") if any(n.startswith(k) for n in names)}
    if len(kinds) != 1:
        found = "both I_b and I_g are" if kinds else "no inertia is"
        yield f"{found} given; expected I_b_.. about CO, or I_g_.. about CG"
    for kind in kinds:
        lacking = [f"{kind}_{i}{i}" for i in (1, 2, 3) if f"{kind}_{i}{i}" not in names]
        if lacking:
            yield f"{', '.join(lacking)} missing; expected all three moments of inertia"
    if surface and "height" not in names:
        yield "height is missing; expected the hull's height, or a hull declared without surface"
    if any(n.startswith("D_f_") for n in names) != ("U_f" in names):
        yield "D_f and U_f do not both stand there; expected the damping that fades, and its speed"


def _gaps_of_strips(given: set[str]) -> Iterator[str]:
    lacking = sorted({"x_bow", "x_stern", "rho"} - given)
    for pair in (("C_D_y", "h_y"), ("C_D_z", "b_z")):
        if len(given & set(pair)) == 1:
            lacking += sorted(set(pair) - given)
    if not given & {"C_D_y", "C_D_z"}:
        lacking.append("C_D_y or C_D_z")
    if lacking:
        yield f"{', '.join(lacking)} missing; expected all that cross-flow drag by strips needs"


_ELSEWHERE = {
    "mass": "m",
    "weight": "W",
    "buoyancy": "B",
    "density": "rho",
    "fluid_density": "rho",
    "volume": "nabla",
    "gravity": "g",
}
_SNAME = re.compile(r"([XYZKMN])_?([uvwpqr])(dot|\2|\|\2\||)$")
_TENSOR = re.compile(r"I_?([xyz])([xyz])?$")


def near_names(name: str) -> str:
    """Give what was meant by a name that does not exist: in other projects' words, or misspelt."""
    if name.lower() in _ELSEWHERE:
        return _ELSEWHERE[name.lower()]
    if (tensor := _TENSOR.match(name)) is not None:
        i, j = "xyz".index(tensor[1]) + 1, "xyz".index(tensor[2] or tensor[1]) + 1
        return f"I_g_{min(i, j)}{max(i, j)} about CG, or I_b_{min(i, j)}{max(i, j)} about CO"
    if (derivative := _SNAME.match(name)) is not None:
        i, j = "XYZKMN".index(derivative[1]) + 1, "uvwpqr".index(derivative[2]) + 1
        kind = {"dot": "M_A", "": "D_l"}.get(derivative[3], "D_q")
        return f"{kind}_{i}{j}, its negative"
    every = [*_SCALARS]
    for kind in ("M_A", "D_l", "D_q", "D_u", "D_f", "I_b", "I_g"):
        every += [f"{kind}_{i}{j}" for i in range(1, 7) for j in range(1, 7)]
    known = [n for n in every if meaning_of(n) is not None]
    near = get_close_matches(name, known, n=4, cutoff=0.6)
    return ", ".join(near) + " (near)" if near else "m, W, z_g, M_A_11, ..."


def declare_parameters(
    m: Model, numbers: Mapping[str, float], surface: bool, sources: Mapping[str, str]
) -> dict[str, Any]:
    """Declare the parameters of a hull, each with its unit and source; gives their symbols."""
    wrong = [
        f"{n!r} is not a parameter of a hull; expected {near_names(n)}"
        for n in numbers
        if meaning_of(n) is None
    ]
    wrong += missing(numbers, surface)
    if wrong:
        raise ParameterInvalid(f"{m.name}: " + "; ".join(wrong))
    symbols: dict[str, Any] = {}
    for name, value in numbers.items():
        meaning = meaning_of(name)
        if meaning is None or (name == "height" and not surface):
            continue
        if meaning.min is not None and not value >= meaning.min:
            raise ParameterInvalid(
                f"{m.name}.{name}: {value} {meaning.unit}; expected at least {meaning.min:g}"
            )
        words = meaning.words + (f" ({sources[name]})" if name in sources else "")
        symbols[name] = m.parameter(
            name, float(value), unit=meaning.unit, min=meaning.min, description=words
        )
    return symbols


_OF_MASS = re.compile(r"(m|[xyz]_g|(I_b|I_g)_[1-3][1-3]|M_A_[1-6][1-6])$")


def not_positive(names: Collection[str], numbers: Mapping[str, float]) -> Iterator[tuple[str, str]]:
    """Give (parameter, sentence) for each mass of a set that is not positive definite.

    `numbers` are those of `names` that could be read. M_A is asked if all of it could, M_RB if
    mass, inertia and CG could, else the inertia alone, whatever else is wrong.
    """
    import numpy as np

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
    what: str, name: str, matrix: Any, least: float, names: Collection[str]
) -> Iterator[tuple[str, str]]:
    import numpy as np

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
        "positive definite matrix: no negative diagonal, and off-diagonals that it bears",
    )


def structure(p: Mapping[str, Any]) -> tuple[Any, ...]:
    """Give (M, W, B, r_g, r_b, D_l, D_q) of a hull's parameters, zeros structural."""
    r_g, r_b = _vector(p, "g"), _vector(p, "b")
    M = rigid_mass(p) + symmetric(p, "M_A")
    if "W" in p:
        W, B = p["W"], p["B"]
    else:
        W, B = p["m"] * p["g"], p["rho"] * p["g"] * p["nabla"]
    return M, W, B, r_g, r_b, elements(p, "D_l", 6), elements(p, "D_q", 6)


def rigid_mass(p: Mapping[str, Any]) -> Any:
    """Give M_RB (6, 6) about CO."""
    r_g, inertia = _vector(p, "g"), symmetric(p, "I_b")
    if not inertia.nnz():
        inertia = inertia_about_CO(p["m"], symmetric(p, "I_g"), r_g)
    return M_RB(p["m"], inertia, r_g)


def _vector(p: Mapping[str, Any], point: str) -> Any:
    at = {(i, 0): p[f"{a}_{point}"] for i, a in enumerate("xyz") if f"{a}_{point}" in p}
    return sparse(3, 1, at)


def elements(p: Mapping[str, Any], kind: str, size: int) -> Any:
    """Give the matrix of the parameters `kind`_ij, sparse where there is none."""
    found = {}
    for name, symbol in p.items():
        match = _ELEMENT.match(name)
        if match is not None and match[1] == kind:
            found[int(match[2]) - 1, int(match[3]) - 1] = symbol
    return sparse(size, size, found)


def mass_of_water(p: Mapping[str, Any]) -> Any:
    """Give the mass [kg] of the water that a submerged hull displaces: B / g, with g = W / m."""
    if "W" not in p:
        return p["rho"] * p["nabla"]
    weighs = p["W"] > 0.0
    return ca.if_else(weighs, p["m"] * p["B"] / ca.if_else(weighs, p["W"], 1.0), p["m"])


def symmetric(p: Mapping[str, Any], kind: str) -> Any:
    """Give the symmetric matrix of the parameters `kind`_ij, sparse where there is none."""
    out = elements(p, kind, 3 if kind.startswith("I") else 6)
    rows, columns = out.sparsity().get_triplet()
    for i, j in list(zip(rows, columns, strict=True)):
        if not out.sparsity().has_nz(j, i):
            out[j, i] = out[i, j]
    return ca.SX(out)
