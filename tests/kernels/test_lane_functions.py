"""What kernels compile otherwise than FMUs: tables in all lanes at once, and what a step holds."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest

from uuvsim_cosim.cache import cache_dir, content_hash, keep
from uuvsim_cosim.content import content
from uuvsim_cosim.fmus.codegen.emit_c import emit_function
from uuvsim_cosim.fmus.codegen.equations import equations
from uuvsim_cosim.fmus.codegen.held import split
from uuvsim_cosim.fmus.codegen.lowering import lower
from uuvsim_cosim.fmus.codegen.runtime import runtime
from uuvsim_cosim.fmus.codegen.table_data import table_call, table_data
from uuvsim_cosim.fmus.codegen.toolchain import compile_shared
from uuvsim_cosim.kernels.batch.memory import aligned
from uuvsim_cosim.kernels.codegen.declaration import declaration_text
from uuvsim_cosim.kernels.codegen.tables import tables_in_lanes
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.intrinsics.breakpoints import buckets
from uuvsim_cosim.models.intrinsics.table import TABLES, Table, table1, table2
from uuvsim_cosim.models.intrinsics.uniform_grids import uniform_grid

INCLUDE = [content("fmus", "kernels"), *runtime()]


def read_by_kernel(table: Table, dtype: str, width: int, calls: list[str]) -> ctypes.CDLL:
    """Compile the table as kernels have it, with a function over arrays for each call."""
    args = ", ".join(["x", "y"][: table.n_in])
    grids = ", ".join([f"{table.name}_{a}, {len(getattr(table, a))}" for a in "xy"[: table.n_in]])
    if table.n_in == 1:
        grids = f"{table.name}_x, {table.name}_values, {len(table.x)}"
    else:
        grids += f", {table.name}_values"
    body = "".join(
        f"UUV_KERNEL_API void {c}(size_t n, const V *xs, const V *ys, V *out) {{\n"
        "    for (size_t i = 0; i < n; i++) {\n        const V x = xs[i], y = ys[i];\n"
        f"        out[i] = uuv_{c}({args}, {grids});\n        (void)y;\n    }}\n}}\n"
        for c in calls
    )
    tables, body = tables_in_lanes(body, np.dtype(dtype))
    head = '#include <stddef.h>\n#include "uuv_lane_component.h"\n#include "uuv_lane_record.h"\n'
    source = cache_dir("generated", content_hash([head, tables, body])) / "table.c"
    keep(source, (head + tables + body).encode())
    flags = [f"-DUUV_W={width}", "-Wno-psabi"]
    flags += ["-DUUV_FLOAT32", "-ffp-contract=fast"] if dtype == "float32" else []
    return ctypes.CDLL(str(compile_shared([source], name="table", include=INCLUDE, flags=flags)))


def every(
    library: ctypes.CDLL, name: str, x: np.ndarray, y: np.ndarray, width: int, dtype: str
) -> np.ndarray:
    blocks = aligned((3, len(x)), dtype)
    blocks[0], blocks[1] = x, y
    pointers = [ctypes.c_void_p(b.ctypes.data) for b in blocks]
    getattr(library, name)(ctypes.c_size_t(len(x) // width), *pointers)
    return np.array(blocks[2])


def arguments(knots: np.ndarray, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    x = np.concatenate(
        [rng.normal(size=400), knots, np.nextafter(knots, 9), np.nextafter(knots, -9)]
    )
    x = np.concatenate([x, [np.nan, np.inf, -np.inf, 50.0, -50.0, 0.0, -0.0]])
    return rng.permutation(np.concatenate([x, np.zeros(-len(x) % 64)]))


def table_of(n: int, ny: int) -> Table:
    rng = np.random.default_rng(n)
    xs, ys = np.sort(rng.normal(size=n)), np.sort(rng.normal(size=ny))
    if ny == 0:
        table1(xs.tolist(), rng.normal(size=n).tolist())
    else:
        table2(xs.tolist(), ys.tolist(), rng.normal(size=(ny, n)).tolist())
    return next(t for t in TABLES.values() if (t.x, t.y or ()) == (tuple(xs), tuple(ys)))


CALLS = {1: ["table1", "table1_d"], 2: ["table2", "table2_dx", "table2_dy"]}


@pytest.mark.parametrize("width", [1, 4, 8, 16])
@pytest.mark.parametrize(("n", "ny"), [(2, 0), (3, 0), (9, 0), (200, 0), (2, 2), (40, 2), (30, 5)])
def test_tables_in_lanes_are_the_table_to_the_last_bit(n: int, ny: int, width: int) -> None:
    table = table_of(n, ny)
    x = arguments(np.array(table.x), 1)
    y = np.resize(arguments(np.array(table.y or (0.0,)), 2), len(x))
    library = read_by_kernel(table, "float64", width, CALLS[table.n_in])
    for name in CALLS[table.n_in]:
        functions = {"": table.__call__, "_d": table.dx, "_dx": table.dx, "_dy": table.dy}
        function = functions[name[6:]]
        got = every(library, name, x, y, width, "float64")
        defined = ~np.isnan(x) & ~np.isnan(y) if "_" in name else np.full(len(x), True)
        pairs = zip(x[defined], y[defined], strict=True)
        some = [function(*pair[: table.n_in]) for pair in pairs]
        np.testing.assert_array_equal(got[defined], some)
        if table.n_in == 1:
            assert np.isnan(got[np.isnan(x)]).all()


def as_called(table: Table, dtype: str, width: int, *, runtime: bool) -> ctypes.CDLL:
    """Compile the call that FMUs make of a table, as they have it or as kernels do."""
    call = table_call(table.name, "", ["xs[i]", "ys[i]"][: table.n_in])
    body = (
        "UUV_KERNEL_API void read(size_t n, const V *xs, const V *ys, V *out) {\n"
        "    (void)ys;\n    for (size_t i = 0; i < n; i++) {\n"
        f"        out[i] = {call};\n    }}\n}}\n"
    )
    tables = table_data(table.name)
    if not runtime:
        tables, body = tables_in_lanes(body, np.dtype(dtype))
    names = ["stddef.h", "uuv_lane_component.h", "uuv_lane_lines.h", "uuv_lane_record.h"]
    names += ["uuv_table.h"] if runtime else []
    text = "".join(f'#include "{n}"\n' for n in names) + tables + body
    source = cache_dir("generated", content_hash([text])) / "table.c"
    keep(source, text.encode())
    flags = [f"-DUUV_W={width}", "-Wno-psabi"]
    flags += ["-DUUV_FLOAT32", "-ffp-contract=fast"] if dtype == "float32" else []
    return ctypes.CDLL(str(compile_shared([source], name="table", include=INCLUDE, flags=flags)))


def shipped_tables() -> list[Table]:
    # Of these alone: which others were declared in this process depends on the user's cache.
    models = [lower(declare(name)) for name in ("thruster_t200", "battery", "allocation")]
    codes = [text for model in models for text in model.files.values()]
    forms = {id(t): t for t in TABLES.values() if uniform_grid(t) or buckets(t)}
    used = [t for t in forms.values() if any(t.name in code for code in codes)]
    return sorted((t for t in used if len(t.x) > 9), key=lambda t: t.name)


@pytest.mark.parametrize("table", shipped_tables(), ids=lambda t: t.name)
def test_the_form_of_a_table_is_the_table_with_the_same_bits_everywhere(table: Table) -> None:
    x = arguments(np.array(table.x), 1)
    x[:100] *= max(np.abs(table.x))
    y = np.resize(arguments(np.array(table.y or (0.0,)), 2), len(x))
    y[:200] = np.random.default_rng(3).uniform(11.0, 17.0, 200)
    results = [
        every(as_called(table, "float64", w, runtime=r), "read", x, y, w, "float64")
        for w, r in ((1, True), (8, True), (1, False), (4, False), (8, False), (16, False))
    ]
    for other in results[1:]:
        np.testing.assert_array_equal(other, results[0])
    wanted = np.array([table(*pair[: table.n_in]) for pair in zip(x, y, strict=True)])
    np.testing.assert_allclose(results[0], wanted, rtol=1e-12, atol=1e-10)
    knots = np.isin(x, table.x) & ~np.isnan(y)
    assert np.array_equal(results[0][knots] == 0.0, wanted[knots] == 0.0)


@pytest.mark.parametrize("width", [4, 8, 16, 32])
@pytest.mark.parametrize("table", shipped_tables(), ids=lambda t: t.name)
def test_the_form_of_a_table_in_float32_is_near_it(table: Table, width: int) -> None:
    rng = np.random.default_rng(4)
    x = rng.uniform(table.x[0], table.x[-1], 512).astype(np.float32)
    y = rng.uniform(11.0, 17.0, 512).astype(np.float32)
    got = every(as_called(table, "float32", width, runtime=False), "read", x, y, width, "float32")
    pairs = zip(x.astype(float), y.astype(float), strict=True)
    wanted = np.array([table(*pair[: table.n_in]) for pair in pairs])
    steepest = max(abs(table.dx(*pair[: table.n_in])) for pair in zip(x, y, strict=True))
    largest = max(map(abs, table.x))
    np.testing.assert_allclose(got, wanted, rtol=3e-6, atol=1e-5 + 3e-7 * steepest * largest)


@pytest.mark.parametrize("width", [4, 8, 16, 32])
@pytest.mark.parametrize(("n", "ny"), [(2, 0), (9, 0), (200, 0), (40, 2), (30, 5)])
def test_float32_tables_bend_where_the_table_does(n: int, ny: int, width: int) -> None:
    table = table_of(n, ny)
    x = arguments(np.array(table.x), 1).astype(np.float32).astype(float)
    y = (
        np.resize(arguments(np.array(table.y or (0.0,)), 2), len(x))
        .astype(np.float32)
        .astype(float)
    )
    steepest = (
        np.abs(np.diff(np.reshape(table.values, (max(1, ny), n)))).max() / np.diff(table.x).min()
    )
    if ny:
        rows = np.diff(np.reshape(table.values, (ny, n)), axis=0)
        steepest += np.abs(rows).max() / np.diff(table.y).min()
    name = CALLS[table.n_in][0]
    library = read_by_kernel(table, "float32", width, [name])
    wanted = np.array([table(*pair[: table.n_in]) for pair in zip(x, y, strict=True)])
    got = every(library, name, x, y, width, "float32")
    np.testing.assert_allclose(got, wanted, rtol=3e-6, atol=1e-5 + 1e-6 * steepest)


def test_the_table_of_a_thruster_is_read_once_a_step() -> None:
    eq = equations(declare("thruster_t200"))
    text = emit_function(eq.rhs, "rhs(const V *b, V *dx)", ("b", "dx"))
    first = eq.layout.offset["state"]
    both, n_held = split(text, lambda cell: cell in (0, first))
    held, rhs = both.split("static void rhs")
    assert "uuv_uniform2" in held
    assert "uuv_uniform2" not in rhs
    assert n_held == 1


def test_what_a_thruster_reads_at_its_command_is_read_together() -> None:
    text = declaration_text(equations(declare("thruster_t200")), np.dtype("float64"))
    held = text.split("static void held(")[1].split("\n}\n")[0]
    step = text.split("static void outputs_of_step(")[1].split("\n}\n")[0]
    assert held.count("_at_uniform(") == held.count("uuv_lane_pair") == 1
    assert step.count("_at_") == step.count("_at_buckets(") == 1


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


def test_in_float32_a_division_by_a_parameter_is_done_once_a_step() -> None:
    text = (
        "static void rhs(const V *b, V *dx) {\n    (void)b;\n    (void)dx;\n"
        "    const V t0 = b[1] - b[2];\n    const V t1 = t0 / b[3];\n    dx[0] = t1;\n}\n"
    )
    both, _ = split(text, lambda cell: cell in (0, 2), invert=True)
    held, rhs = both.split("static void rhs")
    assert "uuv_inv" in held
    assert " / " not in rhs
    assert "uuv_inv" not in rhs
