"""Variable communication step: its length follows the coupling, and a step can be repeated."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import cos, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.errors import ComponentFailed, InputInvalid, SystemInvalid
from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.fmus.export.fmu_file import build_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu
from uuvsim_cosim.kernels.kernel import fuse
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.orchestrator.master.faults import Fault
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.start import enter_initialization
from uuvsim_cosim.orchestrator.plan.variable_step import planned_variable_step
from uuvsim_cosim.orchestrator.python.component import PythonComponent
from uuvsim_cosim.orchestrator.scenarios.scenario import Manipulation, Scenario
from uuvsim_cosim.orchestrator.ssp.ssd import read_ssd, write_ssd
from uuvsim_cosim.orchestrator.system.variable_step import (
    PowerBond,
    VariableStep,
    variable_step_of_text,
)


def mass(m: float) -> Model:
    """A mass that a force accelerates."""
    model = Model("mass")
    force = model.input("force", unit="N")
    x0 = model.parameter("x_0", 0.1, unit="m")
    v = model.state("v_", unit="m/s")
    x = model.state("x_", start=x0, unit="m")
    model.der(v, force / model.parameter("m", m, unit="kg"))
    model.der(x, v)
    model.output("v", v, unit="m/s")
    model.output("x", x, unit="m")
    return model


def spring(k: float) -> Model:
    """A spring whose end moves, with the stroke as its state."""
    model = Model("spring")
    v = model.input("v", unit="m/s")
    x = model.state("stroke", start=model.parameter("x_0", 0.1, unit="m"), unit="m")
    model.der(x, v)
    model.output("force", -k * x, unit="N")
    return model


class Wave:
    """y = sin t, from the step's end."""

    inputs: Mapping[str, str] = {}
    outputs: Mapping[str, str] = {"y": "N"}

    def initialize(self, t: float) -> dict[str, Any]:
        return {"y": sin(t)}

    def step(self, t: float, dt: float, u: dict[str, Any]) -> dict[str, Any]:
        return {"y": sin(t + dt)}


OSCILLATOR = ("mass.v -> spring.v", "spring.force -> mass.force")


def native(model: Model) -> Callable[[str], Native]:
    return lambda path: Native(model, path)


@pytest.fixture
def oscillator(wired: Any) -> Callable[..., Any]:
    """Return a mass on a spring of 1 rad/s, coupled by force and velocity, with a variable step."""

    def make(text: str, *, kind: str = "native", folder: Path = Path(), **changes: Any) -> Any:
        makers: dict[str, Any] = {}
        for name, model in (("mass", mass(1.0)), ("spring", spring(1.0))):
            if kind == "native":
                makers[name] = native(model)
                continue
            fmi = 2 if kind == "FMI 2.0" else 3
            path = build_fmu(model, fmi=fmi, target=folder / f"{name}.fmu")
            isolate = kind == "isolated"
            makers[name] = lambda at, path=path, isolate=isolate: instantiate_fmu(
                path, at, isolate=isolate
            )
        w = wired(makers, OSCILLATOR, tick="1/1000000")
        return varied(w, text, **changes)

    return make


def varied(w: Any, text: str, **changes: Any) -> Any:
    """Return a plan with a variable step."""
    step = replace(variable_step_of_text(text)[0], **changes)
    about = w.plan.tick, w.plan.components, w.plan.transfers, w.plan.groups
    return replace(w, plan=replace(w.plan, variable=planned_variable_step(step, *about)))


def swing(w: Any, until: float = 10.0) -> tuple[float, Any]:
    """Return the error of the oscillator's place at the end, and the report of its steps."""
    with Master(*w) as master:
        master.initialize()
        master.stop_at([round(until / float(w.plan.tick))])
        master.run_until(until)
        assert master.time == until
        return abs(master.get("mass", "x") - 0.1 * cos(until)), master.variable_step


