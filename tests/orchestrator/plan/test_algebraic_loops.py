"""Algebraic loops: iterated by default, refused where they cannot be, delayed where asked."""

import math
import re
import zipfile
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.errors import LoopNotConverged, SystemInvalid
from uuvsim_cosim.fmus.export.fmu_file import build_fmu
from uuvsim_cosim.kernels.kernel import fuse
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.osp.osp import read_osp
from uuvsim_cosim.orchestrator.plan.algebraic_loops import estimated_gain
from uuvsim_cosim.orchestrator.plan.flatten import flatten, plan_to_inspect
from uuvsim_cosim.orchestrator.plan.plan import Group
from uuvsim_cosim.orchestrator.running.library import available
from uuvsim_cosim.orchestrator.running.run import run
from uuvsim_cosim.orchestrator.ssp.ssd import read_ssd, write_ssd
from uuvsim_cosim.orchestrator.system.system import System

FIXED = 3 / 7  # of a = 2 b + 1, b = -3 a + 1


def gain(unit: str = "1") -> Model:
    """Y = g u + 1."""
    m = Model("gain")
    u = m.input("u", unit=unit)
    m.output("y", m.parameter("g", 2.0, unit="1") * u + 1.0, unit="1")
    m.output("still", m.parameter("k", 1.0, unit="1"), unit="1")
    return m


def without(path: Path, target: Path, *edits: tuple[str, str]) -> Path:
    """Copy an FMU with edits of its description."""
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            if name == "modelDescription.xml":
                text = data.decode()
                for a, b in edits:
                    assert a in text
                    text = text.replace(a, b)
                data = text.encode()
            new.writestr(name, data)
    return target


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    folder = tmp_path_factory.mktemp("gains")

    def make(fmi: Literal[2, 3] = 3, unit: str = "1") -> Path:
        target = folder / f"gain_{fmi}_{unit.replace('%', 'percent')}.fmu"
        return target if target.exists() else build_fmu(gain(unit), fmi=fmi, target=target)

    return make


@pytest.fixture
def stateless(fmus: Callable[..., Path], tmp_path: Path) -> Path:
    """A gain that cannot restore its state."""
    edit = ('canGetAndSetFMUState="true"', 'canGetAndSetFMUState="false"')
    serialises = ('canSerializeFMUState="true"', 'canSerializeFMUState="false"')
    return without(fmus(), tmp_path / "stateless.fmu", edit, serialises)


def gains(a: Path, b: Path | None = None, g_a: float = 2.0, g_b: float = -3.0) -> System:
    s = System("gains", "0.1").add("a", str(a), start={"g": g_a})
    s = s.add("b", str(b or a), start={"g": g_b})
    return s.connect("a.y", "b.u").connect("b.y", "a.u")


def outputs(
    system: System, steps: int = 5, isolate: tuple[str, ...] = (), a: str = "a"
) -> list[float]:
    plan = flatten(system)
    with Master(plan, prepare(plan, "native", isolate=isolate)) as master:
        master.initialize()
        found = []
        for _ in range(steps):
            master.step()
            found.append(float(master.get(a, "y")))
        return found


# ---- iterated -------------------------------------------------------------------------------


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("isolate", [(), ("*",), ("b",)])
def test_a_loop_of_gain_minus_six_is_solved_at_each_communication_point(
    fmi: int, isolate: tuple[str, ...], fmus: Any
) -> None:
    assert outputs(gains(fmus(fmi)), isolate=isolate) == pytest.approx([FIXED] * 5, abs=1e-9)


def test_a_model_exchange_member_is_iterated(fmus: Any, tmp_path: Path) -> None:
    text = zipfile.ZipFile(fmus(2)).read("modelDescription.xml").decode()
    begin = text.index("<CoSimulation")
    end = text.index("<", begin + 1)
    inner = text[begin : text.index("</CoSimulation>") + 15] if "</CoSimulation>" in text else ""
    alone = without(fmus(2), tmp_path / "me.fmu", (inner or text[begin:end], ""))
    assert outputs(gains(alone, fmus(3))) == pytest.approx([FIXED] * 5, abs=1e-9)


