"""Presets: figures of a shipped instrument or controller, models/<folder>/<id>/<kind>.yaml."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.parameters import in_unit, line_of, read_yaml

__all__ = ["Preset", "preset"]


@dataclass(frozen=True)
class Preset:
    """The numbers of one file; `number` and `vector` convert to the unit that is wanted."""

    path: Path
    values: Mapping[str, tuple[list[float], str, int]]  # name: (elements, unit, line)

    def vector(self, name: str, unit: str, size: int | None = None) -> list[float]:
        """Give a parameter's elements in `unit`; a single one is repeated `size` times."""
        if name not in self.values:
            raise ParameterInvalid(f"{self.path}: no parameter {name!r}; expected one in {unit}")
        elements, read, line = self.values[name]
        try:
            converted = [in_unit(v, read, unit) for v in elements]
        except ValueError as error:
            raise ParameterInvalid(f"{self.path}:{line}: {name}: {error}") from None
        if size is not None and len(converted) == 1:
            converted *= size
        if size is not None and len(converted) != size:
            raise ParameterInvalid(
                f"{self.path}:{line}: {name} has {len(converted)} elements; expected {size}"
            )
        return converted

    def number(self, name: str, unit: str) -> float:
        """Give a parameter that is a single number."""
        return self.vector(name, unit, 1)[0]


@lru_cache
def preset(folder: str, id: str, kind: str) -> Preset:
    """Read one preset, or the file named by an id that ends in .yaml."""
    is_file = id.endswith((".yaml", ".yml"))
    path = Path(id) if is_file else content("models", folder, id, f"{kind}.yaml")
    if not path.is_file():
        known = sorted(p.parent.name for p in content("models", folder).glob(f"*/{kind}.yaml"))
        raise ParameterInvalid(
            f"there is no {kind} {id!r}; expected {', '.join(known)}, or the path of a file (.yaml)"
        )
    data = read_yaml(path, "preset.schema.json")
    if data["kind"] != kind:
        line = line_of(data, ["kind"])
        raise ParameterInvalid(f"{path}:{line}: kind: {data['kind']}; expected {kind}")
    values = {}
    for name, entry in data["parameters"].items():
        value = entry["value"]
        elements = [float(v) for v in value] if isinstance(value, list) else [float(value)]
        line = line_of(data, ["parameters", name])
        values[str(name)] = (elements, str(entry["unit"]), line)
    return Preset(path, values)
