"""A network gives the same bits as callback, component and kernel, and derivatives in each."""

import ctypes
from itertools import pairwise
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.fmus.codegen.lowering import lower
from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.kernels.kernel import fuse
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.intrinsics.network import Activation, Layer, network, sums
from uuvsim_cosim.orchestrator.system import resolve
from uuvsim_cosim.orchestrator.system.sources import ModelSource
from uuvsim_cosim.orchestrator.system.system import System

N_IN = 5


def layers(sizes: list[int], activation: Activation, seed: int = 0) -> list[Layer]:
    r = np.random.default_rng(seed)
    pairs = list(pairwise(sizes))
    return [
        Layer(
            (r.normal(size=(b, a)) / np.sqrt(a)).astype(np.float32),
            r.normal(size=b).astype(np.float32),
            activation if i + 1 < len(pairs) else "linear",
        )
        for i, (a, b) in enumerate(pairs)
    ]


RELU = layers([N_IN, 37, 19, 3], "relu")
TANH = layers([N_IN, 21, 2], "tanh", 1)


def declared() -> Model:
    """A network in the outputs, one in a right-hand side, one behind a condition in an update."""
    m = Model("networks")
    x = m.input("x", N_IN, unit="1")
    gain = m.parameter("gain", 0.5, unit="1")
    m.output("y", ca.vertcat(network(RELU)(x), network(TANH)(gain * x)), unit="1")
    s = m.state("s", 0.1, unit="1")
    m.der(s, network(TANH)(ca.vertcat(s, x[1:]))[0] - s + network(RELU)(x)[1])
    z = m.discrete("z", (0.0, 0.0), unit="1")
    m.update(m.clock("sample", "0.1"), z, ca.if_else(x[0] > 0, network(TANH)(x + s), z))
    m.output("out", ca.vertcat(s, z), unit="1")
    return m


class Declared(ModelSource):
    def declaration(self) -> Model:
        return declared()


@pytest.fixture(scope="module")
def native() -> Native:
    return Native(declared(), "networks")


def lived(native: Native, x: np.ndarray, steps: int = 6) -> np.ndarray:
    c = native.another("networks")
    v = c.description.variables
    c.enter_initialization_mode(0.0, None)
    c.set(v["x"], x)
    c.exit_initialization_mode()
    for k in range(steps):
        c.do_step(k / 20, 0.05)
    return np.concatenate([c.get(v["y"]), c.get(v["out"])])


