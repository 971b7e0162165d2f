"""The conformance of FMUs and systems in a folder: equal, run, deviating, refused or failed."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import pytest

import uuvsim_cosim as uuv
from tests.conftest import Uuvsim, write_archive
from tests.fmus.check.test_check_fmu import altered
from tests.fmus.conftest import MODELS
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.check.reference_result import LS_REF
from uuvsim_cosim.fmus.export.fmu_file import build_fmu
from uuvsim_cosim.orchestrator.running.conformance import (
    Judged,
    Subject,
    conformance,
    markdown,
    subjects,
)
from uuvsim_cosim.orchestrator.running.conformance_libcosim import beside_libcosim
from uuvsim_cosim.orchestrator.ssp.ssd import write_ssd


def judged(folder: Path) -> dict[str, tuple[str, str]]:
    """Return result and text by the file and the last word of its kind."""
    found = conformance(folder, until=1.0)
    return {f"{j.subject.path.name} {j.subject.kind}": (j.result, j.text) for j in found}


def without_reference(members: dict[str, bytes]) -> None:
    for name in [n for n in members if n.startswith("documentation/")]:
        del members[name]


def crashing(source: str) -> bytes:
    """Return C code whose step writes to address 0."""
    start = source.index("{", source.index("fmi3DoStep"))
    crash = "{ *(volatile int *)0 = 1; "
    return (source[:start] + crash + source[start + 1 :]).encode()


def test_an_fmu_is_equal_to_its_reference_or_to_fmpy_by_each_interface(tmp_path: Path) -> None:
    built = build_fmu(MODELS["lag"](), fmi=2)
    shutil.copy(built, tmp_path / "own.fmu")
    altered(built, tmp_path / "bare.fmu", without_reference)
    found = judged(tmp_path)
    assert {result for result, _ in found.values()} == {"equal"}
    assert found["own.fmu FMI 2.0 Co-Simulation"][1].startswith("documentation/reference.csv")
    same = found["bare.fmu FMI 2.0 Co-Simulation"][1]
    assert same == "FMPy: the same bits in 2 columns, 100 steps of 0.01 s"
    assert "CVODE: within" in found["bare.fmu FMI 2.0 Model Exchange"][1]


def test_arrays_and_a_result_beside_the_fmu_are_compared(tmp_path: Path) -> None:
    altered(build_fmu(MODELS["linear"](), fmi=3), tmp_path / "arrays.fmu", without_reference)
    altered(build_fmu(MODELS["lag"](), fmi=2), tmp_path / "lag.fmu", without_reference)
    (tmp_path / "lag_ref.csv").write_text("time,y\n0,1\n0.5,77\n")
    found = judged(tmp_path)
    assert "the same bits in 4 columns" in found["arrays.fmu FMI 3.0 Co-Simulation"][1]
    result, text = found["lag.fmu FMI 2.0 Co-Simulation"]
    assert result == "deviates"
    assert "'y' deviates by 0.99" in text


def test_a_reference_that_cannot_be_used_is_no_refusal(tmp_path: Path) -> None:
    def change(members: dict[str, bytes]) -> None:
        without_reference(members)
        text = '<r><Related role="result" source="other.csv"/></r>'
        members[f"{LS_REF}/fmi-ls-manifest.xml"] = text.encode()

    altered(build_fmu(MODELS["lag"](), fmi=2), tmp_path / "lag.fmu", change)
    result, text = judged(tmp_path)["lag.fmu FMI 2.0 Co-Simulation"]
    assert result == "equal"
    assert "its reference cannot be used" in text
    assert "other.csv" in text


def test_refusals_name_their_reason_and_a_crash_does_not_end_the_others(
    tmp_path: Path, source_fmu: Callable[..., Path]
) -> None:
    def foreign(members: dict[str, bytes]) -> None:
        for name in [n for n in members if n.startswith(("binaries/", "sources/"))]:
            del members[name]
        members["binaries/x86_64-windows/lag.dll"] = b"x"

    altered(build_fmu(MODELS["lag"](), fmi=3), tmp_path / "windows.fmu", foreign)
    (tmp_path / "broken.fmu").write_text("no archive")
    write_archive(tmp_path / "clocked.fmu", {"modelDescription.xml": (
        b'<fmiModelDescription fmiVersion="3.0" modelName="c" instantiationToken="x">'
        b'<ScheduledExecution modelIdentifier="c"/><ModelVariables/><ModelStructure/>'
        b"</fmiModelDescription>")})  # fmt: skip
    code = Path(__file__).parents[2] / "fmus" / "foreign" / "kinetics_fmi3.c"
    file = source_fmu("kinetics_fmi3.c", code=crashing(code.read_text()))
    shutil.copy(file, tmp_path / "crash.fmu")
    found = judged(tmp_path)
    assert found["windows.fmu FMI 3.0 Co-Simulation"][1].endswith("there: x86_64-windows")
    assert found["broken.fmu FMU"][0] == "refused"
    assert "it has no binary" in found["clocked.fmu FMI 3.0 Scheduled Execution"][1]
    crash = next(v for k, v in found.items() if k.startswith("crash.fmu"))
    assert crash[0] == "failed"
    assert "signal 11" in crash[1]
    refused = [name for name, (result, _) in found.items() if result == "refused"]
    assert len(refused) == 4, "crash.fmu runs by Model Exchange"


def test_systems_are_run_and_their_problems_listed(tmp_path: Path) -> None:
    write_ssd(uuv.System("bench").add("battery", "model:battery"), tmp_path / "bench.ssd")
    (tmp_path / "osp").mkdir()
    (tmp_path / "osp" / "OspSystemStructure.xml").write_text("<nothing/>")
    found = judged(tmp_path)
    assert found["bench.ssd SSP (.ssd)"] == ("runs", "1 components, to 1 s")
    assert found["OspSystemStructure.xml OSP"][0] == "refused"


def test_a_loop_that_cannot_be_iterated_is_run_with_a_delay_and_reported(
    tmp_path: Path, c_fmu: Callable[..., Path]
) -> None:
    """OSP's master delays such loops; a run of this package refuses them by default."""
    fmu = c_fmu(3, edits=[('canGetAndSetFMUState="true" canSerializeFMUState="true"', ""),
                          ('valueReference="2" dependencies=""', 'valueReference="2"'),
                          ('<Output valueReference="2"/>',
                           '<Output valueReference="2" dependencies="1"/>')])  # fmt: skip
    shutil.copy(fmu, tmp_path / "f.fmu")
    system = uuv.System("loop", base=tmp_path).add("a", "f.fmu").add("b", "f.fmu")
    system = system.connect("a.y", "b.u").connect("b.y", "a.u")
    write_ssd(system, tmp_path / "loop.ssd")
    result, text = judged(tmp_path)["loop.ssd SSP (.ssd)"]
    assert result == "runs"
    assert "with --loops delay" in text
    assert "algebraic loop" in text


