"""A system on another processor that is emulated: its bits, and what is missing or fails."""

from __future__ import annotations

import numpy as np
import pytest

from tests.kernels.web_assembly.test_module import tiny
from uuvsim_cosim.errors import ToolchainError
from uuvsim_cosim.kernels.verification import emulated, ways
from uuvsim_cosim.kernels.verification.emulated import emulator, run_emulated

NEEDS_EMULATOR = pytest.mark.skipif(emulator() is None, reason="qemu-aarch64 is missing")


@NEEDS_EMULATOR
def test_the_emulated_processor_has_the_bits_of_native_components() -> None:
    native = ways.ways_of(fused=True, node=False)[0]
    assert native.name == "native components"
    for seed in (0, 5):
        rows = run_emulated(tiny(), 40, seed=seed)
        assert rows.shape[0] == 41
        assert np.array_equal(rows, native.run(tiny(), 40, seed))


def test_without_the_emulator_its_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(emulated, "emulator", lambda: None)
    with pytest.raises(ToolchainError, match="qemu-aarch64 is missing; expected the package qemu-"):
        run_emulated(tiny(), 1)


@NEEDS_EMULATOR
def test_a_program_that_fails_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(emulated, "_program", lambda parts, table: "/no/such/program")
    with pytest.raises(ToolchainError, match="qemu-aarch64 failed with status"):
        run_emulated(tiny(), 1)
