"""The folder of a user's own vehicle: files with a comment at each line, complete from the start.

Volume, inertia and added mass are those of the ellipsoid (or the spheroid) of the size given, drag
that of its faces: estimates, marked so, each to be replaced by a number with a source.
"""

from __future__ import annotations

from math import pi
from pathlib import Path

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.modeline import BY_FILE_NAME, headed, keep_schemas
from uuvsim_cosim.models.declaration.parameter_files import Quantity
from uuvsim_cosim.models.importing.vehicle_draft import check_id, row_of
from uuvsim_cosim.models.shapes.ellipsoid import added_mass

__all__ = ["write_vehicle"]

_SIZES = {"box": (0.45, 0.35, 0.25), "torpedo": (1.6, 0.19, 0.19)}
RHO, G = 1025.0, 9.81
_Row = tuple[str, float, str, str]  # name, value, unit, source


def write_vehicle(id: str, into: Path, shape: str = "box") -> Path:
    """Write parameters.yaml, thrusters.yaml, README.md (and fins, propeller) into `into`/`id`."""
    check_id(id)
    if shape not in _SIZES:
        raise InputInvalid(f"shape {shape!r}", " or ".join(_SIZES))
    folder = into / id
    if folder.exists() and any(folder.iterdir()):
        raise InputInvalid(f"{folder} exists already", "an unused name")
    folder.mkdir(parents=True, exist_ok=True)
    size = ", ".join(f"{side:g}" for side in _SIZES[shape])
    texts = {
        "parameters.yaml": _HEAD.format(id=id, size=size, shape=shape) + _parameters(shape),
        "README.md": _README.format(id=id),
    }
    if shape == "box":
        texts["thrusters.yaml"] = _THRUSTERS.format(id=id)
    else:
        texts["thrusters.yaml"] = _STERN.format(id=id)
        texts["propeller.yaml"] = _PROPELLER.format(id=id)
        texts["fins.yaml"] = _FINS.format(id=id)
    for name, text in texts.items():
        schema = BY_FILE_NAME.get(name)
        (folder / name).write_text(headed(schema, text) if schema else text, encoding="utf-8")
    keep_schemas(*(folder / name for name in texts))
    return folder


