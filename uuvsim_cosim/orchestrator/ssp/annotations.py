"""Annotations for communication steps: those of this project, of OSP and of OpenModelica.

================================  ======================================  ======================
annotation                        the system's step                       a component's step
================================  ======================================  ======================
``org.uuvsim.cosim``              ``<uuvsim:System tick="0.01">``          ``<uuvsim:Component
                                                                          step="0.02"/>``
``com.opensimulationplatform``    ``<osp:FixedStepAlgorithm                ``<osp:StepSizeHint
                                  baseStepSize="0.01"/>`` of the           value="0.02"/>``
                                  default experiment
``org.openmodelica``              ``<oms:FixedStepMaster                   (none)
                                  stepSize="0.01"/>`` of a system
================================  ======================================  ======================

The first of them that is present is used; a remark names the others if they differ. Only the first
contains groups: the other two do not define them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction
from xml.etree.ElementTree import Element as Xml
from xml.etree.ElementTree import SubElement

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.parameters.ssp_xml import (
    add_annotation,
    annotations_of,
    find_annotation,
    q,
)
from uuvsim_cosim.orchestrator.system.elements import Structure, step_text
from uuvsim_cosim.orchestrator.system.validation import as_step
from uuvsim_cosim.orchestrator.system.variable_step import (
    PowerBond,
    VariableStep,
    variable_step_of_text,
)
from uuvsim_cosim.orchestrator.values.xml_values import local_name

__all__ = [
    "add_component_step",
    "add_default_experiment",
    "add_system_step",
    "component_step",
    "step_for_others",
    "system_step",
    "variable_step_of",
    "variable_step_xml",
]

OSP = "com.opensimulationplatform"
OMS = "org.openmodelica"
_SAME = 1e-9  # relative; other tools round a step of 1/60 s


def add_default_experiment(
    root: Xml, step: Fraction, start_time: float, stop_time: float | None
) -> None:
    """Add the default experiment, with the step in the form of the Open Simulation Platform."""
    experiment = SubElement(root, "ssd:DefaultExperiment", startTime=repr(float(start_time)))
    if stop_time is not None:
        experiment.set("stopTime", repr(float(stop_time)))
    algorithm = SubElement(add_annotation(experiment, OSP), "osp:Algorithm")
    SubElement(algorithm, "osp:FixedStepAlgorithm", baseStepSize=_decimal(step))


def add_system_step(system: Xml, step: Fraction) -> None:
    """Add a system's step in OpenModelica's form."""
    notes = SubElement(add_annotation(system, OMS), "oms:Annotations")
    SubElement(
        SubElement(notes, "oms:SimulationInformation"),
        "oms:FixedStepMaster",
        description="oms-ma",
        stepSize=_decimal(step),
        absoluteTolerance="0.0001",
        relativeTolerance="0.0001",
    )


def add_component_step(component: Xml, step: Fraction) -> None:
    """Add a component's step in the form of the Open Simulation Platform."""
    SubElement(add_annotation(component, OSP), "osp:StepSizeHint", value=_decimal(step))


def system_step(root: Xml, system: Xml, remarks: list[str]) -> str | None:
    """Return a system's step; that of the document `root` counts for its outermost system."""
    note = find_annotation(system)
    found: list[tuple[str, str]] = []
    if (
        note is not None
        and note.get("tick")
        and next(_local(note, "VariableStep"), None) is not None
    ):
        return note.get("tick")  # the others have the length of its first step
    if note is not None and note.get("tick"):
        found.append(("org.uuvsim.cosim", note.get("tick", "")))
    outermost = root.find(q("ssd:System")) is system
    for item in annotations_of(root.find(q("ssd:DefaultExperiment")), OSP) if outermost else ():
        found += [(OSP, e.get("baseStepSize", "")) for e in _local(item, "FixedStepAlgorithm")]
    for item in annotations_of(system, OMS):
        found += [(OMS, e.get("stepSize", "")) for e in _local(item, "FixedStepMaster")]
        for e in _local(item, "VariableStepMaster"):
            given = e.get("initialStepSize", "")
            found.append((OMS, given))
            remarks.append(
                f"{OMS}: a variable step; its initial value, {given} s, is used for all steps"
            )
    return _agreed(found, f"system {system.get('name', '')!r}", remarks)


