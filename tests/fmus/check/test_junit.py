"""Results of checks in the XML of JUnit, as CI servers count them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

from tests.conftest import Uuvsim
from uuvsim_cosim.errors import FmuError
from uuvsim_cosim.fmus.check.check_fmu import Look
from uuvsim_cosim.fmus.check.junit import junit_report
from uuvsim_cosim.fmus.export.fmu_file import build_fmu
from uuvsim_cosim.models.declaration.model import Model

LOOKS = [
    Look("rules", "finding", "no unit <m>"),
    Look("rules", "finding", "no start"),
    Look("run", "ok", "9 steps"),
    Look("state", "not applicable", "it has none"),
    Look("reset", "finding", "a control character \x1b[31m"),
]


def test_findings_errors_and_skipped_checks_are_counted_by_case() -> None:
    report = junit_report([(Path("a/plant.fmu"), LOOKS), (Path("b.fmu"), FmuError("broken"))])
    root = ElementTree.fromstring(report)
    counts = [root.get(k) for k in ("tests", "failures", "errors", "skipped")]
    assert counts == ["5", "2", "1", "1"]
    plant, b = root.findall("testsuite")
    assert (plant.get("name"), plant.get("failures")) == ("a/plant.fmu", "2")
    rules = plant.find("testcase[@name='rules']")
    assert rules is not None
    assert [f.get("message") for f in rules.findall("failure")] == ["no unit <m>", "no start"]
    error = b.find("testcase/error")
    assert error is not None
    assert error.get("message") == "broken"


def test_the_command_writes_the_report_of_good_and_unreadable_files(
    uuvsim: Uuvsim, declared: dict[str, Callable[[], Model]]
) -> None:
    good = str(build_fmu(declared["lag"]()))
    Path("broken.fmu").write_text("this is no archive")
    status, out, err = uuvsim("fmu", "check", "broken.fmu", good, "--junit", "fmus.xml")
    root = ElementTree.parse("fmus.xml").getroot()
    assert status == 2
    assert "broken.fmu" in err
    assert "nothing wrong was found" in out
    assert (root.get("errors"), root.get("failures")) == ("1", "0")
    cases = [c.get("name") for c in root.iter("testcase")]
    assert cases == ["read", "rules", "binary", "run", "determinism", "reset", "state", "reference"]