def _parameters(shape: str) -> str:
    """Return the rows of the parameters, with a comment before each group."""
    length, breadth, height = _SIZES[shape]
    volume = pi / 6 * length * breadth * height
    m = RHO * volume * 0.998
    a = (length / 2, breadth / 2, height / 2)
    inertia = [m / 5 * (a[j] ** 2 + a[k] ** 2) for j, k in ((1, 2), (0, 2), (0, 1))]
    M_A = added_mass(*a, RHO)
    if shape == "torpedo":
        M_A[3] = 0.1 * inertia[0]
    how = "estimated: ellipsoid of the size above"
    damping: list[_Row] = []
    if shape == "box":
        about = "damping, positive for a brake: linear D_l_11 ..., with |v| D_q_11 ..."
        c = 0.5 * RHO * 1.05
        faces = (breadth * height, length * height, length * breadth)
        turns = (
            length * (a[1] ** 4 + a[2] ** 4) / 2,
            breadth * (a[0] ** 4 + a[2] ** 4) / 2,
            height * (a[0] ** 4 + a[1] ** 4) / 2,
        )
        for i, area in enumerate((*faces, *turns), 1):
            unit = ("N.s/m", "N.s2/m2") if i < 4 else ("N.m.s/rad", "N.m.s2/rad2")
            at = 0.1 if i < 4 else 0.5
            what = "C_D = 1.05 of the face" if i < 4 else "C_D = 1.05, by strips"
            source = f"estimated: as D_q_{i}{i} gives at {at:g}"
            damping.append((f"D_l_{i}{i}", at * c * area, unit[0], source))
            damping.append((f"D_q_{i}{i}", c * area, unit[1], f"estimated: {what}"))
    else:
        about = "D_q: with |v|. D_u: with |u|, lift. x_bow ... b_z: cross-flow drag by strips"
        d = breadth
        lift = 0.5 * RHO * pi * d * d / 4 * 1.2
        of_hull = "estimated: lift of the hull, 1.2 per rad of its section"
        cylinder = "estimated: cross-flow drag of a cylinder"
        section = 0.5 * RHO * 0.2 * pi * d * d / 4
        damping = [
            ("D_q_11", section, "N.s2/m2", "estimated: C_D = 0.2 of the section"),
            ("D_q_44", 0.05, "N.m.s2/rad2", "estimated: fins"),
            ("D_u_22", lift, "N.s2/m2", of_hull),
            ("D_u_33", lift, "N.s2/m2", of_hull),
            ("x_bow", length / 2, "m", "estimated: half the length"),
            ("x_stern", -length / 2, "m", "estimated: half the length"),
            ("C_D_y", 1.1, "1", cylinder),
            ("h_y", d, "m", "estimated: diameter"),
            ("C_D_z", 1.1, "1", cylinder),
            ("b_z", d, "m", "estimated: diameter"),
        ]
    masses = enumerate(zip(M_A, ["kg"] * 3 + ["kg.m2"] * 3, strict=True), 1)
    groups: dict[str, list[_Row]] = {
        "mass, and either rho, nabla and g, or W and B: never both": [
            ("m", m, "kg", "estimated: 0.2 % lighter than the water displaced"),
            ("rho", RHO, "kg/m3", "sea water"),
            ("nabla", volume, "m3", how),
            ("g", G, "m/s2", "standard gravity, three digits"),
        ],
        "centre of buoyancy (x_b y_b z_b) and of gravity (x_g y_g z_g) from CO, z down": [
            ("z_b", -0.02 if shape == "box" else -0.01, "m", "assumption: ballast below"),
        ],
        "inertia about CG (I_g_11 ...), or about CO (I_b_11 ...); products as I_g_12": [
            (f"I_g_{i}{i}", v, "kg.m2", how) for i, v in enumerate(inertia, 1)
        ],
        "added mass about CO, positive (M_A_11 = -X_udot); off-diagonals as M_A_15": [
            (f"M_A_{i}{i}", v, unit, how) for i, (v, unit) in masses if v > 0
        ],
        about: damping,
        "height of the hull, over which buoyancy is lost at the surface": [
            ("height", height, "m", "the size above"),
        ],
    }
    text = ""
    for comment, rows in groups.items():
        text += f"      # {comment}\n"
        for name, value, unit_, source in rows:
            text += row_of(name, Quantity(float(f"{value:.6g}"), unit_, source))
    return text


