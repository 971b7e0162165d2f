"""The check of an FMU: silent about a good one, and clear about each way to be bad."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from uuvsim_cosim.errors import FmuError
from uuvsim_cosim.fmus.check_fmu import check
from uuvsim_cosim.fmus.export import build_fmu, write_archive
from uuvsim_cosim.fmus.toolchain import compile_shared
from uuvsim_cosim.models.library import available, declare
from uuvsim_cosim.models.model import Model

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

    found = check(altered(build_fmu(declared["lag"]()), tmp_path / "x.fmu", change))
    assert [f.check for f in found] == ["binary"]
    assert "aarch64-darwin" in found[0].text


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


def test_a_file_that_is_no_fmu_is_an_error(tmp_path: Path) -> None:
    file = tmp_path / "x.fmu"
    file.write_text("no zip")
    with pytest.raises(FmuError):
        check(file)


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("name", available())
def test_every_shipped_component_is_a_valid_fmu_that_fmpy_simulates(name: str, fmi: int) -> None:
    assert check(build_fmu(declare(name), fmi=fmi)) == []
