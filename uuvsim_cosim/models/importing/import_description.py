"""Import of a URDF, SDF or xacro as a vehicle: FLU to FRD, signs to Fossen's convention.

CO is the origin of the root link (or of the model). What the file does not hold is estimated from
its size, as for a box, and marked so.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.hull_parameters import meaning_of
from uuvsim_cosim.models.declaration.parameter_files import Quantity
from uuvsim_cosim.models.hull.vehicle import hull
from uuvsim_cosim.models.importing.description_bodies import Bodies, Reader, bodies_of
from uuvsim_cosim.models.importing.description_water import FLU_TO_FRD, Water, water_of
from uuvsim_cosim.models.importing.vehicle_draft import Draft, PlacedThruster
from uuvsim_cosim.models.importing.xacro import local, place_of, read_description
from uuvsim_cosim.models.shapes.ellipsoid import added_mass
from uuvsim_cosim.models.vehicles.closed_forms import closed_forms

__all__ = ["DescriptionImport", "import_description"]

Array = NDArray[np.float64]
G, RHO = 9.81, 1025.0


@dataclass(frozen=True)
class DescriptionImport:
    """The draft, and notes on how it was read."""

    draft: Draft
    notes: tuple[str, ...]


# Possible mistakes of a file, by closed form; the numbers are kept as they are in the file.
_CAUSES = {
    "M is symmetric": "the file's added mass is not symmetric",
    "M is positive definite": "the file's inertia and added mass are not positive definite",
    "inertia is of a body": "the file's largest moment of inertia exceeds the other two together",
    "water takes energy only": "the file's damping drives the vehicle in some direction",
    "level is neutral": "the file's centres of gravity and buoyancy are not in one line",
    "upright is stable": "the file's centre of gravity is above that of buoyancy",
    "weight is near buoyancy": "the file's volume displaces another weight than its mass",
}


def import_description(path: str | Path) -> DescriptionImport:
    """Read a .urdf, .sdf or .xacro and a TAM.yaml near it; raises InputInvalid with the line."""
    path = Path(path)
    root = read_description(path)
    model = root
    if local(root) != "robot":
        models = [e for e in root.iter() if local(e) == "model"]
        if not models:
            raise InputInvalid(
                place_of(path, root),
                f"<{local(root)}>",
                "<robot> (URDF, xacro) or <sdf> with a <model>",
            )
        with_water = [m for m in models if water_of(Reader(path), m) is not None]
        if len(models) > 1 and len(with_water) != 1:
            names = ", ".join(str(m.get("name")) for m in models)
            raise InputInvalid(
                path, f"{len(models)} models ({names})", "one, or one with hydrodynamics"
            )
        model = (with_water or models)[0]
    read = Reader(path)
    bodies = bodies_of(read, model)
    water = water_of(read, root)
    if read.problems:
        raise InputInvalid.of(read.problems)
    notes = list(water.notes) if water is not None else []
    notes += [f"<collision> mesh {what}" for what in dict.fromkeys(bodies.repaired)]
    if len(bodies.links) > 1:
        notes.append(
            f"{len(bodies.links)} links were added up to one body of {bodies.m:.6g} "
            "kg, joints at zero"
        )
    if water is None:
        notes.append(
            "no hydrodynamics are in the file (neither <hydrodynamic_model> nor a plugin with "
            "hydrodynamics in its name): added mass and damping are estimated"
        )
    given = water or Water("")
    size, at, size_source = _size(path, bodies, given, notes)
    found: dict[str, Quantity] = {}
    for name, value, source in (
        *_inertia_and_buoyancy(path, bodies, given, notes),
        *_hydrodynamics(path, given, size),
    ):
        meaning = meaning_of(name)
        assert meaning is not None, name
        found[name] = Quantity(value, meaning.unit, source)
    found["height"] = Quantity(float(size[2]), "m", size_source)
    thrusters, thrusters_source = _thrusters(path, notes)
    estimated = hull("imported", {k: q.value for k, q in found.items()}, surface=False)
    known = {c.name: _CAUSES[c.name] for c in closed_forms(estimated) if not c.off <= c.tolerance}
    notes += [f"{check} does not hold: {because}" for check, because in known.items()]
    what = water.source if water is not None else "no hydrodynamics"
    draft = Draft(
        "imported",
        f"imported from {path.name}",
        f"{path.name}, read by uuvsim models import: inertials, {what}",
        "frames FLU turned to FRD, damping turned to positive for a brake; CO is the origin of "
        f"{bodies.links[0] or 'the model'}",
        found,
        (float(size[0]), float(size[1]), float(size[2])),
        (float(at[0]), float(at[1]), float(at[2])),
        "box",
        size_source,
        _README.format(
            file=path.name, what=what, notes="".join(f"- {n}\n" for n in notes) or "- nothing\n"
        ),
        known,
        thrusters,
        thrusters_source,
    )
    return DescriptionImport(draft, tuple(notes))


def _size(path: Path, bodies: Bodies, water: Water, notes: list[str]) -> tuple[Array, Array, str]:
    """Return extents, their middle from CO in FRD, and where they are from."""
    r_g = FLU_TO_FRD @ bodies.r_g
    if water.size is not None:
        at = water.r_b if water.r_b is not None else np.zeros(3)
        if np.any(np.abs(r_g - at) > 0.5 * water.size):  # the file states no place of its box
            at = 0.5 * (at + r_g)
        return water.size, at, f"{path.name}: box of {water.source}"
    notes += [f"<collision> mesh not read: {why}" for why in bodies.unread]
    if bodies.shaped:
        at = FLU_TO_FRD @ (0.5 * (bodies.low + bodies.high))
        return bodies.high - bodies.low, at, f"{path.name}: <collision> shapes"
    volume = water.volume or bodies.m / (water.rho or RHO)
    side = float((6.0 * volume / np.pi) ** (1.0 / 3.0))
    lacking = "no <box>, no <collision> box, cylinder, sphere or mesh"
    if bodies.unread:
        lacking = "a <collision> mesh was not read; `uuvsim models import MESH.stl` measures one"
    notes.append(
        f"no size is in the file ({lacking}): assumed: a sphere of {side:.3g} m, of its volume"
    )
    return np.full(3, side), r_g, "estimated: sphere of the volume"


def _inertia_and_buoyancy(
    path: Path, bodies: Bodies, water: Water, notes: list[str]
) -> Iterator[tuple[str, float, str]]:
    """Yield mass, inertia, volume and centres in FRD, each with its source."""
    source = f"{path.name}: <inertial>"
    yield "m", bodies.m, source
    r_g = FLU_TO_FRD @ bodies.r_g
    yield from _centre("g", r_g, f"{source}, FLU turned to FRD")
    I_g = FLU_TO_FRD @ bodies.I_g @ FLU_TO_FRD
    for i in range(3):
        for j in range(i, 3):
            if i == j or abs(I_g[i, j]) > 1e-12 * abs(I_g).max():
                yield f"I_g_{i + 1}{j + 1}", float(I_g[i, j]), f"{source}, FLU turned to FRD"
    rho = water.rho if water.rho is not None else RHO
    source = f"{path.name}: {water.source}"
    yield "rho", rho, source if water.rho is not None else "sea water"
    volume, r_b, how = water.volume, water.r_b, f"{source}, FLU turned to FRD"
    if water.neutral:
        volume, words = bodies.m / rho, f"{source}: neutrally buoyant"
    elif volume is not None:
        words = source
    elif bodies.shaped:
        volume, words = bodies.volume, f"{path.name}: volume of the <collision> shapes"
        r_b, how = FLU_TO_FRD @ bodies.moment / bodies.volume, f"{words}, FLU turned to FRD"
    else:
        volume, words = bodies.m / rho, "estimated: assumption, neutrally buoyant"
        what = "of all <collision> shapes is known" if bodies.unread else "is in the file"
        notes.append(f"no volume {what}: assumed neutrally buoyant")
    yield "nabla", float(volume), words
    yield "g", G, "standard gravity, three digits"
    if r_b is None:
        r_b, how = r_g, "estimated: assumption, at the centre of gravity"
    yield from _centre("b", r_b, how)


def _centre(name: str, r: Array, source: str) -> Iterator[tuple[str, float, str]]:
    for axis, value in zip("xyz", r, strict=True):
        if abs(value) > 1e-12:
            yield f"{axis}_{name}", float(value), source


def _hydrodynamics(path: Path, water: Water, size: Array) -> Iterator[tuple[str, float, str]]:
    """Yield added mass and damping, each with its source; estimates for a box without them."""
    source = f"{path.name}: {water.source}"
    rho = water.rho if water.rho is not None else RHO
    l, b, h = (float(s) for s in size)  # noqa: E741
    M_A, source_M = water.matrices.get("M_A"), source
    if M_A is None:
        source_M = "estimated: Lamb's ellipsoid within the size"
        M_A = np.diag(np.array(added_mass(l / 2, b / 2, h / 2, rho), dtype=float))
    damping = {k: (v, source) for k, v in water.matrices.items() if k != "M_A"}
    if not any(np.any(v) for v, _ in damping.values()):
        # Faces of the box, and strips of them where it turns.
        faces = [b * h, l * h, l * b]
        turns = [l * (b**4 + h**4) / 32, b * (l**4 + h**4) / 32, h * (l**4 + b**4) / 32]
        D_q = 0.5 * rho * 1.05 * np.array(faces + turns)
        low = "estimated: as D_q gives at 0.1 m/s or 0.5 rad/s"
        damping = {
            "D_l": (np.diag(D_q * ([0.1] * 3 + [0.5] * 3)), low),
            "D_q": (np.diag(D_q), "estimated: C_D = 1.05 of the faces of the size, by strips"),
        }
    symmetric = np.allclose(M_A, M_A.T)
    for i in range(6):
        for j in range(i if symmetric else 0, 6):
            if M_A[i, j]:
                yield f"M_A_{i + 1}{j + 1}", float(M_A[i, j]), source_M
    for name in ("D_l", "D_q", "D_u"):
        if name in damping:
            matrix, how = damping[name]
            for i, j in zip(*np.nonzero(matrix), strict=True):
                yield f"{name}_{i + 1}{j + 1}", float(matrix[i, j]), how


def _thrusters(path: Path, notes: list[str]) -> tuple[tuple[PlacedThruster, ...], str]:
    """Read the thruster allocation matrix (6 x n, FLU) of a thruster manager near the file."""
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    places = [path.parent, path.parent / "config", path.parent.parent / "config"]
    for place in places:
        for file in sorted(place.glob("*.y*ml")) if place.is_dir() else []:
            if not any(w in file.stem.lower() for w in ("tam", "thruster")):
                continue
            try:
                data = YAML(typ="safe", pure=True).load(file.read_text(encoding="utf-8"))
            except (OSError, UnicodeDecodeError, YAMLError) as error:
                raise InputInvalid(f"{file}: cannot be read as YAML: {error}") from None
            if isinstance(data, dict) and isinstance(data.get("thruster_manager"), dict):
                data = data["thruster_manager"]
            tam = data.get("tam") if isinstance(data, dict) else None
            if tam is None:
                continue
            notes.append(f"thrusters by the lines of force of {file.name}, in FLU turned to FRD")
            try:
                T = np.array(tam, dtype=float)
            except (TypeError, ValueError):
                T = np.zeros(0)
            if T.ndim != 2 or T.shape[0] != 6 or not np.isfinite(T).all():
                raise InputInvalid(
                    file, f"tam of shape {T.shape}", "6 rows of numbers, a column each thruster"
                )
            placed = []
            for k, column in enumerate(T.T):
                strength = float(np.linalg.norm(column[:3]))
                if not strength > 1e-9:
                    raise InputInvalid(file, f"tam: column {k + 1} pushes nowhere", "a direction")
                e, moment = column[:3] / strength, column[3:] / strength
                r = np.cross(e, moment)  # the point of its line that is nearest to CO
                r, e = FLU_TO_FRD @ r, FLU_TO_FRD @ e
                placed.append(PlacedThruster(f"thruster {k}", r.tolist(), e.tolist()))
            return tuple(placed), f"{file.name}: thruster allocation matrix"
    return (), ""


_README = """\
Imported from `{file}` ({what}). Body FRD: FLU of the file turned (y and z change their sign),
damping positive for a brake.

## Notes of the import
{notes}
## Validity
The numbers of the file state no source: write the source beside each number.
"""
