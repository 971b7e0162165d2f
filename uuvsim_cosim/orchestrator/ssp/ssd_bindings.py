"""Parameter bindings of an SSD: values of an element, with prefix and mapping."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from urllib.parse import unquote
from xml.etree.ElementTree import Element as Xml

from uuvsim_cosim.errors import InputInvalid, UuvsimError
from uuvsim_cosim.fmus.importer.archive import unpack
from uuvsim_cosim.models.declaration.units import Unit
from uuvsim_cosim.orchestrator.parameters.ssm import MappingEntry, read_mapping, read_ssm
from uuvsim_cosim.orchestrator.parameters.ssp_xml import MIME, q, read_units
from uuvsim_cosim.orchestrator.parameters.ssv import (
    Enumerations,
    ParameterValue,
    read_parameter_set,
    read_ssv,
)
from uuvsim_cosim.orchestrator.values.transformation import map_value
from uuvsim_cosim.orchestrator.values.values import Quantity

__all__ = ["Bindings"]

_MAPPING = "application/x-ssp-parameter-mapping"


@dataclass(frozen=True)
class Bindings:
    """Reader of a file's bindings; `confine` refuses files outside of an archive."""

    folder: Path
    units: Mapping[str, Unit]
    enumerations: Enumerations
    confine: Callable[[str, str], None]

    def read(
        self, xml: Xml, place: str, wrong: Callable[[UuvsimError], None]
    ) -> list[ParameterValue]:
        """Return the values of an element in the order of the file; later ones have priority."""
        found: list[ParameterValue] = []
        for binding in xml.iterfind(f"{q('ssd:ParameterBindings')}/{q('ssd:ParameterBinding')}"):
            try:
                found += self._binding(binding, xml, place)
            except UuvsimError as error:
                wrong(error)
        return found

    def _binding(self, binding: Xml, owner: Xml, place: str) -> list[ParameterValue]:
        """Return the values of one binding, with prefix, units and mapping; raises InputInvalid."""
        here = f"{place}: <ssd:ParameterBinding>"
        mime = binding.get("type", MIME["ssv"])
        if mime != MIME["ssv"]:
            raise InputInvalid(here, f"type {mime!r}", f"{MIME['ssv']!r}")
        source = binding.get("source")
        if source is not None:
            values, own = read_ssv(self._file(binding, source, owner, here))
        else:
            inline = binding.find(f"{q('ssd:ParameterValues')}/{q('ssv:ParameterSet')}")
            if inline is None:
                raise InputInvalid(here, "neither source nor values", "one of the two")
            values = read_parameter_set(inline, place, self.enumerations)
            own = read_units(inline, "ssv:Units", here)
        definitions = {**self.units, **own}
        prefix = binding.get("prefix", "")  # applied first: a mapping's sources contain it
        found: list[ParameterValue] = []
        for v in values:
            value, unit = v.value, v.unit
            if unit:
                # Some files write brackets around the names of units.
                if unit not in definitions and unit.startswith("[") and unit.endswith("]"):
                    unit = unit[1:-1]
                value = Quantity(value, unit, definitions)
            found.append(replace(v, name=f"{prefix}{v.name}", value=value))
        mapping = binding.find(q("ssd:ParameterMapping"))
        if mapping is None:
            return found
        # Values that the mapping does not name are dropped.
        here = f"{place}: <ssd:ParameterMapping>"
        mime = mapping.get("type", _MAPPING)
        if mime != _MAPPING:
            raise InputInvalid(here, f"type {mime!r}", f"{_MAPPING!r}")
        source = mapping.get("source")
        if source is not None:
            entries = read_ssm(self._file(mapping, source, owner, here))
        else:
            inline = mapping.find(q("ssm:ParameterMapping"))
            entries = [] if inline is None else read_mapping(inline, here)
        by_name = {v.name: v for v in found}
        return [_changed(by_name[e.source], e, here) for e in entries if e.source in by_name]

    def _file(self, xml: Xml, source: str, owner: Xml, place: str) -> Path:
        """Return the path of a source, beside the system file or inside the element's FMU."""
        base = xml.get("sourceBase", "SSD")
        name = unquote(source)
        if base == "SSD":
            self.confine(name, place)
            return self.folder / name
        fmu = unquote(owner.get("source", ""))
        if base != "component" or not fmu.lower().endswith(".fmu"):
            raise InputInvalid(place, f"sourceBase {base!r}", "'SSD', or 'component' inside an FMU")
        self.confine(fmu, place)
        inside = unpack(self.folder / fmu)
        path = (inside / name).resolve()
        if not path.is_relative_to(inside.resolve()):
            raise InputInvalid(place, f"source {source!r}", f"a file inside {fmu}")
        return path


def _changed(value: ParameterValue, entry: MappingEntry, place: str) -> ParameterValue:
    """Return a value with its target's name, transformed by the entry of a mapping."""
    given, change = value.value, entry.change
    if change.table:
        bare = given.value if isinstance(given, Quantity) else given
        given = map_value(change.table, bare, f"{place}: {entry.source}")
    elif change.scales or not change.convert:
        quantity = given if isinstance(given, Quantity) else Quantity(given, None)
        bare = quantity.value if isinstance(quantity.value, list) else [quantity.value]
        if change.scales and not all(
            isinstance(v, float | int) and not isinstance(v, bool) for v in bare
        ):
            raise InputInvalid(place, f"{entry.source} is {bare[0]!r}", "a number to transform")
        unit = quantity.unit if change.convert else None
        given = replace(quantity, unit=unit, factor=change.factor, offset=change.offset)
    return replace(value, name=entry.target, value=given)
