"""Import of a hull's surface and mass as a vehicle, whose numbers are estimates and marked so."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.hull_parameters import meaning_of
from uuvsim_cosim.models.declaration.parameter_files import Quantity
from uuvsim_cosim.models.importing.hull_estimate import (
    added_mass_of,
    drag_coefficients,
    quadratic_drag,
)
from uuvsim_cosim.models.importing.vehicle_draft import Draft
from uuvsim_cosim.models.shapes.mesh import Mesh, Solid, read_mesh, solid_of

__all__ = ["AXES", "MeshImport", "import_mesh"]

Array = NDArray[np.float64]
G = 9.81
# What the file's x, y and z are, as rows of the rotation to FRD.
AXES = {
    "FLU": np.diag([1.0, -1.0, -1.0]),
    "FRD": np.eye(3),
    "RFU": np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
    "LBU": np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
}
_LINEAR_AT, _ANGULAR_AT = 0.1, 0.5  # m/s, rad/s: where linear damping equals quadratic


@dataclass(frozen=True)
class MeshImport:
    """The draft, what was measured of the solid, its drag coefficients, and what to tell."""

    draft: Draft
    solid: Solid  # in b, about the centre of volume
    C_D: Array
    origin: Array  # the file's origin from CO in b [m]
    notes: tuple[str, ...]


def import_mesh(
    path: str | Path,
    mass: float,
    *,
    scale: float = 1.0,
    axes: str = "FLU",
    rho: float = 1025.0,
    volume: float | None = None,
    z_g: float | None = None,
) -> MeshImport:
    """Estimate a vehicle from a closed surface: CO is the centre of the volume, axes are FRD.

    `axes` says what x, y and z of the file are; `volume` [m3] is what displaces water where the
    hull floods (else the solid's); `z_g` [m] the centre of gravity below CO (else 5 % of the
    height). Raises InputInvalid for a surface or a number that cannot be a hull's.
    """
    if axes.upper() not in AXES:
        raise InputInvalid(f"--axes {axes}: expected {', '.join(AXES)}: the file's x, y and z")
    for name, value in (("--mass", mass), ("--rho", rho), ("--volume", volume)):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise InputInvalid(f"{name} {value:g}: expected a number above 0")
    mesh = read_mesh(path, scale)
    turned = mesh.triangles @ AXES[axes.upper()].T
    if np.linalg.det(AXES[axes.upper()]) < 0:
        turned = turned[:, ::-1]
    first = solid_of(Mesh(turned))
    mesh = Mesh(turned - first.centre, mesh.notes)
    centre = np.where(np.abs(first.centre) > 1e-9 * first.extent.max(), first.centre, 0.0)
    solid = solid_of(mesh)
    density = mass / solid.volume
    if not 20.0 <= density <= 20000.0:
        raise InputInvalid(
            path,
            f"{mass:g} kg in {solid.volume:.3g} m3 are {density:.3g} kg/m3",
            "20 to 20000: is the file in another unit (--scale), or the mass not in kg?",
        )
    return _estimated(Path(path), mesh, solid, mass, rho, volume, z_g, 0.0 - centre, axes.upper())


def _estimated(
    path: Path, mesh: Mesh, solid: Solid, m: float, rho: float, given: float | None,
    z_g: float | None, origin: Array, axes: str,
) -> MeshImport:  # fmt: skip
    length, breadth, height = (float(v) for v in solid.extent)
    volume = solid.volume if given is None else given
    M_A, semi = added_mass_of(solid, rho)
    C_D = drag_coefficients(mesh, solid)
    D_q = quadratic_drag(mesh, solid, rho, C_D)
    low = 0.05 * height if z_g is None else z_g
    found: dict[str, Quantity] = {}

    def put(name: str, value: float, source: str) -> None:
        meaning = meaning_of(name)
        assert meaning is not None
        found[name] = Quantity(value, meaning.unit, source)

    put("m", m, "given to uuvsim models import")
    put("rho", rho, "sea water" if rho == 1025.0 else "given to uuvsim models import")
    put("nabla", volume, "given to uuvsim models import" if given is not None
        else f"estimated: volume within the surface of {path.name}")  # fmt: skip
    put("g", G, "standard gravity, three digits")
    put("z_g", low, "given to uuvsim models import" if z_g is not None
        else "estimated: assumption, ballast 5 % of the height below CB")  # fmt: skip
    inertia = solid.inertia(m)
    for i in range(3):
        for j in range(i, 3):
            if i == j or abs(inertia[i, j]) > 1e-4 * inertia.max():
                put(f"I_g_{i + 1}{j + 1}", float(inertia[i, j]),
                    "estimated: mass spread evenly over the volume")  # fmt: skip
    ellipsoid = " x ".join(f"{a:.3g}" for a in semi)
    for i in range(6):
        for j in range(i, 6):
            if abs(M_A[i, j]) > 1e-9 * M_A.max():
                put(f"M_A_{i + 1}{j + 1}", float(M_A[i, j]),
                    f"estimated: Lamb's ellipsoid of semi-axes {ellipsoid} m")  # fmt: skip
    slow = 8.0 * pi * 1.3e-3 * (0.75 * solid.volume / pi)  # 8 pi mu r³ of slow flow
    for i in range(6):
        at = _LINEAR_AT if i < 3 else _ANGULAR_AT
        linear = D_q[i] * at
        how = f"estimated: as D_q_{i + 1}{i + 1} gives at {at:g} {'m/s' if i < 3 else 'rad/s'}"
        if linear < slow and i >= 3:
            linear, how = slow, "estimated: 8 pi mu r^3 of a sphere that turns slowly"
        put(f"D_l_{i + 1}{i + 1}", float(linear), how)
    for i in range(6):
        if i < 3:
            how = f"estimated: C_D = {C_D[i]:.3g} of {solid.areas[i]:.4g} m2 seen along {'xyz'[i]}"
        else:
            how = "estimated: faces by strips, each by its own normal velocity"
        if D_q[i] > 0:
            put(f"D_q_{i + 1}{i + 1}", float(D_q[i]), how)
    put("height", height, f"estimated: extent of {path.name}")
    notes = [*mesh.notes, *_several(mesh)]
    known = {}
    net = (rho * volume - m) / m
    if abs(net) > 0.03:
        way = "floats up" if net > 0 else "sinks"
        cause = (
            f"{m:g} kg were given, and {volume:.4g} m3 displace {rho * volume:.4g} kg: it {way} "
            f"with {abs(net) * m * G:.3g} N"
        )
        known["weight is near buoyancy"] = cause
        hint = (
            "" if given is not None else "; where the hull floods, give what displaces by --volume"
        )
        notes.append(cause + hint)
    middle = tuple(float(v) for v in 0.5 * (solid.low + solid.high))
    where = ", ".join(f"{v:.4g}" for v in origin)
    draft = Draft(
        "estimated",
        f"estimated from {path.name}",
        f"No publication: estimated by uuvsim models import from {path.name} and {m:g} kg",
        f"surface of {len(mesh.triangles)} triangles, axes {axes} turned to FRD; the file's origin "
        f"is at ({where}) m from CO",
        found,
        (length, breadth, height),
        (middle[0], middle[1], middle[2]),
        _shape(solid),
        f"estimated: extent of {path.name}",
        _readme(path, solid, C_D, semi, where),
        known,
    )  # fmt: skip
    return MeshImport(draft, solid, C_D, origin, tuple(notes))


def _several(mesh: Mesh) -> list[str]:
    """Return a sentence where the surface is of several bodies; another if they may share space."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    points = mesh.triangles.reshape(-1, 3)
    grid = np.round(points / (1e-7 * float(np.ptp(points, axis=0).max()))).astype(np.int64)
    _, corner = np.unique(grid, axis=0, return_inverse=True)
    corner = corner.reshape(-1, 3)
    n = int(corner.max()) + 1
    pairs = np.concatenate([corner[:, :2], corner[:, 1:]])
    joined = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    count, label = connected_components(joined, directed=False)
    if count == 1:
        return []
    bodies = [
        mesh.triangles[label[corner[:, 0]] == k].reshape(-1, 3) for k in range(min(count, 50))
    ]
    low = np.array([b.min(axis=0) for b in bodies])
    high = np.array([b.max(axis=0) for b in bodies])
    apart = (low[:, None] >= high[None] - 1e-9).any(axis=2)
    shared = ~(apart | apart.T | np.eye(len(bodies), dtype=bool))
    note = f"{count} bodies that do not touch are added up to one hull"
    if shared.any():
        a, b = (int(i) + 1 for i in np.argwhere(shared)[0])
        note += (
            f"; the extents of bodies {a} and {b} overlap: what they share counts twice, so join "
            "them where the mesh was made, or give --volume"
        )
    return [note]


