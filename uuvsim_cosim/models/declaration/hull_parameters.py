"""Names and units of a hull's parameters.

Names are Fossen's letters with the element's indices from 1: `M_A_15`, `D_q_11`, `I_b_12`, `z_g`.
A parameter that a set does not list is structurally zero: it costs nothing and cannot be set.
A listed zero is a parameter like any other. `M_A_15` stands for `M_A_51` too unless that is
listed; inertia is symmetric, indices rising; damping is not, both elements count. `D_u`,
`D_f`, `C_D_y` and SNAME's products such as `Y_pq` are in hull/damping.py, lift and drag of wings in
hull/wings.py.
The matrices made of them: inertia.py here, and hull/matrices.py.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from difflib import get_close_matches

__all__ = [
    "WINGS",
    "Meaning",
    "Product",
    "meaning_of",
    "missing",
    "near_names",
    "product_of",
]


@dataclass(frozen=True)
class Meaning:
    """Meaning of a parameter's name: its unit, what it is in words, and its least value."""

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
    "S": Meaning("m2", "reference area of the coefficients of lift and drag", 0.0),
    "C_L_alpha": Meaning("1", "slope of the lift coefficient of hull and wings, per rad", 0.0),
    "C_D_0": Meaning("1", "drag coefficient at no angle of attack", 0.0),
    "C_D_alpha": Meaning("1", "rise of the drag coefficient with sin²(alpha)", 0.0),
    "C_N": Meaning("1", "coefficient of the normal force beyond the stall", 0.0),
    "alpha_stall": Meaning("rad", "angle of attack beyond which lift stops growing", 1e-3),
    "x_w": Meaning("m", "x of the centre of lift and drag from CO"),
    "U_f": Meaning("m/s", "speed over which the damping D_f fades", 1e-6),
    "beta_rho": Meaning("1/m", "relative rise of the water's density with depth"),
    "beta_nabla": Meaning("1/m", "relative loss of the hull's volume with depth"),
}
ELEMENT = re.compile(r"(I_b|I_g|M_A|D_l|D_q|D_u|D_f)_([1-6])([1-6])$")
FORCES, VELOCITIES = "XYZKMN", "uvwpqr"
_PRODUCT = re.compile(rf"([{FORCES}])_([{VELOCITIES}])([{VELOCITIES}])$")
_PER = ("m2", "(m.rad)", "rad2")  # by the number of angular rates
_STRIPS = {"C_D_y", "h_y", "C_D_z", "b_z", "x_bow", "x_stern"}
WINGS = ("S", "C_L_alpha", "C_D_0", "C_D_alpha", "C_N", "alpha_stall", "x_w")
_LINEAR = ("N.s/m", "N.s/rad", "N.m.s/m", "N.m.s/rad")
# Units of the four blocks of a matrix, row by row, and what its elements are.
_MATRICES = {
    "M_A": (("kg", "kg.m", "kg.m", "kg.m2"), "added mass"),
    "D_l": (_LINEAR, "linear damping"),
    "D_q": (("N.s2/m2", "N.s2/rad2", "N.m.s2/m2", "N.m.s2/rad2"), "quadratic damping"),
    "D_u": (
        ("N.s2/m2", "N.s2/(m.rad)", "N.m.s2/m2", "N.m.s2/(m.rad)"),
        "damping that grows with |u|: lift of body and fins",
    ),
    "D_f": (_LINEAR, "linear damping that fades with speed"),
}


@dataclass(frozen=True)
class Product:
    """One coefficient: rows from 0 of the force and of both velocities, unit and words."""

    force: int
    a: int
    b: int
    unit: str
    words: str


def product_of(name: str) -> Product | None:
    """Return the product that a name such as `Y_pq` means; None if it is none in rising order."""
    match = _PRODUCT.match(name)
    if match is None:
        return None
    force, a, b = FORCES.index(match[1]), VELOCITIES.index(match[2]), VELOCITIES.index(match[3])
    if a > b:
        return None
    unit = ("N.s2/" if force < 3 else "N.m.s2/") + _PER[(a > 2) + (b > 2)]
    square = f"{match[2]} {match[3]}" if a != b else f"{match[2]} squared"
    return Product(force, a, b, unit, f"coefficient of {square} in {match[1]}")


def meaning_of(name: str) -> Meaning | None:
    """Return what a hull's parameter of this name is; None if there is none of this name."""
    if name in _SCALARS:
        return _SCALARS[name]
    product = product_of(name)
    if product is not None:
        return Meaning(product.unit, product.words)
    match = ELEMENT.match(name)
    if match is None:
        return None
    kind, i, j = match[1], int(match[2]), int(match[3])
    if kind in ("I_b", "I_g"):
        point = "CO" if kind == "I_b" else "CG"
        return Meaning("kg.m2", f"inertia about {point}") if i <= j <= 3 else None
    units, words = _MATRICES[kind]
    return Meaning(units[2 * (i > 3) + (j > 3)], words)


def missing(names: Collection[str], surface: bool = True) -> Iterator[str]:
    """Yield a sentence for each contradiction or gap among the names of a set."""
    if "m" not in names:
        yield "m is missing; expected the mass"
    by_force, by_volume = {"W", "B"}, {"rho", "nabla", "g"}
    given = set(names)
    if given & _STRIPS:
        lacking = sorted({"x_bow", "x_stern", "rho"} - given)
        for pair in (("C_D_y", "h_y"), ("C_D_z", "b_z")):
            if len(given & set(pair)) == 1:
                lacking += sorted(set(pair) - given)
        if not given & {"C_D_y", "C_D_z"}:
            lacking.append("C_D_y or C_D_z")
        if lacking:
            yield f"{', '.join(lacking)} missing; expected all that cross-flow drag by strips needs"
    if given & {*WINGS} and (lacking := sorted({*WINGS, "rho"} - given)):
        yield f"{', '.join(lacking)} missing; expected all that lift and drag of wings need"
    if given & {*WINGS, *_STRIPS} and not given & {"nabla", "g"}:
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
        yield "D_f and U_f must be given together; expected the damping that fades, and its speed"


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
    """Return the parameters that an unknown name may mean: another project's name, or misspelt."""
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
    for kind in (*_MATRICES, "I_b", "I_g"):
        every += [f"{kind}_{i}{j}" for i in range(1, 7) for j in range(1, 7)]
    known = [n for n in every if meaning_of(n) is not None]
    near = get_close_matches(name, known, n=4, cutoff=0.6)
    return "one such as " + ", ".join(near) if near else "m, W, z_g, M_A_11, ..."
