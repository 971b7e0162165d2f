"""Model Exchange FMUs are integrated here, and their events located."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import FOREIGN, write_archive
from uuvsim_cosim.errors import ComponentFailed
from uuvsim_cosim.fmus.codegen.toolchain import compile_shared, host
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.importer.read_description import read_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.system.system import System

G, E = 9.81, 0.7


@pytest.fixture(scope="module", params=[1, 2, 3])
def ball(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    import fmpy

    version = request.param
    include = [Path(fmpy.__file__).parent / "c-code", FOREIGN]
    library = compile_shared([FOREIGN / f"ball_fmi{version}.c"], name="ball", include=include)
    platform = host().fmi3 if version == 3 else host().fmi2
    members = {
        "modelDescription.xml": (FOREIGN / f"ball_fmi{version}.xml").read_bytes(),
        f"binaries/{platform}/ball{host().suffix}": library.read_bytes(),
    }
    return write_archive(tmp_path_factory.mktemp("ball") / f"ball_fmi{version}.fmu", members)


@pytest.fixture
def begun(ball: Path) -> Any:
    made: list[Component] = []

    def begin(**start: float) -> tuple[Component, Callable[[str], float]]:
        c = instantiate_fmu(ball, "ball")
        made.append(c)
        for name, value in start.items():
            c.set(c.description.variables[name], value)
        c.enter_initialization_mode(0.0, None)
        c.exit_initialization_mode()
        return c, lambda name: float(c.get(c.description.variables[name]))

    yield begin
    for c in made:
        c.free()


def height(t: float, kick: float = 0.0, t_kick: float = math.inf) -> float:
    """Return the closed form of the ball let go at 1 m, which may be kicked before it lands."""
    h, v, now = 1.0, 0.0, 0.0
    while True:
        lands = now + (v + math.sqrt(v * v + 2 * G * h)) / G
        if now <= t_kick < min(lands, t):
            dt = t_kick - now
            h, v, now, t_kick = h + v * dt - G * dt**2 / 2, v - G * dt + kick, t_kick, math.inf
        elif lands < t:
            h, v, now = 0.0, E * (G * (lands - now) - v), lands
        else:
            return h + v * (t - now) - G * (t - now) ** 2 / 2


@pytest.mark.parametrize("step", [0.01, 0.25])
def test_a_ball_bounces_as_the_closed_form_has_it(begun: Any, step: float) -> None:
    c, get = begun()
    for k in range(round(2.0 / step)):
        c.do_step(k * step, step)
        assert get("h") == pytest.approx(height((k + 1) * step), abs=1e-7)
    assert get("bounces") == 4


def test_a_time_event_comes_at_its_time(begun: Any) -> None:
    c, get = begun(kick=2.0, t_kick=0.237)
    for k in range(10):
        c.do_step(0.1 * k, 0.1)
        assert get("h") == pytest.approx(height(0.1 * k + 0.1, 2.0, 0.237), abs=1e-7)


def test_inputs_hold_over_a_step_and_feed_through_at_once(begun: Any) -> None:
    c, get = begun()
    c.set(c.description.variables["u"], G)
    assert get("y") == pytest.approx(1.0 + G)
    c.do_step(0.0, 1.0)
    assert get("h") == pytest.approx(1.0, abs=1e-9)
    c.set(c.description.variables["u"], G + 2.0)
    c.do_step(1.0, 1.0)
    assert get("h") == pytest.approx(2.0, abs=1e-7)


def test_a_tunable_parameter_is_set_in_event_mode(begun: Any) -> None:
    c, get = begun()
    if c.description.kind == "FMI 1.0":
        pytest.skip("FMI 1.0 has no tunable parameters")
    c.set(c.description.variables["g"], 0.0)  # the FMU refuses it in Continuous-Time Mode
    c.do_step(0.0, 1.0)
    assert get("h") == pytest.approx(1.0, abs=1e-9)


def test_a_state_restores_the_same_bits(begun: Any) -> None:
    c, get = begun(kick=2.0, t_kick=0.9)
    if c.description.kind == "FMI 1.0":
        pytest.skip("FMI 1.0 has no states")
    c.do_step(0.0, 0.5)
    state = c.get_fmu_state()
    data = c.serialize_fmu_state(state)
    c.do_step(0.5, 0.5)
    first = get("h"), get("bounces")
    c.set_fmu_state(state)
    c.do_step(0.5, 0.5)
    assert (get("h"), get("bounces")) == first
    c.set_fmu_state(c.deserialize_fmu_state(data))
    c.do_step(0.5, 0.5)
    assert (get("h"), get("bounces")) == first


def test_reset_and_a_second_start_give_the_same_bits(begun: Any) -> None:
    c, get = begun()
    c.do_step(0.0, 0.7)
    first = get("h")
    c.reset()
    c.enter_initialization_mode(0.0, None)
    c.exit_initialization_mode()
    c.do_step(0.0, 0.7)
    assert get("h") == first


def test_an_fmu_that_ends_the_simulation_is_an_error_with_the_time(begun: Any) -> None:
    c, _ = begun(t_end=0.5)
    for k in range(4):
        c.do_step(0.1 * k, 0.1)
    with pytest.raises(ComponentFailed, match=r"t = 0\.5 s: it asks to end the simulation"):
        c.do_step(0.4, 0.1)


def test_it_steps_beside_co_simulation(ball: Path) -> None:
    system = System("mixed", "0.05").add("ball", str(ball)).add("battery", "model:battery")
    system = system.connect("ball.y", "battery.current", convert=False)
    plan = flatten(system)
    with Master(plan, prepare(plan, "native")) as master:
        master.initialize()
        master.step(20)
        assert master.get("ball", "y") == pytest.approx(height(1.0), abs=1e-7)
        if plan.components[0].description.kind == "FMI 1.0":
            return  # it has no states
        snapshot = master.snapshot()
        master.step(20)
        last = master.get("ball", "y"), master.get("battery", "voltage")
        master.restore(snapshot)
        master.step(20)
        assert (master.get("ball", "y"), master.get("battery", "voltage")) == last


def test_it_runs_in_a_process_of_its_own(ball: Path) -> None:
    c = instantiate_fmu(ball, "ball", isolate=True)
    c.enter_initialization_mode(0.0, None)
    c.exit_initialization_mode()
    c.do_step(0.0, 1.0)
    assert c.get(c.description.variables["h"]) == pytest.approx(height(1.0), abs=1e-7)
    c.free()


def test_inspection_names_the_interface_and_the_check_finds_nothing_in_states(ball: Path) -> None:
    from uuvsim_cosim.fmus.check.inspect_fmu import inspect
    from uuvsim_cosim.fmus.check.trial_run import trial

    assert inspect(ball).as_dict()["interface"] == "ModelExchange"
    assert [f for f in trial(ball) if f["check"] == "state"] == []


def test_co_simulation_is_preferred_where_an_fmu_has_both(ball: Path, tmp_path: Path) -> None:
    import zipfile

    if read_fmu(ball).description.kind == "FMI 1.0":
        return  # it has one interface
    with zipfile.ZipFile(ball) as archive:
        members = {n: archive.read(n) for n in archive.namelist()}
    text = members["modelDescription.xml"].decode()
    both = text.replace(
        "<DefaultExperiment", '<CoSimulation modelIdentifier="x"/><DefaultExperiment'
    )
    members["modelDescription.xml"] = both.encode()
    archive_of_both = read_fmu(write_archive(tmp_path / "both.fmu", members))
    assert read_fmu(ball).interface == "ModelExchange"
    assert archive_of_both.interface == "CoSimulation"


# ---- stiff equations --------------------------------------------------------------------------


def robertson(t: float) -> list[float]:
    """Integrate Robertson's kinetics from 0, by another implicit method at 1e-10."""
    from scipy.integrate import solve_ivp

    def rates(_: float, x: Any) -> list[float]:
        r1, r2, r3 = 0.04 * x[0], 1e4 * x[1] * (1 - x[0] - x[1]), 3e7 * x[1] ** 2
        return [r2 - r1, r1 - r2 - r3]

    done = solve_ivp(rates, (0, t), [1.0, 0.0], method="Radau", rtol=1e-10, atol=[1e-13, 1e-17])
    return [float(x) for x in done.y[:, -1]]