def test_a_loop_inside_a_nested_system_is_iterated(fmus: Any) -> None:
    inner = gains(fmus()).expose("y", "a.y")
    outer = System("outer", "0.1").add("n", inner).add("c", str(fmus())).connect("n.y", "c.u")
    plan = flatten(outer)
    assert [plan.components[i].path for i in plan.groups[-1].members] == ["n.a", "n.b"]
    assert outputs(outer, a="n.a") == pytest.approx([FIXED] * 5, abs=1e-9)


def test_a_loop_through_two_nested_systems_is_iterated(fmus: Any) -> None:
    one = System("one", "0.1").add("g", str(fmus())).expose("u", "g.u").expose("y", "g.y")
    outer = System("outer", "0.1").add("p", one).add("q", one.set("g.g", -3.0))
    outer = outer.connect("p.y", "q.u").connect("q.y", "p.u")
    assert outputs(outer, a="p.g") == pytest.approx([FIXED] * 5, abs=1e-9)


def test_a_component_that_feeds_itself_is_iterated(fmus: Any) -> None:
    system = System("one", "0.1").add("a", str(fmus()), start={"g": -4.0}).connect("a.y", "a.u")
    assert outputs(system) == pytest.approx([0.2] * 5, abs=1e-10)


def test_a_unit_is_converted_on_the_way_around(fmus: Any) -> None:
    # u in percent: b = -0.03 (100 a) + 1 = -3 a + 1
    system = gains(fmus(3), fmus(3, "%"), g_b=-0.03)
    assert outputs(system) == pytest.approx([FIXED] * 5, abs=1e-9)
    plan = flatten(system)
    gain = estimated_gain(plan, plan.algebraic_loops[0])
    assert gain is not None
    assert gain.around == pytest.approx(-6.0, rel=1e-6)


def test_members_of_one_longer_step_are_iterated(fmus: Any) -> None:
    s = System("gains", "0.1").add("a", str(fmus()), rate="0.3")
    s = s.add("b", str(fmus()), rate="0.3", start={"g": -3.0})
    s = s.connect("a.y", "b.u").connect("b.y", "a.u")
    assert outputs(s, 7) == pytest.approx([FIXED] * 7, abs=1e-9)


@pytest.fixture
def hub(fmus: Any, tmp_path: Path) -> Path:
    """Two ways through: y = u / 2 + 1, z = 1 - 2 v."""
    m = Model("hub")
    u, v = m.input("u", unit="1"), m.input("v", unit="1")
    m.output("y", 0.5 * u + 1.0, unit="1")
    m.output("z", -2.0 * v + 1.0, unit="1")
    return build_fmu(m, fmi=3, target=tmp_path / "hub.fmu")


def test_a_sum_is_iterated_with_what_it_feeds(fmus: Any, hub: Path) -> None:
    s = System("s", "0.1").add("a", str(hub)).add("b", str(fmus()), start={"g": 0.5})
    s = s.add("c", str(fmus())).add("sum", "function:sum?inputs=1").group(["sum", "a"])
    s = s.connect("c.y", "sum.u").connect("sum.y", "a.v")  # beside the loop
    plan = flatten(s.connect("a.y", "b.u").connect("b.y", "a.u"))
    assert plan.groups == (Group("jacobi", (2,)), Group("iterated", (0, 1, 3)))


def test_loops_that_share_a_component_are_solved_together(fmus: Any, hub: Path) -> None:
    s = System("s", "0.1").add("a", str(hub))
    s = s.add("b", str(fmus()), start={"g": 0.5}).add("c", str(fmus()), start={"g": 2.0})
    s = s.connect("a.y", "b.u").connect("b.y", "a.u").connect("a.z", "c.u").connect("c.y", "a.v")
    plan = flatten(s)
    assert plan.groups == (Group("iterated", (0, 1, 2)),)
    assert len(plan.algebraic_loops) == 2
    assert outputs(s) == pytest.approx([2.0] * 5, abs=1e-9)