def test_the_error_follows_the_tolerance(oscillator: Any) -> None:
    errors, steps = [], []
    for tolerance in (1e-3, 1e-4, 1e-5):
        text = f"smallest=1e-6 largest=1 absolute={tolerance} relative={tolerance} order=1"
        error, report = swing(oscillator(text))
        errors.append(error)
        steps.append(report.steps)
        assert report.rejected < report.steps / 5
        assert report.unsatisfied == 0
    assert errors[0] > 3 * errors[1] > 9 * errors[2]
    assert errors[2] < 1e-4
    assert steps[0] < steps[1] < steps[2] < 20_000


@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_extrapolation_of_order_p_has_an_error_of_order_p_plus_one(order: int, wired: Any) -> None:
    """A mass is driven by sin t: at steps of equal length, v - (1 - cos t) goes with h^(p + 1)."""
    errors = []
    for h in ("1/50", "1/100"):
        w = wired(
            {"wave": lambda path: PythonComponent(Wave, path), "mass": native(mass(1.0))},
            ["wave.y -> mass.force"], tick=h,
        )  # fmt: skip
        text = f"smallest={h} largest={h} order={order} rollback=no"
        with Master(*varied(w, text)) as master:
            master.initialize()
            master.run_until(0.2)  # the first steps have fewer points
            begin = master.get("mass", "v") - (1 - cos(0.2))
            worst = 0.0
            while master.time < 4.0:
                before = master.tick
                master.step()
                assert master.tick == before + 1
                error = master.get("mass", "v") - (1 - cos(master.time)) - begin
                worst = max(worst, abs(error))
        errors.append(worst)
    assert errors[0] / errors[1] == pytest.approx(2 ** (order + 1), rel=0.05)


def test_steps_of_one_tick_have_the_bits_of_a_fixed_step() -> None:
    hold = uuv.load("bluerov2_hold")
    fixed, one_tick = flatten(hold), flatten(hold.with_variable_step("smallest=0.01 largest=0.01"))
    states = []
    for plan in (fixed, one_tick):
        from uuvsim_cosim.orchestrator.master.prepared import prepare

        with Master(plan, prepare(plan, "native")) as master:
            master.initialize()
            master.run_until(5.0)
            states.append(np.concatenate([master.get("hull", n) for n in ("eta", "nu", "q")]))
    assert states[0].tobytes() == states[1].tobytes()


TEXT = "smallest=1e-6 largest=1 first=0.2 absolute=1e-4 relative=1e-4 order=2"


@pytest.mark.parametrize("kind", ["FMI 2.0", "FMI 3.0", "isolated"])
def test_fmus_make_the_steps_of_native_components_to_the_bit(
    kind: str, oscillator: Any, tmp_path: Path
) -> None:
    expected = swing(oscillator(TEXT), 3.0)
    assert expected[1].rejected > 0
    assert swing(oscillator(TEXT, kind=kind, folder=tmp_path), 3.0) == expected


def test_the_steps_do_not_depend_on_how_many_are_asked_for(oscillator: Any) -> None:
    ends = []
    for pieces in (1, 7, 1_000_000):
        with Master(*oscillator(TEXT)) as master:
            master.initialize()
            while master.time < 3.0:
                master.step(pieces)
                if pieces == 1_000_000:
                    break
            while master.time < 3.0:
                master.step()
            ends.append((master.tick, master.get("mass", "x"), master.variable_step))
    assert ends[0] == ends[1] == ends[2]


def test_a_snapshot_keeps_the_length_of_the_next_step_and_the_past(oscillator: Any) -> None:
    with Master(*oscillator(TEXT)) as master:
        master.initialize()
        master.run_until(1.0)
        kept = master.snapshot()
        ends = []
        for _ in range(2):
            master.run_until(3.0)
            ends.append((master.tick, master.get("mass", "x"), master.variable_step))
            master.restore(kept)
        assert ends[0] == ends[1]


