"""Results of `check_fmu` in the XML of JUnit: a suite for each FMU, a case for each check."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.fmus.check.check_fmu import Look

__all__ = ["junit_report"]

_NOT_XML = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def junit_report(results: Sequence[tuple[Path, Sequence[Look] | UuvsimError]]) -> str:
    """Return the report; an FMU that could not be read has one case, `read`, with an error.

    A case has one failure for each finding, and is skipped if its check does not apply.
    """
    root = Element("testsuites", name="uuvsim fmu check")
    for path, looks in results:
        suite = SubElement(root, "testsuite", name=str(path))
        if isinstance(looks, UuvsimError):
            case = SubElement(suite, "testcase", name="read", classname=path.stem)
            SubElement(case, "error", message=_plain(str(looks)))
            continue
        cases: dict[str, Element] = {}
        for look in looks:
            if look.check not in cases:
                cases[look.check] = SubElement(
                    suite, "testcase", name=look.check, classname=path.stem
                )
            case = cases[look.check]
            if look.result == "finding":
                SubElement(case, "failure", message=_plain(look.text))
            elif look.result == "not applicable":
                SubElement(case, "skipped", message=_plain(look.text))
            elif look.text:
                SubElement(case, "system-out").text = _plain(look.text)
    for each in (root, *root.findall("testsuite")):
        cases_in = list(each.iter("testcase"))
        each.set("tests", str(len(cases_in)))
        for key, tag in (("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
            each.set(key, str(sum(c.find(tag) is not None for c in cases_in)))
    indent(root)
    return tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _plain(text: str) -> str:
    """Return a text without the characters that XML 1.0 does not allow."""
    return _NOT_XML.sub("?", text)