def osp(folder: Path, fmu: Path, step: float = 0.05) -> Path:
    """Write a chain of two FMUs; without an algorithm, which libcosim asks for."""
    folder.mkdir()
    shutil.copy(fmu, folder / "lag.fmu")
    ends = ('<Variable simulator="a" name="y"/>', '<Variable simulator="b" name="u"/>')
    (folder / "OspSystemStructure.xml").write_text(
        '<OspSystemStructure xmlns="http://opensimulationplatform.com/MSMI/OSPSystemStructure" '
        f'version="0.1"><BaseStepSize>{step}</BaseStepSize><Simulators>'
        '<Simulator name="a" source="lag.fmu"><InitialValues><InitialValue variable="u">'
        '<Real value="1"/></InitialValue></InitialValues></Simulator>'
        '<Simulator name="b" source="lag.fmu"/></Simulators><Connections>'
        f"<VariableConnection>{''.join(ends)}</VariableConnection></Connections>"
        "</OspSystemStructure>"
    )
    return folder / "OspSystemStructure.xml"


def test_a_system_is_equal_to_libcosim(tmp_path: Path, first_order_fmi2: Path) -> None:
    osp(tmp_path / "chain", first_order_fmi2)
    found = conformance(tmp_path, until=1.0, libcosim=sys.executable)
    system = next(j for j in found if j.subject.kind == "OSP")
    assert system.result == "equal"
    assert "libcosim: the same" in system.text
    assert "in 8 columns, 20 steps" in system.text