def _shape(solid: Solid) -> str:
    fullness = solid.volume / float(np.prod(solid.extent))
    slender = float(solid.extent[0] / max(solid.extent[1], solid.extent[2]))
    if fullness > 0.85:
        return "box"
    return "torpedo" if slender > 3.0 else "ellipsoid"


def _readme(path: Path, solid: Solid, C_D: Array, semi: Array, origin: str) -> str:
    rows = "".join(
        f"| {a} | {solid.extent[i]:.4g} | {solid.areas[i]:.4g} | {C_D[i]:.3g} | {semi[i]:.4g} |\n"
        for i, a in enumerate("xyz")
    )
    return f"""\
Estimated from the surface `{path.name}`; nothing was measured. CO is the centre of the volume
({solid.volume:.5g} m3, surface {solid.surface:.4g} m2); the file's origin is at ({origin}) m.

| axis | extent [m] | area seen [m2] | C_D | semi-axis of the ellipsoid [m] |
|---|---|---|---|---|
{rows}
## Validity
Volume, centre, areas and the inertia of an even density are exact for the surface. Added mass is
an ellipsoid's, drag by faces: expect them to be off by a factor of 1.5, and more where the frame is
open. Thrusters, fins, lift and the centre of gravity are not in a surface: add them.

## Errata and choices
None yet. Replace each number that you can measure (`uuvsim identify` fits them to a log).
"""