def test_a_component_with_its_own_step_is_met_at_each_of_its_points(wired: Any) -> None:
    makers = {
        "wave": lambda path: PythonComponent(Wave, path),
        "mass": native(mass(1.0)), "spring": native(spring(1.0)),
    }  # fmt: skip
    w = wired(makers, (*OSCILLATOR, "wave.y -> mass.x_0") [:2], tick="1/1000000",
              step_ticks={"wave": 70_001})  # fmt: skip
    with Master(*varied(w, TEXT)) as master:
        master.initialize()
        seen = set()
        while master.time < 2.0:
            master.step()
            seen.add(master.tick)
        assert {70_001 * k for k in range(1, 28)} <= seen
        assert master.get("wave", "y") == sin(0.070001 * 28)


def test_events_of_a_scenario_are_communication_points(tmp_path: Path) -> None:
    hold = uuv.load("bluerov2_hold").with_variable_step(
        "tick=1e-4 smallest=1e-4 largest=0.05 absolute=1 relative=0.1"
    )
    fault = Manipulation(0.1234, "hull.eta[3]", "bias", 0.5)
    run = uuv.run(
        hold, until=0.5, out=tmp_path / "run", scenario=Scenario("s", (fault,)), backend="native"
    )
    times = run.signals().time
    depth = run.signals()["hull.eta"][:, 2]
    assert 0.1234 in times
    assert times[-1] == 0.5
    assert depth[times < 0.1234].max() < 1.4 <= depth[times == 0.1234][0]
    assert run.variable_step is not None
    assert run.variable_step.longest > 0.02


def test_a_step_that_gives_no_number_is_made_again_with_a_shorter_one(wired: Any) -> None:
    class Fragile:
        """An output that is no number after a step of more than 10 ms."""

        inputs: Mapping[str, str] = {"force": "N"}
        outputs: Mapping[str, str] = {"v": "m/s"}

        def step(self, t: float, dt: float, u: dict[str, Any]) -> dict[str, Any]:
            return {"v": 0.0 if dt <= 0.01 else float("nan")}

    makers = {"wave": lambda path: PythonComponent(Wave, path),
              "fragile": lambda path: PythonComponent(Fragile, path)}  # fmt: skip
    w = wired(makers, ["wave.y -> fragile.force"], tick="1/1000")
    text = "smallest=0.001 largest=1 first=0.5 absolute=10"
    with Master(*varied(w, text)) as master:
        master.initialize()
        master.run_until(0.1)
        assert master.variable_step is not None
        assert 0 < master.variable_step.longest <= 0.01
        assert master.variable_step.rejected > 0
    with Master(*varied(w, f"{text} rollback=no")) as master:
        master.initialize()
        with pytest.raises(ComponentFailed, match="v is nan"):
            master.run_until(1.0)


def test_a_component_that_changes_its_state_in_a_rejected_step_is_named(
    wired: Any, c_fmu: Callable[..., Path]
) -> None:
    path = c_fmu(3, flags=["-DFORGETS_ITS_STATE"])
    makers = {"wave": lambda path: PythonComponent(Wave, path),
              "lag": lambda name: instantiate_fmu(path, name)}  # fmt: skip
    w = wired(makers, ["wave.y -> lag.u"], tick="1/1000")
    text = "smallest=0.001 largest=1 first=0.5 absolute=1e-3"
    with Master(*varied(w, text), live=[("lag", "y")]) as master:
        master.initialize()
        expected = "'lag' failed at t = .* s: its state was restored .* output y has another value"
        with pytest.raises(ComponentFailed, match=expected):
            master.run_until(3.0)
    with Master(*varied(w, f"{text} rollback=no")) as master:
        master.initialize()
        master.run_until(3.0)


def test_power_bonds_choose_the_step_by_their_energy(oscillator: Any) -> None:
    bond = PowerBond("b", ("mass.force", "mass.v"), ("spring.v", "spring.force"))
    text = "smallest=1e-6 largest=0.3 absolute=1e-6 relative=1e-6 estimate=bonds"
    error, report = swing(oscillator(text, bonds=(bond,)))
    assert error < 5e-3
    assert 1000 < report.steps < 50_000
    other, finer = swing(
        oscillator(
            text.replace("1e-6 est", "1e-8 est").replace("absolute=1e-6", "absolute=1e-8"),
            bonds=(bond,),
        )
    )
    assert other < error / 3
    assert finer.steps > 2 * report.steps


