"""The archive: what is inside, that it is reproducible, and how a wrong wish is refused."""

from __future__ import annotations

import re
import subprocess
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from uuvsim_cosim.errors import InputInvalid, ToolchainError
from uuvsim_cosim.fmus.check.inspect_fmu import inspect
from uuvsim_cosim.fmus.codegen.toolchain import compiler, host
from uuvsim_cosim.fmus.export.component_folder import folder_texts, shipped, stale, write_folder
from uuvsim_cosim.fmus.export.fmu_file import build_fmu, build_many, fmi_headers
from uuvsim_cosim.fmus.export.model_description import FmiVersion
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.model import Model

Declared = dict[str, Callable[[], Model]]
both = pytest.mark.parametrize("fmi", [2, 3])


@both
def test_the_archive_holds_binary_sources_documentation_and_reference(
    declared: Declared, fmi: Any
) -> None:
    with zipfile.ZipFile(build_fmu(declared["lag"](), fmi=fmi)) as archive:
        names = set(archive.namelist())
        folder = host().fmi2 if fmi == 2 else host().fmi3
        assert f"binaries/{folder}/lag{host().suffix}" in names
        assert {
            "modelDescription.xml",
            "sources/lag.c",
            "sources/uuv_runtime.c",
            "sources/uuv_component.h",
            f"sources/fmi{fmi}_shell.c",
            "documentation/index.html",
            "documentation/reference.csv",
            "documentation/input.csv",
            "documentation/licenses/license.txt",
        } <= names
        assert ("sources/buildDescription.xml" in names) == (fmi == 3)
        assert "Apache License" in archive.read("documentation/licenses/license.txt").decode()


