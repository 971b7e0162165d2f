"""A system as one FMU is the master, bit for bit, in whatever tool steps it."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import uuvsim_cosim as uuv
from tests.fmus.by_wine import NEEDS_WINE, stepped
from uuvsim_cosim.errors import ComponentFailed, FmuError, InputInvalid, SystemInvalid
from uuvsim_cosim.fmus.check.check_fmu import examine
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.importer.read_description import read_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu
from uuvsim_cosim.kernels.system_fmu.system_fmu import build_system_fmu
from uuvsim_cosim.kernels.system_fmu.variables import _names
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten

TICK = 0.01


def tiny() -> uuv.System:
    """Return a hull with a thruster, noise, a free input and one that is free in part."""
    return (
        uuv.System("tiny", tick="0.01")
        .add("current", "model:current_gauss_markov")
        .add("thruster", "model:thruster")
        .add("hull", "model:sphere", start={"eta_0": [0.0, 0.0, 3.0, 0.0, 0.0, 0.0]})
        .add("compass", "model:compass", rate="0.02")
        .connect("current.v_c", "hull.v_c")
        .connect("thruster.thrust", "hull.tau[1]")
        .connect("hull.nu_r", "thruster.nu_r")
        .connect("hull.eta", "compass.eta")
        .with_mismatches("warn")  # the sphere has another thruster
    )


@pytest.fixture(scope="module")
def built() -> Callable[[int], Path]:
    return lambda fmi: build_system_fmu(tiny(), fmi=fmi)  # type: ignore[arg-type]


class Run:
    """An instance, by names."""

    def __init__(self, path: Path) -> None:
        fmu = read_fmu(path)
        self.variables = fmu.description.variables
        self.x: Component = instantiate_fmu(fmu, "it")

    def set(self, **values: Any) -> None:
        for name, value in values.items():
            v = self.variables[name]
            self.x.set(v, np.broadcast_to(value, v.shape) if v.shape else value)

    def start(self, **values: Any) -> Run:
        self.x.enter_initialization_mode(0.0, None)
        self.set(**values)
        self.x.exit_initialization_mode()
        return self

    def steps(self, first: int, n: int, each: int = 1) -> list[bytes]:
        rows = []
        for k in range(first, first + n, each):
            self.x.do_step(k * TICK, each * TICK)
            rows.append(self.outputs())
        return rows

    def outputs(self) -> bytes:
        outputs = [v for v in self.variables.values() if v.causality == "output"]
        return b"".join(np.asarray(self.x.get(v), float).tobytes() for v in outputs)


@pytest.fixture(params=[2, 3])
def run(built: Callable[[int], Path], request: pytest.FixtureRequest) -> Iterator[Run]:
    made = Run(built(request.param))
    yield made
    made.x.free()


def of_master(
    system: uuv.System, seed: int, steps: int, act: Callable[[Master, int], None]
) -> list[bytes]:
    """Return all outputs at each communication point."""
    plan = flatten(system, seed)
    names = [(c.path, v.name) for c in plan.components for v in c.description.of("output")]
    rows = []
    with Master(plan, prepare(plan, "native")) as master:
        master.initialize()
        for k in range(steps):
            act(master, k)
            master.step()
            rows.append(b"".join(np.asarray(master.get(*n), float).tobytes() for n in names))
    return rows


def test_it_gives_the_bits_of_the_master(run: Run) -> None:
    def act(master: Master, k: int) -> None:
        if k == 40:
            master.set("thruster", "u", 0.5)
        if k == 60:
            master.set("hull", "tau", [0.0, 2.0, 0.0, 0.0, 0.0, 0.1])
        if k == 80:
            master.set("current", "speed", 0.7)
            master.set("thruster", "K_n", 0.0004)

    expected = of_master(tiny(), 5, 120, act)
    run.start(seed=5)
    rows = run.steps(0, 40)
    run.set(thruster_u=0.5)
    rows += run.steps(40, 20)
    run.set(hull_tau=[9.0, 2.0, 0.0, 0.0, 0.0, 0.1])  # the first is connected, and stays so
    rows += run.steps(60, 20)
    run.set(current_speed=0.7, thruster_K_n=0.0004)
    rows += run.steps(80, 40)
    assert rows[1::2] == expected[1::2]  # in between, the compass is in the midst of its step


def test_a_shipped_system_gives_the_bits_of_the_master() -> None:
    system = uuv.load("bluerov2_survey")
    run = Run(build_system_fmu(system, fmi=2)).start(seed=3)
    rows = run.steps(0, 300)
    run.x.free()
    assert rows == of_master(system, 3, 300, lambda master, k: None)


def test_one_long_step_is_many_short_ones(run: Run) -> None:
    run.start()
    short = run.steps(0, 60)
    run.x.reset()
    run.start()
    assert run.steps(0, 60, each=6) == short[5::6]


def test_initial_outputs_follow_start_values(run: Run) -> None:
    run.x.enter_initialization_mode(0.0, None)
    assert run.x.get(run.variables["hull_eta"]).tolist()[2] == 3.0
    run.set(hull_eta_0=[0.0, 0.0, 4.0, 0.0, 0.0, 0.0])
    assert run.x.get(run.variables["hull_eta"]).tolist()[2] == 4.0


def test_a_state_comes_back_also_as_bytes(run: Run) -> None:
    run.start(seed=2, thruster_u=0.4)
    run.steps(0, 30)
    state = run.x.get_fmu_state()
    data = run.x.serialize_fmu_state(state)
    expected = run.steps(30, 50)
    run.x.set_fmu_state(state)
    assert run.steps(30, 50) == expected
    run.x.set_fmu_state(run.x.deserialize_fmu_state(data))
    assert run.steps(30, 50) == expected


def test_seeds_differ_and_two_instances_are_two(run: Run, built: Callable[[int], Path]) -> None:
    other = Run(built(3)).start(seed=1)
    run.start(seed=0)
    first, second = run.steps(0, 20), other.steps(0, 20)
    assert first != second
    run.x.reset()
    run.start(seed=1)
    assert run.steps(0, 20) == second
    other.x.free()


def test_a_step_that_is_no_whole_multiple_is_refused_with_both_numbers(run: Run) -> None:
    run.start()
    before = run.outputs()
    with pytest.raises(ComponentFailed, match=r"0\.015 s.*whole multiple.*0\.01 s"):
        run.x.do_step(0.0, 0.015)
    assert run.outputs() == before
    run.steps(0, 3)


def test_a_value_that_is_not_finite_is_named(run: Run) -> None:
    with pytest.raises(FmuError, match=r"hull\.nu_dot\[1\] is not finite at t = 0 s"):
        run.start(current_speed=1e300)
    run.x.reset()
    run.start()
    run.set(current_speed=1e300)
    with pytest.raises(ComponentFailed, match=r"hull\.\w+\[\d\] is not finite at t = 0\.0\d s"):
        run.steps(0, 50)
    run.x.reset()
    run.start()
    run.steps(0, 3)


def test_values_out_of_range_are_refused_by_name(run: Run) -> None:
    run.start()
    with pytest.raises(ComponentFailed, match=r"thruster_u.*expected a value in \[-1, 1\]"):
        run.set(thruster_u=1.5)


@pytest.mark.parametrize("fmi", [2, 3])
def test_nothing_is_wrong_with_it(built: Callable[[int], Path], fmi: int) -> None:
    looks = examine(built(fmi))
    assert [look for look in looks if look.result == "finding"] == []
    assert {"run", "reset", "determinism", "state"} <= {x.check for x in looks if x.result == "ok"}


@pytest.mark.parametrize("fmi", [2, 3])
def test_fmpy_runs_it(built: Callable[[int], Path], fmi: int) -> None:
    from fmpy import simulate_fmu

    name = "hull_eta[1]" if fmi == 2 else "hull_eta"
    found = simulate_fmu(
        str(built(fmi)),
        stop_time=0.5,
        output_interval=0.05,
        start_values={"thruster_u": 0.5, "seed": 5},
        output=[name],
    )

    def act(master: Master, k: int) -> None:
        if k == 0:
            master.set("thruster", "u", 0.5)

    expected = of_master(tiny(), 5, 50, act)
    rows = [np.frombuffer(row)[_at_eta()] for row in expected[4::5]]
    assert np.array([np.ravel(x)[0] for x in found[name]])[1:].tolist() == rows


def _at_eta() -> int:
    """Return the place of hull.eta among the outputs."""
    at = 0
    for c in flatten(tiny()).components:
        for v in c.description.of("output"):
            if (c.path, v.name) == ("hull", "eta"):
                return at
            at += v.size
    raise AssertionError


LIBCOSIM = """
import json, sys
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave
from libcosimpy.CosimManipulator import CosimManipulator