@settings(deadline=None, max_examples=20)
@given(st.lists(st.floats(-1e3, 1e3, width=32), min_size=N_IN, max_size=N_IN))
def test_c_gives_the_bits_of_the_callback(native: Native, x: list[float]) -> None:
    at = ca.SX.sym("x", N_IN)
    f = ca.Function("f", [at], [ca.vertcat(network(RELU)(at), network(TANH)(0.5 * at))])
    assert np.array_equal(lived(native, np.array(x), 0)[:5], np.array(f(x)).ravel())


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_lanes_of_a_kernel_give_the_bits_of_the_component(
    native: Native, dtype: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(resolve._factories, "networks", lambda text, _: Declared(text))
    kernel = fuse(System("one", "0.05").add("n", "networks:one"), dtype=dtype)
    x = np.random.default_rng(3).normal(size=(11, N_IN))
    with kernel.batch(11, start={"n.x": x}) as batch:
        batch.step(6)
        got = np.concatenate([batch.get("n.y"), batch.get("n.out")], axis=1)
    want = np.array([lived(native, row) for row in x])
    if dtype == "float64":
        assert np.array_equal(got, want)
    else:
        assert np.allclose(got, want, rtol=1e-4, atol=1e-5)


def test_forward_derivatives_in_c_are_those_of_casadi(native: Native) -> None:
    lowered = lower(declared())
    r = np.random.default_rng(5)
    x, seed = r.normal(size=N_IN), r.normal(size=N_IN + 1)
    c = native.another("networks")
    c.enter_initialization_mode(0.0, None)
    c.set(c.description.variables["x"], x)
    c.exit_initialization_mode()
    rows = sum(p.variable.size for p in lowered.layout.placed if p.variable.kind == "output") + 1
    out = np.zeros(rows)
    library: Any = c._c
    library.uuv_forward.argtypes = [ctypes.c_void_p] * 3
    library.uuv_forward(c._instance, seed.ctypes.data, out.ctypes.data)
    block = np.array(c._block)[: lowered.equations.forward.size1_in(0)]
    want = np.array(lowered.equations.forward(block, seed)).ravel()
    assert np.allclose(out, want, rtol=1e-5, atol=1e-6)
    at = ca.SX.sym("x", N_IN)
    jacobian = np.array(ca.Function("J", [at], [ca.jacobian(network(RELU)(at), at)])(x))
    assert np.allclose(out[:3], jacobian @ seed[:N_IN], rtol=1e-5, atol=1e-6)


def test_a_kernel_with_networks_has_tangents_and_adjoints(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tangents as finite differences (float32, away from kinks), adjoints as their transposes."""
    monkeypatch.setitem(resolve._factories, "networks", lambda text, _: Declared(text))
    kernel = fuse(System("one", "0.05").add("n", "networks:one"), lanes=4)
    r = np.random.default_rng(11)
    start = {"n.x": r.normal(size=(3, N_IN)), "n.gain": np.array([0.5, 0.6, 0.7])}
    along = {name: r.normal(size=value.shape) for name, value in start.items()}
    seen = ["n.y", "n.out"]
    values, changes = kernel.jvp(start, along, seen, steps=6, n_envs=3)

    def moved(h: float) -> dict[str, np.ndarray]:
        given = {name: value + h * along[name] for name, value in start.items()}
        return kernel.jvp(given, {}, seen, steps=6, n_envs=3)[0]

    up, down = moved(1e-4), moved(-1e-4)
    _, pull = kernel.vjp(start, seen, steps=6, n_envs=3)
    weights = {name: r.normal(size=value.shape) for name, value in values.items()}
    gradients = pull(weights)
    for name in seen:
        expected = (up[name] - down[name]) / 2e-4
        np.testing.assert_allclose(changes[name], expected, rtol=0, atol=4e-3)
        assert np.abs(expected).max() > 0.3
    forward = sum((weights[name] * changes[name]).sum() for name in seen)
    backward = sum((gradients[name] * along[name]).sum() for name in start)
    assert backward == pytest.approx(forward, rel=1e-5)


def test_a_jacobian_is_that_of_the_layers() -> None:
    at, x = ca.SX.sym("x", N_IN), np.random.default_rng(0).normal(size=N_IN)
    got = np.array(ca.Function("J", [at], [ca.jacobian(network(TANH)(at), at)])(x))
    first, last = TANH
    hidden = np.tanh(first.weight @ x + first.bias)
    want = last.weight @ np.diag(1 - hidden**2) @ first.weight
    assert np.allclose(got, want, atol=1e-6)


def test_a_sum_is_nearer_than_one_product_after_another() -> None:
    r = np.random.default_rng(2)
    weight = r.normal(size=(64, 1024)).astype(np.float32)
    x = r.normal(size=(1024, 1)).astype(np.float32)
    bias = np.zeros(64, np.float32)
    exact = weight.astype(float) @ x.astype(float)
    plain = np.cumsum(weight * x[:, 0], axis=1, dtype=np.float32)[:, -1:]
    error = np.abs(sums(weight, x, bias) - exact).mean()
    assert error < 0.6 * np.abs(plain - exact).mean()


def test_not_a_number_stays_one(native: Native) -> None:
    f = ca.Function("f", [at := ca.SX.sym("x", N_IN)], [network(RELU)(at)])
    assert np.all(np.isnan(np.array(f([np.nan, 0, 0, 0, 0]))))


def test_weights_are_data_and_not_variables() -> None:
    assert sum(v.size for v in declared().variables.values()) < 20


@pytest.mark.parametrize(
    ("given_layers", "words"),
    [
        ([], "no layers"),
        ([Layer(np.ones((2, 3), np.float32), np.ones(3, np.float32))], "layer 0"),
        ([*TANH, Layer(np.ones((2, 3), np.float32), np.ones(2, np.float32))], "layer 2"),
        ([Layer(np.full((2, 3), np.nan, np.float32), np.ones(2, np.float32))], "NaN"),
        ([Layer(np.ones((1, 1)), np.ones(1), "gelu")], "activation 'gelu'"),  # type: ignore[arg-type]
    ],
)
def test_layers_that_do_not_fit_are_refused(given_layers: list[Layer], words: str) -> None:
    with pytest.raises(ParameterInvalid, match=words):
        network(given_layers)


def test_an_instance_needs_neither_heap_nor_libm(tmp_path: Path, native: Native) -> None:
    """Everything is linked without libc; memcpy and memset are given, and nothing is missing."""
    from uuvsim_cosim.fmus.codegen.runtime import runtime, runtime_file
    from uuvsim_cosim.fmus.codegen.toolchain import compile_shared, generated_sources

    code = tmp_path / "main.c"
    (tmp_path / "string.h").write_text(
        "#include <stddef.h>\nvoid *memcpy(void *, const void *, size_t);\n"
        "void *memset(void *, int, size_t);\n"
    )
    code.write_text(
        """#include "uuv_static.h"
        void *memcpy(void *a, const void *b, size_t n) {
            for (size_t i = 0; i < n; i++) ((volatile char *)a)[i] = ((const char *)b)[i];
            return a;
        }
        void *memset(void *a, int c, size_t n) {
            for (size_t i = 0; i < n; i++) ((volatile char *)a)[i] = (char)c;
            return a;
        }
        static double memory[512];
        UUV_EXPORT int live(const double *x, int n_x, int n_out, double *out) {
            if (uuv_place(&uuv_the_component, memory, 100)) return 1;
            uuv_instance *s = uuv_place(&uuv_the_component, memory, sizeof memory);
            if (!s) return 2;
            uuv_enter_initialization(s, 0.0);
            for (int i = 0; i < n_x; i++) s->b[s->component->off_u + i] = x[i];
            uuv_exit_initialization(s);
            for (int k = 0; k < 6; k++)
                if (uuv_do_step(s, k / 20.0, 0.05)) return 3;
            uuv_update_outputs(s);
            for (int i = 0; i < n_out; i++) out[i] = s->b[s->component->off_y + i];
            return 0;
        }
        """
    )
    lowered = lower(declared())
    library = compile_shared(
        [generated_sources(lowered.files)[0], runtime_file("uuv_runtime.c"), code],
        name="embedded",
        include=[*runtime(), tmp_path],
        flags=["-DUUV_NO_HEAP", "-nostdlib", "-Wl,-z,defs", "-fno-builtin"],
    )
    c = ctypes.CDLL(str(library))
    x, out = np.random.default_rng(8).normal(size=N_IN), np.zeros(8)
    pointer = ctypes.c_void_p
    assert c.live(pointer(x.ctypes.data), N_IN, 8, pointer(out.ctypes.data)) == 0
    assert np.array_equal(out, lived(native, x))