_HEAD = """\
# {id}: hull. Each number stands with its unit and source; a parameter that is left out is zero.
# Frames: body FRD (x ahead, y starboard, z down) with its origin CO, world NED. Numbers from other
# frames (gz-sim, URDF: FLU) are turned before they are written here: y and z change their sign.
id: {id}
description: a vehicle of my own
frames: {{body: FRD, world: NED}}
size: {{value: [{size}], unit: m, shape: {shape}, source: "length, breadth, height: measure them"}}
default: estimated            # the set that `model:{id}` means; others are `model:{id}@name`
sets:
  estimated:
    citation: "No publication: estimated from the size by uuvsim models new"
    obtained: "closed forms of an ellipsoid; replace each number that you can measure"
    parameters:
"""
_THRUSTERS = """\
# Thrusters: r from CO, and direction e of positive thrust, both in b (FRD).
vehicle: {id}
source: "chosen: four vectored in the horizontal plane, two upwards"
model: thruster_t200
thrusters:
  - name: front right, horizontal
    r: {{value: [0.14, 0.09, 0], unit: m}}
    e: {{value: [0.70710678, -0.70710678, 0], unit: "1"}}
  - name: front left, horizontal
    r: {{value: [0.14, -0.09, 0], unit: m}}
    e: {{value: [0.70710678, 0.70710678, 0], unit: "1"}}
  - name: rear right, horizontal
    r: {{value: [-0.14, 0.09, 0], unit: m}}
    e: {{value: [-0.70710678, -0.70710678, 0], unit: "1"}}
  - name: rear left, horizontal
    r: {{value: [-0.14, -0.09, 0], unit: m}}
    e: {{value: [-0.70710678, 0.70710678, 0], unit: "1"}}
  - name: right, vertical
    r: {{value: [0, 0.11, 0], unit: m}}
    e: {{value: [0, 0, -1], unit: "1"}}
  - name: left, vertical
    r: {{value: [0, -0.11, 0], unit: m}}
    e: {{value: [0, 0, -1], unit: "1"}}
"""
_STERN = """\
# Propellers: r from CO, and direction e of positive thrust, both in b (FRD).
vehicle: {id}
source: "chosen: one at the stern"
model: propeller
thrusters:
  - name: stern propeller
    r: {{value: [-0.8, 0, 0], unit: m}}
    e: {{value: [1, 0, 0], unit: "1"}}
"""
_PROPELLER = """\
# Propeller: thrust = (1 - t) (T_nn |n| n - T_nV |n| V_a), torque = Q_nn |n| n - Q_nV |n| V_a.
id: {id}
kind: propeller
description: "propeller of 0.14 m"
parameters:
  n_max: {{value: 160, unit: rad/s, source: "assumption"}}
  T_n: {{value: 0.3, unit: s, source: "assumption"}}
  T_nn: {{value: 4.5e-3, unit: N.s2/rad2, source: "assumption: rho D^4 K_T / (2 pi)^2"}}
  T_nV: {{value: 0.19, unit: "N.s2/(m.rad)", source: "assumption: thrust falls with speed"}}
  Q_nn: {{value: 1e-4, unit: N.m.s2/rad2, source: "assumption: rho D^5 K_Q / (2 pi)^2"}}
  Q_nV: {{value: 3.5e-3, unit: "N.m.s2/(m.rad)", source: "assumption"}}
  w: {{value: 0.05, unit: "1", source: "assumption: wake fraction"}}
  t: {{value: 0.1, unit: "1", source: "assumption: thrust deduction"}}
  eta_P: {{value: 0.7, unit: "1", source: "assumption: motor and gear"}}
"""
_FINS = """\
# Fins: r from CO, hinge a, both in b (FRD); right-handed about a is positive.
vehicle: {id}
source: "chosen: a cross at the stern"
undeflected_in_hull: false    # true where the hull's D_u holds the fins at rest already
figures:                      # of all fins; a fin may have its own beside r and a
  rho: {{value: 1025, unit: kg/m3, source: "sea water"}}
  S: {{value: 0.0066, unit: m2, source: "assumption: area of one fin"}}
  C_L_alpha: {{value: 3.0, unit: "1", source: "assumption: low aspect ratio"}}
  C_D_0: {{value: 0.01, unit: "1", source: "assumption"}}
  C_D_n: {{value: 1.1, unit: "1", source: "assumption: flat plate broadside"}}
  alpha_stall: {{value: 25, unit: deg, source: "assumption: low aspect ratio"}}
  delta_max: {{value: 20, unit: deg, source: "assumption"}}
  T_delta: {{value: 0.1, unit: s, source: "assumption"}}
fins:
  - name: upper rudder
    r: {{value: [-0.7, 0, -0.14], unit: m}}
    a: {{value: [0, 0, 1], unit: "1"}}
  - name: lower rudder
    r: {{value: [-0.7, 0, 0.14], unit: m}}
    a: {{value: [0, 0, 1], unit: "1"}}
  - name: starboard stern plane
    r: {{value: [-0.7, 0.14, 0], unit: m}}
    a: {{value: [0, 1, 0], unit: "1"}}
  - name: port stern plane
    r: {{value: [-0.7, -0.14, 0], unit: m}}
    a: {{value: [0, 1, 0], unit: "1"}}
"""
_README = """\
# {id}

Description of the vehicle, and the sources of its numbers.

| address | source | what it is |
|---|---|---|
| `{id}` = `{id}@estimated` | estimated from its size | nothing was measured |

## Validity
Speeds, attitudes and depths for which the numbers hold.

## Errata and choices
Errors in publications, and decisions.
"""
