"""Reader of EccoConfiguration: the variable step that libcosim chooses by power bonds."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from xml.etree.ElementTree import Element as Xml

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.osp.xml import Reading, children
from uuvsim_cosim.orchestrator.system.variable_step import PowerBond, VariableStep
from uuvsim_cosim.orchestrator.values.xml_values import local_name

__all__ = ["NANOSECOND", "read_ecco"]

NANOSECOND = Fraction(1, 10**9)  # libcosim counts time in whole ones
_LENGTHS = {"StepSize": "first", "MinimumStepSize": "smallest", "MaximumStepSize": "largest"}
_NUMBERS = {
    "SafetyFactor": "safety", "MinimumChangeRate": "slowest", "MaximumChangeRate": "fastest",
    "ProportionalGain": "proportional", "IntegralGain": "integral",
    "RelativeTolerance": "relative", "AbsoluteTolerance": "absolute",
}  # fmt: skip


def read_ecco(root: Xml, bonds: Sequence[PowerBond], reading: Reading) -> VariableStep | None:
    """Read the variable step of a file; None, with a remark, if it leaves the step as it is."""
    xml = next(children(root, "EccoConfiguration"), None)
    if xml is None:
        reading.remark("Algorithm ecco has no EccoConfiguration")
        return None
    if not bonds:
        reading.remark("Algorithm ecco has no power bond, so that nothing varies its step")
        return None
    place = "<EccoConfiguration>"
    read: dict[str, Fraction | float] = {}
    for item in children(xml):
        tag = local_name(item)
        if reading.known(tag, [*_LENGTHS, *_NUMBERS], place, "setting"):
            number = reading.number((item.text or "").strip(), f"<{tag}>", "value", 0.0)
            if tag in _LENGTHS:
                read[_LENGTHS[tag]] = int(number * 1e9) * NANOSECOND  # rounded as libcosim does
            else:
                read[_NUMBERS[tag]] = number
    missing = [t for t, name in (_LENGTHS | _NUMBERS).items() if name not in read]
    if missing:
        reading.wrong(place, f"no {', '.join(missing)}", "all settings of ecco, as libcosim needs")
        return None
    try:
        return VariableStep(
            **read,  # type: ignore[arg-type]  # lengths are Fractions, numbers are floats
            rollback=False, estimate="bonds", bonds=tuple(bonds),
        )  # fmt: skip
    except InputInvalid as error:
        problem = error.at(place, "")
        reading.wrong(place, problem.read, problem.expected)
        return None