def test_what_lies_outside_a_loop_keeps_its_step(fmus: Any) -> None:
    system = gains(fmus()).add("c", str(fmus())).connect("a.y", "c.u")
    assert flatten(system).groups == (Group("jacobi", (2,)), Group("iterated", (0, 1)))


def test_a_python_component_is_never_part_of_an_algebraic_loop(fmus: Any, tmp_path: Path) -> None:
    (tmp_path / "p.py").write_text(
        "class P:\n    inputs = {'u': '1'}\n    outputs = {'y': '1'}\n"
        "    def step(self, t, dt, u):\n        return {'y': 0.5 * u['u']}\n"
    )
    s = System("s", "0.1").add("a", str(fmus()), start={"g": 0.5})
    s = s.add("p", f"{tmp_path / 'p.py'}:P").connect("a.y", "p.u").connect("p.y", "a.u")
    plan = flatten(s)
    assert plan.algebraic_loops == ()
    with Master(plan, prepare(plan)) as master:
        master.initialize()
        master.step(3)
        assert {r.target for r in master.residuals} == {"p.u", "a.u"}


@pytest.mark.parametrize("name", available())
def test_shipped_systems_have_no_algebraic_loops(name: str) -> None:
    plan = flatten(uuv.load(name))
    assert plan.algebraic_loops == ()
    assert all(g.algorithm != "iterated" for g in plan.groups)


# ---- refused --------------------------------------------------------------------------------


def test_a_member_that_cannot_restore_is_refused_with_gain_and_remedy(
    fmus: Any, stateless: Path
) -> None:
    with pytest.raises(
        SystemInvalid,
        match=r"a\.y -> b\.u, b\.y -> a\.u: its estimated gain is -6;.*b cannot get and set its "
        r"state; expected components that can.*filter.*--loops delay",
    ):
        flatten(gains(fmus(), stateless))


def test_the_gain_is_estimated_by_differences_where_there_are_no_derivatives(
    stateless: Path, tmp_path: Path
) -> None:
    own = 'providesDirectionalDerivatives="true"'
    mute = without(stateless, tmp_path / "mute.fmu", (own, ""))
    with pytest.raises(SystemInvalid, match="its estimated gain is -6;"):
        flatten(gains(mute))


def test_members_of_different_steps_are_refused(fmus: Any) -> None:
    s = System("gains", "0.1").add("a", str(fmus())).add("b", str(fmus()), rate="0.2")
    with pytest.raises(SystemInvalid, match=r"a steps by 0\.1 s, b by 0\.2 s"):
        flatten(s.connect("a.y", "b.u").connect("b.y", "a.u"))


def test_the_policy_refuse_refuses_a_loop_that_could_be_iterated(fmus: Any) -> None:
    with pytest.raises(SystemInvalid, match=r'gain is -6;.*"refuse"; expected --loops iterate'):
        flatten(gains(fmus()).with_loops("refuse"))


def test_a_loop_partly_in_a_group_is_refused(fmus: Any) -> None:
    s = gains(fmus()).add("c", str(fmus())).group(["a", "c"])
    with pytest.raises(SystemInvalid, match='one group of a, b, of algorithm "iterated"'):
        flatten(s)


def test_another_policy_is_refused(fmus: Any) -> None:
    with pytest.raises(SystemInvalid, match="'dealy'; expected iterate, refuse or delay"):
        gains(fmus()).with_loops("dealy")  # type: ignore[arg-type]


def test_a_kernel_refuses_a_loop_by_name() -> None:
    s = System("s").add("a", "function:sum?inputs=1").connect("a.y", "a.u")
    for policy in ("iterate", "delay"):
        with pytest.raises(SystemInvalid, match=r"a: an .*in a kernel"):
            fuse(s.with_loops(policy))  # type: ignore[arg-type]