def step_for_others(system: Structure) -> Fraction:
    """Return the step that other tools are told: of a variable step, the length of the first."""
    varied = system.variable_step
    return system.base_step if varied is None else varied.beginning


def variable_step_xml(step: VariableStep) -> Xml:
    """Write a variable step, with its power bonds and the tolerances of connections."""
    xml = Xml("uuvsim:VariableStep", settings=step.text())
    for bond in step.bonds:
        ends = zip(
            ("input", "output", "otherInput", "otherOutput"), bond.first + bond.second, strict=True
        )
        SubElement(xml, "uuvsim:PowerBond", {"name": bond.name, **dict(ends)})
    for name, absolute, relative in step.tolerances:
        SubElement(
            xml, "uuvsim:Tolerance", input=name, absolute=repr(absolute), relative=repr(relative)
        )
    return xml


def variable_step_of(note: Xml) -> VariableStep | None:
    """Read what `variable_step_xml` wrote, from the annotation of a system; raises InputInvalid."""
    xml = next(_local(note, "VariableStep"), None)
    if xml is None:
        return None
    bonds = [
        PowerBond(
            b.get("name", ""),
            (b.get("input", ""), b.get("output", "")),
            (b.get("otherInput", ""), b.get("otherOutput", "")),
        )
        for b in _local(xml, "PowerBond")
    ]
    tolerances = [
        (t.get("input", ""), _number(t, "absolute"), _number(t, "relative"))
        for t in _local(xml, "Tolerance")
    ]
    step, _ = variable_step_of_text(xml.get("settings", ""))
    return replace(step, bonds=tuple(bonds), tolerances=tuple(tolerances))


def _number(xml: Xml, name: str) -> float:
    try:
        return float(xml.get(name, ""))
    except ValueError:
        place = f"variable step, tolerance of {xml.get('input', '')!r}"
        raise InputInvalid(place, f"{name}={xml.get(name)!r}", "a number") from None


def component_step(component: Xml, tick: Fraction, remarks: list[str]) -> str | None:
    """Return a component's step; OSP's hint is rounded to whole ticks, as libcosim does."""
    note = find_annotation(component)
    place = f"component {component.get('name', '')!r}"
    found: list[tuple[str, str]] = []
    if note is not None and note.get("step"):
        found.append(("org.uuvsim.cosim", note.get("step", "")))
    for item in annotations_of(component, OSP):
        for hint in _local(item, "StepSizeHint"):
            text = hint.get("value", "")
            step = _step(text, f"{place}, {OSP}")
            rounded = max(round(step / tick), 1) * tick
            if abs(step - rounded) > _SAME * step:
                remarks.append(
                    f"{place}: {OSP} hints at a step of {text} s, no multiple of "
                    f"{step_text(tick)} s: {step_text(rounded)} s is used, as in libcosim"
                )
            found.append((OSP, step_text(rounded)))
    return _agreed(found, place, remarks)


def _agreed(found: list[tuple[str, str]], place: str, remarks: list[str]) -> str | None:
    """Return the first step, and add a remark for each that differs from it."""
    steps = [(tool, text, _step(text, f"{place}, {tool}")) for tool, text in found]
    for tool, text, step in steps[1:]:
        first, first_text, used = steps[0]
        if abs(step - used) > _SAME * used:
            remarks.append(
                f"{place}: {first} states a step of {first_text} s and {tool} one of {text} s; "
                f"{first_text} s is used"
            )
    return steps[0][1] if steps else None


def _step(text: str, place: str) -> Fraction:
    step = as_step(text, place)
    if step > 10**6 or step < Fraction(1, 10**12):
        raise InputInvalid(place, f"step {text!r}", "between 1e-12 s and 1e6 s")
    return step


def _local(parent: Xml, name: str) -> Iterator[Xml]:
    """Yield the elements inside of this name, in any namespace and at any depth."""
    for item in parent.iter():
        if local_name(item) == name:
            yield item


def _decimal(step: Fraction) -> str:
    text = step_text(step)
    return format(Decimal(repr(float(step))), "f") if "/" in text else text
