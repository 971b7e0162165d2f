"""A component in a process of its own: the same bits, and any way to die is an error, no more."""

import os
import select
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import ComponentFailed, FmuError, InputInvalid, SystemInvalid
from uuvsim_cosim.fmus.component import BindingKind, Component
from uuvsim_cosim.fmus.importer.read_description import read_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu, instantiate_here
from uuvsim_cosim.fmus.isolation.isolated import Isolated
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.shared import SharedBinding
from uuvsim_cosim.orchestrator.plan.plan import Group
from uuvsim_cosim.orchestrator.python.component import PythonComponent
from uuvsim_cosim.orchestrator.recording.recorder import Recorder
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.orchestrator.running.run import run

NAN, ERROR, ABORT, DISCARD, FATAL, HANG, ENDS, EARLY, SEGFAULT = range(1, 10)
TYPES = [
    "float32", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64",
    "boolean", "string", "binary",
]  # fmt: skip


def isolated(fmu: Path, watchdog: float | None = 10.0) -> Callable[[str], Component]:
    return lambda path: instantiate_fmu(fmu, path, isolate=True, watchdog=watchdog)


def by_pipes(fmu: Path) -> Callable[[str], Component]:
    archive = read_fmu(fmu)

    def make(path: str) -> Component:
        arguments = (archive, path)
        return Isolated(path, archive.description, instantiate_here, arguments, shared=False)

    return make


def child_of(master: Master, path: str) -> int:
    (component,) = (c for c in master.components if c.path == path)
    assert isinstance(component, Isolated)
    assert component.process is not None
    return component.process


def segments() -> int:
    """Count this process's shared memory without a name."""
    links = (Path("/proc/self/fd") / name for name in os.listdir("/proc/self/fd"))
    return sum(os.path.lexists(link) and "uuvsim-exchange" in target(link) for link in links)


def target(link: Path) -> str:
    try:
        return os.readlink(link)
    except OSError:
        return ""


def mappings() -> int:
    return Path("/proc/self/maps").read_text().count("uuvsim-exchange")


def is_gone(process: int) -> bool:
    try:
        stat = Path(f"/proc/{process}/stat").read_text()
    except OSError:
        return True
    return stat.rpartition(")")[2].split()[0] == "Z"


# ---- the same bits ----------------------------------------------------------------------------


def test_every_type_crosses_the_shared_memory(wired: Any, first_order_fmi3: Path) -> None:
    links = [f"a.{t}_out -> b.{t}_in" for t in TYPES]
    start = {
        "a": {
            "u": 1.0, "float32_in": 0.1, "int8_in": -8, "uint8_in": 200, "int16_in": -1600,
            "uint16_in": 60000, "int32_in": np.array([-7, 2**31 - 1]), "uint32_in": 2**32 - 1,
            "int64_in": -(2**63), "uint64_in": 2**64 - 1, "boolean_in": True,
            "string_in": np.array(["Tiefe äöü", ""], object), "binary_in": b"a\0b",
        }
    }  # fmt: skip
    got, kinds = [], []
    fmu = first_order_fmi3
    for make in (isolated(fmu), by_pipes(fmu), lambda path: instantiate_fmu(fmu, path)):
        with Master(*wired({"a": make, "b": make}, links, start=start)) as master:
            master.initialize()
            master.step(3)
            kinds.append({b.kind for b in master._ready().bindings})
            got.append([master.get("b", f"{t}_in") for t in TYPES] + [master.get("a", "y")])
    assert kinds == [{BindingKind.SHARED}, {BindingKind.CALLBACK}, {BindingKind.FMI3}]
    for shared, piped, here in zip(*got, strict=True):
        np.testing.assert_array_equal(shared, here)
        np.testing.assert_array_equal(piped, here)
    assert got[0][TYPES.index("int64")] == -(2**63)
    assert got[0][TYPES.index("uint64")] == 2**64 - 1
    assert got[0][TYPES.index("string")].tolist() == ["Tiefe äöü", ""]
    assert got[0][TYPES.index("binary")] == b"a\0b"


class Echo:
    """Gives back what it gets, later; refuses much."""

    inputs = {"u": "1"}  # noqa: RUF012
    outputs = {"y": "1"}  # noqa: RUF012

    def step(self, t: float, dt: float, u: Any) -> Any:
        if u["u"] > 5:
            raise ValueError("too much")
        return {"y": u["u"] + t}


