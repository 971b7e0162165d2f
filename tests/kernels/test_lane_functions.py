"""What kernels compile otherwise than FMUs: tables in all lanes at once, and what a step holds."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
import pytest

from uuvsim_cosim.content import content
from uuvsim_cosim.fmus.emit import emit_function
from uuvsim_cosim.fmus.equations import equations
from uuvsim_cosim.fmus.toolchain import compile_shared
from uuvsim_cosim.kernels.held import split
from uuvsim_cosim.models.library import declare

SHIM = Path(__file__).parents[1] / "fmus" / "runtime_table_shim.c"
INCLUDE = [content("fmus", "kernels"), content("fmus", "runtime")]
IN_LANES = ["-DUUV_W=8", "-Wno-psabi", "-DUUV_TABLE_H", "-include", "uuv_lane_table.h"]


@pytest.mark.parametrize("n", [2, 3, 9, 200])
def test_tables_in_lanes_have_the_bits_of_the_runtime(n: int) -> None:
    one, eight = (
        ctypes.CDLL(str(compile_shared([SHIM], name="lane_table", include=INCLUDE, flags=flags)))
        for flags in (["-DUUV_W=1"], IN_LANES)
    )
    rng = np.random.default_rng(n)
    xs, ys = np.sort(rng.normal(size=n)), np.sort(rng.normal(size=5))
    values, rows = rng.normal(size=n), rng.normal(size=(5, n))
    x = np.concatenate([rng.normal(size=400), xs, np.nextafter(xs, 9), np.nextafter(xs, -9)])
    x = np.concatenate([x, [np.nan, np.inf, -np.inf, 50.0, -50.0]])
    x = np.concatenate([x, np.zeros(-len(x) % 8)])
    y = rng.permutation(np.concatenate([rng.normal(size=len(x) - 7), ys, [np.nan, np.inf]]))
    size = ctypes.c_size_t(len(x))

    def p(a: np.ndarray) -> ctypes.c_void_p:
        return ctypes.c_void_p(a.ctypes.data)

    for name in ("table1", "table1_d", "table2", "table2_dx", "table2_dy"):
        results = []
        for library in (one, eight):
            out = np.empty(len(x))
            if name.startswith("table1"):
                getattr(library, name)(size, p(x), p(xs), p(values), n, p(out))
            else:
                table = (p(xs), n, p(ys), 5, p(rows))
                getattr(library, name)(size, p(x), p(y), *table, p(out))
            results.append(out)
        np.testing.assert_array_equal(*results)


def test_the_table_of_a_thruster_is_read_once_a_step() -> None:
    eq = equations(declare("thruster_t200"))
    text = emit_function(eq.rhs, "rhs(const V *b, V *dx)", ("b", "dx"))
    first = eq.layout.offset["state"]
    both, n_held = split(text, lambda cell: cell in (0, first))
    held, rhs = both.split("static void rhs")
    assert "uuv_table2" in held
    assert "uuv_table2" not in rhs
    assert n_held == 1


def test_nothing_that_depends_on_states_or_time_is_held() -> None:
    text = (
        "static void rhs(const V *b, V *dx) {\n    (void)b;\n    (void)dx;\n"
        "    const V t0 = b[1] * b[2];\n    const V t1 = t0 + b[0];\n    const V t2 = uuv_sq(t1);\n"
        "    const V t3 = uuv_const(2.0);\n    const V t4_0 = b[3] * t3;\n"
        "    dx[0] = t2;\n    dx[1] = t4_0;\n    dx[2] = b[3];\n}\n"
    )
    both, n_held = split(text, lambda cell: cell in (0, 3))
    held, rhs = both.split("static void rhs")
    assert n_held == 1
    assert "w[0] = t0;" in held
    assert "t1" not in held
    assert "const V t4_0 = b[3] * t3;" in rhs
    assert "const V t3 = uuv_const(2.0);" in rhs