def test_a_loop_that_is_refused_can_be_shown(fmus: Any, stateless: Path) -> None:
    plan, refused = plan_to_inspect(gains(fmus(), stateless))
    assert "cannot get and set" in refused
    assert len(plan.algebraic_loops) == 1


@pytest.mark.parametrize("offset", [1.0, 0.0])
def test_a_gain_of_one_has_no_single_solution(offset: float, fmus: Any) -> None:
    s = System("s", "0.1").add("a", str(fmus()), start={"g": 2.0}).add("b", str(fmus()))
    s = s.set("b.g", 0.5).connect("a.y", "b.u", offset=-1.0).connect("b.y", "a.u", offset=-offset)
    plan = flatten(s)  # b.u = 2 a.u, a.u = b.u / 2 + 1 - offset
    with Master(plan, prepare(plan)) as master, pytest.raises(LoopNotConverged, match=r"gain.* 1"):
        master.initialize()


def test_a_run_whose_loop_stops_converging_keeps_its_recording(fmus: Any, tmp_path: Path) -> None:
    events = tmp_path / "events.yaml"
    events.write_text("events:\n  - {at: 1, set: a.g, value: 2.0}\n")  # gain 0.25, then 1
    system = gains(fmus(), g_a=0.5, g_b=0.5)
    with pytest.raises(LoopNotConverged, match=r"t = 1 s.*gain is not 1.*--loops delay") as error:
        run(system, until=2.0, out=tmp_path / "r", backend="native", scenario=events)
    assert error.value.exit_status == 3
    kept = error.value.recording
    assert kept == tmp_path / "r"
    assert uuv.read_signals(kept).time[-1] == 1.0


def test_a_switch_that_never_settles_is_named(wired: Any, fmi3: Any) -> None:
    m = Model("no")
    u = m.input("u", unit="1", type="Boolean")
    m.output("y", 1 - u, unit="1", type="Boolean")
    from uuvsim_cosim.fmus.codegen.native import Native

    w = wired({"a": lambda p: Native(m, p)}, ["a.y -> a.u"], groups=[Group("iterated", (0,))])
    with Master(*w) as master:
        master.initialize()
        with pytest.raises(LoopNotConverged, match=r"a\.u changes each time"):
            master.step()


# ---- delayed --------------------------------------------------------------------------------


def test_a_delayed_loop_that_diverges_is_reported(fmus: Any, tmp_path: Path) -> None:
    done = run(gains(fmus()), until=20.0, out=tmp_path / "r", backend="native", loops="delay")
    said = " | ".join(done.warnings)
    assert "delayed by a step for each connection" in said
    assert "its estimated gain is -6" in said
    assert "t = 20 s, where the run ends: the loop may diverge" in said
    assert done.residual is not None
    assert done.residual.relative > 1.0
    text = (tmp_path / "r" / "run.json").read_text()
    assert '"loops": "delay"' in text
    assert '"coupling_residual": {' in text


def test_a_delayed_loop_of_small_gain_is_reported_and_does_not_diverge(
    fmus: Any, tmp_path: Path
) -> None:
    s = gains(fmus(), g_a=0.5, g_b=0.5)
    done = run(s, until=2.0, out=tmp_path / "r", backend="native", loops="delay")
    assert len(done.warnings) == 1
    assert done.residual is not None
    assert done.residual.relative < 1e-9  # initialization has solved it


def test_an_iterated_loop_has_no_residual(fmus: Any, tmp_path: Path) -> None:
    done = run(gains(fmus()), until=2.0, out=tmp_path / "r", backend="native")
    assert (done.residual, done.warnings) == (None, ())
    assert done.iterated == ("a.y -> b.u, b.y -> a.u",)


def test_a_loop_inside_a_group_that_the_user_chose_is_delayed_and_named(fmus: Any) -> None:
    plan = flatten(gains(fmus(), g_a=0.5).group(["a", "b"]))
    assert plan.groups == (Group("gauss-seidel", (0, 1)),)
    assert "by its group" in plan.warnings[0]


