"""float32 functions of kernels: within a few ulp of float64's, with C's edge cases."""

from __future__ import annotations

import ctypes
import math
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from uuvsim_cosim.content import content
from uuvsim_cosim.fmus.codegen.emit_c import NAMED
from uuvsim_cosim.fmus.codegen.runtime import runtime
from uuvsim_cosim.fmus.codegen.toolchain import compile_shared

SHIM = Path(__file__).parent / "float_math_shim.c"
INCLUDE = [content("fmus", "kernels"), *runtime()]
FLAGS = ["-DUUV_FLOAT32", "-Wno-psabi", "-ffp-contract=fast"]
INF, NAN = np.inf, np.nan
EDGES = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    -0.5,
    2.0,
    1e-45,
    -1e-45,
    1e-38,
    3.4e38,
    -3.4e38,
    INF,
    -INF,
    NAN,
]
NEAR = np.geomspace(1e-30, 1.0, 4000)

# name: (reference in float64, arguments, largest error in ulp)
REFERENCE: dict[str, tuple[Callable[[np.ndarray], np.ndarray], np.ndarray, float]] = {
    "exp": (np.exp, np.linspace(-104, 89, 20000), 1.5),
    "log": (np.log, np.geomspace(1e-44, 3e38, 20000), 1.5),
    "sqrt": (np.sqrt, np.geomspace(1e-44, 3e38, 20000), 0.51),
    "sin": (np.sin, np.linspace(-3000, 3000, 40000), 1.5),
    "cos": (np.cos, np.linspace(-3000, 3000, 40000), 1.5),
    "tan": (np.tan, np.linspace(-30, 30, 40000), 3.5),
    "asin": (np.arcsin, np.linspace(-1, 1, 20000), 2.5),
    "acos": (np.arccos, np.linspace(-1, 1, 20000), 2.5),
    "atan": (np.arctan, np.tan(np.linspace(-1.57, 1.57, 20000)), 2.5),
    "sinh": (np.sinh, np.linspace(-89, 89, 20000), 1.0),
    "cosh": (np.cosh, np.linspace(-89, 89, 20000), 1.0),
    "tanh": (np.tanh, np.linspace(-12, 12, 20000), 2.5),
    "asinh": (np.arcsinh, np.linspace(-90, 90, 20000), 1.0),
    "acosh": (np.arccosh, np.geomspace(1, 3e38, 20000), 1.0),
    "atanh": (np.arctanh, np.linspace(-0.999999, 0.999999, 20000), 1.0),
    "log1p": (np.log1p, np.geomspace(1e-6, 1e30, 20000) - 0.999999, 1.0),
    "expm1": (np.expm1, np.linspace(-30, 88, 20000), 1.0),
}
ODD = ("sin", "tan", "asin", "atan", "sinh", "tanh", "asinh", "atanh", "log1p", "expm1")


def padded(x: np.ndarray) -> np.ndarray:
    return np.concatenate([x, np.ones(-len(x) % 32)]).astype(np.float32)


@pytest.fixture(scope="module", params=["zig 16", "zig 4", "zig 16 native", "gcc 16"])
def shim(request: pytest.FixtureRequest) -> ctypes.CDLL:
    compiler, width, *native = request.param.split()
    flags = [*FLAGS, f"-DUUV_W={width}", *(["-mcpu=native"] if native else [])]
    with pytest.MonkeyPatch.context() as patch:
        if compiler == "zig":
            patch.delenv("CC", raising=False)
        elif shutil.which(compiler) is None:
            pytest.skip(f"no {compiler} here; zig is what users have")
        else:
            patch.setenv("CC", compiler)
        return ctypes.CDLL(
            str(compile_shared([SHIM], name="float_math", include=INCLUDE, flags=flags))
        )


def call(library: ctypes.CDLL, name: str, *arguments: np.ndarray) -> np.ndarray:
    out = np.empty_like(arguments[0])
    pointers = [ctypes.c_void_p(a.ctypes.data) for a in (*arguments, out)]
    getattr(library, f"array_{name}")(ctypes.c_size_t(len(out)), *pointers)
    return out


