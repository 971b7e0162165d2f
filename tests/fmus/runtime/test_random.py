"""uuv_random.h: known answers, distributions, and draws that depend on their name alone."""

from __future__ import annotations

import ctypes
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from uuvsim_cosim.fmus.codegen.runtime import runtime
from uuvsim_cosim.fmus.codegen.toolchain import compile_shared

SHIM = Path(__file__).with_name("runtime_random_shim.c")
COMPILERS = ["zig", *(["gcc"] if shutil.which("gcc") else [])]
Array = np.ndarray[Any, np.dtype[np.float64]]


class Draws:
    """The functions of uuv_random.h in one build."""

    def __init__(self, compiler: str, w: int) -> None:
        with pytest.MonkeyPatch.context() as patch:
            if compiler == "zig":
                patch.delenv("CC", raising=False)
            else:
                patch.setenv("CC", compiler)
            flags = [f"-DUUV_W={w}", "-Wno-psabi"]
            include = runtime()
            path = compile_shared([SHIM], name="runtime_random", include=include, flags=flags)
        self.library = ctypes.CDLL(str(path))
        self.w = w

    def philox(self, counter: list[int], key: list[int]) -> list[int]:
        """Return the words of one counter and key, which stand in the last of W lanes."""
        c, k, out = (np.zeros((self.w, n), dtype=np.uint32) for n in (4, 2, 4))
        c[-1], k[-1] = counter, key
        self.library.philox(
            ctypes.c_uint32(self.w), *(ctypes.c_void_p(a.ctypes.data) for a in (c, k, out))
        )
        return [int(x) for x in out[-1]]

    def draw(self, kind: str, seeds: tuple[int, int], variable: int, sample: int, n: int) -> Array:
        out = np.full(n + 1, np.nan)
        words = [ctypes.c_uint32(x) for x in (*seeds, variable)]
        getattr(self.library, kind)(
            *words, ctypes.c_uint64(sample), ctypes.c_uint32(n), ctypes.c_void_p(out.ctypes.data)
        )
        assert np.isnan(out[-1])  # not one more than asked for
        return out[:-1]

    def normal(self, seeds: tuple[int, int], variable: int, sample: int, n: int) -> Array:
        return self.draw("normal", seeds, variable, sample, n)

    def normal_lanes(self, seeds: Array, variable: int, sample: Array, n: int) -> Array:
        """Return draws[component, j] for W components with seeds[component] and sample indices."""
        out = np.empty((n, self.w))
        parts = [np.ascontiguousarray(a, dtype=np.uint64) for a in (*seeds.T, sample)]
        s0, s1, k = (ctypes.c_void_p(a.ctypes.data) for a in parts)
        self.library.normal_lanes(
            s0, s1, ctypes.c_uint32(variable), k, ctypes.c_uint32(n),
            ctypes.c_void_p(out.ctypes.data),
        )  # fmt: skip
        return out.T

    def open_interval(self, high: int, low: int) -> float:
        out = ctypes.c_double()
        self.library.open_interval(ctypes.c_uint32(high), ctypes.c_uint32(low), ctypes.byref(out))
        return out.value


@pytest.fixture(scope="module", params=[(c, w) for c in COMPILERS for w in (1, 8)], ids=str)
def draws(request: pytest.FixtureRequest) -> Draws:
    return Draws(*request.param)


@pytest.fixture(scope="module")
def one() -> Draws:
    return Draws("zig", 1)