def test_the_same_declaration_gives_the_same_bytes(
    declared: Declared, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    versions: tuple[FmiVersion, ...] = (2, 3)

    def built(folder: str) -> list[bytes]:
        lag = declared["lag"]
        return [
            build_fmu(lag(), fmi=fmi, target=tmp_path / folder / f"{fmi}.fmu").read_bytes()
            for fmi in versions
        ]

    first = built("first")
    monkeypatch.setenv("UUVSIM_CACHE", str(tmp_path / "another_cache"))
    assert built("again") == first


def test_a_target_is_a_file_or_a_folder(declared: Declared, tmp_path: Path) -> None:
    for target in (tmp_path / "a", tmp_path / "b.fmu"):
        build_fmu(declared["lag"](), target=target)
    assert (tmp_path / "a" / "lag.fmu").read_bytes() == (tmp_path / "b.fmu").read_bytes()


def test_another_start_value_gives_another_token(declared: Declared) -> None:
    def token(model: Model) -> str:
        return inspect(build_fmu(model)).fmu.description.token

    other = Model("lag")
    other.output("y", other.input("u", unit="1"), unit="1")
    assert token(declared["lag"]()) != token(other)
    assert token(declared["lag"]()) == token(declared["lag"]())


@both
def test_the_listed_sources_compile_to_a_working_library(
    declared: Declared, fmi: Any, tmp_path: Path
) -> None:
    from fmpy.model_description import read_model_description

    path = build_fmu(declared["noisy"](), fmi=fmi)
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path)
    files = read_model_description(str(path)).buildConfigurations[0].sourceFileSets[0].sourceFiles
    library = tmp_path / "again.so"
    flags = ["-std=c11", "-O2", "-ffp-contract=off", "-fPIC", "-shared", "-Wall", "-Werror"]
    sources = [str(tmp_path / "sources" / file) for file in files]
    done = subprocess.run(
        [*compiler()[0], *flags, f"-I{fmi_headers()}", *sources, "-o", str(library)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert library.is_file()


def test_no_path_of_this_machine_is_inside(declared: Declared) -> None:
    with zipfile.ZipFile(build_fmu(declared["lag"]())) as archive:
        for name in archive.namelist():
            data = archive.read(name)
            assert str(Path.home()).encode() + b"/" not in data, name
            assert str(Path(__file__).parents[3]).encode() not in data, name


def test_the_linux_binary_asks_for_no_newer_glibc_than_2_17(declared: Declared) -> None:
    with zipfile.ZipFile(build_fmu(declared["noisy"](), fmi=2, platforms=("linux64",))) as archive:
        data = archive.read("binaries/linux64/noisy.so")
    asked = {int(minor) for minor in re.findall(rb"GLIBC_2\.(\d+)", data)}
    assert asked
    assert max(asked) <= 17


def test_an_unknown_platform_is_refused_with_those_known(declared: Declared) -> None:
    with pytest.raises(ToolchainError, match=r"'amiga'.*linux64"):
        build_fmu(declared["lag"](), platforms=("amiga",))


def test_an_unknown_fmi_version_is_refused(declared: Declared) -> None:
    with pytest.raises(InputInvalid, match="expected 2 or 3"):
        build_fmu(declared["lag"](), fmi=1)  # type: ignore[arg-type]


def test_a_target_that_cannot_be_written_is_refused(declared: Declared, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputInvalid, match=r"file/lag\.fmu: cannot be written"):
        build_fmu(declared["lag"](), target=tmp_path / "file")


def test_a_wrong_name_is_refused_before_anything_is_built(tmp_path: Path) -> None:
    with pytest.raises(InputInvalid, match="no_such"):
        build_many(["current_gauss_markov", "no_such"], target_dir=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_names_take_options_and_two_of_one_file_are_refused(tmp_path: Path) -> None:
    names = ["altimeter@ping?scene=flat&period=0.5"]
    (path,) = build_many(names, target_dir=tmp_path)
    assert "bottom_depth" not in {v["name"] for v in inspect(path).as_dict()["variables"]}
    with pytest.raises(InputInvalid, match="two would be the same file"):
        build_many([*names, "altimeter"], target_dir=tmp_path)


def test_inspection_is_ready_for_json(declared: Declared) -> None:
    import json

    path = build_fmu(declared["noisy"](), fmi=2)
    data = json.loads(json.dumps(inspect(path).as_dict()))
    assert data["fmi"] == "2.0"
    assert data["capabilities"]["serialize"] is True
    seed = next(v for v in data["variables"] if v["name"] == "seed")
    assert (seed["shape"], seed["start"]) == ([2], [0, 0])


def test_a_changed_declaration_makes_its_folder_stale(declared: Declared, tmp_path: Path) -> None:
    folder = write_folder(declared["lag"](), tmp_path)
    assert shipped(tmp_path) == ["lag"]
    assert stale(declared["lag"](), folder) == []
    changed = declared["lag"]()
    changed.output("w", changed.variables["x"].symbol, unit="N")
    assert stale(changed, folder) == ["modelDescription.xml", "variables.md", "reference.csv"]


def test_folders_of_shipped_components_are_what_is_declared() -> None:
    from uuvsim_cosim.content import content

    wrong = {name: stale(declare(name), content("fmus", "components", name)) for name in shipped()}
    assert {name: files for name, files in wrong.items() if files} == {}


def test_every_shipped_component_has_a_folder() -> None:
    from uuvsim_cosim.models.declaration.library import available

    assert {name for name in available() if "@" not in name} <= set(shipped())


def test_a_folder_does_not_change_with_every_build(declared: Declared) -> None:
    texts = folder_texts(declared["lag"]())
    assert 'instantiationToken="of each build"' in texts["modelDescription.xml"]


@pytest.mark.parametrize("junk", [b"", b"PK\x03\x04 junk", None])
def test_a_damaged_fmu_in_the_cache_is_built_again(
    declared: dict[str, Callable[[], Model]], junk: bytes | None
) -> None:
    path = build_fmu(declared["lag"](), fmi=2)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2] if junk is None else junk)
    assert build_fmu(declared["lag"](), fmi=2) == path
    assert path.read_bytes() == whole


@both
def test_the_licences_of_the_component_and_of_fmis_headers_are_inside(
    declared: Declared, fmi: Any
) -> None:
    with zipfile.ZipFile(build_fmu(declared["lag"](), fmi=fmi)) as archive:
        own = archive.read("documentation/licenses/license.txt").decode()
        headers = archive.read("documentation/licenses/fmi_headers.txt").decode()
    assert "Apache License" in own
    assert "Modelica Association" in headers
    assert "reproduce the above copyright notice" in headers
