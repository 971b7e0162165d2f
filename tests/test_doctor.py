from pathlib import Path

import pytest

from uuvsim_cosim._version import __version__
from uuvsim_cosim.commands import doctor


def test_the_doctor_says_versions_platform_compiler_and_cache() -> None:
    text = "\n".join(doctor.findings())
    assert __version__ in text
    for name in ("python", "platform", "compiler", "cache", "numpy", "casadi", "fmpy"):
        assert f"\n{name}" in text
    assert "works" in text


def test_the_doctor_tells_no_personal_path() -> None:
    text = "\n".join(doctor.findings())
    assert str(Path.home()) not in text


def test_a_compiler_that_is_not_there_is_a_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    text = "\n".join(doctor.findings())
    assert "DOES NOT WORK" in text
    assert "no-such-compiler" in text


def test_a_compiler_that_cannot_compile_is_a_finding(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    broken = tmp_path / "cc"
    broken.write_text("#!/bin/sh\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setenv("CC", str(broken))
    assert "DOES NOT WORK" in "\n".join(doctor.findings())


def test_a_missing_extra_is_named_with_what_it_costs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "EXTRAS", {"no-such-package-xyz": "nothing at all"})
    assert any("missing; needed for nothing at all" in text for text in doctor.findings())
