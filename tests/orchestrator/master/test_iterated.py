"""Iterated groups: a step is repeated until inputs and outputs at its end agree."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import ComponentFailed, LoopNotConverged, SystemInvalid
from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.fmus.export.fmu_file import build_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Group
from uuvsim_cosim.orchestrator.ssp.ssd import read_ssd, write_ssd
from uuvsim_cosim.orchestrator.system.system import System

LOOP = ["a.y -> b.u", "b.y -> a.u"]
SOLVERS = ("newton", "anderson", "fixed-point")


def gain(g: float) -> Model:
    m = Model("gain")
    u = m.input("u", unit="1")
    m.output("y", m.parameter("g", g, unit="1") * u + 1.0, unit="1")
    return m


def square() -> Model:
    """A loop of y = u^2 + 1 onto itself has no solution."""
    m = Model("square")
    u = m.input("u", unit="1")
    m.output("y", u * u + 1.0, unit="1")
    return m


def native(model: Model) -> Callable[[str], Native]:
    return lambda path: Native(model, path)


def iterated(n: int = 2, solver: Any = "newton", **more: Any) -> list[Group]:
    return [Group("iterated", tuple(range(n)), solver, **more)]


@pytest.fixture(params=["native", "FMI 2.0", "FMI 3.0", "isolated"])
def gains(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[[float], Any]:
    """Make a component y = g u + 1 of each kind."""

    def make(g: float) -> Callable[[str], Any]:
        if request.param == "native":
            return native(gain(g))
        fmi = 2 if request.param == "FMI 2.0" else 3
        path = build_fmu(gain(g), fmi=fmi, target=tmp_path / f"gain{g}.fmu")
        isolate = request.param == "isolated"
        return lambda name: instantiate_fmu(path, name, isolate=isolate)

    return make


@pytest.mark.parametrize(("g_a", "g_b", "expected"), [(0.5, 0.5, 2.0), (2.0, -3.0, 3 / 7)])
def test_a_linear_loop_is_exact_in_stepping(
    g_a: float, g_b: float, expected: float, gains: Any, wired: Any
) -> None:
    w = wired({"a": gains(g_a), "b": gains(g_b)}, LOOP, groups=iterated())
    with Master(*w) as master:
        master.initialize()
        for _ in range(3):
            master.step()
            assert master.get("a", "y") == pytest.approx(expected, abs=1e-12)
            assert master.get("b", "y") == pytest.approx(g_b * expected + 1.0, abs=1e-12)


@pytest.mark.parametrize("solver", SOLVERS[:2])
def test_a_loop_gain_of_six_needs_more_than_a_fixed_point(solver: str, wired: Any) -> None:
    makers = {"a": native(gain(2.0)), "b": native(gain(-3.0))}
    with Master(*wired(makers, LOOP, groups=iterated(solver=solver))) as master:
        master.initialize()
        master.step(5)
        assert master.get("a", "y") == pytest.approx(3 / 7, abs=1e-9)


@pytest.mark.parametrize("solver", SOLVERS[:2])
def test_a_linear_loop_that_changes_is_solved_in_as_many_trials_as_it_has_unknowns_and_two(
    solver: str, wired: Any
) -> None:
    makers = {"a": native(gain(0.5)), "b": native(gain(0.5))}
    w = wired(makers, LOOP, groups=iterated(solver=solver, limit=4))
    with Master(*w) as master:
        master.initialize()
        for g_a, g_b in ((2.0, -3.0), (-7.0, 0.5), (0.25, 30.0)):
            for component, g in zip(master.components, (g_a, g_b), strict=True):
                component.set(component.description.variables["g"], g)
            master.step()
            assert master.get("a", "y") == pytest.approx((g_a + 1) / (1 - g_a * g_b), abs=1e-9)


def test_an_unconverged_loop_names_hops_residual_and_step(wired: Any) -> None:
    makers = {"a": native(gain(0.5)), "b": native(gain(0.5))}
    w = wired(makers, LOOP, groups=iterated(solver="fixed-point", limit=2))
    with Master(*w) as master:
        master.initialize()
        master.step(3)  # Initialization Mode has solved the loop already
        master.components[1].set(master.components[1].description.variables["g"], -3.0)
        master.components[0].set(master.components[0].description.variables["g"], 2.0)
        with pytest.raises(
            LoopNotConverged,
            match=r"a\.y -> b\.u, b\.y -> a\.u.*t = 0\.03 s.*'fixed-point'.*residual .* at [ab]\.u",
        ):
            master.step()


def test_a_member_whose_state_cannot_be_kept_fails_the_step_by_its_name(
    wired: Any, fmi2: Any
) -> None:
    with Master(*wired({"a": fmi2, "b": fmi2}, LOOP, groups=iterated())) as master:
        master.initialize()
        master.step()
        b = master.components[1]
        b.set(b.description.variables["fault"], 11)
        with pytest.raises(ComponentFailed, match=r"component 'b' .* 0\.01 s: fmi2GetFMU"):
            master.step()


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_loop_without_solution_is_an_error(solver: str, wired: Any) -> None:
    makers = {"a": native(gain(0.0)), "s": native(square())}
    connections = ["a.y -> s.u", "s.y -> a.u"]
    w = wired(makers, connections, groups=iterated(solver=solver))
    with Master(*w) as master:
        master.initialize()
        master.step()
        master.components[0].set(master.components[0].description.variables["g"], 1.0)
        with pytest.raises(LoopNotConverged):  # x = x^2 + 2
            master.step()


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("kind", ["native", "fmi2", "fmi3", "python"])
def test_coupled_lags_agree_at_the_end_of_every_step(
    solver: str, kind: str, wired: Any, request: pytest.FixtureRequest
) -> None:
    make = request.getfixturevalue(kind)
    start = {"a": {"k": 1.0}, "b": {"k": -2.0}}
    w = wired({"a": make, "b": make}, LOOP, groups=iterated(solver=solver), start=start,
              tick="1/20")  # fmt: skip
    with Master(*w) as master:
        master.initialize()
        for _ in range(20):
            before = {p: master.get(p, "y") for p in "ab"}
            master.step()
            y = {p: master.get(p, "y") for p in "ab"}
            for p, other, k in (("a", "b", 1.0), ("b", "a", -2.0)):
                if kind == "python":  # one step of Euler
                    expected = before[p] + 0.05 * (k * y[other] - before[p]) / 0.5
                else:  # the input holds over the step
                    expected = k * y[other] + (before[p] - k * y[other]) * np.exp(-0.1)
                assert y[p] == pytest.approx(expected, abs=2e-6)


def test_a_group_of_many_loops_is_solved_at_once(wired: Any) -> None:
    n = 6
    rng = np.random.default_rng(3)
    g = rng.uniform(-2.0, 2.0, n)
    makers = {f"c{i}": native(gain(g[i])) for i in range(n)}
    ring = [f"c{i}.y -> c{(i + 1) % n}.u" for i in range(n)]
    with Master(*wired(makers, ring, groups=iterated(n))) as master:
        master.initialize()
        master.step(2)
        matrix = np.eye(n)
        for i in range(n):
            matrix[(i + 1) % n, i] -= g[(i + 1) % n]
        expected = np.linalg.solve(matrix, np.ones(n))
        found = [master.get(f"c{i}", "y") for i in range(n)]
        assert found == pytest.approx(expected, rel=1e-9)


def test_a_replay_from_a_snapshot_has_the_same_bits(native: Any, wired: Any) -> None:
    start = {"a": {"k": 1.5}, "b": {"k": -2.0}}
    with Master(*wired({"a": native, "b": native}, LOOP, groups=iterated(), start=start)) as m:
        m.initialize()
        m.step(7)
        snapshot = m.snapshot()
        m.step(9)
        first = m.get("a", "y")
        m.restore(snapshot)
        m.step(9)
        assert m.get("a", "y") == first


def test_inputs_from_outside_the_group_are_those_of_the_steps_start(wired: Any) -> None:
    makers = {"a": native(gain(0.5)), "b": native(gain(0.5)), "out": native(gain(3.0))}
    groups = [Group("iterated", (0, 1)), Group("jacobi", (2,))]
    with Master(*wired(makers, [*LOOP, "a.y -> out.u"], groups=groups)) as master:
        master.initialize()
        assert master.get("out", "y") == pytest.approx(7.0)
        master.components[0].set(master.components[0].description.variables["g"], 0.0)
        master.step()
        assert master.get("a", "y") == pytest.approx(1.0)
        assert master.get("out", "y") == pytest.approx(7.0)  # a.y of the step's start
        master.step()
        assert master.get("out", "y") == pytest.approx(4.0)


def hold() -> System:
    return System("tank").add("a", "model:battery").add("b", "model:wrench")


def test_the_settings_of_a_group_survive_the_ssd(tmp_path: Path) -> None:
    system = hold().group(["a", "b"], "iterated", solver="anderson", tolerance=1e-7, limit=9)
    write_ssd(system, tmp_path / "tank.ssd")
    again = read_ssd(tmp_path / "tank.ssd")
    assert again.groups == system.groups
    assert flatten(again).groups[0] == Group("iterated", (0, 1), "anderson", 1e-7, 9)


def test_a_member_that_cannot_restore_is_refused_by_name(tmp_path: Path) -> None:
    code = "class C:\n    inputs = {}\n    outputs = {'y': '1'}\n"
    code += "    def __init__(self):\n        self.kept = (i for i in ())\n"
    code += "    def step(self, t, dt, u):\n        return {'y': 1.0}\n"
    (tmp_path / "c.py").write_text(code)
    system = hold().add("c", f"{tmp_path / 'c.py'}:C").group(["a", "c"], "iterated")
    with pytest.raises(SystemInvalid, match="c cannot get and set its state"):
        flatten(system)


def test_members_of_different_steps_are_refused_by_name() -> None:
    system = hold().add("c", "model:battery", rate="0.03").group(["a", "c"], "iterated")
    with pytest.raises(SystemInvalid, match=r"a steps by 0\.01 s, c by 0\.03 s"):
        flatten(system)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"algorithm": "iterate"}, "iterated"),
        ({"solver": "newtn"}, "newton"),
        ({"tolerance": 0.0}, "tolerance"),
        ({"limit": 0}, "at least one iteration"),
    ],
)
def test_a_wrong_setting_is_refused_with_the_right_ones(more: dict[str, Any], message: str) -> None:
    with pytest.raises(SystemInvalid, match=message):
        hold().group(["a", "b"], **{"algorithm": "iterated", **more})


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_loop_of_gain_one_has_no_solution_however_far_it_runs(solver: str, wired: Any) -> None:
    makers = {"a": native(gain(0.5)), "b": native(gain(0.5))}
    with Master(*wired(makers, LOOP, groups=iterated(solver=solver))) as master:
        master.initialize()
        master.components[0].set(master.components[0].description.variables["g"], 2.0)
        with pytest.raises(LoopNotConverged):  # x = x + 3/2
            master.step()
