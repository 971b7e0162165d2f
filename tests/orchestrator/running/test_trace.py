"""Traced FMUs in a system: every call is written, and the results keep their bits."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.importer.read_description import read_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu
from uuvsim_cosim.fmus.tracing.trace import Trace, instantiate_traced
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.running.run import run
from uuvsim_cosim.orchestrator.system.system import System


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_a_traced_system_has_the_same_bits(
    wired: Any, first_order_fmi2: Path, first_order_fmi3: Path, tmp_path: Path
) -> None:
    def stepped(make: Any) -> list[Any]:
        makers = {"a": make(first_order_fmi3), "b": make(first_order_fmi2)}
        links = ["a.y -> b.u", "b.y -> a.v[1]"]
        with Master(*wired(makers, links, start={"a": {"u": 1.0}})) as master:
            master.initialize()
            master.step(5)
            kept = master.snapshot()
            master.step(5)
            master.restore(kept)
            master.step(5)
            return [np.asarray(master.get(p, n)).tolist() for p in "ab" for n in ("y", "w")]

    with Trace(tmp_path / "calls.csv") as trace:
        traced = stepped(lambda f: lambda path: instantiate_traced(read_fmu(f), path, trace))
    assert traced == stepped(lambda f: lambda path: instantiate_fmu(f, path))
    functions = [c["function"] for c in rows(tmp_path / "calls.csv")]
    assert functions.count("fmi2DoStep") == functions.count("fmi3DoStep") == 15
    assert "fmi3GetFMUState" in functions
    assert "fmi2SetFMUstate" in functions


def test_a_run_writes_the_calls_of_its_fmus_and_the_same_recording(
    first_order_fmi2: Path, first_order_fmi3: Path, tmp_path: Path
) -> None:
    system = (
        System("two", "0.1")
        .add("a", str(first_order_fmi3))
        .add("b", str(first_order_fmi2))
        .connect("a.y", "b.u")
        .set("a.u", 1.0)
    )
    plain = run(system, until=1.0, out=tmp_path / "plain").signals()
    file = tmp_path / "calls.csv"
    traced = run(system, until=1.0, out=tmp_path / "traced", trace_fmi=file).signals()
    assert np.array_equal(traced["b.y"], plain["b.y"])
    calls = rows(file)
    steps = [(c["component"], c["function"]) for c in calls if c["function"].endswith("DoStep")]
    assert steps == [("a", "fmi3DoStep"), ("b", "fmi2DoStep")] * 10
    assert {c["component"] for c in calls if "FreeInstance" in c["function"]} == {"a", "b"}
    for other in ({"isolate": ["a"]}, {"backend": "native"}):
        with pytest.raises(InputInvalid, match="expected FMUs in this process"):
            run(system, until=1.0, out=tmp_path / "no", trace_fmi=file, **other)  # type: ignore
    assert len(rows(file)) == len(calls)