def test_power_bonds_make_the_steps_that_the_formula_of_ecco_asks_for(oscillator: Any) -> None:
    """The loop is written here again, as libcosim's code has it."""
    bond = PowerBond("b", ("mass.force", "mass.v"), ("spring.v", "spring.force"))
    text = (
        "smallest=1e-4 largest=0.05 first=1e-3 absolute=1e-6 relative=1e-4 estimate=bonds "
        "rollback=no safety=0.9 slowest=0.2 fastest=1.5 proportional=0.2 integral=0.15"
    )
    ours = []
    w = oscillator(text, bonds=(bond,))
    with Master(*w) as master:
        master.initialize()
        while master.time < 5.0:
            master.step()
            ours.append((master.tick, master.get("mass", "v"), master.get("spring", "force")))
    a, b = Native(mass(1.0), "mass"), Native(spring(1.0), "spring")
    into = {"a": a.description.variables["force"], "b": b.description.variables["v"]}
    out = {"a": a.description.variables["v"], "b": b.description.variables["force"]}
    for planned, component in zip(w.plan.components, (a, b), strict=True):
        enter_initialization(planned, component, {}, None, (0.0, None))
        component.exit_initialization_mode()
    tick, length, before = 0, 1000, 1.0
    theirs: list[tuple[int, float, float]] = []
    to_a, to_b = float(b.get(out["b"])), float(a.get(out["a"]))
    while tick < 5_000_000:
        a.set(into["a"], to_a)
        b.set(into["b"], to_b)
        for component in (a, b):
            component.do_step(tick / 1e6, length / 1e6)
        y_a, y_b = float(a.get(out["a"])), float(b.get(out["b"]))
        residual = abs(to_a * y_a - to_b * y_b) * length / 1e6
        error = residual / (1e-6 + 1e-4 * residual)
        tick += length
        theirs.append((tick, y_a, y_b))
        if len(theirs) > 1:
            if before and error:
                change = 0.9 * error**-0.35 * before**0.2
                same = length
                length = min(max(int(min(max(change, 0.2), 1.5) * length), 100), 50_000)
                if change > 1.0 and length == same:  # a step of few ticks grows by one
                    length += 1
            before = error
        to_a, to_b = y_b, y_a
    for component in (a, b):
        component.free()
    assert len(ours) == len(theirs) > 100
    np.testing.assert_allclose(np.array(ours), np.array(theirs), rtol=1e-9, atol=1e-12)
    assert len(set(np.diff([tick for tick, *_ in ours]))) > 50


WRONG = {
    "largest=1": "no smallest",
    "smallest=1 largest=0.1": "0 < smallest <= largest",
    "smallest=1e-5 largest=1 order=4": "0, 1, 2 or 3",
    "smallest=1e-5 largest=1 rollback=maybe": "yes or no",
    "smallest=1e-5 largest=1 absolute=0": "absolute tolerance above 0",
    "smallest=1e-5 largest=1 relative=nan": "a number, 0 or more",
    "smallest=1e-5 largest=1 safety=2": "above 0 and at most 1",
    "smallest=1e-5 largest=1 fastest=0.5": "slowest < 1 <= fastest",
    "smallest=1e-5 largest=1 larges=2": "largest",
    "smallest=1e-5 largest=1 first=2": "from 1e-05 to 1 s",
    "smallest=1/0 largest=1": "a number",
    "smallest=1e-5 largest=1 estimate=power": "connections, bonds or both",
}


@pytest.mark.parametrize(("text", "expected"), WRONG.items())
def test_a_wrong_setting_is_answered_with_what_is_right(text: str, expected: str) -> None:
    with pytest.raises(InputInvalid, match=r"^variable step: .*") as wrong:
        variable_step_of_text(text)
    assert expected in str(wrong.value)


