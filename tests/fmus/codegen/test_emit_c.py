"""Emitted C: branches that are skipped and updates in place have the bits of the plain text."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from uuvsim_cosim.fmus.codegen.branches import Block, flat, nodes_of, scheduled
from uuvsim_cosim.fmus.codegen.emit_c import emit_function, emit_tables, emit_update
from uuvsim_cosim.fmus.codegen.equations import equations
from uuvsim_cosim.fmus.codegen.runtime import runtime
from uuvsim_cosim.fmus.codegen.toolchain import compile_shared
from uuvsim_cosim.models.declaration.library import declare

W = 4
HEAD = '#include "uuv_component.h"\n#include "uuv_table.h"\n'


def library(tmp_path: Path, name: str, text: str) -> ctypes.CDLL:
    path = tmp_path / f"{name}.c"
    path.write_text(HEAD + text)
    flags = (f"-DUUV_W={W}", "-Wno-psabi", "-Wno-unused-function")
    return ctypes.CDLL(str(compile_shared([path], name=name, include=runtime(), flags=flags)))


def lanes(values: Any) -> np.ndarray:
    """Copy (n, W) values to where a vector register can be loaded from."""
    values = np.asarray(values, dtype=float).reshape(-1, W)
    room = np.zeros(values.size + 8)
    shift = (-room.ctypes.data // 8) % 8
    out = room[shift : shift + values.size].reshape(values.shape)
    out[:] = values
    return out


def call(function: Any, *arrays: np.ndarray) -> None:
    function(*(ctypes.c_void_p(a.ctypes.data) for a in arrays))


def flat_text(f: Any, name: str) -> str:
    """Return the text without blocks: that of a right-hand side."""
    plain = ca.Function("rhs", f.sx_in(), f.call(f.sx_in()))
    return emit_function(plain, f"{name}(const V *x, V *y)", ("x", "y"))


def compare(tmp_path: Path, f: Any, x: Any) -> None:
    """Evaluate a function of one column with and without blocks, in lanes that differ."""
    text = emit_function(f, "skips(const V *x, V *y)", ("x", "y")) + flat_text(f, "plain")
    text += "UUV_EXPORT void with(const V *x, V *y) { skips(x, y); }\n"
    text += "UUV_EXPORT void without(const V *x, V *y) { plain(x, y); }\n"
    c = library(tmp_path, "branches", text)
    x = lanes(x)
    results = []
    for function in (c["with"], c.without):
        y = lanes(np.zeros((f.numel_out(0), W)))
        call(function, x, y)
        results.append(y.copy())
        for lane in range(W):
            wanted = np.array(f(x[:, lane])).ravel()
            assert y[:, lane] == pytest.approx(wanted, rel=1e-12, abs=1e-12)
    np.testing.assert_array_equal(*results)


def dear(x: Any, n: int = 8) -> Any:
    for _ in range(n):
        x = ca.sin(x) + 0.5 * x
    return x


def blocks_of(items: list[int | Block]) -> list[Block]:
    return [i for i in items if isinstance(i, Block)]


def test_what_only_one_branch_needs_stands_in_one_block(tmp_path: Path) -> None:
    x = ca.SX.sym("x", 3)
    c = x[0] > 0
    a = dear(x[1])
    f = ca.Function("f", [x], [ca.vertcat(ca.if_else(c, a, x[2]), ca.if_else(c, a * a, 1.0))])
    (block,) = blocks_of(scheduled(nodes_of(f)))
    assert len(block.selections) == 2
    compare(tmp_path, f, [[1, -1, -1, -1], [0.1, 0.2, 0.3, 0.4], [5, 6, 7, 8]])
    compare(tmp_path, f, -np.ones((3, W)))


def test_what_the_other_branch_needs_too_is_always_computed(tmp_path: Path) -> None:
    x = ca.SX.sym("x", 3)
    a = dear(x[1])
    f = ca.Function("f", [x], [ca.if_else(x[0] > 0, a * x[2], a + x[2])])
    assert blocks_of(scheduled(nodes_of(f))) == []
    compare(tmp_path, f, np.arange(-6.0, 6.0).reshape(3, W))


def test_blocks_nest(tmp_path: Path) -> None:
    x = ca.SX.sym("x", 3)
    inner = ca.if_else(x[1] > 0, dear(x[2]), dear(x[2] * 2.0, 2))
    f = ca.Function("f", [x], [ca.if_else(x[0] > 0, dear(inner), x[2])])
    (outer,) = blocks_of(scheduled(nodes_of(f)))
    assert len(blocks_of(outer.body)) == 1
    compare(tmp_path, f, [[1, 1, -1, -1], [1, -1, 1, -1], [0.1, 0.2, 0.3, 0.4]])
    compare(tmp_path, f, [[1, 1, -1, -1], [-1, -1, 1, -1], [0.1, 0.2, 0.3, 0.4]])


def test_branches_that_need_each_other_by_turns_are_put_in_order(tmp_path: Path) -> None:
    """s1 by c needs s2 by d, s3 by d needs s4 by c: no two blocks can hold them all."""
    x = ca.SX.sym("x", 4)
    c, d = x[0] > 0, x[1] > 0
    s2, s4 = ca.if_else(d, dear(x[2]), x[3]), ca.if_else(c, dear(x[3]), x[2])
    s1, s3 = ca.if_else(c, dear(s2 + x[2]), 0.5), ca.if_else(d, dear(s4 + x[3]), 0.25)
    f = ca.Function("f", [x], [ca.vertcat(s1, s2, s3, s4)])
    compare(tmp_path, f, np.random.default_rng(1).normal(size=(4, W)))


def test_nothing_of_a_branch_not_taken_gets_out(tmp_path: Path) -> None:
    x = ca.SX.sym("x", 2)
    f = ca.Function("f", [x], [ca.if_else(x[0] > 0, dear(ca.log(x[0]) / x[1]), x[1])])
    compare(tmp_path, f, [[1, -1, -2, -3], [0.5, 0.0, 0.0, 3.0]])


@pytest.mark.parametrize("name", ["navigation", "guidance", "dvl", "usbl", "imu"])
def test_updates_in_place_have_the_bits_of_updates(name: str, tmp_path: Path) -> None:
    eq = equations(declare(name))
    first, n_z = eq.layout.offset["discrete"], eq.layout.count["discrete"]
    text = emit_tables(list(eq.updates))
    for i, f in enumerate(eq.updates):
        text += emit_function(f, f"u{i}(const V *b, const V *w, V *z)", ("b", "w", "z"))
        text += emit_update(f, f"p{i}(V *b, const V *draws, uuv_mask due)", first)
        text += f"UUV_EXPORT void out_{i}(const V *b, const V *w, V *z) {{ u{i}(b, w, z); }}\n"
        text += f"UUV_EXPORT void in_{i}(V *b, const V *w, const uuv_mask *due) {{\n"
        text += f"    p{i}(b, w, *due);\n}}\n"
    c = library(tmp_path, name, text)
    rng = np.random.default_rng(3)
    start = lanes(rng.normal(0.0, 1.0, (eq.layout.size, W)))
    for i, f in enumerate(eq.updates):
        for due in ([1, 1, 1, 1], [1, 0, 0, 1], [0, 1, 0, 0]):
            draws = lanes(rng.normal(size=(f.numel_in(1) + 1, W)))
            z, b = lanes(np.zeros((n_z, W))), lanes(start)
            mask = lanes(np.where(due, -1, 0).astype(np.int64).view(np.float64))
            call(c[f"out_{i}"], b, draws, z)
            call(c[f"in_{i}"], b, draws, mask)
            wanted = start.copy()
            at = slice(first, first + n_z)
            wanted[at] = np.where(np.array(due, bool), z, start[at])
            np.testing.assert_array_equal(b, wanted)
            start[at] = np.where(np.isfinite(wanted[at]), wanted[at], 0.0)


def test_a_right_hand_side_stays_flat() -> None:
    x = ca.SX.sym("x", 2)
    f = ca.Function("rhs", [x], [ca.if_else(x[0] > 0, dear(x[1]), x[1])])
    assert "if (" not in emit_function(f, "rhs(const V *b, V *dx)", ("b", "dx"))
    assert blocks_of(flat(nodes_of(f))) == []


def test_functions_of_one_name_that_differ_in_a_number_keep_their_own_texts() -> None:
    def text(number: float) -> str:
        x = ca.SX.sym("x")
        f = ca.Function("f", [x], [ca.sin(number * x)])
        return emit_function(f, "f(const V *x, V *y)", ("x", "y"))

    assert text(0.1) == text(0.1)
    assert text(0.1) != text(0.1 + 2**-56)
    assert repr(0.1 + 2**-56) in text(0.1 + 2**-56)
