"""Snapshots: what follows a restore is the same to the last bit."""

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import FmuError, InputInvalid
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.plan.plan import Group

LINKS = ["a.y -> b.u", "b.y -> c.u", "c.y -> d.u", "d.y -> a.u", "a.string_out -> e.string_in"]


def system(wired: Any, fmi2: Any, fmi3: Any, native: Any, python: Any, **more: Any) -> Any:
    makers = {"a": fmi3, "b": fmi2, "c": native, "d": python, "e": fmi3}
    start = {"a": {"k": 1.5, "string_in": np.array(["one", "two"], object)}}
    more.setdefault("groups", [Group("jacobi", (0, 3, 4)), Group("gauss-seidel", (1, 2))])
    return wired(makers, LINKS, start=start, step_ticks={"b": 3, "c": 3},
                 conversions={LINKS[3]: (-2.0, 1.0)}, **more)  # fmt: skip


@pytest.fixture
def mixed(wired: Any, fmi2: Any, fmi3: Any, native: Any, python: Any) -> Any:
    return system(wired, fmi2, fmi3, native, python)


def values(master: Master) -> list[Any]:
    return [*(master.get(p, "y") for p in "abcd"), master.get("e", "string_in").tolist()]


def test_a_restored_run_is_repeated_bit_for_bit(mixed: Any, watcher: Any) -> None:
    with Master(*mixed, observers=[watcher]) as master:
        master.initialize()
        master.step(16)  # in the middle of a slow step
        kept = master.snapshot()
        master.step(25)
        first = values(master)
        master.restore(kept)
        assert master.tick == 16
        master.step(25)
        assert values(master) == first
    for name in watcher.names:
        assert watcher.values[name][17:42] == watcher.values[name][42:], name


def test_a_snapshot_in_a_file_continues_in_another_master(mixed: Any, tmp_path: Path) -> None:
    with Master(*mixed) as master:
        master.initialize()
        master.step(16)
        master.save_snapshot(tmp_path / "x.snapshot")
        master.step(25)
        first = values(master)
    with Master(*mixed) as master:
        master.initialize()
        master.load_snapshot(tmp_path / "x.snapshot")
        assert master.tick == 16
        master.step(25)
        assert values(master) == first
    assert [p.name for p in tmp_path.iterdir()] == ["x.snapshot"]


def test_a_file_of_another_system_is_refused(mixed: Any, wired: Any, fmi3: Any,
                                             tmp_path: Path) -> None:  # fmt: skip
    with Master(*mixed) as master:
        master.initialize()
        master.save_snapshot(tmp_path / "x")
    with Master(*wired({"a": fmi3})) as master:
        master.initialize()
        with pytest.raises(InputInvalid, match=r"of another system .*differ in b, c, d, e"):
            master.load_snapshot(tmp_path / "x")


def test_a_file_of_another_version_or_none_at_all_is_refused(mixed: Any, tmp_path: Path) -> None:
    with Master(*mixed) as master:
        master.initialize()
        with zipfile.ZipFile(tmp_path / "old", "w") as archive:
            archive.writestr("snapshot.json", json.dumps({"schema_version": 0}))
        with pytest.raises(InputInvalid, match="schema version 0; expected 2"):
            master.load_snapshot(tmp_path / "old")
        (tmp_path / "noise").write_bytes(b"noise")
        with pytest.raises(InputInvalid, match="is no snapshot, or damaged"):
            master.load_snapshot(tmp_path / "noise")
        with pytest.raises(InputInvalid, match="cannot be read"):
            master.load_snapshot(tmp_path / "nothing")
        with pytest.raises(InputInvalid, match="cannot be written"):
            master.save_snapshot(tmp_path / "no" / "folder")


def test_a_component_without_state_refuses_by_name(wired: Any, python: Any, tmp_path: Path) -> None:
    from uuvsim_cosim.orchestrator.python.component import PythonComponent

    class Holder:
        inputs: dict[str, Any] = {}  # noqa: RUF012
        outputs = {"y": "1"}  # noqa: RUF012

        def __init__(self) -> None:
            self.log = (x for x in ())  # cannot be copied
            self.n = 0

        def step(self, t: float, dt: float, u: Any) -> dict[str, float]:
            self.n += 1
            return {"y": self.n}

    with Master(*wired({"a": lambda p: PythonComponent(Holder, p)})) as master:
        master.initialize()
        master.step(3)
        with pytest.raises(FmuError, match="a: objects of Holder cannot be copied"):
            master.snapshot()
        master.reset()
        assert master.get("a", "y") == 0.0
        master.step(2)
        assert master.get("a", "y") == 2.0
