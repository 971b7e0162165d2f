"""Libraries for Windows are linked with two dozen functions of ucrtbase.dll, not with mingw-w64."""

from __future__ import annotations

from pathlib import Path

import pytest

from uuvsim_cosim.fmus.codegen.toolchain import (
    FLAGS,
    compile_shared,
    compiler,
    linked_lightly,
)

WHOLE = """
#include <stdio.h>
#include <stdlib.h>
static _Thread_local int kept[4];
__declspec(dllexport) int f(int n, char *text) {
    volatile double many[4096]; /* more than a page of the stack */
    many[n] = kept[n & 3]++;
    return snprintf(text, 8, "%g", many[n]);
}
"""


@pytest.fixture(autouse=True)
def zig(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CC", raising=False)


def test_texts_threads_and_large_frames_need_ucrtbase_alone(tmp_path: Path) -> None:
    source = tmp_path / "whole.c"
    source.write_text(WHOLE)
    library = compile_shared([source], name="whole", platform="win64").read_bytes()
    assert b"ucrtbase.dll" in library
    assert b"api-ms-win" not in library  # what mingw-w64 imports from


def test_what_needs_more_of_c_is_left_to_the_whole_of_it(tmp_path: Path) -> None:
    source = tmp_path / "more.c"
    source.write_text("double cbrt(double); double f(double x) { return cbrt(x); }")
    arguments = ["-target", "x86_64-windows-gnu", *FLAGS]
    made = tmp_path / "more.dll"
    assert not linked_lightly(compiler()[0], arguments, [], [source], tmp_path, made)