def echo(path: str) -> Component:
    return PythonComponent(Echo, path)


def test_a_python_component_in_its_own_process_is_stepped_through_shared_memory(
    wired: Any,
) -> None:
    def own(path: str) -> Component:
        return Isolated(path, echo(path).description, echo, (path,), watchdog=10.0)

    with Master(*wired({"a": own, "b": own}, ["a.y -> b.u"])) as master:
        master.initialize()
        (binding, _) = master._ready().bindings
        assert isinstance(binding, SharedBinding)
        assert binding.served is BindingKind.CALLBACK
        master.set("a", "u", 2.0)
        master.step(3)
        assert master.get("a", "y") == 2.0 + 0.02
        assert master.get("b", "y") == 2.0 + 0.01 + 0.02
        master.set("a", "u", 6.0)
        with pytest.raises(ComponentFailed, match=r"'a' failed at t = 0\.03 s.*too much"):
            master.step()


def test_messages_come_while_it_steps(
    wired: Any, pythonfmu2_lag: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with Master(*wired({"a": isolated(pythonfmu2_lag)})) as master:
        master.initialize()
        with caplog.at_level("INFO", "uuvsim_cosim.a"):
            master.step(2)
        assert caplog.messages


def test_parameters_and_states_go_by_the_pipes_in_between(
    wired: Any, first_order_fmi3: Path
) -> None:
    got = []
    for make in (isolated(first_order_fmi3), lambda p: instantiate_fmu(first_order_fmi3, p)):
        with Master(*wired({"a": make, "b": make}, ["a.y -> b.u"])) as master:
            master.initialize()
            master.set("a", "u", 1.0)
            master.step(3)
            kept = master.snapshot()
            master.set("a", "k", 2.0)
            master.step(3)
            values = [master.get("b", "y")]
            master.restore(kept)
            master.step(6)
            got.append([*values, master.get("b", "y")])
    assert got[0] == got[1]


@pytest.mark.parametrize("algorithm", ["gauss-seidel", "iterated"])
def test_any_algorithm_gives_the_same_bits(
    algorithm: Any, wired: Any, first_order_fmi2: Path
) -> None:
    links, groups = ["a.y -> b.u", "b.y -> a.u"], [Group(algorithm, (0, 1))]
    got = []
    for make in (isolated(first_order_fmi2), lambda p: instantiate_fmu(first_order_fmi2, p)):
        w = wired({"a": make, "b": make}, links, groups=groups, start={"a": {"y": 1.0}})
        with Master(*w, record=[("a", "y"), ("b", "y")]) as master:
            master.initialize()
            master.step(10)
            got.append([master.get("a", "y"), master.get("b", "y")])
    assert got[0] == got[1]


# ---- each way to fail -------------------------------------------------------------------------


@pytest.fixture
def nothing_left() -> Iterator[list[int]]:
    """Check that the processes in the list, and all shared memory, are gone at the end."""
    processes: list[int] = []
    before = segments(), mappings()
    yield processes
    assert all(is_gone(p) for p in processes)
    assert (segments(), mappings()) == before


@pytest.mark.parametrize("version", [1, 2, 3])
@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        (NAN, "output y is (-)?nan; expected a finite number"),
        (ERROR, r"fmi\d?DoStep returned error: .*too hot"),
        (ABORT, r"its process died \(signal 6\)"),
        (DISCARD, r"fmi\d?DoStep returned discard"),
        (FATAL, r"fmi\d?DoStep returned fatal"),
        (HANG, r"did not answer within 1\.0 s; its process was ended"),
        (SEGFAULT, r"its process died \(signal 11\)"),
    ],
)
def test_each_fault_is_an_error_that_names_component_and_time(
    version: int, fault: int, reason: str, c_fmu: Any, wired: Any, nothing_left: list[int],
    tmp_path: Path,
) -> None:  # fmt: skip
    start = {"a": {"fault": fault, "fault_time": 0.05, "u": 1.0}}
    watchdog = 1.0 if fault == HANG else None
    w = wired({"a": isolated(c_fmu(version), watchdog)}, start=start)
    with Master(*w, observers=[Recorder(tmp_path)]) as master:
        master.initialize()
        nothing_left.append(child_of(master, "a"))
        with pytest.raises(ComponentFailed, match=rf"'a' failed at t = 0\.0\d+ s: .*{reason}"):
            master.step(20)
    times = read_signals(tmp_path).time
    np.testing.assert_allclose(times, np.arange(6) / 100, atol=1e-12)


