import importlib.metadata
import os
import pwd
import tempfile
import tomllib
from pathlib import Path

import pytest

from uuvsim_cosim._version import __version__
from uuvsim_cosim.cache import cache_dir
from uuvsim_cosim.cli import status_of
from uuvsim_cosim.commands import doctor
from uuvsim_cosim.errors import InputInvalid

ROOT = Path(__file__).parents[1]


def report(capsys: pytest.CaptureFixture[str]) -> str:
    assert status_of(["doctor"]) == 0
    return capsys.readouterr().out


def test_the_doctor_says_versions_platform_compiler_and_cache(
    capsys: pytest.CaptureFixture[str],
) -> None:
    text = report(capsys)
    assert __version__ in text
    for name in ("python", "platform", "compiler", "cache", "numpy", "casadi", "fmpy"):
        assert f"\n{name}" in text
    assert "works" in text


def test_the_doctor_tells_no_personal_path(capsys: pytest.CaptureFixture[str]) -> None:
    text = report(capsys)
    assert str(Path.home()) not in text


def test_a_compiler_that_is_not_there_is_a_finding(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    text = report(capsys)
    assert "DOES NOT WORK" in text
    assert "no-such-compiler" in text


def test_a_compiler_that_cannot_compile_is_a_finding(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    broken = tmp_path / "cc"
    broken.write_text("#!/bin/sh\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setenv("CC", str(broken))
    assert "DOES NOT WORK" in doctor.facts()["compiler"]


def test_the_doctor_lists_the_extras_of_pyproject_with_what_each_is_for() -> None:
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert set(doctor.EXTRAS) == set(declared["optional-dependencies"])
    assert set(doctor.packages()) == {"", *declared["optional-dependencies"]}
    assert len(doctor.packages()[""]) == len(declared["dependencies"])


def test_a_missing_extra_is_named_with_what_it_costs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def asked(name: str) -> list[str]:
        return ["numpy>=1", 'no-such-package-xyz>=1; extra == "view"']

    monkeypatch.setattr(importlib.metadata, "requires", asked)
    (said,) = [text for text in report(capsys).splitlines() if text.startswith("view ")]
    assert "MISSING: `uuvsim view`, `--view` (without no-such-package-xyz)" in said


# ---- without a home folder --------------------------------------------------------------------


@pytest.fixture
def homeless(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Take HOME and the entry in passwd away, as in a container with a number for a user."""

    def nobody(number: int) -> None:
        raise KeyError(number)

    monkeypatch.delenv("HOME")
    for name in ("UUVSIM_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(pwd, "getpwuid", nobody)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_without_a_home_folder_the_cache_is_this_users_alone(homeless: Path) -> None:
    found = cache_dir("x")
    assert found == homeless / f"uuvsim-cosim-{os.getuid()}" / "x"
    assert found.parent.stat().st_mode & 0o077 == 0


def test_a_cache_that_others_can_write_is_refused(homeless: Path) -> None:
    cache_dir().chmod(0o777)
    with pytest.raises(InputInvalid, match="others can write it; set UUVSIM_CACHE"):
        cache_dir()


def test_a_cache_that_is_a_link_is_refused(homeless: Path) -> None:
    (homeless / "elsewhere").mkdir()
    (homeless / f"uuvsim-cosim-{os.getuid()}").symlink_to(homeless / "elsewhere")
    with pytest.raises(InputInvalid, match="others can write it"):
        cache_dir()


def test_the_doctor_says_where_the_cache_is_and_why(
    homeless: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "because there is no home folder" in report(capsys)


def test_commands_work_without_a_home_folder(
    homeless: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of(["new", "controller"]) == 0
    assert status_of(["run", "~/tank.ssd"]) == 2
    assert "there is no home folder; expected a path without ~" in capsys.readouterr().err
