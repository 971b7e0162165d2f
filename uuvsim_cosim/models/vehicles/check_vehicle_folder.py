"""Reader of a vehicle's folder: all files are read, and all mistakes are reported at once.

A component reads only the files that it needs; a check of a vehicle reports mistakes in all.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.actuators.fins import fins, read_fins
from uuvsim_cosim.models.actuators.propeller import read_propeller
from uuvsim_cosim.models.actuators.thruster_geometry import read_thrusters
from uuvsim_cosim.models.declaration.hull_parameters import meaning_of, near_names
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.models.declaration.parameter_files import (
    in_unit,
    line_of,
    read_yaml,
    vehicle_file,
    vehicle_folder,
)
from uuvsim_cosim.models.hull.ballast import read_ballast
from uuvsim_cosim.models.shapes.hull_shape import read_hull_shape
from uuvsim_cosim.models.shapes.volumes import vehicle_volumes

__all__ = ["read_folder"]


def read_folder(vehicle: str) -> None:
    """Read every file of a vehicle's folder; raises ParameterInvalid with all mistakes of all."""
    if vehicle.endswith((".yaml", ".yml")):  # a file by itself has no folder
        vehicle_file(vehicle)
        return
    folder = vehicle_folder(vehicle)
    problems = [
        f"{path}: not a file of a vehicle, nothing reads it; "
        f"expected {expected_names(path.name, _READERS)}"
        for path in sorted(folder.iterdir())
        if path.suffix in (".yaml", ".yml") and path.name not in _READERS
    ]
    own = folder.resolve().name
    for path, read in ((folder / name, read) for name, read in _READERS.items()):
        if not path.is_file():
            continue
        try:
            read(folder)
        except ParameterInvalid as error:
            problems += map(str, error.problems)
            continue
        for n, text in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            found = re.match(r"(id|vehicle):\s*([^#]*)", text)
            owner = found[2].strip().strip("'\"") if found else own
            if found and owner != own:
                problem = f"{found[1]}: {owner!r}; expected {own!r}, the folder's name"
                problems.append(f"{path}:{n}: {problem}")
    if problems:
        raise ParameterInvalid.of(dict.fromkeys(problems))


def _hull(folder: Path) -> None:
    _, data = vehicle_file(str(folder / "parameters.yaml"))
    if "volumes" in data:
        vehicle_volumes(str(folder / "parameters.yaml"))


def _control(folder: Path) -> None:
    read_yaml(folder / "control.yaml", "control.schema.json")
    if (folder / "fins.yaml").is_file():
        fins(str(folder), form="derivatives")


def _intervals(data: Any) -> Iterator[tuple[int, str]]:
    for name, entries in data["parameters"].items():
        meaning = meaning_of(str(name))
        if meaning is None:
            line = line_of(data, ["parameters", name])
            yield line, f"{name}: not a parameter of a hull; expected {near_names(str(name))}"
            continue
        for i, entry in enumerate(entries):
            try:
                in_unit(float(entry["value"]), str(entry["unit"]), meaning.unit)
            except ValueError as error:
                yield line_of(data, ["parameters", name, i]), f"{name}: {error}"


_READERS: dict[str, Callable[[Path], object]] = {
    "parameters.yaml": _hull,
    "thrusters.yaml": lambda folder: read_thrusters(folder / "thrusters.yaml"),
    "propeller.yaml": lambda folder: read_propeller(folder / "propeller.yaml"),
    "fins.yaml": lambda folder: read_fins(folder / "fins.yaml"),
    "ballast.yaml": lambda folder: read_ballast(str(folder / "ballast.yaml")),
    "control.yaml": _control,
    "published.yaml": lambda folder: read_yaml(
        folder / "published.yaml", "published.schema.json", _intervals
    ),
    "shape.yaml": lambda folder: read_hull_shape(folder / "shape.yaml"),
    "speeds.yaml": lambda folder: read_yaml(folder / "speeds.yaml", "speeds.schema.json"),
    "checks.yaml": lambda folder: read_yaml(folder / "checks.yaml", "checks.schema.json"),
}
