"""The conductor: calls in order, lockstep of several, and failures that lose nothing."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.bridge.conductor import Conductor
from uuvsim_cosim.bridge.desk import Client
from uuvsim_cosim.errors import ComponentFailed, InputInvalid, UuvsimError
from uuvsim_cosim.orchestrator.recording import read_signals
from uuvsim_cosim.orchestrator.system import System

PARTS = Path(__file__).parent / "parts.py"
ME = Client("me", "local")


def system(part: str = "Sum") -> System:
    return System("sums", "0.1").add("sum", f"{PARTS}:{part}")


@pytest.fixture
def desk() -> Iterator[Conductor]:
    with Conductor(system()) as conductor:
        yield conductor


def held(desk: Conductor, *names: str, lag: float = 60.0) -> list[Client]:
    return [desk.join(Client(name, "local"), lockstep=True, lag=lag) for name in names]


# ---- calls ------------------------------------------------------------------------------------


def test_a_step_sets_inputs_then_steps_then_gives_outputs(desk: Conductor) -> None:
    moment, outputs = desk.step(ME, 5, {"sum.a": 2.0}, ["sum.s", "sum.both"])
    assert (moment.tick, moment.running) == (5, False)
    assert outputs["sum.s"] == pytest.approx(1.0)
    assert outputs["sum.both"].tolist() == [2.0, 0.0]


def test_one_element_has_a_name(desk: Conductor) -> None:
    desk.step(ME, 1, {"sum.a": 3.0})
    assert desk.get(ME, ["sum.both[1]"]) == {"sum.both[1]": 3.0}


def test_steps_and_a_run_give_the_same(desk: Conductor) -> None:
    desk.set(ME, {"sum.a": 0.3, "sum.b": 0.1})
    for _ in range(20):
        desk.step(ME)
    one_by_one = desk.get(ME, ["sum.s"])["sum.s"]
    desk.reset(ME)
    desk.set(ME, {"sum.a": 0.3, "sum.b": 0.1})
    given = desk.run(ME, until=2.0, record=["sum.s", "sum.a"])
    assert given["sum.s"][-1] == one_by_one
    assert given["time"].tolist() == [k * 1 / 10 for k in range(21)]
    assert given["sum.a"].tolist() == [0.3] * 21


def test_more_steps_than_are_made_at_once_are_made(desk: Conductor) -> None:
    moment, _ = desk.step(ME, 2500)
    assert moment.tick == 2500


def test_moment_follows_each_answer(desk: Conductor) -> None:
    desk.step(ME, 3)
    assert desk.moment().tick == 3
    desk.run(ME, until=1.0)
    assert (desk.moment().tick, desk.moment().running) == (10, False)
    desk.reset(ME)
    assert desk.moment().tick == 0


def test_the_schema_says_what_can_be_set(desk: Conductor) -> None:
    schema = {s.name: s for s in desk.schema()}
    assert [n for n, s in schema.items() if s.settable] == ["sum.a", "sum.b", "sum.k"]
    assert (schema["sum.both"].shape, schema["sum.both"].unit) == ((2,), "m/s")


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"sum.c": 1.0}, "sum.a"),
        ({"smu.a": 1.0}, "sum.a"),
        ({"sum.s": 1.0}, "output"),
        ({"sum.a": [1.0, 2.0]}, "2 values"),
        ({"sum.a": float("nan")}, "nan"),
        ({"sum.a": "1 kg"}, "kg"),
        ({"sum.a": "1 m/s", "sum.b": None}, "sum.b"),
    ],
)
def test_a_wrong_value_is_refused_and_none_is_set(
    desk: Conductor, values: dict[str, Any], words: str
) -> None:
    with pytest.raises(InputInvalid, match=words):
        desk.set(ME, {"sum.b": 7.0, **values})
    assert desk.get(ME, ["sum.b"]) == {"sum.b": 0.0}


def test_text_with_a_unit_is_converted(desk: Conductor) -> None:
    desk.set(ME, {"sum.a": "3.6 km/h"})
    assert desk.get(ME, ["sum.a"])["sum.a"] == pytest.approx(1.0)


@pytest.mark.parametrize("n", [0, -1, 1.5, True, "2"])
def test_a_number_of_steps_that_is_none_is_refused(desk: Conductor, n: Any) -> None:
    with pytest.raises(InputInvalid, match="whole number"):
        desk.step(ME, n)


def test_what_is_wrong_with_outputs_is_found_before_the_step(desk: Conductor) -> None:
    with pytest.raises(InputInvalid, match=r"sum\.s"):
        desk.step(ME, 1, None, ["sum.t"])
    assert desk.moment().tick == 0


def test_a_restored_snapshot_is_gone_on_from_bit_for_bit(desk: Conductor) -> None:
    desk.step(ME, 3, {"sum.a": 0.7})
    kept = desk.snapshot(ME)
    first = desk.step(ME, 4, None, ["sum.s"])
    desk.restore(ME, kept)
    assert desk.step(ME, 4, None, ["sum.s"]) == first


def test_an_unknown_snapshot_is_refused_with_those_there_are(desk: Conductor) -> None:
    name = desk.snapshot(ME)
    with pytest.raises(InputInvalid, match=name):
        desk.restore(ME, "s17")


def test_reset_takes_start_values(desk: Conductor) -> None:
    desk.reset(ME, start={"sum.a": 1.0, "sum.k": 3.0})
    assert desk.step(ME, 10, None, ["sum.s"])[1]["sum.s"] == pytest.approx(3.0)


def test_a_replaced_component_begins_anew(desk: Conductor) -> None:
    desk.step(ME, 3)
    moment = desk.replace(ME, "sum", f"{PARTS}:Fails")
    assert moment.tick == 0
    assert desk.describe()["components"][0]["name"] == "Fails"


def test_a_replacement_that_does_not_fit_leaves_all_as_it_is(desk: Conductor) -> None:
    desk.step(ME, 3, {"sum.a": 1.0})
    with pytest.raises(UuvsimError, match="nothing"):
        desk.replace(ME, "sum", f"{PARTS}:nothing")
    assert desk.step(ME, 1, None, ["sum.s"])[1]["sum.s"] == pytest.approx(0.4)


def test_a_role_that_may_only_read_is_told_what_it_needs(desk: Conductor) -> None:
    reader = Client("reader", "local", frozenset({"read"}))
    assert desk.get(reader, ["sum.s"]) == {"sum.s": 0.0}
    with pytest.raises(InputInvalid, match="'reader' may read, and this needs 'step'"):
        desk.step(reader)


def test_names_of_clients_are_made_unique(desk: Conductor) -> None:
    joined = [desk.join(Client("learner", "local")).name for _ in range(3)]
    assert joined == ["learner", "learner-2", "learner-3"]


# ---- streaming --------------------------------------------------------------------------------


def test_commands_come_between_the_steps_of_a_stream(desk: Conductor) -> None:
    seen = Watching(desk, until_tick=20)
    desk.run(ME, factor=50.0)
    assert desk.set(ME, {"sum.a": 1.0}).running
    seen.reached.result(timeout=20)
    assert desk.get(ME, ["sum.s"])["sum.s"] > 0.0
    assert not desk.pause(ME).running
    tick = desk.moment().tick
    assert desk.step(ME)[0].tick == tick + 1


def test_a_step_while_it_streams_is_refused(desk: Conductor) -> None:
    desk.run(ME)
    with pytest.raises(InputInvalid, match="expected pause first"):
        desk.step(ME)


def test_a_run_that_is_paused_gives_what_it_has(desk: Conductor) -> None:
    seen = Watching(desk, until_tick=5)
    run = desk.ask("run", ME, 1e6, 50.0, ["sum.s"])
    seen.reached.result(timeout=20)
    paused = desk.pause(ME)
    given = run.result(timeout=20)
    assert given["time"][-1] == paused.time
    assert len(given["sum.s"]) == paused.tick + 1


def test_a_stream_keeps_to_its_factor() -> None:
    with Conductor(system()) as desk:
        run = desk.ask("run", ME, 2.0, 20.0, ["sum.s"])
        assert len(run.result(timeout=20)["time"]) == 21


# ---- lockstep ---------------------------------------------------------------------------------


def test_time_moves_when_all_have_asked(desk: Conductor) -> None:
    a, b = held(desk, "a", "b")
    first = desk.ask("step", a, 1, {"sum.a": 1.0}, ["sum.s"])
    desk.get(ME, ["sum.s"])
    assert not first.done()
    moment, outputs = desk.step(b, 1, {"sum.b": 2.0}, ["sum.s"])
    assert moment.tick == 1
    assert first.result() == (moment, outputs)
    assert outputs["sum.s"] == pytest.approx(0.3)


def test_the_smallest_request_is_made_and_who_asked_for_more_waits(desk: Conductor) -> None:
    a, b = held(desk, "a", "b")
    more = desk.ask("step", a, 3, None, [])
    desk.step(b, 1)
    assert not more.done()
    desk.step(b, 2)
    assert more.result()[0].tick == 3


def test_who_asks_first_does_not_change_the_result() -> None:
    given = []
    for order in ((0, 1), (1, 0)):
        with Conductor(system()) as desk:
            both = held(desk, "a", "b")
            inputs = [{"sum.a": 0.1}, {"sum.b": 0.7}]
            for _ in range(10):
                waiting = [desk.ask("step", both[i], 1, inputs[i], ["sum.s"]) for i in order]
                [w.result() for w in waiting]
            given.append(desk.get(ME, ["sum.s"]))
    assert given[0] == given[1]


def test_an_input_that_two_set_in_one_step_is_refused(desk: Conductor) -> None:
    a, b = held(desk, "a", "b")
    desk.ask("step", a, 1, {"sum.a": 1.0}, [])
    with pytest.raises(InputInvalid, match="by 'a' already"):
        desk.step(b, 1, {"sum.a": 2.0})


def test_nobody_else_moves_time_that_is_held(desk: Conductor) -> None:
    held(desk, "a")
    for call in (lambda: desk.step(ME), lambda: desk.run(ME, until=1.0)):
        with pytest.raises(InputInvalid, match="held in lockstep by a"):
            call()


def test_one_that_leaves_is_no_longer_waited_for(desk: Conductor) -> None:
    a, b = held(desk, "a", "b")
    waiting = desk.ask("step", a, 1, None, [])
    desk.leave(b)
    assert waiting.result(timeout=20)[0].tick == 1


def test_a_late_one_is_dropped_and_told_so(desk: Conductor) -> None:
    a, late = held(desk, "a", "late", lag=0.05)
    assert desk.step(a)[0].tick == 1
    with pytest.raises(InputInvalid, match=r"'late' was dropped .* within 0\.05 s"):
        desk.step(late)


def test_a_late_one_pauses_all_where_that_is_configured() -> None:
    with Conductor(system(), fail_safe="pause") as desk:
        a, late = held(desk, "a", "late", lag=0.05)
        with pytest.raises(InputInvalid, match="'late' did not ask"):
            desk.step(a)
        assert desk.moment().tick == 0
        waiting = desk.ask("step", late, 1, None, [])
        assert desk.step(a)[0] == waiting.result()[0]


def test_steps_go_on_without_a_late_one_where_that_is_configured() -> None:
    with Conductor(system(), fail_safe="go-on") as desk:
        a, late = held(desk, "a", "late", lag=0.05)
        assert desk.step(a)[0].tick == 1
        assert desk.step(a)[0].tick == 2
        waiting = desk.ask("step", late, 1, None, [])
        assert desk.step(a)[0].tick == 3
        assert waiting.result()[0].tick == 3


def test_one_that_is_lost_inside_a_step_is_no_longer_waited_for(desk: Conductor) -> None:
    a, gone = held(desk, "a", "gone")
    waiting = desk.ask("step", gone, 5, None, [])
    desk.ask("step", a, 1, None, []).result(timeout=20)
    desk.lost(gone)
    with pytest.raises(InputInvalid, match="'gone' is gone"):
        waiting.result()
    assert desk.step(a)[0].tick == 2


def test_one_that_is_lost_pauses_all_where_that_is_configured() -> None:
    with Conductor(system(), fail_safe="pause") as desk:
        a, gone = held(desk, "a", "gone")
        waiting = desk.ask("step", a, 1, None, [])
        desk.lost(gone)
        with pytest.raises(InputInvalid, match="'gone' is gone"):
            waiting.result(timeout=20)
        assert desk.step(a)[0].tick == 1


def test_a_reset_answers_those_who_wait(desk: Conductor) -> None:
    a, _ = held(desk, "a", "b")
    waiting = desk.ask("step", a, 1, None, [])
    desk.reset(ME)
    with pytest.raises(InputInvalid, match="reset by 'me'"):
        waiting.result(timeout=20)


def test_a_failure_is_told_to_all_who_wait() -> None:
    with Conductor(system("Fails")) as desk:
        a, b = held(desk, "a", "b")
        waiting = desk.ask("step", a, 9, None, [])
        with pytest.raises(ComponentFailed, match="the well is dry"):
            desk.step(b, 9)
        with pytest.raises(ComponentFailed, match="the well is dry"):
            waiting.result(timeout=20)


# ---- failures and recordings ------------------------------------------------------------------


@pytest.mark.parametrize("part", ["Fails", "NotANumber"])
def test_a_failed_step_pauses_in_words_and_the_recording_is_intact(
    part: str, tmp_path: Path
) -> None:
    with Conductor(system(part), record=tmp_path / "run") as desk:
        with pytest.raises(ComponentFailed) as failed:
            desk.step(ME, 9, {"sum.a": 1.0})
        assert failed.value.path == "sum"
        with pytest.raises(InputInvalid, match="expected reset, restore or replace"):
            desk.step(ME)
        assert desk.get(ME, ["sum.a"]) == {"sum.a": 1.0}
    recorded = read_signals(tmp_path / "run")
    assert recorded["sum.s"] == pytest.approx([0.1 * k for k in range(6)])


def test_a_stream_that_fails_answers_and_pauses() -> None:
    with Conductor(system("Fails")) as desk:
        with pytest.raises(ComponentFailed, match="the well is dry"):
            desk.run(ME, until=3.0)
        assert not desk.moment().running
        assert isinstance(desk.failed, ComponentFailed)


@pytest.mark.parametrize("part", ["Fails", "NotANumber"])
def test_it_goes_on_after_a_failure_by_reset(part: str) -> None:
    with Conductor(system(part)) as desk:
        with pytest.raises(ComponentFailed):
            desk.step(ME, 9)
        desk.reset(ME)
        assert desk.step(ME, 3)[0].tick == 3


def test_it_goes_on_after_a_failure_by_restore_and_by_replace() -> None:
    with Conductor(system("Fails")) as desk:
        kept = desk.snapshot(ME)
        for back in (lambda: desk.restore(ME, kept), lambda: desk.replace(ME, "sum", SUM)):
            with pytest.raises(ComponentFailed):
                desk.step(ME, 9)
            back()
            assert desk.step(ME, 3)[0].tick == 3


SUM = f"{PARTS}:Sum"


def test_each_run_between_resets_is_a_recording_in_which_time_goes_on(tmp_path: Path) -> None:
    with Conductor(system(), record=tmp_path / "run") as desk:
        desk.step(ME, 5)
        kept = desk.snapshot(ME)
        desk.reset(ME)
        desk.step(ME, 2)
        desk.restore(ME, kept)
        desk.step(ME, 1)
        folders = desk.folders
    names = ["run", "run-2", "run-3"]
    assert [f.name for f in folders] == names
    assert [len(read_signals(f).time) for f in folders[:2]] == [6, 3]
    assert all((np.diff(read_signals(f).time) > 0).all() for f in folders)


def test_calls_after_the_end_are_refused_in_words() -> None:
    desk = Conductor(system())
    desk.close()
    desk.close()
    with pytest.raises(InputInvalid, match="has ended"):
        desk.get(ME, ["sum.s"])


def test_those_who_wait_at_the_end_are_answered() -> None:
    desk = Conductor(system())
    a, _ = held(desk, "a", "b")
    waiting = desk.ask("step", a, 1, None, [])
    desk.close()
    with pytest.raises(InputInvalid, match="ended"):
        waiting.result(timeout=20)


def test_a_system_that_cannot_be_begun_is_told_where_it_was_asked_for() -> None:
    with pytest.raises(UuvsimError, match="there is no system"):
        Conductor("bluerov2_holt")


def test_calls_of_many_threads_are_carried_out_one_after_another(desk: Conductor) -> None:
    def ask() -> None:
        for _ in range(50):
            desk.step(ME)

    threads = [threading.Thread(target=ask) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert desk.moment().tick == 200


class Watching:
    """An observer that tells when a tick is reached, so that nobody has to sleep."""

    def __init__(self, desk: Conductor, until_tick: int) -> None:
        self.reached: Future[int] = Future()
        self._tick = until_tick
        desk.watch(self)

    def begin(self, plan: Any, columns: Any) -> None:
        pass

    def observe(self, chunk: Any) -> None:
        if chunk.ticks[-1] >= self._tick and not self.reached.done():
            self.reached.set_result(int(chunk.ticks[-1]))

    def end(self) -> None:
        pass


def test_a_source_that_a_client_names_lies_where_the_server_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine.py").write_text(PARTS.read_text(), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    with Conductor(system()) as desk:
        assert desk.replace(ME, "sum", "mine.py:NotANumber").tick == 0
        with pytest.raises(UuvsimError, match="no such file"):
            desk.replace(ME, "sum", "yours.py:Sum")


@pytest.mark.parametrize("wrong", [5, None])
def test_what_is_no_system_is_refused_by_its_kind(wrong: Any) -> None:
    with pytest.raises(InputInvalid, match="expected a system, its plan, a master"):
        Conductor(wrong)
