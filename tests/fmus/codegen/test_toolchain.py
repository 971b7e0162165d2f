"""The tool chain: one compiler everywhere, and sentences where it cannot."""

import ctypes
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from uuid import uuid4

import pytest

from uuvsim_cosim.cache import cache_dir
from uuvsim_cosim.errors import ToolchainError
from uuvsim_cosim.fmus.codegen import toolchain

SOURCE = '__attribute__((visibility("default"))) double twice(double x) { return 2 * x; }\n'


@pytest.fixture
def source(tmp_path: Path) -> Path:
    path = tmp_path / "twice.c"
    path.write_text(SOURCE)
    return path


def test_a_library_that_was_compiled_loads_and_computes(source: Path) -> None:
    library = ctypes.CDLL(str(toolchain.compile_shared([source], name="twice")))
    library.twice.restype = ctypes.c_double
    library.twice.argtypes = [ctypes.c_double]
    assert library.twice(2.5) == 5.0


def test_a_second_compilation_is_the_cached_file(
    source: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = toolchain.compile_shared([source], name="twice")
    monkeypatch.setattr(toolchain, "_ran", lambda command: pytest.fail("compiled again"))
    assert toolchain.compile_shared([source], name="twice") == first


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:1000])


def overwrite(path: Path) -> None:
    path.write_bytes(b"x" * path.stat().st_size)


@pytest.mark.parametrize("damage", [truncate, Path.unlink, overwrite])
def test_a_damaged_library_is_compiled_again(
    damage: Callable[[Path], None],
    source: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for key in ("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR"):
        monkeypatch.setenv(key, str(cache_dir("zig")))
    monkeypatch.setenv("UUVSIM_CACHE", str(tmp_path / "cache"))
    path = toolchain.compile_shared([source], name="twice")
    damage(path)
    assert toolchain.compile_shared([source], name="twice") == path
    library = ctypes.CDLL(str(path))
    library.twice.restype, library.twice.argtypes = ctypes.c_double, [ctypes.c_double]
    assert library.twice(2.5) == 5.0


def test_a_damaged_cache_of_zig_is_made_again(
    source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("UUVSIM_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("CC", raising=False)
    damaged = cache_dir("zig") / "damaged"
    damaged.touch()
    ran = toolchain._ran

    def stumbles(command: list[str]) -> subprocess.CompletedProcess[str]:
        if damaged.exists():
            return subprocess.CompletedProcess(command, 1, "", "ld.lld: error: x.o: no object")
        Path(command[command.index("-o") + 1]).write_bytes(b"library")
        return ran([sys.executable, "-c", "pass"])

    monkeypatch.setattr(toolchain, "_ran", stumbles)
    assert toolchain.compile_shared([source], name="twice").read_bytes() == b"library"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other links elsewhere")
def test_a_library_that_needs_the_compilers_own_functions_is_linked_with_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CC", raising=False)
    ran, run, calls = toolchain._ran, toolchain._run, []

    def counted(command: list[str]) -> subprocess.CompletedProcess[str]:
        calls.append("without")
        return ran(command)

    monkeypatch.setattr(toolchain, "_ran", counted)
    monkeypatch.setattr(toolchain, "_run", lambda c: (calls.append("with"), run(c)))
    export = '__attribute__((visibility("default")))'
    new = f"/* {uuid4()} */"
    (tmp_path / "plain.c").write_text(f"{new}\n{export} long half(long x) {{ return x / 2; }}")
    toolchain.compile_shared([tmp_path / "plain.c"], name="plain")
    assert calls == ["without"]
    wide = "return (long)(((__int128)x << 64) / ((__int128)y << 64));"  # calls __divti3
    (tmp_path / "wide.c").write_text(f"{new}\n{export} long ratio(long x, long y) {{ {wide} }}")
    library = ctypes.CDLL(str(toolchain.compile_shared([tmp_path / "wide.c"], name="wide")))
    assert calls[1:] == ["without", "with", "without"]
    assert library.ratio(14, 2) == 7


def test_a_changed_header_is_another_key(source: Path, tmp_path: Path) -> None:
    include = tmp_path / "include"
    include.mkdir()
    (include / "a.h").write_text("/* 1 */")
    first = toolchain.compile_shared([source], name="twice", include=[include])
    (include / "a.h").write_text("/* 2 */")
    assert toolchain.compile_shared([source], name="twice", include=[include]) != first


def test_c_that_changes_while_it_is_compiled_is_not_kept(
    source: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seven = f"/* {uuid4()}: of no earlier run */ {SOURCE.replace('2 * x', '7 * x')}"
    source.write_text(seven)
    ran = toolchain._ran

    def edited(command: list[str]) -> subprocess.CompletedProcess[str]:
        source.write_text(SOURCE.replace("2 * x", "0 * x"))
        return ran(command)

    with monkeypatch.context() as patched:
        patched.setattr(toolchain, "_ran", edited)
        with pytest.raises(ToolchainError, match="twice: its C was changed while it was compiled"):
            toolchain.compile_shared([source], name="twice")
    source.write_text(seven)
    library = ctypes.CDLL(str(toolchain.compile_shared([source], name="twice")))
    library.twice.restype, library.twice.argtypes = ctypes.c_double, [ctypes.c_double]
    assert library.twice(1.0) == 7.0


def test_what_does_not_compile_is_quoted(tmp_path: Path) -> None:
    path = tmp_path / "bad.c"
    path.write_text("int f(void) { return missing; }\n")
    with pytest.raises(ToolchainError, match="missing"):
        toolchain.compile_shared([path], name="bad")


def test_a_cc_that_does_not_exist_is_named(source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(ToolchainError, match="no-such-compiler"):
        toolchain.compile_shared([source], name="twice")


def test_a_cc_that_cannot_compile_is_an_error(
    source: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", "false")
    with pytest.raises(ToolchainError, match=r"status 1 and printed nothing; exp"):
        toolchain.compile_shared([source], name="twice")


def test_a_cc_that_writes_nothing_is_an_error(
    source: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", "true")
    with pytest.raises(ToolchainError, match=r"true reports no error, but wrote no library; exp"):
        toolchain.compile_shared([source], name="twice")


def test_an_unknown_platform_lists_the_known(source: Path) -> None:
    with pytest.raises(ToolchainError, match="linux64"):
        toolchain.compile_shared([source], name="twice", platform="amiga")


def test_cc_is_refused_for_another_platform(source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "true")
    with pytest.raises(ToolchainError, match="this machine only"):
        toolchain.compile_shared([source], name="twice", platform="aarch64-darwin")
