"""The ModelStructure of a model description: which unknown depends on which known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal
from xml.etree.ElementTree import Element, SubElement

from uuvsim_cosim.fmus.codegen.dependencies import (
    KINDS,
    derivative_knowns,
    direct_kinds,
    initial_knowns,
)
from uuvsim_cosim.fmus.codegen.equations import Equations

__all__ = ["FmiVersion", "Places", "model_structure"]

FmiVersion = Literal[2, 3]


@dataclass(frozen=True)
class Places:
    """References in XML to offsets of the block: by index (FMI 2) or value reference (FMI 3)."""

    reference: Callable[[int], str | None]  # None: the variable is not exposed
    outputs: list[tuple[str, range]]  # reference and elements of each output
    states: list[tuple[str, range]]  # and of each continuous state
    derivatives: list[tuple[str, range]]  # the same elements, as references to derivatives


def model_structure(root: Element, fmi: FmiVersion, eq: Equations, places: Places) -> None:
    """Add the element ModelStructure to `root`."""
    structure = SubElement(root, "ModelStructure")
    direct = direct_kinds(eq)
    first = eq.layout.offset["output"]
    of_rates: list[dict[int, str]] = [dict.fromkeys(k, "dependent") for k in derivative_knowns(eq)]
    by_row = [
        ("Output", [(name, [direct[r - first] for r in rows]) for name, rows in places.outputs]),
        (
            "ContinuousStateDerivative",
            [(name, [of_rates[r] for r in rows]) for name, rows in places.derivatives],
        ),
    ]
    for tag, unknowns in by_row:
        parent = structure
        if fmi == 2 and unknowns:
            parent = SubElement(structure, "Outputs" if tag == "Output" else "Derivatives")
        for name, found in unknowns:
            kinds: dict[str, str] = {}
            for place, kind in (item for row in found for item in row.items()):
                known = places.reference(place)
                if known is not None:
                    kinds[known] = max(kinds.get(known, kind), kind, key=KINDS.index)
            attributes = {
                "index" if fmi == 2 else "valueReference": name,
                "dependencies": " ".join(kinds),
                "dependenciesKind": " ".join(kinds.values()),
            }
            SubElement(parent, "Unknown" if fmi == 2 else tag, attributes)
    _initial_unknowns(structure, fmi, eq, places)


def _initial_unknowns(structure: Element, fmi: FmiVersion, eq: Equations, places: Places) -> None:
    unknowns: list[tuple[str, list[str]]] = []
    for listed, rows in (
        (places.outputs, dict(enumerate(initial_knowns(eq), eq.layout.offset["output"]))),
        (places.states, dict(enumerate(initial_knowns(eq, "initial")))),
        (places.derivatives, dict(enumerate(initial_knowns(eq, "rhs")))),
    ):
        for name, elements in listed:
            found = {places.reference(place) for row in elements for place in rows[row]}
            unknowns.append((name, sorted((k for k in found if k is not None), key=int)))
    parent = structure
    if fmi == 2:
        unknowns.sort(key=lambda u: int(u[0]))  # FMI 2.0 requires this order
        parent = SubElement(structure, "InitialUnknowns") if unknowns else structure
    for name, knowns in unknowns:
        SubElement(
            parent,
            "Unknown" if fmi == 2 else "InitialUnknown",
            {
                "index" if fmi == 2 else "valueReference": name,
                "dependencies": " ".join(knowns),
            },
        )
