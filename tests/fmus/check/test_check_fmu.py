"""The check of an FMU: silent about a good one, and clear about each way to be bad."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import forget
from uuvsim_cosim.errors import FmuError
from uuvsim_cosim.fmus.check import check_fmu
from uuvsim_cosim.fmus.check.check_fmu import _STRUCTURED, Look, check, examine, relied_on
from uuvsim_cosim.fmus.check.reference_result import LS_REF
from uuvsim_cosim.fmus.check.trial_run import LOOKS, trial
from uuvsim_cosim.fmus.codegen.lowering import Lowered, lower
from uuvsim_cosim.fmus.codegen.toolchain import compile_shared, host
from uuvsim_cosim.fmus.export.fmu_file import build_fmu, write_archive
from uuvsim_cosim.models.declaration.library import available, declare
from uuvsim_cosim.models.declaration.model import Model

Declared = dict[str, Callable[[], Model]]


def altered(path: Path, target: Path, change: Callable[[dict[str, bytes]], None]) -> Path:
    with zipfile.ZipFile(path) as archive:
        members = {n: archive.read(n) for n in archive.namelist()}
    change(members)
    write_archive(target, members)
    return target


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("name", ["lag", "linear", "noisy", "root"])
def test_every_fmu_that_is_built_passes(declared: Declared, name: str, fmi: Any) -> None:
    assert check(build_fmu(declared[name](), fmi=fmi)) == []


def test_a_broken_rule_is_found(declared: Declared, tmp_path: Path) -> None:
    def change(members: dict[str, bytes]) -> None:
        text = members["modelDescription.xml"]
        members["modelDescription.xml"] = text.replace(b'unit="N"', b'unit="furlong"')

    found = check(altered(build_fmu(declared["lag"]()), tmp_path / "x.fmu", change))
    assert any(f.check == "rules" and "furlong" in f.text for f in found)


def test_a_missing_binary_is_found(declared: Declared, tmp_path: Path) -> None:
    def change(members: dict[str, bytes]) -> None:
        for name in [n for n in members if n.startswith("binaries/")]:
            members["binaries/aarch64-darwin/lag.dylib"] = members.pop(name)
        for name in [n for n in members if n.startswith("sources/")]:
            del members[name]

    found = check(altered(build_fmu(declared["lag"]()), tmp_path / "x.fmu", change))
    assert [f.check for f in found] == ["binary"]
    assert "aarch64-darwin" in found[0].text


@pytest.mark.parametrize("fmi", [2, 3])
def test_what_this_package_exports_passes_from_its_sources_alone(
    declared: Declared, tmp_path: Path, fmi: Any
) -> None:
    def change(members: dict[str, bytes]) -> None:
        for name in [n for n in members if n.startswith("binaries/")]:
            del members[name]

    path = altered(build_fmu(declared["lag"](), fmi=fmi), tmp_path / "x.fmu", change)
    assert check(path) == []  # its own reference result among the rest
    forget(path)


def test_another_reference_result_is_found_with_name_and_time(
    declared: Declared, tmp_path: Path
) -> None:
    def change(members: dict[str, bytes]) -> None:
        lines = members["documentation/reference.csv"].decode().splitlines()
        t, y, z = lines[3].split(",")
        lines[3] = f"{t},{float(y) + 1e-6},{z}"
        members["documentation/reference.csv"] = "\n".join(lines).encode()

    found = check(altered(build_fmu(declared["lag"]()), tmp_path / "x.fmu", change))
    assert [f.check for f in found] == ["reference"]
    assert "'y'" in found[0].text
    assert "t = 0.15 s" in found[0].text


def test_a_wrong_token_is_found_in_the_fmus_own_words(declared: Declared, tmp_path: Path) -> None:
    def change(members: dict[str, bytes]) -> None:
        text = members["modelDescription.xml"].decode()
        start = text.index('instantiationToken="') + len('instantiationToken="')
        members["modelDescription.xml"] = (text[:start] + "0" + text[start + 1 :]).encode()
        if text[start] == "0":
            members["modelDescription.xml"] = (text[:start] + "1" + text[start + 1 :]).encode()

    found = check(altered(build_fmu(declared["lag"]()), tmp_path / "x.fmu", change))
    assert [f.check for f in found] == ["run"]
    assert "is not that of this binary" in found[0].text


@pytest.mark.parametrize(
    ("body", "words"), [("*(volatile int *)0 = 1;", "crashed"), ("for (;;) ;", "did not end")]
)
def test_an_fmu_that_crashes_or_hangs_is_a_finding(
    declared: Declared, tmp_path: Path, body: str, words: str
) -> None:
    source = tmp_path / "bad.c"
    source.write_text(
        f'__attribute__((constructor, visibility("default"))) void bad(void) {{ {body} }}\n'
    )
    bad = compile_shared([source], name="bad").read_bytes()

    def change(members: dict[str, bytes]) -> None:
        for name in [n for n in members if n.startswith("binaries/")]:
            members[name] = bad

    path = altered(build_fmu(declared["lag"]()), tmp_path / "x.fmu", change)
    found = check(path, time_limit=5.0)
    assert [f.check for f in found] == ["run"]
    assert words in found[0].text


FIRST_ORDER = Path(__file__).parents[1] / "foreign" / "first_order_fmi2"


def first_order(tmp_path: Path, *edits: tuple[str, str], **members: str) -> Path:
    """An FMU in C that leaves out functions nobody needs; its C may be edited."""
    import fmpy

    code, text = (FIRST_ORDER.with_suffix(s).read_text() for s in (".c", ".xml"))
    for old, new in edits:
        assert old in code
        code = code.replace(old, new, 1)
    source = tmp_path / "first_order.c"
    source.write_text(code)
    headers = [Path(fmpy.__file__).parent / "c-code", FIRST_ORDER.parent]
    library = compile_shared([source], name="first_order", include=headers)
    platform = host()
    path = tmp_path / "first_order.fmu"
    write_archive(
        path,
        {
            "modelDescription.xml": text.encode(),
            f"binaries/{platform.fmi2}/first_order{platform.suffix}": library.read_bytes(),
            **{name: content.encode() for name, content in members.items()},
        },
    )
    return path


def results(path: Path) -> dict[str, str]:
    return {look.check: look.result for look in examine(path)}


def test_every_look_at_an_fmu_is_told_with_its_result(tmp_path: Path) -> None:
    found = results(first_order(tmp_path))
    assert found == {
        "rules": "ok", "binary": "ok", "run": "ok", "determinism": "ok", "reset": "ok",
        "state": "ok", "reference": "not applicable",
    }  # fmt: skip


def test_an_fmu_that_omits_functions_nobody_needs_passes(tmp_path: Path) -> None:
    left_out = ("fmi2CancelStep", "fmi2SetRealInputDerivatives")
    assert check(first_order(tmp_path, *((name, f"x{name}") for name in left_out))) == []


COUNT = "v->integer[STEPS]++;"
KEPT = "    memcpy(&((instance *)c)->v, state, sizeof(values));"
RESET = "    start(&((instance *)c)->v);\n    return fmi2OK;"


@pytest.mark.parametrize(
    ("edit", "finding", "words"),
    [
        ((COUNT, "static int all; v->integer[STEPS] = ++all;"), "determinism", "'steps' differs"),
        ((RESET, "    return c ? fmi2OK : fmi2Error;"), "reset", "'steps' differs after a reset"),
        ((RESET, "    abort();"), "reset", "crashed with signal"),
        ((RESET, "    for (volatile int i = 1; i;) ;"), "reset", "did not end within"),
        (("fmi2Status fmi2Reset", "fmi2Status fmi2Reset_"), "reset", "fmi2Reset"),
        ((KEPT, "    (void)c, (void)state;"), "state",
         "'steps' differs after the state was restored"),
    ],
)  # fmt: skip
def test_what_a_master_needs_and_the_fmu_does_not_keep_is_found(
    tmp_path: Path, edit: tuple[str, str], finding: str, words: str
) -> None:
    looks = examine(path := first_order(tmp_path, edit), time_limit=8.0)
    found = {look.check: look for look in looks}
    assert found[finding].result == "finding"
    assert any(look.check == finding and words in look.text for look in looks)
    assert found["run"].result == "ok"
    assert found["reference"].result == "not applicable"  # the looks after it were made
    said = relied_on(path, looks)
    topic = {"determinism": "same bits each time", "reset": "FMI's own reset", "state": "snapshot"}
    assert said[topic[finding]].startswith(("no, tried", "not as declared"))


MANIFEST = """<?xml version="1.0" encoding="UTF-8"?>
<fmiReferences xmlns:fmi-ls="http://fmi-standard.org/fmi-ls-manifest"
 fmi-ls:fmi-ls-name="org.fmi-standard.fmi-ls-ref" fmi-ls:fmi-ls-version="1.0.0-alpha.1">
