"""The master: life, values between steps, reset, and what remains after a failure."""

from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import ComponentFailed, FmuError, InputInvalid
from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.orchestrator.master.core import Core
from uuvsim_cosim.orchestrator.master.master import Master

KINDS = ["fmi2", "fmi3", "native", "python"]


def noisy(path: str) -> Native:
    m = Model("noisy")
    clock = m.clock("sample", "0.02")
    z = m.discrete("z", unit="1")
    m.update(clock, z, m.normal(clock)[0])
    m.output("y", z, unit="1")
    return Native(m, path)


@pytest.mark.parametrize("kind", KINDS)
def test_reset_repeats_the_run_bit_for_bit(
    kind: str, wired: Any, request: pytest.FixtureRequest
) -> None:
    make = request.getfixturevalue(kind)
    w = wired({"a": make, "b": make}, ["a.y -> b.u", "b.y -> a.u"], start={"a": {"k": 1.5}},
              conversions={"b.y -> a.u": (-1.0, 0.3)})  # fmt: skip
    with Master(*w) as master:
        master.initialize()
        master.step(40)
        first = master.get("b", "y")
        master.reset()
        assert master.tick == 0
        assert master.get("b", "y") == 0.0
        master.step(40)
        assert master.get("b", "y") == first != 0.0
        master.reset(start={"a": {"k": 2.0}})
        master.step(40)
        assert master.get("b", "y") != first
        master.reset()
        master.step(40)
        assert master.get("b", "y") == first


def test_components_draw_by_system_seed_and_path(wired: Any) -> None:
    def drawn(master: Master) -> list[float]:
        master.step(2)
        return [master.get("a", "y"), master.get("b", "y")]

    with Master(*wired({"a": noisy, "b": noisy}, seed=7)) as master:
        master.initialize()
        of_plan = drawn(master)
        master.reset(seed=8)
        other = drawn(master)
        master.reset(seed=7)
        again = drawn(master)
    assert len({*of_plan, *other}) == 4
    assert again == of_plan


@pytest.mark.parametrize("kind", KINDS)
def test_inputs_and_tunable_parameters_are_set_between_steps(
    kind: str, wired: Any, request: pytest.FixtureRequest
) -> None:
    with Master(*wired({"a": request.getfixturevalue(kind)})) as master:
        master.initialize()
        master.step()
        assert master.get("a", "y") == 0.0
        master.set("a", "u", 2.0)
        master.step()
        first = master.get("a", "y")
        assert first > 0
        master.set("a", "k", 0.0)
        master.step(2)
        assert master.get("a", "y") < first


def test_what_cannot_be_set_is_refused_with_the_reason(wired: Any, fmi3: Any) -> None:
    with Master(*wired({"a": fmi3, "b": fmi3}, ["a.y -> b.u"])) as master:
        master.initialize()
        with pytest.raises(InputInvalid, match=r"b.u: is connected to a.y"):
            master.set("b", "u", 1.0)
        with pytest.raises(InputInvalid, match=r"a.y: is a continuous output; expected an input"):
            master.set("a", "y", 1.0)
        with pytest.raises(InputInvalid, match=r"no variable 'z'; expected one of .*boolean_in"):
            master.set("a", "z", 1.0)
        with pytest.raises(InputInvalid, match=r"no component 'c'; expected one of a, b"):
            master.get("c", "y")
        with pytest.raises(InputInvalid, match=r"a\.u: 2 values; expected a scalar"):
            master.set("a", "u", np.zeros(2))


def test_free_elements_of_a_partly_connected_input_can_be_set(wired: Any, fmi3: Any) -> None:
    with Master(*wired({"a": fmi3, "b": fmi3}, ["a.y -> b.v[2]"])) as master:
        master.initialize()
        master.set("b", "v", np.array([1.0, 2.0, 3.0]))
        master.step()
        assert master.get("b", "v").tolist() == [1.0, 0.0, 3.0]


def test_run_until_stops_at_the_first_communication_point_not_before(wired: Any, fmi3: Any) -> None:
    with Master(*wired({"a": fmi3})) as master:
        master.initialize(start_time=0.5)
        assert master.time == 0.5
        master.run_until(0.501)
        assert master.time == 0.51
        master.run_until(0.3)
        assert master.tick == 51
        with pytest.raises(InputInvalid, match="before initialize"):
            master.attach(None)  # type: ignore[arg-type]