@pytest.mark.parametrize(("step", "count"), [(0.01, 1000), (0.4, 100), (1e6, 100)])
def test_robertsons_kinetics_are_integrated(kinetics: Path, step: float, count: int) -> None:
    c = instantiate_fmu(read_fmu(kinetics, "ModelExchange"), "kinetics")
    try:
        c.enter_initialization_mode(0.0, None)
        c.exit_initialization_mode()
        for k in range(count):
            c.do_step(k * step, step)
        a, b = (c.get(c.description.variables[n]) for n in "ab")
        said = [text for kind, text in c.messages if kind == "note"]  # type: ignore[attr-defined]
    finally:
        c.free()
    expected = robertson(count * step)
    assert a == pytest.approx(expected[0], rel=1e-2, abs=1e-4)
    assert b == pytest.approx(expected[1], rel=2e-2, abs=1e-7)
    assert len(said) == 1
    assert "its equations are stiff at t = " in said[0]


def test_a_run_reports_that_an_implicit_solver_was_used(kinetics: Path, tmp_path: Path) -> None:
    from uuvsim_cosim.orchestrator.running.run import run

    system = System("s", "0.4").add("k", f"{kinetics}#interface=ModelExchange")
    done = run(system, until=40.0, out=tmp_path / "r")
    assert any("k: its equations are stiff at t = " in w for w in done.warnings)
    assert done.signals()["k.a"][-1] == pytest.approx(robertson(40.0)[0], abs=1e-3)
    assert done.signals()["k.kind"][-1] == 2