<Related type="text/csv" source="in.csv" role="input"/>
<Related type="text/csv" source="out.csv" role="result"/></fmiReferences>"""


def with_reference(tmp_path: Path, result: str, **more: str) -> Path:
    members = {
        "fmi-ls-manifest.xml": MANIFEST,
        "in.csv": "time,u\n0,1\n",
        "out.csv": result,
        **more,
    }
    return first_order(tmp_path, **{f"{LS_REF}/{name}": text for name, text in members.items()})


def test_the_result_of_fmi_ls_ref_is_repeated_with_its_inputs(tmp_path: Path) -> None:
    # Euler by hand: y' = (1 - y) / 0.5, h = 0.1
    rows = "".join(f"{k / 10},{1 - 0.8**k!r},{k}\n" for k in range(6))
    looks = examine(with_reference(tmp_path, "time,y,steps\n" + rows))
    (look,) = (look for look in looks if look.check == "reference")
    assert look.result == "ok"
    assert "out.csv: 2 columns within 0.0001 of their range, at 6 of 6 times" in look.text


def test_a_deviation_from_fmi_ls_ref_is_found_with_its_time_and_tolerance(tmp_path: Path) -> None:
    found = check(with_reference(tmp_path, "time,y\n0,0\n0.1,0.2\n0.2,0.5\n"))
    assert [f.check for f in found] == ["reference"]
    assert "output 'y' deviates by 0.28 of its range at t = 0.2 s" in found[0].text
    assert "expected at most 0.0001" in found[0].text


def test_an_experiment_of_fmi_ls_ref_names_parameters_signals_and_tolerance(
    tmp_path: Path,
) -> None:
    experiments = """<Experiments name="all"><Experiment name="gain" stopTime="1" stepSize="0.1"
     tolerance="0.01"><Parameters source="p.ssv"/><Stimuli source="in.csv"/>
     <References source="gain.csv"><Signal name="y"/></References></Experiment></Experiments>"""
    ssv = '<P><Parameters><Parameter name="k"><Real value="2"/></Parameter></Parameters></P>'
    path = with_reference(
        tmp_path,
        "time,y\n0,0\n0.1,0.2\n",
        **{"experiments.xml": experiments, "p.ssv": ssv},
        **{"gain.csv": "time,y,steps\n0,0,9\n0.1,0.4001,9\n"},
    )
    (look,) = (look for look in examine(path) if look.check == "reference")
    assert look.result == "ok", look.text
    assert "'gain' gain.csv: 1 columns within 0.01" in look.text


def test_a_file_that_the_manifest_names_must_be_there(tmp_path: Path) -> None:
    path = first_order(tmp_path, **{f"{LS_REF}/fmi-ls-manifest.xml": MANIFEST})
    assert "names 'out.csv', which is not in the archive" in str(*check(path))


def test_a_file_that_is_no_fmu_is_an_error(tmp_path: Path) -> None:
    file = tmp_path / "x.fmu"
    file.write_text("no zip")
    with pytest.raises(FmuError):
        check(file)


NAMES = ["x", "a.b[1,2].c", "hull.tau[12]", "_x9", "der(x[1],2)", "der(a.b)", "x[1]y", "der(x",
         "der(der(x))", "1x", "a..b", "a.", "x[]", "x[1", "x [1]", "x[-1]", "", "'a b'", "ä", "x\n",
         "x[1,]", "x[1][2]", "der(x,y)", "der()", "a-b", "x[\u0661]"]  # fmt: skip


def test_a_structured_name_is_taken_only_if_fmpy_takes_it() -> None:
    from types import SimpleNamespace

    from fmpy.validation import _validate_variable_names

    for name in NAMES:
        variable = SimpleNamespace(name=name, sourceline=1)
        asked = SimpleNamespace(variableNamingConvention="structured", modelVariables=[variable])
        taken = _validate_variable_names(asked) == []
        assert taken == (_STRUCTURED.fullmatch(name) is not None or name == "'a b'"), name


@lru_cache(maxsize=1)  # its two versions come one after the other
def lowered(name: str) -> Lowered:
    return lower(declare(name))


def in_this_process(path: Path, time_limit: float) -> list[Look]:
    """Make the looks without a process of their own: to start it takes longer than to look."""
    made: list[dict[str, str]] = []
    trial(path, report=made.append)
    return [Look(**entry) for entry in made if entry["result"] != "begun"]  # type: ignore[arg-type]


# Both versions of every component; of a vehicle's further sets, whose C differs, one.
@pytest.mark.parametrize(
    ("name", "fmi"), [(n, fmi) for n in available() for fmi in ((3,) if "@" in n else (2, 3))]
)
def test_every_shipped_component_is_a_valid_fmu_that_fmpy_simulates(
    name: str, fmi: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    import fmpy

    monkeypatch.setattr(check_fmu, "_trial", in_this_process)
    path = build_fmu(lowered(name), fmi=fmi)
    looks = examine(path)
    assert [look for look in looks if look.result == "finding"] == []
    assert {look.check for look in looks} == {"rules", "binary", *LOOKS}
    assert len(fmpy.simulate_fmu(str(path), validate=False)) > 1


def test_the_run_starts_where_the_default_experiment_does(c_fmu: Any, tmp_path: Path) -> None:
    edits = [('startTime="0" stopTime="2"', 'startTime="1e6" stopTime="1000002"')]
    told: list[Any] = []
    trial(c_fmu(2, edits=edits), ["run"], told.append)
    assert told[-1] == {"check": "run", "result": "ok", "text": "20 steps of 0.1 s"}


def test_a_run_of_one_step_is_repeated_from_each_state(c_fmu: Any) -> None:
    told: list[Any] = []
    trial(c_fmu(2, edits=[('stopTime="2"', 'stopTime="0.1"')]), ["state"], told.append)
    assert told[-1]["result"] == "ok"
    assert told[-1]["text"].endswith("the same bits over 1 steps")