def test_a_system_that_libcosim_gives_other_values_of_deviates(
    tmp_path: Path, first_order_fmi2: Path
) -> None:
    file = osp(tmp_path / "chain", first_order_fmi2)
    signals = uuv.run(uuv.load(file), until=1.0, out=tmp_path / "run").signals()
    outputs = {"b": ["y"]}
    tick = Fraction(1, 20)
    assert beside_libcosim(sys.executable, file, tick, signals, outputs)[0] == "equal"
    wrong = replace(signals, values_by_name={"b.y": signals["b.y"] * 1.001})
    result, text = beside_libcosim(sys.executable, file, tick, wrong, outputs)
    assert (result, text.rpartition("; ")[2]) == ("deviates", "the most in b.y")
    result, text = beside_libcosim("/bin/false", file, tick, signals, outputs)
    assert (result, text) == ("runs", "libcosim does not run it: no message")


def test_an_fmi_1_fmu_has_the_interface_of_its_implementation(tmp_path: Path) -> None:
    for name, inside in (("cs", "<Implementation/>"), ("me", "")):
        text = f'<fmiModelDescription fmiVersion="1.0">{inside}</fmiModelDescription>'
        write_archive(tmp_path / f"{name}.fmu", {"modelDescription.xml": text.encode()})
    assert [s.kind for s in subjects(tmp_path)] == [
        "FMI 1.0 Co-Simulation", "FMI 1.0 Model Exchange",
    ]  # fmt: skip


def test_a_folder_without_a_subject_is_refused(tmp_path: Path) -> None:
    for folder in (tmp_path, tmp_path / "none"):
        with pytest.raises(InputInvalid):
            conformance(folder)


def test_the_table_is_markdown_with_counts(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b.fmu"
    text = markdown(tmp_path, [
        Judged(Subject(path, "FMI 2.0 Co-Simulation"), "equal", "a | b"),
        Judged(Subject(path, "FMU"), "refused", "x" * 300),
    ])  # fmt: skip
    assert "1 equal, 1 refused." in text
    assert "| `a/b.fmu` | FMI 2.0 Co-Simulation | equal | a \\| b |" in text
    assert max(map(len, text.splitlines())) < 250


def test_the_command_writes_the_table_and_fails_if_something_deviates(
    uuvsim: Uuvsim, tmp_path: Path
) -> None:
    folder = tmp_path / "fmus"
    folder.mkdir()
    shutil.copy(build_fmu(MODELS["root"](), fmi=3), folder / "x.fmu")
    status, out, _ = uuvsim("fmu", "conformance", str(folder), "--until", "1", "-o", "t.md",
                            "--json")  # fmt: skip
    found = json.loads(out)
    assert (status, found["counts"]) == (0, [{"result": "equal", "number": 2}])
    assert [r["result"] for r in found["results"]] == ["equal", "equal"]
    assert "| `x.fmu` |" in Path("t.md").read_text()
    (folder / "x_ref.csv").write_text("time,y\n0,5\n0.1,5\n")
    assert uuvsim("fmu", "conformance", str(folder), "--until", "1")[0] == 1
    assert uuvsim("fmu", "conformance", str(folder), "--until", "0")[0] == 2
    assert uuvsim("fmu", "conformance", str(folder), "--libcosim", "none")[0] == 2
