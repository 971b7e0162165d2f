"""uuv_math.h where C99 leaves no room: exact operations, signed zeros, infinities, NaN."""

from __future__ import annotations

import ctypes
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uuvsim_cosim.fmus.codegen.runtime import runtime, runtime_files
from uuvsim_cosim.fmus.codegen.toolchain import compile_shared

Array = np.ndarray[Any, np.dtype[np.float64]]
Call = Callable[..., Array]

SHIM = Path(__file__).with_name("runtime_math_shim.c")
SPECIAL = np.array(
    [0.0, 5e-324, 2.0**-1022, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 1e300, 2.0**52 - 0.5, 2.0**53, np.inf]
)
SPECIAL = np.concatenate([SPECIAL, -SPECIAL, [np.nan]])
X, Y = (a.ravel() for a in np.meshgrid(SPECIAL, SPECIAL))


@pytest.fixture(scope="module")
def call() -> Call:
    path = compile_shared([SHIM], name="runtime_math", include=runtime())
    library = ctypes.CDLL(str(path))

    def evaluate(name: str, *arguments: Any) -> Array:
        arrays = [np.ascontiguousarray(a, dtype=float) for a in np.broadcast_arrays(*arguments)]
        out = np.empty(arrays[0].shape)
        pointers = [ctypes.c_void_p(a.ctypes.data) for a in (*arrays, out)]
        getattr(library, f"array_{name}")(ctypes.c_size_t(out.size), *pointers)
        return out

    return evaluate


def assert_same_bits(got: Array, expected: Any, *arguments: Array) -> None:
    """Take NaN as equal to NaN, and -0 as different from +0."""
    a, b = (np.where(np.isnan(v), np.nan, v).view(np.uint64) for v in (got, np.asarray(expected)))
    wrong = np.flatnonzero(a != b)
    assert wrong.size == 0, [
        (*(float(x[i]) for x in arguments), float(got[i]), float(expected[i])) for i in wrong[:5]
    ]


UNARY = {
    "neg": np.negative, "exp": np.exp, "log": np.log, "sqrt": np.sqrt, "sin": np.sin,
    "cos": np.cos, "tan": np.tan, "asin": np.arcsin, "acos": np.arccos, "atan": np.arctan,
    "floor": np.floor, "ceil": np.ceil, "fabs": np.fabs, "sinh": np.sinh, "cosh": np.cosh,
    "tanh": np.tanh, "asinh": np.arcsinh, "acosh": np.arccosh, "atanh": np.arctanh,
    "log1p": np.log1p, "expm1": np.expm1,
}  # fmt: skip
BINARY = {
    "pow": np.power, "constpow": np.power, "fmod": np.fmod, "copysign": np.copysign,
    "atan2": np.arctan2, "hypot": np.hypot,
}  # fmt: skip


@pytest.mark.parametrize("name", UNARY)
def test_zeros_infinities_and_nan_of_one_argument_are_those_of_c99(call: Call, name: str) -> None:
    with np.errstate(all="ignore"):
        expected = UNARY[name](SPECIAL)
    plain = np.isfinite(expected) & (expected != 0.0)
    got = call(name, SPECIAL)
    assert_same_bits(got[~plain], expected[~plain], SPECIAL[~plain])
    np.testing.assert_allclose(got[plain], expected[plain], rtol=4e-15)


@pytest.mark.parametrize("name", BINARY)
def test_zeros_infinities_and_nan_of_two_arguments_are_those_of_c99(call: Call, name: str) -> None:
    with np.errstate(all="ignore"):
        expected = BINARY[name](X, Y)
    plain = np.isfinite(expected) & (expected != 0.0)
    got = call(name, X, Y)
    assert_same_bits(got[~plain], expected[~plain], X[~plain], Y[~plain])
    np.testing.assert_allclose(got[plain], expected[plain], rtol=4e-15)


ODD = ["sin", "tan", "asin", "atan", "sinh", "tanh", "asinh", "atanh"]


@pytest.mark.parametrize("name", [*ODD, "log1p", "expm1"])
def test_a_tiny_argument_is_its_own_result(call: Call, name: str) -> None:
    rng = np.random.default_rng(1)
    x = rng.choice([-1, 1], 2000) * 10 ** rng.uniform(-323, -17, 2000)
    assert_same_bits(call(name, x), x, x)


@pytest.mark.parametrize("name", ODD)
def test_an_odd_function_is_odd_to_the_last_bit(call: Call, name: str) -> None:
    x = np.random.default_rng(2).normal(0, 0.4, 2000)
    assert_same_bits(call(name, -x), -call(name, x), x)


EXACT: dict[str, Callable[[Array, Array], Any]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "lt": lambda a, b: a < b,
    "le": lambda a, b: a <= b,
    "eq": lambda a, b: a == b,
    "ne": lambda a, b: a != b,
    "and": lambda a, b: (a != 0) & (b != 0),
    "or": lambda a, b: (a != 0) | (b != 0),
    "if_else_zero": lambda a, b: np.where(a != 0, b, 0.0),
}


