"""A container FMU steps its FMUs with the bits of the master, also in groups, in other tools."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import uuvsim_cosim as uuv
from tests.conftest import Uuvsim
from tests.kernels.system_fmu.test_system_fmu import libcosim
from uuvsim_cosim.errors import ComponentFailed, FmuError, SystemInvalid
from uuvsim_cosim.fmus.check.check_fmu import examine
from uuvsim_cosim.fmus.importer.read_description import read_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu
from uuvsim_cosim.kernels.system_fmu.container import build_container_fmu
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.ssp.ssd import write_ssd

ALGORITHMS = ("jacobi", "gauss-seidel", "iterated")
SHOWN = ("a_y", "a_w", "b_y", "b_w", "b_int32_out", "slow_voltage")


@pytest.fixture
def pair(first_order_fmi2: Path, first_order_fmi3: Path) -> Callable[..., uuv.System]:
    """Two foreign FMUs, of FMI 2.0 and 3.0, that feed each other, and a slower declaration."""

    def make(algorithm: str = "jacobi", tick: str = "0.1") -> uuv.System:
        system = (
            uuv.System("pair", tick=tick)
            .add("a", str(first_order_fmi2), start={"k": 0.9, "v": [1.0, 2.0, 3.0]})
            .add("b", str(first_order_fmi3), start={"k": 1.5, "string_in": ["x", "é"]})
            .add("slow", "model:battery", rate="0.2", start={"soc_0": 0.7})
            .connect("a.y", "b.u", factor=0.3, offset=0.1)
            .connect("b.y", "a.u")
            .connect("a.w", "b.v")
            .connect("b.y", "slow.current", convert=False)
        )
        return system if algorithm == "jacobi" else system.group(["a", "b"], algorithm)

    return make


@contextmanager
def alone(path: Path) -> Iterator[Any]:
    """Instantiate an FMU by this package's importer."""
    x = instantiate_fmu(read_fmu(path), "it")
    try:
        yield x
    finally:
        x.free()


def values_of(x: Any, names: tuple[str, ...]) -> bytes:
    variables = x.description.variables
    return b"".join(np.asarray(x.get(variables[n]), float).tobytes() for n in names)


def stepped(
    path: Path, n: int, act: Callable[[Any, int], None] = lambda x, k: None,
    names: tuple[str, ...] = SHOWN,
) -> list[bytes]:  # fmt: skip
    """Return the values at each communication point; `act` sets values before step k, -1: start."""
    with alone(path) as x:
        act(x, -1)
        x.enter_initialization_mode(0.0, None)
        x.exit_initialization_mode()
        rows = [values_of(x, names)]
        for k in range(n):
            act(x, k)
            x.do_step(k * 0.1, 0.1)
            rows.append(values_of(x, names))
    return rows


def of_master(
    system: uuv.System, n: int, act: Callable[[Master, int], None] = lambda m, k: None,
    names: tuple[str, ...] = SHOWN,
) -> list[bytes]:  # fmt: skip
    plan = flatten(system)

    paths = [(name.split("_", 1)[0], name.split("_", 1)[1]) for name in names]

    def row(master: Master) -> bytes:
        return b"".join(np.asarray(master.get(*path), float).tobytes() for path in paths)

    with Master(plan, prepare(plan), live=paths) as master:  # as others see them
        master.initialize()
        rows = [row(master)]
        for k in range(n):
            act(master, k)
            master.step()
            rows.append(row(master))
    return rows


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_each_step_has_the_bits_of_the_master(
    pair: Callable[..., uuv.System], algorithm: str, fmi: Any
) -> None:
    path, remarks = build_container_fmu(pair(algorithm), fmi=fmi)
    assert remarks == ()
    assert stepped(path, 30) == of_master(pair(algorithm), 30)


def test_the_groups_differ_from_each_other(pair: Callable[..., uuv.System]) -> None:
    ends = {of_master(pair(a), 30)[-1] for a in ALGORITHMS}
    assert len(ends) == 3, "the claim above would be empty"


def test_inputs_and_tunable_parameters_of_the_importer_reach_the_fmus(
    pair: Callable[..., uuv.System],
) -> None:
    def act(x: Any, k: int) -> None:
        v = x.description.variables
        if k == 3:
            x.set(v["b_int32_in"], np.array([7, -8], np.int32))
            x.set(v["a_v"], np.array([4.0, 5.0, 6.0]))
        if k == 5:
            x.set(v["a_k"], 0.2)

    def same(master: Master, k: int) -> None:
        if k == 3:
            master.set("b", "int32_in", [7, -8])
            master.set("a", "v", [4.0, 5.0, 6.0])
        if k == 5:
            master.set("a", "k", 0.2)

    path, _ = build_container_fmu(pair("gauss-seidel"), fmi=3)
    found = stepped(path, 12, act)
    assert found == of_master(pair("gauss-seidel"), 12, same)
    assert found != stepped(path, 12)


def test_parameters_that_are_set_before_the_start_are_those_of_the_system(
    pair: Callable[..., uuv.System],
) -> None:
    def act(x: Any, k: int) -> None:
        if k == -1:
            v = x.description.variables
            x.set(v["a_T"], 0.25)
            x.set(v["a_v"], np.array([9.0, 8.0, 7.0]))
            x.set(v["slow_soc_0"], 0.2)

    path, _ = build_container_fmu(pair("iterated"))
    changed = pair("iterated").set("a.T", 0.25).set("a.v", [9, 8, 7]).set("slow.soc_0", 0.2)
    assert stepped(path, 10, act) == of_master(changed, 10)


