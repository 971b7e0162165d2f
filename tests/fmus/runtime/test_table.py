"""uuv_table.h against numpy.interp, closed forms and the Python table that models evaluate."""

from __future__ import annotations

import ctypes
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.fmus.codegen.runtime import runtime
from uuvsim_cosim.fmus.codegen.toolchain import compile_shared
from uuvsim_cosim.models.intrinsics.table import Table

SHIM = Path(__file__).with_name("runtime_table_shim.c")
COMPILERS = ["zig", *(["gcc"] if shutil.which("gcc") else [])]
Array = np.ndarray[Any, np.dtype[np.float64]]
Call = Callable[..., Array]


def library(compiler: str, w: int) -> Call:
    """Return ``call(name, arguments, *table)``; a table is knots and values, as in uuv_table.h."""
    with pytest.MonkeyPatch.context() as patch:
        if compiler == "zig":
            patch.delenv("CC", raising=False)
        else:
            patch.setenv("CC", compiler)
        flags = [f"-DUUV_W={w}", "-Wno-psabi"]
        include = runtime()
        path = compile_shared([SHIM], name="runtime_table", include=include, flags=flags)
    functions = ctypes.CDLL(str(path))

    def call(name: str, arguments: tuple[Array, ...], *table: Array) -> Array:
        n = len(arguments[0])
        padded = [np.append(a, np.zeros(-n % 8)) for a in arguments]
        out = np.empty(len(padded[0]))
        *knots, values = (np.ascontiguousarray(a, dtype=float) for a in table)
        words: list[Any] = [ctypes.c_size_t(len(out))]
        words += [ctypes.c_void_p(a.ctypes.data) for a in padded]
        if len(knots) == 1:
            words += [ctypes.c_void_p(a.ctypes.data) for a in (*knots, values)]
            words += [ctypes.c_int(len(values))]
        else:
            for k in knots:
                words += [ctypes.c_void_p(k.ctypes.data), ctypes.c_int(len(k))]
            words += [ctypes.c_void_p(values.ctypes.data)]
        getattr(functions, name)(*words, ctypes.c_void_p(out.ctypes.data))
        return out[:n]

    return call


@pytest.fixture(scope="module", params=[(c, w) for c in COMPILERS for w in (1, 8)], ids=str)
def call(request: pytest.FixtureRequest) -> Call:
    return library(*request.param)


RNG = np.random.default_rng(1)
XS, YS = np.sort(RNG.normal(size=9)), np.sort(RNG.normal(size=5))
VALUES, ROWS = RNG.normal(size=9), RNG.normal(size=(5, 9))
INSIDE_X = RNG.uniform(XS[0], XS[-1], 500)
INSIDE_Y = RNG.uniform(YS[0], YS[-1], 500)
# Inside, outside, on knots and next to them; each x with another y.
AT_X = np.concatenate([INSIDE_X, [XS[0] - 5, XS[-1] + 5, -np.inf, np.inf, np.nan], XS,
                       np.nextafter(XS, -9), np.nextafter(XS, 9)])  # fmt: skip
AT_Y = np.concatenate([RNG.uniform(-3, 3, len(AT_X) - 7), [-np.inf, np.nan], YS])
AT_Y = RNG.permutation(AT_Y)


def same_bits(a: Array, b: Array) -> bool:
    return bool(np.all((a == b) | (np.isnan(a) & np.isnan(b))))


def test_a_table_has_the_values_of_numpy_interp(call: Call) -> None:
    x = AT_X[np.isfinite(AT_X)]
    np.testing.assert_allclose(
        call("table1", (x,), XS, VALUES), np.interp(x, XS, VALUES), rtol=1e-14, atol=1e-15
    )


def test_a_table_of_two_rows_has_the_values_of_numpy_interp(call: Call) -> None:
    x, xs, ys = np.linspace(-1, 3, 101), np.array([0.0, 2.0]), np.array([1.0, -4.0])
    np.testing.assert_allclose(call("table1", (x,), xs, ys), np.interp(x, xs, ys), atol=1e-15)


def test_a_knot_has_its_value_exactly(call: Call) -> None:
    np.testing.assert_array_equal(call("table1", (XS,), XS, VALUES), VALUES)
    y, x = np.meshgrid(YS, XS, indexing="ij")
    values = call("table2", (x.ravel(), y.ravel()), XS, YS, ROWS)
    np.testing.assert_array_equal(values, ROWS.ravel())


def test_a_table_is_held_beyond_its_ends(call: Call) -> None:
    x = np.array([XS[0] - 1e-9, -1e300, -np.inf, XS[-1] + 1e-9, 1e300, np.inf])
    expected = VALUES[[0, 0, 0, -1, -1, -1]]
    np.testing.assert_array_equal(call("table1", (x,), XS, VALUES), expected)
    np.testing.assert_array_equal(call("table1_d", (x,), XS, VALUES), np.zeros(6))