def test_a_start_time_off_the_ticks_is_refused(wired: Any, fmi3: Any) -> None:
    with (
        Master(*wired({"a": fmi3})) as master,
        pytest.raises(InputInvalid, match=r"0\.005 s is no multiple of the tick"),
    ):
        master.initialize(start_time=0.005)


def test_everything_is_freed_if_one_component_cannot_be_made(wired: Any, python: Any) -> None:
    made: list[Any] = []

    def make(path: str) -> Any:
        if path == "b" and made:
            raise FmuError("b: cannot be made")
        made.append(python(path))
        return made[-1]

    w = wired({"a": python, "b": python})
    w.makers.update({"a": make, "b": make})
    with pytest.raises(FmuError, match="cannot be made"):
        Master(*w)
    assert len(made) == 1
    assert made[0]._object is None


def test_an_interrupted_run_ends_its_observers(wired: Any, python: Any, watcher: Any) -> None:
    class Stopper:
        inputs: dict[str, Any] = {}  # noqa: RUF012
        outputs = {"y": "1"}  # noqa: RUF012

        def step(self, t: float, dt: float, u: Any) -> dict[str, float]:
            if t >= 0.05:
                raise KeyboardInterrupt
            return {"y": t}

    from uuvsim_cosim.orchestrator.python.component import PythonComponent

    w = wired({"a": lambda path: PythonComponent(Stopper, path)})
    with Master(*w, observers=[watcher]) as master:
        master.initialize()
        with pytest.raises(KeyboardInterrupt):
            master.step(100)
        master.free()
    assert watcher.ticks == [0, 1, 2, 3, 4, 5]
    assert watcher.ended == 1


def test_observers_see_every_nth_point_of_what_was_asked(
    wired: Any, fmi3: Any, watcher: Any
) -> None:
    w = wired({"a": fmi3}, start={"a": {"u": 1.0}})
    chosen = [("a", "u"), ("a", "string_out"), ("a", "w")]
    with Master(*w, observers=[watcher], record=chosen, record_every=3) as master:
        master.initialize()
        master.step(7)
    assert watcher.ticks == [0, 3, 6]
    assert watcher.names == ["a.u", "a.string_out[1]", "a.string_out[2]", *(f"a.w[{i}]" for i in (1, 2, 3))]  # fmt: skip  # noqa: E501
    assert watcher.values["a.u"] == [1.0] * 3
    assert watcher.values["a.string_out[1]"] == [""] * 3


def test_a_component_that_failed_leaves_the_master_free_to_go(wired: Any, fmi3: Any) -> None:
    with Master(*wired({"a": fmi3}, start={"a": {"fault": 5}})) as master:
        master.initialize()
        with pytest.raises(ComponentFailed):
            master.step()
        master.free()
        with pytest.raises(InputInvalid, match="freed"):
            master.step()


def test_rows_of_a_step_that_ctrl_c_interrupts_are_not_lost(
    wired: Any, native: Any, watcher: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(core: Core, n_ticks: int, seconds: float) -> None:
        plain(core, n_ticks, seconds)
        raise KeyboardInterrupt

    plain = Core.run
    with Master(*wired({"a": native}), observers=[watcher]) as master:
        master.initialize()
        monkeypatch.setattr(Core, "run", interrupted)
        with pytest.raises(KeyboardInterrupt):
            master.step(5)
    assert watcher.ticks == [0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda m: m.step(1.5), "1.5 steps; expected a whole number"),
        (lambda m: m.step(-1), "expected a whole number, 0 or more"),
        (lambda m: m.run_until(float("nan")), "expected seconds"),
        (lambda m: m.run_until("soon"), "expected seconds"),
        (lambda m: m.restore(None), "a NoneType; expected a snapshot that"),
        (lambda m: m.initialize(), r"expected reset\(\)"),
        (lambda m: m.set("a", "u", float("nan")), "nan"),
    ],
)
def test_a_wrong_call_is_refused_in_words(call: Any, message: str, wired: Any, native: Any) -> None:
    with Master(*wired({"a": native})) as master:
        master.initialize()
        with pytest.raises(InputInvalid, match=message):
            call(master)