def refused(w: Any, text: str, **changes: Any) -> str:
    with pytest.raises(SystemInvalid) as wrong:
        varied(w, text, **changes)
    return str(wrong.value)


def test_what_cannot_follow_is_refused_by_name(wired: Any, oscillator: Any) -> None:
    w = oscillator(TEXT)
    stiff = [replace(c, description=replace(c.description, can_handle_variable_step=False,
                                            can_get_and_set_state=False))
             for c in w.plan.components[:1]]  # fmt: skip
    other = replace(w, plan=replace(w.plan, components=(*stiff, *w.plan.components[1:])))
    text = refused(other, TEXT)
    assert "mass: it declares that it cannot handle a variable communication step" in text
    assert "mass: it cannot restore its state" in text
    assert "rollback=no" in text
    assert "spring:" not in text
    assert "cannot restore" not in refused(other, f"{TEXT} rollback=no")
    assert "no multiple of the tick of 0.000001 s" in refused(w, "smallest=1e-7 largest=1")
    assert "no power bond" in refused(w, f"{TEXT} estimate=both")
    assert "no connection to 'mass.forse'" in refused(w, TEXT, tolerances=(("mass.forse", 1, 1),))
    bond = PowerBond("b", ("mass.v", "mass.force"), ("spring.v", "spring.force"))
    assert "mass.v is an output" in refused(w, f"{TEXT} estimate=bonds", bonds=(bond,))
    twice = PowerBond("b", ("mass.force", "mass.x"), ("spring.v", "spring.force"))
    assert "mass.x is not connected to spring.v" in refused(
        w, f"{TEXT} estimate=bonds", bonds=(twice,)
    )
    alone = wired({"mass": native(mass(1.0))}, tick="1/1000000")
    assert "nothing chooses its length" in refused(alone, TEXT)


def test_a_kernel_refuses_a_variable_step() -> None:
    hold = uuv.load("bluerov2_hold").with_variable_step("smallest=0.01 largest=0.1")
    with pytest.raises(SystemInvalid, match="communication step: of variable length"):
        fuse(hold)


def test_faults_that_count_samples_are_refused(oscillator: Any) -> None:
    with Master(*oscillator(TEXT)) as master:
        master.initialize()
        for kind, value in (("delay", 0.1), ("drop", 0.5)):
            with pytest.raises(InputInvalid, match="a variable communication step"):
                master.faults.add(Fault("mass.v", kind, value))  # type: ignore[arg-type]
        master.faults.add(Fault("mass.v", "bias", 0.1))
        master.run_until(1.0)
        assert master.variable_step is not None
        assert master.variable_step.rejected > 0


def test_an_ssd_keeps_the_variable_step(tmp_path: Path) -> None:
    bond = PowerBond("b", ("a.voltage", "a.current"), ("b.current", "b.voltage"))
    step = replace(
        variable_step_of_text("smallest=1/60 largest=1/2 first=1/30 order=2 rollback=no")[0],
        bonds=(bond,), tolerances=(("hull.tau", 0.5, 1e-3),),
    )  # fmt: skip
    system = replace(uuv.load("bluerov2_hold"), tick="1/120").with_variable_step(step)
    write_ssd(system, tmp_path / "hold.ssd")
    again = read_ssd(tmp_path / "hold.ssd")
    assert again.variable_step == step
    assert again.base_step == system.base_step
    assert again.with_variable_step(None).variable_step is None
    assert "1e-3" not in VariableStep(step.smallest, step.largest).text()


def test_too_long_a_smallest_step_is_a_warning(oscillator: Any) -> None:
    with Master(*oscillator("smallest=0.1 largest=0.2 absolute=1e-6")) as master:
        master.initialize()
        master.run_until(2.0)
        (remark,) = [r for r in master.remarks if "variable step" in r]
        assert (
            "steps have an error above the tolerance, because no shorter step is allowed" in remark
        )
