"""Materials that a sonar distinguishes: their backscatter over grazing angle, and which is where.

`strength_table` is what an acoustic model reads: a row of cross sections for each material.
`scene_materials` finds the material of each node of a seabed, of each solid and of each mesh.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid, Problem
from uuvsim_cosim.models.acoustics.backscatter import (
    APL_UW_RANGES,
    Sediment,
    apl_uw,
    grain_size,
    lambert,
)
from uuvsim_cosim.models.acoustics.reflection import rayleigh
from uuvsim_cosim.models.declaration.files_read import shared_until_changed
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.models.declaration.parameter_files import read_yaml
from uuvsim_cosim.models.worlds.scene import Scene

__all__ = [
    "GRAZING",
    "LAWS",
    "Material",
    "SceneMaterials",
    "StrengthTable",
    "material",
    "materials",
    "reflection_table",
    "scene_materials",
    "strength_table",
]

Array = NDArray[np.float64]

GRAZING = np.linspace(0.0, pi / 2, 91)  # rad: grazing angles of a table, one degree apart
LAWS = ("auto", "apl_uw", "lambert")
WATER = 1000.0  # kg/m3, density in the reflection coefficient of a solid
_FITTED = slice(10, 61)  # degrees at which Lambert's law replaces a sediment
_SIX = ("rho", "nu", "delta", "sigma_2", "w_2", "gamma")


@dataclass(frozen=True)
class Material:
    """A material with the inputs of its law: a sediment, or a reflection coefficient."""

    name: str
    description: str
    sediment: Sediment | None  # of the law apl_uw
    impedance: float  # kg/(m2 s), of the law lambert; infinite: rigid
    c: float  # m/s, speed of sound in it, of the law lambert
    sources: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class StrengthTable:
    """Cross sections sigma (materials, angles) at the grazing angles `GRAZING`.

    sigma is per unit area and unit solid angle; the backscattering strength is 10 log10 sigma.
    `assumptions` are sentences for the user: what was assumed beyond the published formula.
    """

    names: tuple[str, ...]
    sigma: Array
    assumptions: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class SceneMaterials:
    """The materials of a scene, each an index into `names`."""

    names: tuple[str, ...]
    terrain: NDArray[np.uint8]  # shaped as the terrain's z; (0, 0) without terrain
    solids: NDArray[np.uint8]  # of each solid, in the scene's order
    meshes: NDArray[np.uint8]  # of each mesh, in the scene's order
    assumptions: tuple[str, ...]


@shared_until_changed
def materials() -> Mapping[str, Material]:
    """Read ``models/materials.yaml``."""
    data = read_yaml(content("models", "materials.yaml"), "materials.schema.json")
    return {str(name): _read(str(name), given) for name, given in data["materials"].items()}


def material(name: str) -> Material:
    """Return a material; raises `InputInvalid` with the known ones for another name."""
    known = materials()
    if name not in known:
        raise InputInvalid(f"material {name!r}", "there is none", expected_names(name, known))
    return known[name]


def strength_table(
    names: Iterable[str], frequency: float, c: float = 1500.0, law: str = "auto"
) -> StrengthTable:
    """Return the backscatter of materials at a frequency [Hz], with the speed of sound c [m/s].

    `law` "apl_uw" computes sediments by APL-UW TR 9407 and is refused outside of 10 to 100 kHz.
    "lambert" replaces each sediment by Lambert's law, with the mu that has the same mean level
    from 10 to 60 degrees at the nearest frequency of that range, at most 1/pi; then no frequency
    is refused.
    "auto" is the first inside of 10 to 100 kHz and the second outside. Solids follow Lambert's law.

    Example: levels [dB] of mud and steel at 30 degrees and 40 kHz.

    >>> import numpy as np
    >>> from uuvsim_cosim.models.acoustics.materials import strength_table
    >>> table = strength_table(["mud", "steel"], 40e3)
    >>> (10 * np.log10(table.sigma[:, 30])).round(1).tolist()
    [-29.9, -11.5]
    """
    if law not in LAWS:
        raise InputInvalid(f"law {law!r}", f"one of {', '.join(LAWS)}")
    if not 0.0 < frequency < np.inf:
        raise InputInvalid("sonar", f"frequency {frequency:g} Hz", "above 0")
    names = tuple(names)
    found = [material(name) for name in names]
    valid = APL_UW_RANGES["frequency"]
    nearest = min(max(frequency, valid.low), valid.high)
    inside = nearest == frequency
    fitted = law == "lambert" or (law == "auto" and not inside)
    rows, assumptions = [], []
    for m in found:
        if m.sediment is None:
            rows.append(lambert(GRAZING, _reflected(m.impedance, c) / pi))
        elif not fitted:
            rows.append(apl_uw(GRAZING, frequency, m.sediment, c))
        else:
            mu = _fitted_mu(apl_uw(GRAZING, nearest, m.sediment, c))
            rows.append(lambert(GRAZING, mu))
            assumptions.append(
                f"{m.name} at {frequency / 1e3:g} kHz: Lambert's law with 10 log10 mu = "
                f"{10 * np.log10(mu):.1f} dB, the mean level of APL-UW TR 9407 at "
                f"{nearest / 1e3:g} kHz, at most -5.0 dB"
            )
    sigma = np.array(rows).reshape(len(found), len(GRAZING))
    return StrengthTable(names, sigma, tuple(dict.fromkeys(assumptions)))


def reflection_table(
    names: Iterable[str], theta: Array, c: float = 1500.0
) -> NDArray[np.complex128]:
    """Return the reflection coefficients (materials, angles) at grazing angles `theta` [rad].

    A sediment has the density, speed of sound and loss of its law, another material its own density
    and speed, in water of the speed of sound `c` [m/s]. See `reflection.rayleigh`.
    """
    rows = []
    for m in map(material, names):
        if m.sediment is not None:
            rows.append(rayleigh(theta, m.sediment.rho, m.sediment.nu, m.sediment.delta))
        elif np.isinf(m.impedance):
            rows.append(rayleigh(theta, np.inf, 1.0))
        else:
            rows.append(rayleigh(theta, m.impedance / m.c / WATER, m.c / c))
    return np.array(rows).reshape(len(rows), len(theta))


def scene_materials(scene: Scene, seabed: str = "", solid: str = "") -> SceneMaterials:
    """Return the materials of a scene's nodes, solids and meshes.

    `seabed` is the material where the nature of the seabed is unknown, `solid` that of solids and
    meshes that state none. Raises `InputInvalid` for a material that is not known, and where one
    of the two is needed and not given.
    """
    problems: list[Problem] = []
    assumptions: list[str] = []
    names: list[str] = []

    def index(name: str, place: str) -> int:
        try:
            material(name)
        except InputInvalid as error:
            problems.append(error.at(place, ""))
        if name not in names:
            names.append(name)
        return names.index(name)

    def default(name: str, option: str, what: str) -> str:
        if name:
            assumptions.append(f"{what}: {name} (option {option})")
            return name
        expected = f"{option}=NAME, one of {', '.join(materials())}"
        problems.append(
            Problem(f"scene {scene.name}", f"no material is stated for {what}", expected)
        )
        return next(iter(materials()))

    terrain = np.zeros((0, 0), np.uint8)
    if scene.terrain is not None:
        known = scene.terrain.materials if scene.terrain.material is not None else ()
        layer = np.zeros(scene.terrain.z.shape, np.uint8)
        if scene.terrain.material is not None:
            layer = scene.terrain.material
        terrain = np.zeros_like(layer)
        for k in np.unique(layer).tolist():
            name = known[k] if k < len(known) else "unknown"
            share = np.mean(layer == k)
            if name == "unknown":
                name = default(seabed, "seabed", f"{share:.0%} of the seabed")
            terrain[layer == k] = index(name, f"scene {scene.name}: seabed")
    bare = sum(not o.material for o in (*scene.obstacles, *scene.meshes))
    usual = default(solid, "solid", f"{bare} solids and meshes") if bare else ""
    of_solids, of_meshes = (
        np.array([index(o.material or usual, f"scene {scene.name}: {o.name}") for o in each], "u1")
        for each in (scene.obstacles, scene.meshes)
    )
    if problems:
        raise InputInvalid.of(dict.fromkeys(problems))
    return SceneMaterials(tuple(names), terrain, of_solids, of_meshes, tuple(assumptions))


def _read(name: str, given: Mapping[str, Mapping[str, object]]) -> Material:
    numbers = {key: float(v["value"]) for key, v in given.items() if isinstance(v, Mapping)}  # type: ignore[arg-type]
    sources = tuple(str(v["source"]) for v in given.values() if isinstance(v, Mapping))
    sediment, impedance = None, np.inf
    if "M_z" in numbers:
        sediment = grain_size(numbers["M_z"])
    elif "rho" in numbers:
        sediment = Sediment(*(numbers[key] for key in _SIX))
    elif "density" in numbers:
        impedance = numbers["density"] * numbers["c"]
    speed = numbers.get("c", np.inf)
    return Material(name, str(given["description"]), sediment, impedance, speed, sources)


def _reflected(impedance: float, c: float) -> float:
    """Return |R|², the share of the energy that a surface reflects at normal incidence."""
    water = WATER * c / impedance
    return ((1.0 - water) / (1.0 + water)) ** 2


def _fitted_mu(sigma: Array) -> float:
    """Return the mu of Lambert's law with the same mean level [dB], at most 1/pi.

    With more than 1/pi, the surface would scatter more energy than it receives.
    """
    mu = float(np.exp(np.mean(np.log(sigma[_FITTED] / lambert(GRAZING[_FITTED], 1.0)))))
    return min(mu, 1.0 / pi)