def test_an_undeclared_hop_keeps_its_delay_and_is_named(fmus: Any, tmp_path: Path) -> None:
    text = zipfile.ZipFile(fmus()).read("modelDescription.xml").decode()
    begin = text.index("dependencies=")
    declared = text[text.rindex("<Output", 0, begin) : text.index("/>", begin)]
    bare = declared[: declared.index("dependencies=")]
    silent = without(fmus(), tmp_path / "silent.fmu", (declared, bare))
    done = run(gains(fmus(), silent, 0.5, 0.5), until=1.0, out=tmp_path / "r", backend="native")
    assert any("not declared (b.u -> b.y)" in w and "delayed" in w for w in done.warnings)
    assert done.residual is not None


# ---- files, replacement ---------------------------------------------------------------------


def test_the_policy_survives_the_ssd(fmus: Any, tmp_path: Path) -> None:
    system = System("s", "0.1", base=tmp_path).add("a", str(fmus())).with_loops("delay")
    write_ssd(system, tmp_path / "s.ssd")
    assert read_ssd(tmp_path / "s.ssd").loops == "delay"
    write_ssd(system.with_loops("iterate"), tmp_path / "s.ssd")
    assert "loops" not in (tmp_path / "s.ssd").read_text()


def test_the_policy_of_a_nested_system_is_not_used_and_that_is_reported(fmus: Any) -> None:
    outer = System("outer", "0.1").add("n", gains(fmus()).with_loops("delay"))
    plan = flatten(outer)
    assert plan.algebraic_loops[0].iterated
    assert "n: its loop policy 'delay' is ignored" in plan.warnings[0]


def test_a_loop_through_a_sum_of_an_osp_file_is_iterated(fmus: Any, tmp_path: Path) -> None:
    (tmp_path / "gain.fmu").write_bytes(fmus(2).read_bytes())
    (tmp_path / "OspSystemStructure.xml").write_text(
        '<?xml version="1.0" encoding="utf-8"?><OspSystemStructure version="0.1" '
        'xmlns="http://opensimulationplatform.com/MSMI/OSPSystemStructure">'
        '<BaseStepSize>0.1</BaseStepSize><Simulators><Simulator name="a" source="gain.fmu"/>'
        '</Simulators><Functions><Sum name="s" inputCount="1"/></Functions><Connections>'
        '<SignalConnection><Variable simulator="a" name="y"/>'
        '<Signal function="s" name="in[0]"/></SignalConnection>'
        '<SignalConnection><Variable simulator="a" name="u"/>'
        '<Signal function="s" name="out"/></SignalConnection>'
        "</Connections></OspSystemStructure>"
    )
    system = read_osp(tmp_path / "OspSystemStructure.xml")
    assert [g.algorithm for g in flatten(system).groups] == ["iterated"]
    assert outputs(system) == pytest.approx([-1.0] * 5, abs=1e-9)  # y = 2 y + 1


def test_a_replacement_that_closes_a_loop_is_refused(fmus: Any, tmp_path: Path) -> None:
    text = zipfile.ZipFile(fmus()).read("modelDescription.xml").decode()
    assert 'dependencies="' in text
    begin = text.index('dependencies="')
    given = text[begin : text.index('"', begin + 14) + 1]
    begin = text.index("dependenciesKind")
    kinds = text[begin : text.index('"', begin + 18) + 1]
    holding = without(fmus(), tmp_path / "hold.fmu", (f"{given} {kinds}", 'dependencies=""'))
    plan = flatten(gains(fmus(), holding, 0.5, 0.5))
    assert plan.algebraic_loops == ()
    with Master(plan, prepare(plan)) as master:
        master.initialize()
        master.step(2)
        master.snapshot()
        with pytest.raises(SystemInvalid, match=r"algebraic loop a\.y -> b\.u, b\.y -> a\.u"):
            master.restart("b", source=str(fmus()))


