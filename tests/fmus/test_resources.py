"""Refusal of work that does not fit in memory or on the disk, before it starts."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import uuvsim_cosim as uuv
from uuvsim_cosim.errors import InputInvalid, ToolchainError
from uuvsim_cosim.fmus import resources
from uuvsim_cosim.fmus.codegen import toolchain
from uuvsim_cosim.fmus.resources import SMALL, refuse_unless_it_fits
from uuvsim_cosim.orchestrator.recording.export import export

LITTLE = 30_000_000  # bytes


@pytest.fixture
def little_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resources, "available_memory", lambda: LITTLE)


@pytest.fixture
def little_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=LITTLE))


@pytest.fixture
def tank() -> uuv.System:
    return uuv.System("tank", tick="0.1").add("hull", "model:sphere")


@given(wanted=st.floats(0.0, 1e15), free=st.integers(0, 10**13))
def test_a_refusal_names_a_divisor_with_which_the_work_fits(wanted: float, free: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(resources, "available_memory", lambda: free)
        try:
            refuse_unless_it_fits("place", "it", wanted, "{times}")
        except InputInvalid as error:
            times = int(error.problems[0].expected)
            assert wanted > max(free, SMALL)
            assert wanted / times <= 0.5 * free + 1.0
        else:
            assert wanted <= max(free, SMALL)


def test_a_number_of_bytes_beyond_every_float_is_refused(little_memory: None) -> None:
    with pytest.raises(InputInvalid, match=r"about 1\.00e\+391 GB of memory"):
        refuse_unless_it_fits("place", "it", 10**400, "less")


@pytest.fixture
def kernel(tank: uuv.System) -> uuv.Kernel:
    return uuv.fuse(tank)


@pytest.mark.usefixtures("kernel", "little_memory")
def test_environments_that_memory_cannot_hold_are_refused(kernel: uuv.Kernel) -> None:
    with pytest.raises(InputInvalid, match=r"1000000 environments .* expected at most \d+") as e:
        kernel.batch(10**6)
    most = int(re.findall(r"at most (\d+)", str(e.value))[0])
    kernel.batch(min(most, 1000)).close()


@pytest.mark.usefixtures("kernel", "little_memory")
def test_outputs_of_a_rollout_that_memory_cannot_hold_are_refused(kernel: uuv.Kernel) -> None:
    with pytest.raises(InputInvalid, match=r"outputs of 1000000 steps .* 0\.048 GB of memory"):
        kernel.vjp({}, ["hull.eta"], steps=10**6)


@pytest.mark.usefixtures("little_memory")
def test_samples_of_a_study_that_memory_cannot_hold_are_refused_without_a_folder(
    tank: uuv.System, tmp_path: Path
) -> None:
    study = uuv.Study(tank, duration=5e5, every="0.1", metrics={"z": "final(hull.eta[3])"})
    with pytest.raises(InputInvalid, match=r"every: the samples of 1 runs .* times as far apart"):
        study.run(tmp_path / "s")
    assert not (tmp_path / "s").exists()


@pytest.mark.usefixtures("little_memory")
def test_isolated_components_that_memory_cannot_hold_are_refused_without_a_folder(
    tank: uuv.System, tmp_path: Path
) -> None:
    two = tank.add("other", "model:sphere")
    with pytest.raises(InputInvalid, match="isolate: 2 components in separate processes"):
        uuv.run(two, until=1.0, isolate=["*"], out=tmp_path / "r")
    assert not (tmp_path / "r").exists()


def test_a_recording_that_the_disk_cannot_hold_is_refused_before_a_component_is_built(
    tank: uuv.System, little_disk: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("uuvsim_cosim.orchestrator.running.run.prepare", None)
    with pytest.raises(InputInvalid, match=r"the recording .* 0\.03 GB are free.*--record-every"):
        uuv.run(tank, until=1e6)


@pytest.mark.parametrize("kind", ["csv", "mat", "mcap"])
def test_an_export_that_the_disk_cannot_hold_is_refused_and_writes_nothing(
    kind: str, tank: uuv.System, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = uuv.run(tank, until=10.0, out=tmp_path / "r")
    monkeypatch.setattr(resources, "SMALL", 0)
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=1000))
    with pytest.raises(InputInvalid, match=r"the file would take .*--record-every"):
        export(run.folder, tmp_path / f"x.{kind}")
    assert [p.name for p in tmp_path.iterdir()] == ["r"]


@pytest.mark.parametrize("kind", ["csv", "mat", "mcap"])
def test_an_export_counts_up_to_its_total(kind: str, tank: uuv.System, tmp_path: Path) -> None:
    run = uuv.run(tank, until=1000.0, out=tmp_path / "r")
    seen: list[tuple[float, float]] = []
    export(run.folder, tmp_path / f"x.{kind}", lambda _, done, total: seen.append((done, total)))
    done, totals = np.array(seen).T
    assert len(set(totals)) == 1
    assert (np.diff(done) >= 0).all()
    assert done[-1] == totals[-1] or kind == "mat"


def test_c_that_the_compiler_has_no_memory_for_is_refused_before_the_compiler_runs(
    little_memory: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no(*_: object, **__: object) -> None:
        raise AssertionError("the compiler ran")

    monkeypatch.setattr(subprocess, "run", no)
    (tmp_path / "new.c").write_text("int new_and_never_compiled_before(void);\n" * 1000)
    with pytest.raises(ToolchainError, match=r"new: the compiler for its 0\.041 MB of C"):
        toolchain.compile_shared([tmp_path / "new.c"], name="new")
