"""FMUs of FMI 1.0 in a system: beside all other kinds, with aliases, and what is refused."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import pytest

from uuvsim_cosim.errors import ComponentFailed, FmuError, SystemInvalid
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.running.library import load
from uuvsim_cosim.orchestrator.running.run import run
from uuvsim_cosim.orchestrator.ssp.ssp import pack
from uuvsim_cosim.orchestrator.system.system import System

CFmu = Callable[..., Path]
STEPS = 50


@pytest.mark.parametrize("isolate", [False, True])
def test_it_steps_beside_fmi_2_fmi_3_and_a_native_component(
    c_fmu: CFmu, wired: Any, native: Any, isolate: bool
) -> None:
    def chain(*versions: int) -> list[list[float]]:
        def make(path: str) -> Component:
            fmu = c_fmu(versions[int(path[1:])])
            return instantiate_fmu(fmu, path, isolate=isolate)

        makers = {f"c{i}": make for i in range(len(versions))} | {"last": native}
        names = list(makers)
        links = [f"{a}.y -> {b}.u" for a, b in pairwise(names)]
        rows = []
        with Master(*wired(makers, links, start={"c0": {"u": 1.0}})) as master:
            master.initialize()
            for _ in range(STEPS):
                master.step()
                rows.append([float(master.get(n, "y")) for n in names])
        return rows

    mixed = chain(1, 2, 3, 1)
    assert mixed == chain(2, 2, 2, 2)
    assert mixed[-1][-1] > 0.0


@pytest.mark.parametrize("isolate", [False, True])
def test_the_values_of_its_aliases_have_their_sign_in_the_stepping_loop(
    c_fmu: CFmu, wired: Any, isolate: bool
) -> None:
    def fmi1(path: str) -> Any:
        return instantiate_fmu(c_fmu(1), path, isolate=isolate)

    makers = {"a": fmi1, "b": fmi1, "c": fmi1, "d": fmi1}
    makers["e"] = lambda path: instantiate_fmu(c_fmu(3), path)
    links = ["a.minus_y -> b.u", "a.y -> c.minus_u", "a.y -> d.u", "e.boolean_out -> d.off"]
    links.append("e.boolean_out -> d.spare")  # a call sets two Booleans, of one byte each
    read = [("a", "minus_steps"), ("a", "steps"), ("d", "y"), ("d", "off"), ("d", "on")]
    read.append(("d", "same_spare"))
    start = {"a": {"u": 2.0}, "e": {"boolean_in": True}}
    with Master(*wired(makers, links, start=start), live=read) as master:
        master.initialize()
        master.step(STEPS)
        a, b, c = (float(master.get(path, "y")) for path in "abc")
        assert a == -float(master.get("a", "minus_y")) > 0.0
        assert b == c < 0.0
        assert (master.get("a", "steps"), master.get("a", "minus_steps")) == (STEPS, -STEPS)
        assert master.get("d", "y") == 0.0  # it is off
        flags = [bool(master.get("d", name)) for name in ("off", "on", "same_spare")]
        assert flags == [True, False, True]


@pytest.mark.parametrize(
    ("fault", "text"),
    [
        (1, r"output y is -?nan; expected a finite number"),
        (2, r"fmiDoStep returned error: .*too hot"),
        (4, r"fmiDoStep returned discard \(it reached t = 0\.035 s\)"),
    ],
)
def test_a_failure_in_a_chain_of_numbers_names_function_and_time(
    c_fmu: CFmu, wired: Any, fault: int, text: str
) -> None:
    """Beside an FMU of FMI 2.0, which the loop steps with functions of the same arguments."""
    makers = {
        name: lambda path: instantiate_fmu(c_fmu(2 if path == "c" else 1), path) for name in "abc"
    }
    start = {"b": {"fault": fault, "fault_time": 0.03}}
    with Master(*wired(makers, ["a.y -> b.u", "b.y -> c.u"], start=start)) as master:
        master.initialize()
        with pytest.raises(ComponentFailed, match=f"'b' failed at t = 0.0[34]5? s: .*{text}"):
            master.step(10)


def test_connected_inputs_are_there_when_it_initializes(c_fmu: CFmu, tmp_path: Path) -> None:
    system = System("s", "0.1").add("b", str(c_fmu(1))).add("a", str(c_fmu(2)))
    system = system.set("a.v", [0.5, 0.0, 0.0]).connect("a.w[1]", "b.u", convert=False)
    found = run(system, until=0.1, out=tmp_path / "r").signals()
    assert found["b.begun"].tolist() == [1.0, 1.0]  # a.w = 2 a.v


def test_a_traced_run_has_the_same_bits(c_fmu: CFmu, tmp_path: Path) -> None:
    system = System("s", "0.1").add("a", str(c_fmu(1)), start={"u": 1.0})
    system = system.add("b", str(c_fmu(1))).connect("a.minus_y", "b.minus_u")
    plain = run(system, until=1.0, out=tmp_path / "a").signals()
    traced = run(system, until=1.0, out=tmp_path / "b", trace_fmi=tmp_path / "calls.csv").signals()
    np.testing.assert_array_equal(plain["b.y"], traced["b.y"])
    assert plain["b.y"][-1] > 0.0
    calls = (tmp_path / "calls.csv").read_text()
    assert "first_order_fmiInitializeSlave,0.0 1 1.0,ok" in calls


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_packed_system_has_the_same_bits(c_fmu: CFmu, tmp_path: Path, fmi: Any) -> None:
    system = System("s", "0.1").add("a", str(c_fmu(1)), start={"u": 1.0, "v": [1.0, 2.0, 3.0]})
    system = system.add("b", str(c_fmu(1))).connect("a.y", "b.u").connect("a.w", "b.v")
    plain = run(system, until=1.0, out=tmp_path / "a").signals()
    pack(system, tmp_path / "s.ssp", fmi=fmi)
    packed = run(load(tmp_path / "s.ssp"), until=1.0, out=tmp_path / "b").signals()
    for name in ("b.y", "b.w"):
        np.testing.assert_array_equal(plain[name], packed[name])
    assert packed["b.w"][-1].tolist() == [4.0, 8.0, 12.0]
    with ZipFile(tmp_path / "s.ssp") as archive:
        text = archive.read("SystemStructure.ssd").decode()
    assert 'name="v[1]"' in text  # FMI 1.0 has no arrays


def test_an_iterated_group_is_refused_because_it_cannot_repeat_a_step(c_fmu: CFmu) -> None:
    system = System("s", "0.1").add("a", str(c_fmu(1))).add("b", str(c_fmu(1)))
    system = system.connect("a.y", "b.u").connect("b.y", "a.u").group(["a", "b"], "iterated")
    with pytest.raises(SystemInvalid, match="a cannot get and set its state"):
        flatten(system)


def test_a_snapshot_is_refused_by_name(c_fmu: CFmu, wired: Any) -> None:
    with Master(*wired({"a": lambda path: instantiate_fmu(c_fmu(1), path)})) as master:
        master.initialize()
        with pytest.raises(FmuError, match=r"a: first_order\S+ says that it cannot copy its state"):
            master.snapshot()


def test_the_second_instance_of_one_that_may_exist_once_has_its_own_process(c_fmu: CFmu) -> None:
    path = c_fmu(1, edits=[('OnlyOncePerProcess="false"', 'OnlyOncePerProcess="true"')])
    first, second = (instantiate_fmu(path, name) for name in "ab")
    assert (type(first).__name__, type(second).__name__) == ("Fmu1", "Isolated")
    for fmu in (first, second):
        fmu.free()