@pytest.mark.parametrize("name", ["table1", "table1_d"])
def test_nan_gives_nan(call: Call, name: str) -> None:
    assert np.isnan(call(name, (np.array([np.nan]),), XS, VALUES)[0])


@pytest.mark.parametrize("name", ["table2", "table2_dx", "table2_dy"])
def test_nan_in_either_argument_gives_nan(call: Call, name: str) -> None:
    x, y = np.array([np.nan, 0.1]), np.array([0.1, np.nan])
    assert np.all(np.isnan(call(name, (x, y), XS, YS, ROWS)))


def test_the_slope_is_the_difference_quotient_between_knots(call: Call) -> None:
    i = np.searchsorted(XS, INSIDE_X, side="right") - 1
    slopes = np.diff(VALUES) / np.diff(XS)
    np.testing.assert_allclose(
        call("table1_d", (INSIDE_X,), XS, VALUES), slopes[i], rtol=1e-15, atol=0
    )


def test_the_slope_at_a_knot_is_that_to_its_right(call: Call) -> None:
    slopes = np.append(np.diff(VALUES) / np.diff(XS), 0.0)
    np.testing.assert_allclose(call("table1_d", (XS,), XS, VALUES), slopes, rtol=1e-15, atol=0)


def test_a_table_of_rows_reproduces_a_bilinear_function(call: Call) -> None:
    def f(x: Array, y: Array) -> Array:
        return 2.0 + 3.0 * x - y + 0.5 * x * y

    rows = f(XS[None, :], YS[:, None])
    at = (INSIDE_X, INSIDE_Y)
    np.testing.assert_allclose(call("table2", at, XS, YS, rows), f(*at), rtol=0, atol=1e-13)
    dx = call("table2_dx", at, XS, YS, rows)
    dy = call("table2_dy", at, XS, YS, rows)
    np.testing.assert_allclose(dx, 3.0 + 0.5 * INSIDE_Y, rtol=0, atol=1e-11)
    np.testing.assert_allclose(dy, -1.0 + 0.5 * INSIDE_X, rtol=0, atol=1e-11)


def test_a_table_of_rows_is_linear_between_its_rows(call: Call) -> None:
    rows = [np.interp(INSIDE_X, XS, row) for row in ROWS]
    expected = [
        np.interp(y, YS, column) for y, column in zip(INSIDE_Y, np.transpose(rows), strict=True)
    ]
    got = call("table2", (INSIDE_X, INSIDE_Y), XS, YS, ROWS)
    np.testing.assert_allclose(got, expected, rtol=1e-13, atol=1e-14)


def test_partial_derivatives_are_the_differences_of_the_values(call: Call) -> None:
    h = 1e-7
    near = (abs(INSIDE_X[:, None] - XS) < h).any(1) | (abs(INSIDE_Y[:, None] - YS) < h).any(1)
    x, y = INSIDE_X[~near], INSIDE_Y[~near]

    def f(x: Array, y: Array) -> Array:
        return call("table2", (x, y), XS, YS, ROWS)

    along_x, along_y = ((f(x + h, y) - f(x - h, y)), (f(x, y + h) - f(x, y - h)))
    dx = call("table2_dx", (x, y), XS, YS, ROWS)
    dy = call("table2_dy", (x, y), XS, YS, ROWS)
    np.testing.assert_allclose(along_x / (2 * h), dx, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(along_y / (2 * h), dy, rtol=1e-6, atol=1e-7)


def test_c_and_python_have_the_same_bits(call: Call) -> None:
    line = Table("line", tuple(XS), (), tuple(VALUES))
    assert same_bits(call("table1", (AT_X,), XS, VALUES), np.array([line(x) for x in AT_X]))
    x, y = AT_X[~np.isnan(AT_X + AT_Y)], AT_Y[~np.isnan(AT_X + AT_Y)]
    area = Table("area", tuple(XS), tuple(YS), tuple(ROWS.ravel()))
    for name, f in (("table2", area), ("table2_dx", area.dx), ("table2_dy", area.dy)):
        expected = np.array([f(a, b) for a, b in zip(x, y, strict=True)])
        assert same_bits(call(name, (x, y), XS, YS, ROWS), expected), name


def test_every_build_gives_the_same_bits(call: Call) -> None:
    reference = library("zig", 1)
    for name in ("table1", "table1_d"):
        at: tuple[Array, ...] = (AT_X,)
        assert same_bits(call(name, at, XS, VALUES), reference(name, at, XS, VALUES)), name
    for name in ("table2", "table2_dx", "table2_dy"):
        at = (AT_X, AT_Y)
        assert same_bits(call(name, at, XS, YS, ROWS), reference(name, at, XS, YS, ROWS)), name