@pytest.mark.parametrize("name", EXACT)
def test_an_operation_of_two_arguments_is_exact(call: Call, name: str) -> None:
    rng = np.random.default_rng(3)
    a, b = (np.concatenate([s, rng.normal(size=1000)]) for s in (X, Y))
    with np.errstate(all="ignore"):
        expected = np.asarray(EXACT[name](a, b), dtype=float)
    assert_same_bits(call(name, a, b), expected, a, b)


@pytest.mark.parametrize(
    ("name", "function"),
    [
        ("sq", lambda x: x * x),
        ("twice", lambda x: 2 * x),
        ("inv", lambda x: 1 / x),
        ("not", lambda x: (x == 0).astype(float)),
        ("sign", lambda x: np.where(x < 0, -1.0, np.where(x > 0, 1.0, x))),
    ],
)
def test_an_operation_of_one_argument_is_exact(
    call: Call, name: str, function: Callable[[Array], Array]
) -> None:
    with np.errstate(all="ignore"):
        expected = function(SPECIAL)
    assert_same_bits(call(name, SPECIAL), expected, SPECIAL)


def test_a_false_condition_gives_zero_whatever_stands_behind_it(call: Call) -> None:
    behind = np.array([np.nan, np.inf, -np.inf, 3.0])
    assert_same_bits(call("if_else_zero", 0.0, behind), np.zeros(4))
    assert_same_bits(call("if_else", 0.0, behind, 1.0), np.ones(4))
    assert_same_bits(call("select_less", 2.0, np.array([1.0, np.nan])), [1.0, np.nan])


@pytest.mark.parametrize("name", ["fmin", "fmax"])
def test_minimum_and_maximum_swallow_one_nan(call: Call, name: str) -> None:
    nonzero = (X != 0) | (Y != 0)  # of two zeros, C leaves open which one
    x, y = X[nonzero], Y[nonzero]
    assert_same_bits(call(name, x, y), getattr(np, name)(x, y), x, y)


finite = st.floats(allow_nan=False, allow_infinity=False)


@given(x=finite, y=finite.filter(bool))
def test_fmod_and_remainder_are_exact_for_any_ratio(call: Call, x: float, y: float) -> None:
    assert_same_bits(call("fmod", [x], [y]), np.array([math.fmod(x, y)]))
    assert_same_bits(call("remainder", [x], [y]), np.array([math.remainder(x, y)]))


@given(n=st.integers(-(2**52), 2**52 - 1), exponent=st.integers(-1070, 900))
def test_a_tie_of_remainder_goes_to_the_even_quotient(call: Call, n: int, exponent: int) -> None:
    x, y = (2 * n + 1) * 2.0**exponent, 2.0 * 2.0**exponent
    assert_same_bits(call("remainder", [x], [y]), np.array([math.remainder(x, y)]))


def test_the_remainder_next_to_a_multiple_is_exact(call: Call) -> None:
    rng = np.random.default_rng(5)
    y = rng.uniform(1e-3, 1e3, 3000)
    x = rng.integers(1, 2 ** rng.integers(1, 53, 3000)) * y
    x = x + rng.integers(-2, 3, 3000) * np.spacing(x)
    assert_same_bits(call("fmod", x, y), np.fmod(x, y), x, y)
    expected = np.array([math.remainder(a, b) for a, b in zip(x, y, strict=True)])
    assert_same_bits(call("remainder", x, y), expected, x, y)


def test_the_remainder_of_extreme_ratios_is_exact(call: Call) -> None:
    rng = np.random.default_rng(4)
    x, y = (rng.integers(0, 2**64, 500, dtype=np.uint64).view(float) for _ in range(2))
    both = np.isfinite(x) & np.isfinite(y) & (y != 0)
    x, y = x[both], y[both]
    assert_same_bits(call("fmod", x, y), np.fmod(x, y), x, y)
    expected = np.array([math.remainder(a, b) for a, b in zip(x, y, strict=True)])
    assert_same_bits(call("remainder", x, y), expected, x, y)


@given(x=st.floats(0.01, 100.0), n=st.integers(-30, 30))
def test_a_whole_power_of_a_negative_base_has_the_sign_of_its_parity(
    call: Call, x: float, n: int
) -> None:
    sign = -1.0 if n % 2 else 1.0
    assert_same_bits(call("pow", [-x], [n]), sign * call("pow", [x], [n]))


def test_a_broken_power_of_a_negative_base_is_nan(call: Call) -> None:
    assert np.all(np.isnan(call("pow", -2.0, np.array([0.5, -0.5, 1e-300, 2.0**51 + 0.5]))))


def test_every_operation_of_casadi_that_the_emitter_names_exists() -> None:
    from uuvsim_cosim.fmus.codegen.emit_c import NAMED

    text = "".join(f.read_text() for f in runtime_files() if f.suffix == ".h")
    defined = set(re.findall(r"^static inline V (uuv_\w+)\(", text, re.MULTILINE))
    assert set(NAMED.values()) <= defined