execution = CosimExecution.from_step_size(50_000_000)  # ns
slave = execution.add_local_slave(CosimLocalSlave(fmu_path=sys.argv[1], instance_name="it"))
observer = CosimObserver.create_last_value()
execution.add_observer(observer)
for name, value in json.loads(sys.argv[3]).items():
    found = [v for v in execution.slave_variables(slave) if v.name.decode() == name]
    execution.integer_initial_value(slave, found[0].reference, value)
execution.simulate_until(500_000_000)
reals = [v for v in execution.slave_variables(slave) if v.name.decode() == sys.argv[2]]
found = observer.last_real_values(slave, [v.reference for v in reals])
sys.stderr.write("found " + json.dumps(found))
"""


def libcosim(fmu: Path, output: str, **integers: int) -> float:
    """Run an FMU alone for 0.5 s in libcosim, in a process of its own."""
    command = [sys.executable, "-c", LIBCOSIM, str(fmu), output, json.dumps(integers)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return float(json.loads(done.stderr.rpartition("found ")[2])[0])


def test_libcosim_runs_it(built: Callable[[int], Path]) -> None:
    expected = of_master(tiny(), 5, 50, lambda master, k: None)[-1]
    assert libcosim(built(2), "hull_eta[1]", seed=5) == np.frombuffer(expected)[_at_eta()]


def test_a_component_that_is_no_declaration_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        "class Mine:\n    inputs = {}\n    outputs = {'y': 'm'}\n"
        "    def step(self, t, dt, u):\n        return {'y': 0.0}\n"
    )
    system = tiny().add("mine", f"{tmp_path}/mine.py:Mine")
    with pytest.raises(SystemInvalid, match=r"mine: .*a Python component.*expected a declaration"):
        build_system_fmu(system)


def test_only_the_outputs_that_were_asked_for_are_shown() -> None:
    path = build_system_fmu(tiny(), fmi=3, signals=["hull.nu", "compass.*"])
    outputs = {v.name for v in read_fmu(path).description.of("output")}
    assert outputs == {"hull_nu", "compass_psi", "compass_valid", "compass_t_sample"}
    with pytest.raises(InputInvalid, match=r"signals 'hull\.mu': no output; .*hull\.nu"):
        build_system_fmu(tiny(), signals=["hull.mu"])


def test_names_have_no_dots_and_those_that_clash_get_two_underscores() -> None:
    assert _names(["a.b", "rov.hull.nu"], "flat") == ["a_b", "rov_hull_nu"]
    assert _names(["a.b_c", "a_b.c", "d.e"], "flat") == ["a__b_c", "a_b__c", "d_e"]
    assert _names(["a.b_c", "a_b.c"], "structured") == ["a.b_c", "a_b.c"]
    with pytest.raises(SystemInvalid, match="exported as a__b"):
        _names(["a.b", "a_b", "a__b"], "flat")


@pytest.mark.slow
@NEEDS_WINE
def test_the_windows_binary_gives_the_bits_of_the_linux_binary(
    tmp_path: Path, built: Callable[[int], Path]
) -> None:
    import zipfile

    run = Run(built(3)).start()
    expected = []
    for k in range(0, 60, 3):
        run.set(thruster_u=0.01 * (k // 3))
        run.x.do_step(k * TICK, 3 * TICK)
        eta = run.x.get(run.variables["hull_eta"])
        expected += [f"{bits:016x}" for bits in eta.view(np.uint64)]
    path = build_system_fmu(tiny(), fmi=3, platforms=("win64",))
    zipfile.ZipFile(path).extract("binaries/x86_64-windows/tiny.dll", tmp_path)
    fmu = read_fmu(path)
    u, y = (fmu.description.variables[n].value_references[0] for n in ("thruster_u", "hull_eta"))
    arguments = [fmu.description.token, u, 1, y, 6, 20]
    dll = tmp_path / "binaries/x86_64-windows/tiny.dll"
    assert stepped(tmp_path, dll, arguments) == expected