# ---- the residual ---------------------------------------------------------------------------


class Ramp:
    """y = 3 t, and passes on what it is fed with."""

    inputs = {"u": "1"}  # noqa: RUF012
    outputs = {"y": "1"}  # noqa: RUF012

    def step(self, t: float, dt: float, u: dict[str, Any]) -> dict[str, Any]:
        return {"y": 3.0 * (t + dt)}


class Sensor(Ramp):
    """y = 50 + 3 t, from its first sample on."""

    def step(self, t: float, dt: float, u: dict[str, Any]) -> dict[str, Any]:
        return {"y": 50.0 + 3.0 * (t + dt)}


def ramps(wired: Any, measured: bool = True, **more: Any) -> Master:
    from uuvsim_cosim.orchestrator.python.component import PythonComponent

    make: Any = lambda path: PythonComponent(Ramp, path)  # noqa: E731
    w = wired({"a": make, "b": make}, ["a.y -> b.u"], tick="1/10", **more)
    return Master(*w, measured=measured)


def test_the_residual_of_a_ramp_is_its_slope_times_the_step(wired: Any) -> None:
    with ramps(wired) as master:
        master.initialize()
        master.step(2)
        (r,) = master.residuals
        assert (r.source, r.target, r.time) == ("a.y", "b.u", 0.2)
        assert r.residual == pytest.approx(0.3)
        assert r.relative == pytest.approx(0.3 / 1.3)  # the input was 0.3
        master.step(10)
        assert master.residuals[0].residual == pytest.approx(0.3)


def test_the_residual_of_a_longer_step_is_that_of_the_whole_step(wired: Any) -> None:
    with ramps(wired, step_ticks={"b": 4}) as master:
        master.initialize()
        master.step(7)
        assert master.residuals[0].relative == 0.0
        master.step()
        assert (master.residuals[0].residual, master.residuals[0].time) == (pytest.approx(1.2), 0.8)


@pytest.mark.parametrize(("slow", "rises"), [({}, 3.0), ({"a": 5}, 15.0), ({"b": 5}, 15.0)])
def test_an_initial_value_that_no_step_has_produced_does_not_count(
    slow: dict[str, int], rises: float, wired: Any
) -> None:
    # A sensor that measures 50 + 3 t has the output 0 before its first sample.
    from uuvsim_cosim.orchestrator.python.component import PythonComponent

    sensor: Any = lambda path: PythonComponent(Sensor, path)  # noqa: E731
    makers = {"a": sensor, "b": sensor}
    with Master(*wired(makers, ["a.y -> b.u"], tick="1/10", step_ticks=slow)) as master:
        master.initialize()
        master.step(5 if slow else 1)
        assert master.residuals[0].residual == 0.0
        master.step(15)
        assert master.residuals[0].residual == pytest.approx(0.1 * rises)


def test_a_conversion_is_part_of_the_residual(wired: Any) -> None:
    with ramps(wired, conversions={"a.y -> b.u": (100.0, 7.0)}) as master:
        master.initialize()
        master.step(2)
        assert master.residuals[0].residual == pytest.approx(30.0)
        assert master.residuals[0].relative == pytest.approx(30.0 / 38.0)  # the input was 37


@pytest.mark.parametrize(("unit", "turn"), [("rad", 2 * math.pi), ("deg", 360.0), ("1", None)])
def test_an_angle_that_passes_half_a_turn_has_no_residual_of_a_turn(
    unit: str, turn: float | None, wired: Any
) -> None:
    from uuvsim_cosim.orchestrator.python.component import PythonComponent

    whole = turn or 1.0

    class Heading:
        """It turns by a tenth of a turn in each step, and is wrapped to half a turn."""

        inputs = {"u": unit}  # noqa: RUF012
        outputs = {"y": unit}  # noqa: RUF012

        def step(self, t: float, dt: float, u: dict[str, Any]) -> dict[str, Any]:
            return {"y": ((t + dt + 0.5) % 1.0 - 0.5) * whole}

    make: Any = lambda path: PythonComponent(Heading, path)  # noqa: E731
    with Master(*wired({"a": make, "b": make}, ["a.y -> b.u"], tick="1/10")) as master:
        master.initialize()
        master.step(20)
        assert master.residuals[0].residual == pytest.approx(0.1 * whole if turn else 0.9)


