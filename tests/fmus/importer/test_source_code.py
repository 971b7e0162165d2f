"""FMUs that come as sources, without a binary for this machine."""

from pathlib import Path

import pytest

from tests.conftest import FIRST_ORDER, FOREIGN, forget, write_archive
from uuvsim_cosim.errors import FmuError
from uuvsim_cosim.fmus.check.check_fmu import examine
from uuvsim_cosim.fmus.check.inspect_fmu import reliance
from uuvsim_cosim.fmus.check.simulate_fmu import simulate_fmu
from uuvsim_cosim.fmus.importer.read_description import read_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu

WRAP = b'#include "model.inc"\n#if !defined(ONE) || ONE != 1\n#error no ONE\n#endif\n'
BUILD = (
    '<fmiBuildDescription fmiVersion="3.0"><BuildConfiguration modelIdentifier="first_order">'
    '<SourceFileSet language="C99"><SourceFile name="{file}"/><PreprocessorDefinition name="ONE" '
    'value="1"/><PreprocessorDefinition name="NOT" optional="true"/><IncludeDirectory name="inc"/>'
    "</SourceFileSet>{more}</BuildConfiguration></fmiBuildDescription>"
)


def sources_only(
    path: Path, version: int, file: str = "all.c", code: bytes = WRAP, more: str = ""
) -> Path:
    description = FIRST_ORDER[version].read_text()
    members = {
        f"sources/{file}": code,
        "sources/inc/model.inc": (FOREIGN / f"first_order_fmi{version}.c").read_bytes(),
        "binaries/vax/first_order.so": b"",
    }
    if version == 2:
        begin, end = description.index("<CoSimulation "), 0
        end = description.index("/>", begin)
        listed = f'><SourceFiles><File name="{file}"/></SourceFiles></CoSimulation>'
        description = description[:end] + listed + description[end + 2 :]
        members[f"sources/{file}"] = code.replace(b"model.inc", b"inc/model.inc").replace(
            b"!defined(ONE) || ONE != 1", b"0"
        )
    else:
        members["sources/buildDescription.xml"] = BUILD.format(file=file, more=more).encode()
    return write_archive(path, {"modelDescription.xml": description.encode(), **members})


@pytest.mark.parametrize("version", [2, 3])
def test_sources_give_the_bits_of_the_binary(
    tmp_path: Path, version: int, request: pytest.FixtureRequest
) -> None:
    path = sources_only(tmp_path / "sources.fmu", version)
    binary = request.getfixturevalue(f"first_order_fmi{version}")
    found, expected = (simulate_fmu(p, until=1, inputs={"u": 1.0}) for p in (path, binary))
    assert list(found["y"]) == list(expected["y"])
    assert reliance(read_fmu(path))["run"] == "yes, its sources are compiled at first use"
    isolated = instantiate_fmu(path, "a", isolate=True, watchdog=5.0)
    isolated.free()
    forget(path)


def test_the_check_compiles_and_runs_them(tmp_path: Path) -> None:
    path = sources_only(tmp_path / "sources.fmu", 2)
    looks = {look.check: look for look in examine(path)}
    assert "its sources were compiled; there: vax" in looks["binary"].text
    assert looks["run"].result == "ok"
    forget(path)


@pytest.mark.parametrize(
    ("file", "code", "more", "said"),
    [
        ("a.c", b"int x = ;", "", r"its sources do not compile: .*a\.c:1:9: error: expected expr"),
        ("a.cpp", b"", "", r"a\.cpp is not C"),
        ("a.c", b"", '<Library name="sundials"/>', "need the library sundials"),
        ("../modelDescription.xml", b"", "", "is not there; expected it in sources/"),
        ("a.c", b"int x;", "", "does not export fmi3Instantiate"),
    ],
)
def test_sources_that_do_not_do_are_named(
    tmp_path: Path, file: str, code: bytes, more: str, said: str
) -> None:
    path = sources_only(tmp_path / "sources.fmu", 3, "a.c", code, more)
    if file != "a.c":
        build = BUILD.format(file=file, more=more).encode()
        members = {"modelDescription.xml": FIRST_ORDER[3].read_bytes(), "sources/a.cpp": b"",
                   "sources/inc/x.h": b"", "sources/buildDescription.xml": build}  # fmt: skip
        path = write_archive(tmp_path / "other.fmu", members)
    with pytest.raises(FmuError, match=said):
        instantiate_fmu(path, "a").free()
    forget(path)


def test_a_configuration_for_another_platform_is_not_taken(tmp_path: Path) -> None:
    path = tmp_path / "other.fmu"
    build = BUILD.format(file="a.c", more="").replace("modelId", 'platform="vax" modelId')
    members = {"modelDescription.xml": FIRST_ORDER[3].read_bytes(), "sources/a.c": b"",
               "sources/buildDescription.xml": build.encode()}  # fmt: skip
    with pytest.raises(FmuError, match="there are: none, and no sources that are listed"):
        instantiate_fmu(write_archive(path, members), "a")
    forget(path)