def test_an_fmu_that_loses_its_parameters_in_setup_has_those_of_the_system(
    c_fmu: Callable[..., Path],
) -> None:
    """Some FMUs set their start values in SetupExperiment, so that they are set again after it."""

    def act(x: Any, k: int) -> None:
        if k == -1:
            x.set(x.description.variables["a_T"], 0.25)

    def system(habit: str) -> uuv.System:
        fmu = c_fmu(2, flags=[f"-D{habit}"])
        return uuv.System("one", tick="0.1").add("a", str(fmu), start={"k": 0.9, "u": 1.0})

    path, _ = build_container_fmu(system("HABITS_OF_20SIM"))
    expected = of_master(system("NONE").set("a.T", 0.25), 5, names=("a_y",))
    assert stepped(path, 5, act, names=("a_y",)) == expected


def test_a_reset_and_a_second_instance_repeat_the_bits(pair: Callable[..., uuv.System]) -> None:
    path, _ = build_container_fmu(pair("iterated"))
    looks = {look.check: look.result for look in examine(path)}
    assert looks["run"] == looks["determinism"] == looks["reset"] == "ok"
    assert looks["rules"] == "ok"


def test_fmpy_and_libcosim_give_the_bits_of_the_master(pair: Callable[..., uuv.System]) -> None:
    from fmpy import simulate_fmu

    system = pair("gauss-seidel", "0.05")
    path, _ = build_container_fmu(system)
    expected = np.frombuffer(of_master(system, 10, names=("a_y",))[-1])[0]
    table = simulate_fmu(str(path), stop_time=0.5, output_interval=0.05, output=["a_y"])
    assert table["a_y"][-1] == expected
    assert libcosim(path, "a_y") == expected


def test_a_loop_at_the_start_is_stored_and_reported(first_order_fmi3: Path) -> None:
    """In both FMUs, w = 2 v; the factors make the gain of the loop 1/4."""
    system = uuv.System("loop", tick="0.1")
    system = system.add("a", str(first_order_fmi3)).add("b", str(first_order_fmi3))
    system = system.connect("a.w", "b.v", factor=0.25, offset=1).connect("b.w", "a.v", factor=0.25)
    system = system.group(["a", "b"], "iterated")
    path, remarks = build_container_fmu(system)
    assert "its solution is stored" in remarks[0]
    assert not read_fmu(path).description.of("parameter")
    names = ("a_w", "b_w", "a_y")
    found = stepped(path, 8, names=names)
    assert found == of_master(system, 8, names=names)
    assert np.frombuffer(found[0])[0] == pytest.approx(4 / 3)  # w_a = (1 + w_a / 2 / 4 * …)


def test_other_components_are_refused_by_name(
    pair: Callable[..., uuv.System], tmp_path: Path, source_fmu: Callable[..., Path]
) -> None:
    (tmp_path / "mine.py").write_text(
        "class Mine:\n    inputs = {}\n    outputs = {'y': 'm'}\n"
        "    def step(self, t, dt, u):\n        return {'y': 0.0}\n"
    )
    system = pair().add("mine", f"{tmp_path}/mine.py:Mine")
    system = system.add("ball", f"{source_fmu('ball_fmi2.c')}#interface=ModelExchange")
    with pytest.raises(SystemInvalid) as refused:
        build_container_fmu(system)
    assert {p.place for p in refused.value.problems} == {"mine", "ball"}


def test_a_failing_component_is_named_with_its_time(first_order_fmi2: Path) -> None:
    """`fault` 2 makes a step from `fault_time` on return an error."""
    system = uuv.System("faulty", tick="0.1").add(
        "plant", str(first_order_fmi2), start={"fault": 2, "fault_time": 0.25}
    )
    with pytest.raises(ComponentFailed, match="plant failed at t = 0"):
        stepped(build_container_fmu(system)[0], 10, names=("plant_y",))


def test_a_step_that_is_no_multiple_is_refused(pair: Callable[..., uuv.System]) -> None:
    with alone(build_container_fmu(pair())[0]) as x:
        x.enter_initialization_mode(0.0, None)
        x.exit_initialization_mode()
        with pytest.raises((ComponentFailed, FmuError), match=r"whole multiple .* 0\.1 s"):
            x.do_step(0.0, 0.15)


def test_the_command_writes_it_and_pack_names_the_loss_of_groups(
    uuvsim: Uuvsim, pair: Callable[..., uuv.System]
) -> None:
    write_ssd(pair("gauss-seidel"), Path("pair.ssd"))
    status, out, err = uuvsim("fmu", "container", "pair.ssd", "-o", "pair.fmu", "--signals", "a.*")
    assert status == 0, err
    assert "pair.fmu" in out
    members = zipfile.ZipFile("pair.fmu").namelist()
    assert {"resources/fmu_0/modelDescription.xml", "sources/step_loop.c"} <= set(members)
    assert {v.name[:2] for v in read_fmu(Path("pair.fmu")).description.of("output")} == {"a_"}
    write_ssd(pair("gauss-seidel").remove("b"), Path("one.ssd"))
    write_ssd(
        uuv.System("own", "0.1").add("battery", "model:battery").add("t", "model:thruster_t200")
        .connect("battery.voltage", "t.voltage").connect("t.current", "battery.current")
        .group(["t", "battery"]),
        Path("own.ssd"),
    )  # fmt: skip
    status, out, err = uuvsim("pack", "own.ssd", "-o", "own.ssp")
    assert status == 0, err
    assert "warning: gauss-seidel group t, battery: SSP has no groups" in out