@pytest.mark.parametrize(
    ("fault", "reason"), [(ENDS, "asks to end"), (EARLY, "returned from a step before")]
)
def test_what_only_fmi_3_can_do_is_told_as_in_process(
    fault: int, reason: str, first_order_fmi3: Path, wired: Any, nothing_left: list[int]
) -> None:
    told = []
    for make in (isolated(first_order_fmi3), lambda p: instantiate_fmu(first_order_fmi3, p)):
        with Master(*wired({"a": make}, start={"a": {"fault": fault}})) as master:
            master.initialize()
            with pytest.raises(ComponentFailed, match=reason) as raised:
                master.step()
            told.append(str(raised.value))
    assert told[0] == told[1]


def test_a_kill_from_outside_is_an_error(
    first_order_fmi3: Path, wired: Any, nothing_left: list[int]
) -> None:
    makers = {"a": isolated(first_order_fmi3, None), "b": isolated(first_order_fmi3, None)}
    with Master(*wired(makers, ["a.y -> b.u"])) as master:
        master.initialize()
        nothing_left += [child_of(master, p) for p in "ab"]
        master.step(4)
        os.kill(child_of(master, "b"), signal.SIGKILL)
        with pytest.raises(ComponentFailed, match=r"'b' failed at t = 0\.04 s.*signal 9"):
            master.step()
        with pytest.raises(ComponentFailed, match=r"'b'.*died before"):
            master.step()
        with pytest.raises(FmuError, match="after its process died"):
            master.snapshot()


def test_isolated_components_step_beside_each_other(
    first_order_fmi3: Path, wired: Any, nothing_left: list[int]
) -> None:
    makers = {"dies": isolated(first_order_fmi3), "lives": isolated(first_order_fmi3)}
    with Master(*wired(makers, start={"lives": {"u": 1.0}})) as master:
        master.initialize()
        nothing_left += [child_of(master, p) for p in makers]
        master.step(4)
        lives = master.components[1]
        y = lives.description.variables["y"]
        before = lives.get(y)
        os.kill(child_of(master, "dies"), signal.SIGKILL)
        with pytest.raises(ComponentFailed, match=r"'dies' failed at t = 0\.04 s.*signal 9"):
            master.step()
        assert lives.get(y) != before  # its step was not waiting for the other's


LIVES = """
import sys
from pathlib import Path
from fractions import Fraction
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu
from uuvsim_cosim.fmus.importer.read_description import read_description
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.plan.plan import Group, Plan, PlannedComponent

fmu, fault = Path(sys.argv[1]), int(sys.argv[2])
part = PlannedComponent("a", "", read_description(fmu), {"fault": fault, "fault_time": 0.02})
plan = Plan(Fraction("0.01"), (part,), (), (Group("jacobi", (0,)),), ((0,),))
master = Master(plan, lambda p: instantiate_fmu(fmu, p.path, isolate=True))
master.initialize()
print(master.components[0].process, flush=True)
while True:
    master.step(100)
"""


