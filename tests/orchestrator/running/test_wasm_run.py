"""Runs whose FMUs are WebAssembly: the bits of native code, and what else is isolated how."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import FOREIGN, SourceFmu
from uuvsim_cosim.errors import ComponentFailed, FmuError, InputInvalid
from uuvsim_cosim.orchestrator.master.isolation import isolations
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.orchestrator.running.run import run
from uuvsim_cosim.orchestrator.system.sources import Backend
from uuvsim_cosim.orchestrator.system.system import System

pytest.importorskip("wasmtime")

LAW = '''
class Law:
    """u = -y."""
    inputs = {"y": None}
    outputs = {"u": None}
    def step(self, t, dt, u):
        return {"u": -u["y"]}
'''


def test_isolation_is_by_path_and_an_own_entry_has_priority() -> None:
    paths = ["a", "b", "c"]
    assert isolations(["a"], paths) == {"a": "process"}
    assert isolations(["wasm"], paths) == dict.fromkeys(paths, "preferred")
    assert isolations(["b=wasm", "*"], paths) == {"a": "process", "b": "wasm", "c": "process"}
    assert isolations(["*=wasm", "c"], paths)["c"] == "process"


@pytest.mark.parametrize(
    ("text", "paths", "message"),
    [
        ("d", ["a"], "no component 'd'; expected one of a, .*or wasm for all as WebAssembly"),
        ("a=docker", ["a"], "the way 'docker'; expected component=wasm"),
        ("wasm", ["wasm"], r"a component has this name; expected wasm=wasm .*, or \*=wasm"),
    ],
)
def test_an_unknown_isolation_is_refused(text: str, paths: list[str], message: str) -> None:
    with pytest.raises(InputInvalid, match=message):
        isolations([text], paths)


@pytest.mark.parametrize("backend", ["fmu", "native"])
def test_a_run_as_webassembly_has_the_same_bits(tmp_path: Path, backend: Backend) -> None:
    system = System("s", "0.01").add("thruster", "model:thruster", start={"u": 0.4})
    system = system.add("battery", "model:battery").connect("battery.voltage", "thruster.voltage")
    system = system.connect("thruster.current", "battery.current")
    plain = run(system, until=1.0, out=tmp_path / "plain", backend=backend).signals()
    done = run(system, until=1.0, out=tmp_path / "wasm", backend=backend, isolate=["wasm"])
    assert done.warnings == ()
    for name in ("thruster.thrust", "thruster.n", "battery.voltage"):
        assert np.array_equal(plain[name], done.signals()[name]), name


def test_what_cannot_be_webassembly_has_its_own_process_and_is_named(
    first_order_fmi3: Path, tmp_path: Path
) -> None:
    (tmp_path / "law.py").write_text(LAW)
    system = System("s", "0.01").add("plant", str(first_order_fmi3))
    system = system.add("law", f"{tmp_path / 'law.py'}:Law").add("battery", "model:battery")
    done = run(system, until=0.1, out=tmp_path / "r", isolate=["wasm"])
    named = [text for text in done.warnings if "is no WebAssembly" in text]
    assert len(named) == 2
    assert "law (Python) is no WebAssembly: it has its own process" in named[0]
    assert "plant (an FMU without C sources)" in named[1]


def test_a_component_that_is_named_must_be_able_to(first_order_fmi3: Path, tmp_path: Path) -> None:
    (tmp_path / "law.py").write_text(LAW)
    system = System("s", "0.01").add("plant", str(first_order_fmi3))
    system = system.add("law", f"{tmp_path / 'law.py'}:Law")
    with pytest.raises(InputInvalid, match="component of the kind Python; expected an FMU"):
        run(system, until=0.1, out=tmp_path / "r", isolate=["law=wasm"])
    with pytest.raises(FmuError, match="cannot run as WebAssembly"):
        run(system, until=0.1, out=tmp_path / "r", isolate=["plant=wasm"])


def test_sources_that_webassembly_cannot_have_run_in_a_process_or_name_it(
    source_fmu: SourceFmu, tmp_path: Path
) -> None:
    code = b"#include <unistd.h>\nint x(void) { return fork(); }\nint y(void) { return fork(); }\n"
    code += (FOREIGN / "runaway_fmi3.c").read_bytes()
    forks = source_fmu("runaway_fmi3.c", "hostile", "hostile_fmi3.xml", code)
    system = System("s", "0.01").add("plant", str(forks))
    first = r"\S+\.c:2:22: error: call to undeclared function 'fork'"
    done = run(system, until=0.1, out=tmp_path / "r", isolate=["wasm"])
    (named,) = [text for text in done.warnings if "is no WebAssembly" in text]
    expected = rf"plant \(its sources do not compile: {first}\) is no WebAssembly: it has its own"
    assert re.search(expected, named)
    with pytest.raises(FmuError, match=rf"to WebAssembly: {first}; expected .*`--isolate NAME`"):
        run(system, until=0.1, out=tmp_path / "r", isolate=["plant=wasm"])


def test_a_loop_without_end_ends_the_run_and_keeps_the_recording(
    runaway: Path, tmp_path: Path
) -> None:
    fmu = str(runaway)
    system = System("s", "0.01").add("bad", fmu, start={"act": 1}).add("good", fmu)
    with pytest.raises(ComponentFailed, match=r"'bad' failed at t = 0\.01 s: .*was interrupted"):
        run(system, until=0.5, out=tmp_path / "r", isolate=["wasm"], watchdog=0.2)
    assert read_signals(tmp_path / "r").time[-1] == 0.01


def test_a_refusal_is_a_warning_and_the_run_goes_on(runaway: Path, tmp_path: Path) -> None:
    system = System("s", "0.01").add("bad", str(runaway), start={"act": 8, "path": "/etc/passwd"})
    done = run(system, until=0.1, out=tmp_path / "r", isolate=["wasm"])
    (warning,) = done.warnings
    assert warning == "bad: it tried to open the file /etc/passwd, which WebAssembly refuses"
