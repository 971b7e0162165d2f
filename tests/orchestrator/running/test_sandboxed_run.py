"""A hostile FMU in a run: one message names the access, and the recording is complete."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.cache import cache_dir
from uuvsim_cosim.errors import ComponentFailed, InputInvalid
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.orchestrator.running.run import run
from uuvsim_cosim.orchestrator.system.sources import Backend
from uuvsim_cosim.orchestrator.system.system import System

if sys.platform != "linux":
    pytest.skip("the sandbox is Linux's", allow_module_level=True)

READ_KEY, TCP, UDP, FORKS, ALLOCATES, EXECS = range(1, 7)
ANSWERS, SHRINKS = 14, 15
# Each bad input of a foreign FMU: what it does, and the text that names it.
BAD = {
    READ_KEY: (r"it tried to read \S+/\.ssh/id, which .*--grant bad=read:\S+/\.ssh/id"),
    TCP: r"it tried to open a socket \(TCP\), which .*--grant bad=network",
    UDP: r"it tried to open a socket \(UDP\), which .*--grant bad=network",
    ALLOCATES: r"it asked for 100\.\d\d GiB of memory at once.*--grant bad=memory:101GiB",
    EXECS: r"it tried to start the program /bin/sh, which .*--grant bad=processes",
}


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("UUVSIM_CACHE", str(cache_dir()))
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / ".ssh").mkdir()
    (tmp_path / ".ssh" / "id").write_text("secret")
    return tmp_path


def system_of(fmu: Path, act: int, **start: Any) -> System:
    system = System("s", "0.01").add("bad", str(fmu), start={"act": act, **start})
    return system.add("good", str(fmu))


@pytest.mark.parametrize("act", BAD)
def test_a_run_goes_on_after_a_refusal_with_one_warning(
    act: int, hostile: Path, tmp_path: Path
) -> None:
    done = run(system_of(hostile, act), until=0.5, out=tmp_path / "r", isolate=["*"])
    (warning,) = done.warnings
    assert np.array_equal(done.signals()["good.y"], done.signals()["bad.y"])
    assert len(done.signals().time) == 51
    import re

    assert re.match(f"bad: {BAD[act]}", warning)


@pytest.mark.parametrize("act", BAD)
def test_a_run_that_fails_names_the_refusal_and_keeps_the_recording(
    act: int, hostile: Path, tmp_path: Path
) -> None:
    with pytest.raises(
        ComponentFailed, match=rf"'bad' failed at t = 0\.01 s: .*{BAD[act]}"
    ) as failed:
        run(system_of(hostile, act, fails=1), until=0.5, out=tmp_path / "r", isolate=["bad"])
    assert failed.value.recording == tmp_path / "r"
    assert read_signals(tmp_path / "r").time[-1] == 0.01
    written = json.loads((tmp_path / "r" / "run.json").read_text())
    assert written["steps"] == 1
    assert not (tmp_path / "r" / "signals.arrows").exists()


def test_an_fmu_that_forks_without_end_is_ended_and_named(hostile: Path, tmp_path: Path) -> None:
    with pytest.raises(
        ComponentFailed,
        match=r"did not answer within 1\.0 s; its process was ended; it tried to start a process",
    ):
        run(system_of(hostile, FORKS), until=0.5, out=tmp_path / "r", isolate=["bad"], watchdog=1.0)
    assert read_signals(tmp_path / "r").time[-1] == 0.01


def test_shared_memory_cannot_be_cut_by_the_fmu(hostile: Path, tmp_path: Path) -> None:
    done = run(system_of(hostile, SHRINKS), until=0.5, out=tmp_path / "r", isolate=["bad"])
    assert len(done.signals().time) == 51


def test_a_grant_belongs_to_one_component(hostile: Path, tmp_path: Path) -> None:
    system = system_of(hostile, TCP).set("good.act", TCP)
    grants = {"bad": ["network"]}
    done = run(system, until=0.1, out=tmp_path / "r", isolate=["*"], grants=grants)
    assert [text.partition(":")[0] for text in done.warnings] == ["good"]
    done = run(system, until=0.1, out=tmp_path / "r2", isolate=["*"], grants={"*": ["network"]})
    assert done.warnings == ()


def test_a_grant_to_a_component_that_is_not_isolated_is_refused(
    hostile: Path, tmp_path: Path
) -> None:
    with pytest.raises(
        InputInvalid, match="grants: 'good' is not isolated; expected a component of"
    ):
        run(
            system_of(hostile, TCP), until=0.1, out=tmp_path / "r", isolate=["bad"],
            grants={"good": ["network"]},
        )  # fmt: skip


@pytest.mark.parametrize(
    ("path", "backend", "words"),
    [("hul", "fmu", "no component 'hul'; expected one such as hull"),
     ("hull", "native", "'hull' is a native component, which has no sandbox; expected an FMU"),
     ("law", "fmu", "'law' is a Python component, which has no sandbox; expected an FMU")],
)  # fmt: skip
def test_a_grant_that_would_do_nothing_is_refused(
    tmp_path: Path, path: str, backend: Backend, words: str
) -> None:
    (tmp_path / "law.py").write_text(
        "class Law:\n    inputs = {}\n    outputs = {'u': '1'}\n"
        "    def step(self, t, dt, u):\n        return {'u': t}\n"
    )
    system = System("mixed", tick="0.01").add("hull", "model:sphere")
    system = system.add("law", f"{tmp_path / 'law.py'}:Law")
    with pytest.raises(InputInvalid, match=f"grants: {re.escape(words)}"):
        run(system, until=0.1, out=tmp_path / "r", isolate=["*"], backend=backend,
            grants={path: ["network"]})  # fmt: skip


def test_the_command_line_warns_and_grants(
    hostile: Path, tmp_path: Path, uuvsim: Callable[..., tuple[int, str, str]]
) -> None:
    system_of(hostile, UDP).write(tmp_path / "s.ssd")
    status, out, err = uuvsim("run", "s.ssd", "--until", "0.1", "-o", "r", "--isolate", "bad")
    assert status == 0
    assert (out + err).count("it tried to open a socket (UDP)") == 1
    granted = ("--grant", "bad=network", "--isolate", "bad")
    status, out, err = uuvsim("run", "s.ssd", "--until", "0.1", "-o", "r2", *granted)
    assert (status, "it tried" in out + err) == (0, False)
    status, _, err = uuvsim("run", "s.ssd", "--until", "0.1", "--isolate", "bad", "--grant", "bad")
    assert status == 2
    assert "--grant bad: expected component=read:PATH" in err
