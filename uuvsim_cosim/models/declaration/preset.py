"""Presets: figures of a shipped instrument or controller, models/<folder>/<id>/<kind>.yaml."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from inspect import signature
from pathlib import Path

import casadi as ca

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import ParameterInvalid, Problem
from uuvsim_cosim.models.declaration.files_read import shared_until_changed
from uuvsim_cosim.models.declaration.library import LIBRARY
from uuvsim_cosim.models.declaration.model import Model, Units
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.models.declaration.parameter_files import in_unit, line_of, read_yaml

__all__ = ["Preset", "preset", "presets_of"]

FOLDERS = ("sensors", "controllers")


@dataclass(frozen=True)
class Preset:
    """The numbers of one file; `number` and `vector` convert to the unit that is wanted."""

    path: Path
    values: Mapping[str, tuple[list[float], list[str], int]]  # name: (elements, units, line)
    vehicle: str = ""  # id@set, of the vehicle for which alone the numbers hold
    asked: set[str] = field(default_factory=set)  # names that a declaration has read

    def vector(self, name: str, unit: Units, size: int | None = None) -> list[float]:
        """Return a parameter's elements in `unit`, one for all or one each.

        A single element is repeated `size` times.
        """
        self.asked.add(name)
        if name not in self.values:
            units = unit if isinstance(unit, str) else ", ".join(dict.fromkeys(unit))
            shipped = {*self.path.parts[-3:-2]} & {*FOLDERS}
            same = self.path.parent.parent.glob(f"*/{self.path.name}") if shipped else ()
            others = [
                path.parent.name
                for path in sorted(same)
                if path != self.path and f"\n  {name}:" in path.read_text(encoding="utf-8")
            ]
            raise ParameterInvalid(
                f"{self.path}: no parameter {name!r}; expected one in {units}"
                + (f", as the preset {' or '.join(others)} has" if others else "")
            )
        elements, read, line = self.values[name]
        try:
            given = read * len(elements) if len(read) == 1 else read
            wanted = [unit] * len(elements) if isinstance(unit, str) else list(unit)
            if len(given) != len(elements) or len(wanted) != len(elements):
                raise ValueError(f"{len(elements)} elements with {len(given)} units")
            converted = [in_unit(*v) for v in zip(elements, given, wanted, strict=True)]
        except ValueError as error:
            raise ParameterInvalid(f"{self.path}:{line}: {name}: {error}") from None
        if size is not None and len(converted) == 1:
            converted *= size
        if size is not None and len(converted) != size:
            raise ParameterInvalid(
                f"{self.path}:{line}", f"{name} has {len(converted)} elements", size
            )
        return converted

    def number(self, name: str, unit: str) -> float:
        """Return a parameter that is a single number."""
        return self.vector(name, unit, 1)[0]

    def parameter(
        self,
        m: Model,
        name: str,
        unit: Units,
        description: str,
        size: int | None = None,
        *,
        min: float | None = None,
        max: float | None = None,
    ) -> ca.SX:
        """Declare a parameter of a model with the file's value: a number, or `size` elements."""
        elements = self.vector(name, unit, size or 1)
        value = elements if size else elements[0]
        if self.vehicle:
            m.made_for[f"gains of {self.path.parent.name}"] = self.vehicle
        return m.parameter(name, value, unit=unit, min=min, max=max, description=description)

    def parameters(
        self, m: Model, table: Mapping[str, tuple[str, str]], min: float = 0
    ) -> dict[str, ca.SX]:
        """Declare numbers of the file as parameters of a model; table: {name: (unit, meaning)}."""
        return {name: self.parameter(m, name, *about, min=min) for name, about in table.items()}

    def has(self, name: str) -> bool:
        """Return whether a parameter that a declaration can do without is there."""
        self.asked.add(name)
        return name in self.values

    def complete(self, optional: Collection[str] = ()) -> None:
        """Refuse parameters that the declaration does not know, each with its line.

        `optional` are those that only other options of the declaration ask for.
        """
        self.asked.update(optional)
        unknown = [
            Problem(
                f"{self.path}:{line}: {name}",
                "not a parameter of this kind",
                expected_names(name, sorted(self.asked)),
            )
            for name, (_, _, line) in self.values.items()
            if name not in self.asked
        ]
        if unknown:
            raise ParameterInvalid.of(unknown)


def presets_of(component: str) -> dict[str, str]:
    """Return the shipped presets of a component, id: what it is.

    Controllers share one kind of file; to each belong the presets that have its default's figures.
    """
    kind, own = component, None
    if component in LIBRARY:
        module, function = LIBRARY[component].split(":")
        id = signature(getattr(import_module(module), function)).parameters.get("id")
        own = id.default if id is not None and isinstance(id.default, str) else None
    if own is not None:
        kind = next((f.stem for f in content("models", "controllers", own).glob("*.yaml")), kind)
    files = sorted(content("models").glob(f"*/*/{kind}.yaml"))
    read = {
        f.parent.name: read_yaml(f, "preset.schema.json") for f in files if f.parts[-3] in FOLDERS
    }
    like = set(read[own]["parameters"]) if own in read else None
    return {
        id: str(data["description"])
        for id, data in read.items()
        if like is None or kind != "controller" or set(data["parameters"]) == like
    }


@shared_until_changed
def preset(folder: str, id: str, kind: str) -> Preset:
    """Read one preset, or the file named by an id that ends in .yaml."""
    is_file = id.endswith((".yaml", ".yml"))
    path = Path(id) if is_file else content("models", folder, id, f"{kind}.yaml")
    if not path.is_file():
        known = sorted(p.parent.name for p in content("models", folder).glob(f"*/{kind}.yaml"))
        raise ParameterInvalid(
            f"there is no {kind} {id!r}", f"{', '.join(known)}, or the path of a file (.yaml)"
        )
    data = read_yaml(path, "preset.schema.json")
    if data["kind"] != kind:
        line = line_of(data, ["kind"])
        raise ParameterInvalid(f"{path}:{line}", f"kind: {data['kind']}", kind)
    values = {}
    for name, entry in data["parameters"].items():
        value = entry["value"]
        elements = [float(v) for v in value] if isinstance(value, list) else [float(value)]
        line = line_of(data, ["parameters", name])
        unit = entry["unit"]
        units = [str(u) for u in unit] if isinstance(unit, list) else [str(unit)]
        values[str(name)] = (elements, units, line)
    return Preset(path, values, str(data.get("vehicle", "")))
