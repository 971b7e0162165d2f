"""`uuvsim run MODEL.fmu`: what a run that fails leaves."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from tests.conftest import Uuvsim
from uuvsim_cosim.cli import status_of

LOOPS = 1


def test_a_table_ends_with_csv(
    first_order_fmi2: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.docx"
    assert status_of(["run", str(first_order_fmi2), "--until", "1", "-o", str(out)]) == 2
    assert "ending '.docx' was read; expected .csv" in capsys.readouterr().err
    assert not out.exists()


def test_the_values_before_a_failure_are_kept_and_named(
    first_order_fmi2: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.csv"
    options = ["--until", "1", "--step", "0.1", "--set", "fault=1", "--set", "fault_time=0.5"]
    assert status_of(["run", str(first_order_fmi2), *options, "-o", str(out)]) == 3
    said = "".join(capsys.readouterr())
    assert f"the values up to that time are in {out}" in said
    assert "failed at t = 0.6 s: y is not finite" in said
    with out.open(newline="") as file:
        times = [float(row["time"]) for row in csv.DictReader(file)]
    assert times[-1] == 0.5


def test_a_single_fmu_runs_as_webassembly_with_the_same_bits(
    runaway: Path, tmp_path: Path, uuvsim: Uuvsim
) -> None:
    pytest.importorskip("wasmtime")
    run = ["run", str(runaway), "--until", "0.1"]
    for name, options in (("a", []), ("b", ["--isolate", "wasm"]), ("c", ["--isolate", "*"])):
        assert uuvsim(*run, "-o", str(tmp_path / f"{name}.csv"), *options)[0] == 0
    texts = {(tmp_path / f"{name}.csv").read_text() for name in "abc"}
    assert len(texts) == 1
    hang = ["--isolate", "wasm", "--watchdog", "0.2", "--set", f"act={LOOPS}"]
    status, _, err = uuvsim(*run, "-o", str(tmp_path / "d.csv"), *hang)
    assert status == 3
    assert "'hostile' failed at t = 0.01 s: fmi3DoStep returned fatal: it did not answer" in err


def test_a_single_binary_fmu_gets_a_process_instead_which_is_noted(
    first_order_fmi3: Path, tmp_path: Path, uuvsim: Uuvsim
) -> None:
    pytest.importorskip("wasmtime")
    run = ["run", str(first_order_fmi3), "--until", "1", "-o", str(tmp_path / "a.csv")]
    status, out, err = uuvsim(*run, "--isolate", "wasm")
    assert status == 0
    assert "first_order (an FMU without C sources) is no WebAssembly: it has" in out + err
    exits = ["--set", "fault=10", "--set", "fault_time=0.5"]
    status, _, err = uuvsim(*run, "--isolate", "first_order", *exits)
    assert status == 3
    assert "its process died (status 3)" in err


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--grant", "a=network"], "--grant: the FMU is not isolated; expected --isolate wasm"),
        (["--isolate", "a"], "no component 'a'; expected one of first_order, *"),
        (["--isolate", "*", "--grant", "a=network"], "no component 'a'; expected first_order or *"),
        (["--isolate", "*", "--trace-fmi", "t.csv"], "--trace-fmi: together with --isolate"),
    ],
)
def test_isolation_of_a_single_fmu_is_checked(
    first_order_fmi3: Path, tmp_path: Path, uuvsim: Uuvsim, options: list[str], expected: str
) -> None:
    run = ["run", str(first_order_fmi3), "-o", str(tmp_path / "a.csv"), *options]
    status, _, err = uuvsim(*run)
    assert (status, expected in err) == (2, True), err
    assert not (tmp_path / "a.csv").exists()