# Random123, tests/kat_vectors, philox4x32 10: counter, key, result.
KNOWN = [
    ("00000000 00000000 00000000 00000000", "00000000 00000000",
     "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
    ("ffffffff ffffffff ffffffff ffffffff", "ffffffff ffffffff",
     "408f276d 41c83b0e a20bc7c6 6d5451fd"),
    ("243f6a88 85a308d3 13198a2e 03707344", "a4093822 299f31d0",
     "d16cfe09 94fdcceb 5001e420 24126ea1"),
]  # fmt: skip


@pytest.mark.parametrize(("counter", "key", "answer"), KNOWN)
def test_philox_gives_the_published_answers(
    draws: Draws, counter: str, key: str, answer: str
) -> None:
    c, k, a = ([int(word, 16) for word in text.split()] for text in (counter, key, answer))
    assert draws.philox(c, k) == a


def test_every_build_draws_the_same_bits(one: Draws, draws: Draws) -> None:
    for kind in ("normal", "uniform"):
        name = ((2**32 - 1, 12345), 7, 2**40 + 3, 1001)
        np.testing.assert_array_equal(draws.draw(kind, *name), one.draw(kind, *name))


def test_lanes_draw_what_each_component_draws_alone(one: Draws, draws: Draws) -> None:
    w = draws.w
    seeds = np.random.default_rng(1).integers(0, 2**32, (w, 2), dtype=np.uint64)
    sample = np.arange(w, dtype=np.uint64) * 2**33
    together = draws.normal_lanes(seeds, 5, sample, 7)
    for i in range(w):
        alone = one.normal((int(seeds[i, 0]), int(seeds[i, 1])), 5, int(sample[i]), 7)
        np.testing.assert_array_equal(together[i], alone)


def test_a_draw_does_not_depend_on_how_many_are_asked_for(draws: Draws) -> None:
    many = draws.normal((1, 2), 3, 4, 40)
    for n in (0, 1, 2, 3, 7, 16, 17):
        np.testing.assert_array_equal(draws.normal((1, 2), 3, 4, n), many[:n])


def test_a_draw_does_not_depend_on_earlier_ones(draws: Draws) -> None:
    forwards = [draws.normal((1, 2), 0, k, 3) for k in range(20)]
    backwards = [draws.normal((1, 2), 0, k, 3) for k in reversed(range(20))]
    np.testing.assert_array_equal(forwards, backwards[::-1])


@pytest.mark.parametrize(
    "other",
    [((2, 2), 3, 4), ((1, 3), 3, 4), ((1, 2), 4, 4), ((1, 2), 3, 5), ((1, 2), 3, 4 + 2**32)],
)
def test_another_name_gives_other_draws(
    one: Draws, other: tuple[tuple[int, int], int, int]
) -> None:
    assert not np.any(one.normal((1, 2), 3, 4, 50) == one.normal(*other, 50))


def test_a_uniform_draw_is_never_zero_nor_one(one: Draws) -> None:
    assert one.open_interval(0, 0) == 2.0**-53
    assert one.open_interval(2**32 - 1, 2**32 - 1) == 1 - 2.0**-53


N = 200_000


def test_uniform_draws_are_uniform(one: Draws) -> None:
    u = one.draw("uniform", (11, 12), 0, 0, N)
    assert stats.kstest(u, "uniform").pvalue > 0.01
    assert np.mean(u) == pytest.approx(0.5, abs=4 * np.sqrt(1 / 12 / N))


def test_normal_draws_are_standard_normal(one: Draws) -> None:
    z = one.normal((21, 22), 0, 0, N)
    assert stats.kstest(z, "norm").pvalue > 0.01


def test_normal_draws_of_successive_samples_are_standard_normal(one: Draws) -> None:
    z = np.concatenate([one.normal((31, 32), 1, k, 3) for k in range(20_000)])
    assert stats.kstest(z, "norm").pvalue > 0.01


def test_the_moments_of_normal_draws_are_those_of_the_distribution(one: Draws) -> None:
    z = one.normal((41, 42), 0, 0, N)
    moments = [np.mean(z**k) for k in (1, 2, 3, 4)]
    deviations = np.sqrt(np.array([1, 2, 15, 96]) / N)  # variance of z^k
    assert np.all(np.abs(np.subtract(moments, [0, 1, 0, 3])) < 4 * deviations)


def test_the_two_draws_of_a_block_are_uncorrelated(one: Draws) -> None:
    z = one.normal((51, 52), 0, 0, N).reshape(-1, 2)
    for power in (1, 2):
        r = np.corrcoef(z[:, 0] ** power, z[:, 1] ** power)[0, 1]
        assert abs(r) < 4 / np.sqrt(N / 2)


def test_successive_samples_are_uncorrelated(one: Draws) -> None:
    z = np.array([one.normal((61, 62), 0, k, 1)[0] for k in range(20_000)])
    assert abs(np.corrcoef(z[1:], z[:-1])[0, 1]) < 4 / np.sqrt(len(z))