@pytest.mark.parametrize("unit", ["1", "rad"])
@pytest.mark.parametrize(("second", "diverges"), [(-3.0, True), (-0.4, False)])
def test_a_loop_of_python_components_that_diverges_is_named(
    second: float, diverges: bool, unit: str, tmp_path: Path
) -> None:
    """Their outputs answer a step later, so that the loop is not algebraic."""
    (tmp_path / "gains.py").write_text(
        f"class Gain:\n    k = 2.0\n    inputs = {{'u': '{unit}'}}\n"
        f"    outputs = {{'y': '{unit}'}}\n"
        "    def step(self, t, dt, u):\n        return {'y': self.k * u['u'] + 1.0}\n"
        f"class Second(Gain):\n    k = {second}\n"
    )
    system = System("gains", "0.1")
    for name, kind in (("a", "Gain"), ("b", "Second")):
        system = system.add(name, f"{tmp_path / 'gains.py'}:{kind}")
    system = system.connect("a.y", "b.u").connect("b.y", "a.u")
    done = run(system, until=20, out=tmp_path / "run", backend="native")
    named = [w for w in done.warnings if "the loop may diverge" in w]
    assert bool(named) == diverges
    if diverges:
        assert re.search(r"loop through (a\.y -> b|b\.y -> a)\.u: its values change by", named[0])


def test_a_connection_without_delay_has_no_residual(wired: Any) -> None:
    with ramps(wired, groups=[Group("gauss-seidel", (0, 1))]) as master:
        master.initialize()
        master.step(3)
        assert master.residuals == []


def test_a_master_that_nobody_asks_measures_nothing(wired: Any) -> None:
    with ramps(wired, measured=False) as master:
        master.initialize()
        master.step(3)
        assert (master.residuals, master.remarks) == ([], ())


def test_a_reset_forgets_the_residuals(wired: Any) -> None:
    with ramps(wired) as master:
        master.initialize()
        master.step(3)
        master.reset()
        assert [r.relative for r in master.residuals] == [0.0]


@pytest.mark.parametrize("groups", [(), ((0,), (1,))])
def test_the_lockstep_measures_as_the_loop_does(groups: Any, wired: Any, fmi2: Any) -> None:
    # dy/dt = (u - y) / 0.5 by Euler: y = 1 after the start decays; b follows a.
    makers = {"a": fmi2, "b": fmi2}
    given = [Group("gauss-seidel", members) for members in groups]
    start = {"a": {"y": 1.0}}
    with Master(*wired(makers, ["a.y -> b.u"], groups=given, start=start)) as master:
        master.initialize()
        master.step(2)
        (r,) = master.residuals
        decay = 1.0 - 0.01 / 0.5
        assert r.residual == pytest.approx(decay - decay**2)
        assert r.unit == "cm"


def test_the_gain_of_a_ring_of_three_is_the_product(fmus: Any) -> None:
    s = System("ring", Fraction(1, 10))
    for name, g in (("a", 2.0), ("b", -3.0), ("c", 0.5)):
        s = s.add(name, str(fmus()), start={"g": g})
    s = s.connect("a.y", "b.u").connect("b.y", "c.u").connect("c.y", "a.u", factor=4.0)
    plan = flatten(s)
    gain = estimated_gain(plan, plan.algebraic_loops[0])
    assert gain is not None
    assert gain.around == pytest.approx(-12.0)
    assert gain.growth == pytest.approx(12.0 ** (1 / 3))
    assert not gain.is_singular
