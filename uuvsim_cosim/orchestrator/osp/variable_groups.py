"""Variable groups (OspModelDescription.xml): names for several variables of one model."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element as Xml

from uuvsim_cosim.orchestrator.osp.xml import Reading, children, opened
from uuvsim_cosim.orchestrator.values.xml_values import local_name

__all__ = ["VariableGroup", "find_model_description", "pairs", "read_variable_groups"]


@dataclass(frozen=True)
class VariableGroup:
    """A group of variables, in order, and of groups inside it."""

    name: str
    tag: str
    variables: tuple[str, ...]
    groups: tuple[VariableGroup, ...]

    def find(self, name: str) -> VariableGroup | None:
        """Find a group of this name, itself or inside."""
        if self.name == name:
            return self
        return next((g for inner in self.groups if (g := inner.find(name))), None)

    def listed(self) -> list[str]:
        """List its variables and those of its groups."""
        return [*self.variables, *(v for g in self.groups for v in g.listed())]


def find_model_description(fmu: Path, model_name: str, beside: Path) -> Path | None:
    """Find the file of a model's groups: near the FMU, else near the system's file."""
    stems = (model_name, model_name.replace(".", "_"), fmu.stem)
    for folder in (fmu.parent, beside):
        for stem in dict.fromkeys(stems):
            path = folder / f"{Path(stem).name}_OspModelDescription.xml"
            if path.is_file():
                return path
    return None


def read_variable_groups(path: Path, reading: Reading) -> tuple[VariableGroup, ...]:
    """Read the groups of a model; their units are ignored (see docs/systems/ssp_support.md)."""
    root = opened(path, "OspModelDescription")
    inner = Reading(path.name, reading.problems, reading.remarks)
    return tuple(
        _group(item, inner)
        for section in children(root, "VariableGroups")
        for item in children(section)
    )


def _group(xml: Xml, reading: Reading) -> VariableGroup:
    tag = local_name(xml)
    name = reading.required(xml, "name", f"<{tag}>", "the name of the group")
    place = f"<{tag} name={name!r}>"
    variables = [
        reading.required(v, "ref", f"{place} <Variable>", "the name of a variable")
        for v in children(xml, "Variable")
    ]
    inner = [_group(g, reading) for g in children(xml) if local_name(g) not in ("Variable", "")]
    return VariableGroup(name, tag, tuple(variables), tuple(inner))


def pairs(
    a: VariableGroup, b: VariableGroup, place: str, reading: Reading
) -> list[tuple[str, str]]:
    """Join two groups variable by variable, in order; note a problem if their sizes differ."""
    for what, ours, theirs in (
        ("variable", len(a.variables), len(b.variables)),
        ("group", len(a.groups), len(b.groups)),
    ):
        if ours != theirs:
            read = f"{a.name!r} has {ours} {what}s and {b.name!r} has {theirs}"
            reading.wrong(place, read, f"groups of equally many {what}s, joined in order")
            return []
    found = list(zip(a.variables, b.variables, strict=True))
    for inner_a, inner_b in zip(a.groups, b.groups, strict=True):
        found += pairs(inner_a, inner_b, place, reading)
    return found