def ulps(got: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Error in units of the last place of the float32 next to what is wanted."""
    with np.errstate(over="ignore"):
        size = np.spacing(np.abs(wanted.astype(np.float32))).astype(float)
    finite = np.isfinite(wanted) & (np.abs(wanted) < 3.4e38)
    assert (np.isnan(got) == np.isnan(wanted)).all()
    with np.errstate(invalid="ignore"):
        error = np.abs(got.astype(float) - wanted) / size
    return np.where(finite, error, 0.0)


@pytest.mark.parametrize("name", REFERENCE)
def test_a_function_is_within_a_few_ulp(shim: ctypes.CDLL, name: str) -> None:
    reference, arguments, bound = REFERENCE[name]
    more = np.concatenate([NEAR, -NEAR]) if name in ODD else np.zeros(0)
    x = padded(np.concatenate([arguments, more]))
    if name == "acosh":
        x = np.maximum(x, np.float32(1))
    with np.errstate(all="ignore"):
        wanted = reference(x.astype(float))
    error = ulps(call(shim, name, x), wanted)
    assert error.max() <= bound, (name, x[error.argmax()], error.max())


def test_angles_however_large_are_reduced(shim: ctypes.CDLL) -> None:
    x = padded(np.random.default_rng(1).uniform(13.0, 127.9, 4000))
    x = np.exp2(x.astype(float)).astype(np.float32) * np.where(np.arange(len(x)) % 2, 1, -1)
    x = x.astype(np.float32)
    for name, reference in (("sin", np.sin), ("cos", np.cos)):
        assert ulps(call(shim, name, x), reference(x.astype(float))).max() <= 1.5


@pytest.mark.parametrize("name", REFERENCE)
def test_edges_are_those_of_c(shim: ctypes.CDLL, name: str) -> None:
    x = padded(np.array(EDGES))
    with np.errstate(all="ignore"):
        wanted = REFERENCE[name][0](x.astype(float)).astype(np.float32)
    got = call(shim, name, x)
    infinite = np.isinf(wanted)
    assert (np.isnan(got) == np.isnan(wanted)).all(), (x, got, wanted)
    np.testing.assert_array_equal(got[infinite], wanted[infinite])
    zero = wanted == 0
    np.testing.assert_array_equal(np.signbit(got[zero]), np.signbit(wanted[zero]))
    np.testing.assert_array_equal(got[zero], wanted[zero])


BINARY: dict[str, tuple[Callable[[np.ndarray, np.ndarray], np.ndarray], float]] = {
    "atan2": (np.arctan2, 3.0),
    "hypot": (np.hypot, 0.51),
    "pow": (np.power, 0.6),
    "constpow": (np.power, 0.6),
    "fmod": (np.fmod, 0.0),
    "remainder": (np.vectorize(math.remainder, otypes=[float]), 0.0),
}


@pytest.mark.parametrize("name", BINARY)
def test_a_function_of_two_is_within_a_few_ulp(shim: ctypes.CDLL, name: str) -> None:
    reference, bound = BINARY[name]
    rng = np.random.default_rng(5)
    x, y = (padded(rng.normal(size=8000) * 10.0 ** rng.uniform(-6, 6, 8000)) for _ in range(2))
    if "pow" in name:
        x, y = np.abs(x), padded(rng.uniform(-9, 9, 8000))
    with np.errstate(all="ignore"):
        wanted = reference(x.astype(float), y.astype(float))
    error = ulps(call(shim, name, x, y), wanted)
    assert error.max() <= bound, (x[error.argmax()], y[error.argmax()], error.max())


@pytest.mark.parametrize("name", ["atan2", "hypot", "pow", "fmod", "fmin", "fmax"])
def test_edges_of_two_are_those_of_c(shim: ctypes.CDLL, name: str) -> None:
    more = {"fmin": np.fmin, "fmax": np.fmax}
    reference = more[name] if name in more else BINARY[name][0]
    x, y = (padded(a.ravel()) for a in np.meshgrid(EDGES, EDGES))
    with np.errstate(all="ignore"):
        wanted = reference(x.astype(float), y.astype(float)).astype(np.float32)
    got = call(shim, name, x, y)
    np.testing.assert_allclose(got, wanted, rtol=3e-7, atol=0)
    if name in ("atan2", "fmod", "pow"):
        signs = ~np.isnan(wanted)
        np.testing.assert_array_equal(np.signbit(got[signs]), np.signbit(wanted[signs]))


def test_exact_functions_are_exact(shim: ctypes.CDLL) -> None:
    rng = np.random.default_rng(9)
    x = padded(np.concatenate([rng.normal(size=4000) * 100, EDGES, np.arange(-9, 9, 0.5)]))
    exact = {
        "floor": np.floor,
        "ceil": np.ceil,
        "fabs": np.abs,
        "sign": np.sign,
        "neg": np.negative,
    }
    for name, reference in exact.items():
        np.testing.assert_array_equal(call(shim, name, x), reference(x))


def test_every_operation_of_the_emitter_has_a_float32_form(shim: ctypes.CDLL) -> None:
    missing = [n for n in NAMED.values() if not hasattr(shim, n.replace("uuv_", "array_"))]
    assert missing == []
