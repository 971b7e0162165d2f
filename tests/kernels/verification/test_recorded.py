"""The hash of a recorded run is that of the same run in every other form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.conftest import Uuvsim
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.kernels.verification.recorded import hash_of_run
from uuvsim_cosim.kernels.verification.ways import outputs_of, ways_of
from uuvsim_cosim.kernels.web_assembly.output_hash import output_hash
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.running.library import load
from uuvsim_cosim.orchestrator.running.run import run


@pytest.mark.parametrize("name", ["bluerov2_hold", "bluerov2_survey"])
def test_a_run_has_the_hash_of_the_native_way(name: str, tmp_path: Path) -> None:
    system = load(name)
    run(system, until=0.2, out=tmp_path / "run", backend="native", seed=3)
    way = ways_of(fused=False, node=False)[0]
    rows, outputs = way.run(system, 20, 3), outputs_of(flatten(system))
    found = hash_of_run(tmp_path / "run")
    assert found.hash == output_hash(rows, [o.whole for o in outputs])
    assert (found.steps, found.tick, found.outputs) == (20, 0.01, len(outputs))


def test_a_changed_bit_changes_the_hash(tmp_path: Path) -> None:
    system = load("bluerov2_hold").set("hull.nu_0", [0.1, 0.0, 0.0, 0.0, 0.0, 0.0])
    run(system, until=0.1, out=tmp_path / "a", backend="native")
    speed = [float(np.nextafter(0.1, 1.0)), 0.0, 0.0, 0.0, 0.0, 0.0]
    changed = load("bluerov2_hold").set("hull.nu_0", speed)
    run(changed, until=0.1, out=tmp_path / "b", backend="native")
    assert hash_of_run(tmp_path / "a").hash != hash_of_run(tmp_path / "b").hash


def test_a_recording_with_gaps_is_refused(tmp_path: Path) -> None:
    run(load("bluerov2_hold"), until=0.2, out=tmp_path / "run", backend="native", record_every=2)
    with pytest.raises(InputInvalid, match=r"its rows are not all communication points.*0\.01 s"):
        hash_of_run(tmp_path / "run")


@pytest.mark.parametrize("option", ["--steps", "--seed", "--set"])
def test_options_of_systems_are_refused_for_a_run(
    option: str, uuvsim: Uuvsim, tmp_path: Path
) -> None:
    run(load("bluerov2_hold"), until=0.1, out=tmp_path / "run", backend="native")
    value = "hull.m=12" if option == "--set" else "10"
    status, _, err = uuvsim("verify", str(tmp_path / "run"), option, value)
    assert status == 2
    assert err.startswith(f"uuvsim: {option}: ")
    assert "is a run, which has its own" in err


def test_a_folder_without_its_system_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputInvalid, match=r"no system\.ssd"):
        hash_of_run(tmp_path)