@pytest.mark.parametrize("fault", [0, HANG])
def test_nothing_is_left_when_the_parent_is_killed(fault: int, first_order_fmi3: Path) -> None:
    command = [sys.executable, "-c", LIVES, str(first_order_fmi3), str(fault)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        child = os.pidfd_open(int(parent.stdout.readline()))
        parent.kill()
    ended, _, _ = select.select([child], [], [], 120.0)
    os.close(child)
    assert ended


# ---- going on ---------------------------------------------------------------------------------


@pytest.fixture
def chain(wired: Any, first_order_fmi3: Path, native: Any) -> Any:
    makers = {"a": isolated(first_order_fmi3), "b": native, "c": isolated(first_order_fmi3)}
    links = ["a.y -> b.u", "b.y -> c.u", "c.y -> a.u", "a.string_out -> c.string_in"]
    start = {"a": {"k": 1.5, "y": 1.0, "string_in": np.array(["one", "two"], object)}}
    return wired(makers, links, start=start, step_ticks={"c": 3})


def values(master: Master) -> list[Any]:
    return [*(master.get(p, "y") for p in "abc"), master.get("c", "string_in").tolist()]


def test_a_killed_component_is_restarted_and_the_run_goes_on_bit_for_bit(
    chain: Any, watcher: Any, nothing_left: list[int]
) -> None:
    with Master(*chain, observers=[watcher]) as master:
        master.initialize()
        master.step(50)
        expected = values(master)
    unbroken, watcher.values = watcher.values, {}
    whole, watcher.ticks = watcher.ticks, []
    with Master(*chain, observers=[watcher]) as master:
        master.initialize()
        master.step(17)
        master.snapshot()
        master.step(8)
        nothing_left += [child_of(master, p) for p in "ac"]
        os.kill(child_of(master, "c"), signal.SIGKILL)
        with pytest.raises(ComponentFailed, match="'c'"):
            master.step(10)
        master.restart("c")
        assert master.tick == 17
        master.step(33)
        assert values(master) == expected
        nothing_left += [child_of(master, p) for p in "ac"]
        master.reset()
        master.step(50)
        assert values(master) == expected
    n = len(whole)
    assert watcher.ticks[:n] == whole
    assert {k: v[:n] for k, v in watcher.values.items()} == unbroken


FAULTS = [0, NAN, ERROR, ABORT, DISCARD, FATAL, HANG, SEGFAULT]


# Each fault in a process of its own, in either version by turns: a restart is half a second.
@pytest.mark.parametrize(
    ("fault", "version", "isolate"),
    [(fault, 2 + k % 2, True) for k, fault in enumerate(FAULTS)]
    + [(fault, version, False) for fault in FAULTS for version in (2, 3)],
)
def test_whatever_has_failed_is_restarted_twice_and_goes_on_bit_for_bit(
    fault: int, version: int, isolate: bool, c_fmu: Any, wired: Any, nothing_left: list[int]
) -> None:
    if not isolate and fault in (ABORT, FATAL, HANG, SEGFAULT):
        return  # would end this process, or with FATAL leaves nobody to serialise the state
    fmu = c_fmu(version)

    def make(path: str) -> Component:
        return instantiate_fmu(
            fmu, path, isolate=isolate, watchdog=1.0 if isolate and fault == HANG else None
        )

    start = {"a": {"fault": fault, "fault_time": 0.1, "u": 1.0}, "b": {"u": 2.0}}
    with Master(*wired({"a": make, "b": make}, start=start), live=[("a", "y")]) as master:
        master.initialize()
        master.step(5)
        expected = master.get("a", "y"), master.get("b", "y")
        master.reset()
        master.snapshot()
        for _ in range(3):
            if isolate:
                nothing_left.append(child_of(master, "a"))
            if fault:
                with pytest.raises(ComponentFailed, match="'a' failed at t = 0"):
                    master.step(20)
            else:
                master.step(20)
            master.restart("a")
            assert master.tick == 0
            master.step(5)
            assert (master.get("a", "y"), master.get("b", "y")) == expected
        master.reset()
        master.step(5)
        assert (master.get("a", "y"), master.get("b", "y")) == expected


def test_without_a_snapshot_a_restart_begins_anew(chain: Any) -> None:
    with Master(*chain) as master:
        master.initialize()
        master.step(50)
        expected = values(master)
        os.kill(child_of(master, "a"), signal.SIGKILL)
        with pytest.raises(ComponentFailed):
            master.step()
        master.restart("a")
        assert master.tick == 0
        master.step(50)
        assert values(master) == expected


@pytest.mark.parametrize("version", [2, 3])
def test_a_restart_is_refused_where_the_state_went_with_the_process(
    version: int, c_fmu: Any, wired: Any
) -> None:
    flag = "canSerializeFMUstate" if version == 2 else "canSerializeFMUState"
    fmu = c_fmu(version, edits=[(f'{flag}="true"', f'{flag}="false"')])
    with Master(*wired({"a": isolated(fmu)}, start={"a": {"u": 1.0}})) as master:
        master.initialize()
        master.step(5)
        kept = master.snapshot()
        os.kill(child_of(master, "a"), signal.SIGKILL)
        with pytest.raises(ComponentFailed):
            master.step()
        with pytest.raises(InputInvalid, match=r"restart: a cannot serialise its state.*\"start\""):
            master.restart("a", kept)
        master.restart("a", "start")
        master.step(5)


def test_a_failed_component_of_this_process_is_restarted_too(
    wired: Any, first_order_fmi3: Path
) -> None:
    def make(path: str) -> Component:
        return instantiate_fmu(first_order_fmi3, path)

    with Master(*wired({"a": make}, start={"a": {"u": 1.0}})) as master:
        master.initialize()
        master.step(5)
        kept = master.snapshot()
        master.step(5)
        expected = master.get("a", "y")
        master.set("a", "fault", ERROR)
        with pytest.raises(ComponentFailed, match="too hot"):
            master.step()
        master.restart("a", kept)
        master.step(5)
        assert master.get("a", "y") == expected


def replaceable(fmu: Path, start: dict[str, dict[str, Any]], wired: Any, native: Any) -> Any:
    """A plan whose sources are files; `c` and what is in the place of `a` are isolated."""
    makers = {"a": isolated(fmu), "b": native, "c": isolated(fmu)}
    w = wired(makers, ["a.y -> b.u", "b.y -> a.u", "b.y -> c.u"], start=start)

    def instantiate(planned: Any) -> Component:
        if planned.path != "a":
            return w.instantiate(planned)
        source = fmu if planned.source == "a" else Path(planned.source)
        return instantiate_fmu(source, planned.path, isolate=True, watchdog=10.0)

    return w.plan, instantiate


def test_another_component_takes_the_place_of_a_killed_one(
    c_fmu: Any, wired: Any, native: Any, watcher: Any, caplog: pytest.LogCaptureFixture
) -> None:
    wanted = [('name="k" valueReference="3"', 'name="gain" valueReference="3"')]
    other = c_fmu(3, edits=wanted)
    w = replaceable(c_fmu(3), {"a": {"k": 1.5}, "b": {"k": 2.0}}, wired, native)
    with Master(*w, observers=[watcher], record=[("a", "y"), ("c", "y")]) as master:
        master.initialize()
        master.components[0].set(master.components[0].description.variables["u"], 1.0)
        master.step(10)
        before = [master.get("b", "y"), master.get("c", "y")]
        master.snapshot()
        master.step(5)
        os.kill(child_of(master, "a"), signal.SIGKILL)
        with pytest.raises(ComponentFailed):
            master.step()
        master.restart("a", source=str(other))
        assert master.tick == 10
        assert [master.get("b", "y"), master.get("c", "y")] == before
        assert master.get("a", "y") == 0.0  # it begins here
        assert any("has no k" in m for m in caplog.messages)
        assert "gain" in master.components[0].description.variables
        master.step(20)
        master.reset()
        master.step(3)
    assert watcher.ticks[:31] == list(range(31))


@pytest.mark.parametrize("killed", [True, False])
def test_a_unit_that_another_source_does_not_name_is_taken_from_the_place(
    killed: bool, c_fmu: Any, wired: Any, native: Any, caplog: pytest.LogCaptureFixture
) -> None:
    bare = c_fmu(3, edits=[(' start="0" unit="cm"', ' start="0"')])
    with Master(*replaceable(c_fmu(3), {"a": {"k": 1.5}}, wired, native)) as master:
        master.initialize()
        master.step(4)
        master.snapshot()
        master.step(4)
        if killed:
            os.kill(child_of(master, "a"), signal.SIGKILL)
            with pytest.raises(ComponentFailed):
                master.step()
        master.restart("a", source=str(bare))
        assert master.tick == 4
        assert any("a.y: states no unit" in m for m in caplog.messages)
        master.step(4)


def test_a_component_that_does_not_fit_is_refused(c_fmu: Any, wired: Any, native: Any) -> None:
    wrong = c_fmu(3, edits=[('name="y" valueReference="2"', 'name="x" valueReference="2"')])
    with Master(*replaceable(c_fmu(3), {}, wired, native)) as master:
        master.initialize()
        master.step(2)
        master.snapshot()
        with pytest.raises(SystemInvalid, match=r"a\.y: first_order has none; expected output"):
            master.restart("a", source=str(wrong))
        master.step(2)
        assert master.tick == 4


# ---- the shipped survey -----------------------------------------------------------------------


def test_the_shipped_system_gives_the_same_bits_all_isolated(tmp_path: Path) -> None:
    runs = [
        run("bluerov2_hold", until=1.0, out=tmp_path / name, isolate=isolate).signals()
        for name, isolate in (("here", ()), ("apart", ("*",)))
    ]
    assert len(runs[0]) > 20
    for name in runs[0]:
        np.testing.assert_array_equal(runs[0][name], runs[1][name])
