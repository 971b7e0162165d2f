"""Import of a hull's surface and mass as a vehicle, whose numbers are estimates and marked so.

Added mass is computed by a panel method (panel_method.py) if Capytaine is installed. Else it is
that of the ellipsoid with the solid's second moments in proportion and its volume (Lamb,
ellipsoid.py), turned to its principal axes.

Drag along axis i is 1/2 rho C_D A_i: C_D is 1.05 of the flat part that meets the flow (a cube's
face), and for the round rest between that of a sphere (0.5), a long cylinder across the flow (1.1)
and a streamlined body along it (0.44/e + 0.02 e, the form that Hoerner 1965, Fluid-Dynamic Drag,
gives for ellipsoids, with friction 0.005). The interval of C_D follows table 7.3 of White (2011,
Fluid Mechanics): flat from 0.85 (a cylinder end on, twice as long as broad) to 1.3 (a plate of
10:1); round 0.4 times (a boundary layer that is turbulent before it separates) to 1.2 times. For
streamlined bodies 0.5 to 2 times is an assumption. In rotation each element of surface that
advances pushes with its own normal velocity: D_q = 1/2 rho s ∫ |n·(e x r)|³ dA, which is the
strips' formula for a box and 0 for a sphere.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from math import pi, sqrt
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.hull_parameters import meaning_of
from uuvsim_cosim.models.declaration.parameter_files import Quantity
from uuvsim_cosim.models.importing.panel_method import (
    RECORD,
    PanelResult,
    by_panels,
    mesh_hash,
    stored_result,
)
from uuvsim_cosim.models.importing.vehicle_draft import Draft
from uuvsim_cosim.models.shapes.ellipsoid import added_mass
from uuvsim_cosim.models.shapes.mesh import Mesh, Solid, likely_unit, read_mesh, solid_of
from uuvsim_cosim.models.shapes.panels import cut_to

__all__ = [
    "AXES",
    "MeshImport",
    "added_mass_of",
    "drag_coefficients",
    "import_mesh",
    "quadratic_drag",
]

Array = NDArray[np.float64]
G = 9.81
BLUNT = 1.05  # C_D of a cube's face
_BLUNT_FROM, _BLUNT_TO = 0.85, 1.3
LEAST_SHARE = 0.01  # of the enclosed volume that a frame displaces
KNOWN, REFUSED = 0.15, 5.0  # net force in parts of the weight; mass over displaced mass, or inverse
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
    C_D: Array  # (3, 3): least, expected and greatest along x, y, z
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
    added_mass: str | Path = "auto",
    turn: bool = False,
) -> MeshImport:
    """Estimate a vehicle from a closed surface: CO is the centre of the volume, axes are FRD.

    `axes` are the directions of x, y and z in the file; `volume` [m3] is the displaced volume if
    the hull floods (else the solid's); `z_g` [m] is the depth of the centre of gravity below CO
    (else 5 % of the height). `added_mass` is `capytaine`, `ellipsoid`, `auto` (Capytaine if it is
    installed), or the folder of a vehicle that was imported from the same surface. `turn` turns
    triangles that are inside out. Raises InputInvalid for a surface or a number that cannot be a
    hull's.
    """
    if axes.upper() not in AXES:
        raise InputInvalid(f"--axes {axes}: expected {', '.join(AXES)}: the file's x, y and z")
    for name, value in (("--mass", mass), ("--rho", rho), ("--volume", volume)):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise InputInvalid(f"{name} {value:g}: expected a number above 0")
    mesh = read_mesh(path, scale, turn=turn, mass=None if volume else mass)
    turned = mesh.triangles @ AXES[axes.upper()].T
    if np.linalg.det(AXES[axes.upper()]) < 0:
        turned = turned[:, ::-1]
    first = solid_of(Mesh(turned))
    sha256 = mesh_hash(Mesh(turned))
    mesh = Mesh(turned - first.centre, mesh.notes)
    centre = np.where(np.abs(first.centre) > 1e-9 * first.extent.max(), first.centre, 0.0)
    solid = solid_of(mesh)
    unit = likely_unit(mesh.triangles / scale, None if volume else mass, scale)
    _plausible(str(path), solid, mass, rho, volume, z_g, unit)
    panels, notes = _panels(mesh, str(path), sha256, str(added_mass))
    return _estimated(
        Path(path), Mesh(mesh.triangles, (*mesh.notes, *notes)), solid, panels, mass, rho, volume,
        z_g, 0.0 - centre, axes.upper(),
    )  # fmt: skip


def _plausible(
    place: str,
    solid: Solid,
    mass: float,
    rho: float,
    volume: float | None,
    z_g: float | None,
    unit: str,
) -> None:
    """Raise InputInvalid where mass, volume or centre of gravity cannot belong to the surface."""
    if volume is not None and volume > 1.05 * solid.volume:
        raise InputInvalid(
            f"--volume {volume:.4g}",
            f"the surface of {place} encloses {solid.volume:.4g} m3",
            f"at most that volume: {unit or 'is the file in another unit (--scale)?'} Or is the "
            "volume not in m3?",
        )
    if volume is not None and volume < LEAST_SHARE * solid.volume:
        raise InputInvalid(
            f"--volume {volume:.4g}",
            f"less than {100 * LEAST_SHARE:g} % of the {solid.volume:.4g} m3 that the surface of "
            f"{place} encloses",
            f"more of it: {unit or 'is the file in another unit (--scale)?'}",
        )
    displaced = rho * (solid.volume if volume is None else volume)
    if not 1.0 / REFUSED <= mass / displaced <= REFUSED:
        hint = "" if volume is not None or mass > displaced else ", or give --volume if it floods"
        other = f". {unit[0].upper()}{unit[1:]}" if unit and volume is None else ""
        raise InputInvalid(
            place,
            f"{mass:g} kg were given, and the hull displaces {displaced:.4g} kg of water",
            f"{displaced / REFUSED:.3g} to {displaced * REFUSED:.3g} kg: correct --mass (in kg)"
            f"{hint}{other}",
        )
    if z_g is not None and not solid.low[2] <= z_g <= solid.high[2]:
        raise InputInvalid(
            f"--z-g {z_g:g}",
            "the centre of gravity is outside of the hull, which reaches from "
            f"{solid.low[2]:.4g} to {solid.high[2]:.4g} m below the centre of buoyancy",
            "a distance in m within that range",
        )


def _panels(
    mesh: Mesh, place: str, sha256: str, how: str
) -> tuple[PanelResult | None, tuple[str, ...]]:
    """Return the panel method's result, None for the ellipsoid, and a note on the choice."""
    if how == "ellipsoid":
        return None, ()
    if how not in ("auto", "capytaine"):
        return stored_result(Path(how), sha256), (f"added mass was read from {how}/{RECORD}",)
    if how == "capytaine":
        return by_panels(mesh, place, sha256), ()
    if find_spec("capytaine") is None:
        return None, (
            "added mass is that of an ellipsoid, which can be 50 % off for a flat or boxy hull: "
            "`pip install 'uuvsim-cosim[hydro]'` and import again to compute it from the surface",
        )
    try:
        return by_panels(mesh, place, sha256), ()
    except InputInvalid as error:
        return None, (f"added mass is that of an ellipsoid, because panels failed: {error}",)


def _estimated(
    path: Path, mesh: Mesh, solid: Solid, panels: PanelResult | None, m: float, rho: float,
    given: float | None, z_g: float | None, origin: Array, axes: str,
) -> MeshImport:  # fmt: skip
    length, breadth, height = (float(v) for v in solid.extent)
    volume = solid.volume if given is None else given
    M_A, semi = added_mass_of(solid, rho)
    if panels is not None:
        M_A = rho * panels.values
    C_D = drag_coefficients(mesh, solid)
    least, D_q, most = (quadratic_drag(mesh, solid, rho, c) for c in C_D)
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
            if abs(M_A[i, j]) <= 1e-9 * M_A.max():
                continue
            how = f"estimated: Lamb's ellipsoid of semi-axes {ellipsoid} m"
            if panels is not None:
                how = (
                    f"estimated: Capytaine {panels.capytaine}, extrapolated from "
                    f"{', '.join(map(str, panels.panels))} panels, within "
                    f"{rho * panels.half_widths[i, j]:.2g}"
                )
            put(f"M_A_{i + 1}{j + 1}", float(M_A[i, j]), how)
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
            how = (
                f"estimated: C_D = {C_D[1, i]:.3g} of {solid.areas[i]:.4g} m2 seen along {'xyz'[i]}"
            )
        else:
            how = "estimated: faces by strips, each by its own normal velocity"
        how += f"; {least[i]:.3g} to {most[i]:.3g} for a closed bare hull"
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
        hint = (
            ""
            if given is not None
            else "; if the hull floods, give the displaced volume by --volume"
        )
        if abs(net) <= KNOWN:
            known["weight is near buoyancy"] = cause
        else:
            hint += "; uuvsim models check fails until mass and volume agree"
        notes.append(cause + hint)
    middle = tuple(float(v) for v in 0.5 * (solid.low + solid.high))
    shape = "torpedo" if length / max(breadth, height) > 3.0 else "ellipsoid"
    if solid.volume / float(np.prod(solid.extent)) > 0.85:
        shape = "box"
    rows = "".join(
        f"| {a} | {solid.extent[i]:.4g} | {solid.areas[i]:.4g} | {C_D[1, i]:.3g} | "
        f"{C_D[0, i]:.3g} to {C_D[2, i]:.3g} |\n"
        for i, a in enumerate("xyz")
    )
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
        shape,
        f"estimated: extent of {path.name}",
        _README.format(
            file=path.name, volume=solid.volume, surface=solid.surface, origin=where, rows=rows,
            how=_ELLIPSOID.format(semi=ellipsoid) if panels is None else _PANELS,
        ),
        known,
        files={} if panels is None else {RECORD: panels.text(path.name)},
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


_README = """\
Estimated from the surface `{file}`; nothing was measured. CO is the centre of the volume
({volume:.5g} m3, surface {surface:.4g} m2); the file's origin is at ({origin}) m.

| axis | extent [m] | area seen [m2] | C_D | interval of C_D |
|---|---|---|---|---|
{rows}
## Validity
Volume, centre, areas and the inertia of an even density are exact for the surface.
{how}
Drag is estimated from the areas seen. Its intervals hold for a closed hull without appendages;
expect it to be off by a factor of 2 or more where the frame is open. Thrusters, fins, lift and the
centre of gravity are not in a surface: add them.

## Errata and choices
None yet. Replace each number that you can measure (`uuvsim identify` fits them to a log).
"""


_ELLIPSOID = """\
Added mass is that of the ellipsoid of semi-axes {semi} m: for a flat or boxy hull it can be 50 %
too small."""
_PANELS = """\
Added mass is that of the closed surface in ideal fluid without walls; added_mass.json has the
meshes and the half widths of the intervals. Water that flows through an open frame makes it smaller
than this."""


def added_mass_of(solid: Solid, rho: float) -> tuple[Array, Array]:
    """Return M_A (6, 6) [kg, kg.m2] about the centre of volume, and the semi-axes [m] used."""
    values, axes = np.linalg.eigh(solid.second)
    values = np.maximum(values, 1e-9 * values.max())
    # Nearly equal second moments (sphere, cube) have no axes of their own: keep the body's.
    if np.ptp(values) < 1e-3 * values.max():
        axes = np.eye(3)
    order = np.argmax(np.abs(axes), axis=0)
    if len(set(order.tolist())) == 3:  # name the axes as the body's that they are nearest to
        back = np.argsort(order)
        values, axes = values[back], axes[:, back]
    semi = np.sqrt(5.0 * values / solid.volume)
    semi *= (solid.volume / (4.0 / 3.0 * pi * semi.prod())) ** (1.0 / 3.0)
    a, b, c = (float(s) for s in semi)
    diagonal: Array = np.array(added_mass(a, b, c, rho), dtype=float)
    M_A = np.zeros((6, 6))
    for k in (0, 3):
        block = axes @ np.diag(diagonal[k : k + 3]) @ axes.T
        small = np.abs(block) < 1e-4 * np.abs(diagonal[k : k + 3]).max()
        block[small & ~np.eye(3, dtype=bool)] = 0.0
        M_A[k : k + 3, k : k + 3] = block
    return M_A, semi


def _surface(mesh: Mesh) -> tuple[Array, Array, Array]:
    """Return outward unit normals (n, 3), areas (n,) [m2] and middles (n, 3) [m]."""
    t = mesh.triangles
    cross = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
    length = np.linalg.norm(cross, axis=1)
    return cross / np.maximum(length, 1e-300)[:, None], 0.5 * length, t.mean(axis=1)


def drag_coefficients(mesh: Mesh, solid: Solid) -> Array:
    """Return C_D of the areas seen along x, y and z (3, 3): rows least, expected and greatest."""
    normals, areas, _ = _surface(mesh)
    out = np.zeros((3, 3))
    for i in range(3):
        j, k = (a for a in range(3) if a != i)
        seen = float(solid.areas[i])
        flat = 0.5 * sum(float(areas[s * normals[:, i] > 0.999].sum()) for s in (1.0, -1.0))
        blunt = min(1.0, flat / seen)
        e = float(solid.extent[i]) / (2.0 * sqrt(seen / pi))
        low, high = 0.4, 1.2
        if e >= 1.0:
            round_ = min(0.5, 0.44 / e + 0.02 * e + 0.02 / sqrt(e))
            if e >= 2.0:
                low, high = 0.5, 2.0
        else:
            slender = float(max(solid.extent[j], solid.extent[k]))
            slender /= float(min(solid.extent[j], solid.extent[k]))
            round_ = 1.1 - 0.6 / slender
        faces = np.array([_BLUNT_FROM, BLUNT, _BLUNT_TO])
        out[:, i] = blunt * faces + (1.0 - blunt) * round_ * np.array([low, 1.0, high])
    return out


def quadratic_drag(mesh: Mesh, solid: Solid, rho: float, C_D: Array) -> Array:
    """Return the diagonal of D_q (6,) [N.s2/m2, N.m.s2/rad2] about the centre of volume."""
    normals, areas, _ = _surface(mesh)
    D_q = np.zeros(6)
    D_q[:3] = 0.5 * rho * C_D * solid.areas
    impact = np.array(
        [float((np.maximum(normals[:, i], 0.0) ** 3 * areas).sum()) for i in range(3)]
    )
    share = C_D * solid.areas / np.maximum(impact, 1e-12)
    fine = Mesh(cut_to(mesh.triangles, float(solid.extent.max()) / 24.0))
    normals, areas, _ = _surface(fine)
    s = (normals**2) @ share
    points: Array = np.einsum("kc,nci->nki", _POINTS, fine.triangles) - solid.centre
    for i in range(3):
        turning = np.cross(np.eye(3)[i], points)  # (n, 7, 3)
        advance = np.maximum(np.einsum("nki,ni->nk", turning, normals), 0.0) ** 3
        D_q[3 + i] = 0.5 * rho * float((s * areas * (advance @ _WEIGHTS)).sum())
    D_q[3:][D_q[3:] < 1e-6 * rho * float(solid.extent.max()) ** 5] = 0.0
    return D_q


# Seven points in a triangle, exact to fifth degree (Dunavant 1985): a flat face keeps |r|³.
_A, _B = (6.0 - sqrt(15.0)) / 21.0, (6.0 + sqrt(15.0)) / 21.0
_POINTS = np.array(
    [
        [1 / 3] * 3,
        *([_A if j != i else 1 - 2 * _A for j in range(3)] for i in range(3)),
        *([_B if j != i else 1 - 2 * _B for j in range(3)] for i in range(3)),
    ]
)
_WEIGHTS = np.array([0.225, *[(155 - sqrt(15)) / 1200] * 3, *[(155 + sqrt(15)) / 1200] * 3])
