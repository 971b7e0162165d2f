"""Booleans that are connected keep their values: FMI 2.0 has them as int, FMI 3.0 as bool."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from uuvsim_cosim.fmus.export.fmu_file import build_fmu
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.orchestrator.running.run import run
from uuvsim_cosim.orchestrator.system.system import System


def source() -> Model:
    """Declare three flags: bit k of the count of samples."""
    m = Model("source", "Flags")
    count = m.discrete("count", unit="1")
    clock = m.clock("sample", "0.1")
    m.update(clock, count, count + 1.0)
    bits = [ca.floor(count / 2**k) - 2 * ca.floor(count / 2 ** (k + 1)) for k in range(3)]
    m.output("flags", ca.vertcat(*bits), unit="1", type="Boolean")
    return m


def sink() -> Model:
    """Declare what adds up the flags as bits."""
    m = Model("sink", "The number that flags are the bits of")
    flags = m.input("flags", 3, unit="1", type="Boolean")
    m.output("number", flags[0] + 2 * flags[1] + 4 * flags[2], unit="1")
    return m


@pytest.mark.parametrize("fmi", [2, 3])
def test_each_boolean_of_a_connection_arrives(fmi: Any, tmp_path: Path) -> None:
    files = [str(build_fmu(make(), fmi=fmi, target=tmp_path)) for make in (source, sink)]
    system = System("flags", "0.1").add("source", files[0]).add("sink", files[1])
    done = run(system.connect("source.flags", "sink.flags"), until=1.2, out=tmp_path / "run")
    signals = read_signals(done.folder)
    flags = np.asarray(signals["source.flags"], float) @ [1.0, 2.0, 4.0]
    number = signals["sink.number"]
    assert set(flags) == set(range(8))
    np.testing.assert_array_equal(number[1:], flags[:-1])
