"""The conductor: calls in order, lockstep of several, and failures that lose nothing."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.calls.values import pieces
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.bridge.server.snapshots import EACH
from uuvsim_cosim.errors import ComponentFailed, InputInvalid, UuvsimError
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.orchestrator.system.system import System

PARTS = Path(__file__).parents[1] / "parts.py"
ME = Client("me", "local")


def system(part: str = "Sum") -> System:
    return System("sums", "0.1").add("sum", f"{PARTS}:{part}")


@pytest.fixture
def service() -> Iterator[Conductor]:
    with Conductor(system()) as conductor:
        yield conductor


def held(service: Conductor, *names: str, lag: float = 60.0) -> list[Client]:
    return [service.join(Client(name, "local"), lockstep=True, lag=lag) for name in names]


# ---- calls ------------------------------------------------------------------------------------


def test_a_step_sets_inputs_then_steps_then_gives_outputs(service: Conductor) -> None:
    moment, outputs = service.step(ME, 5, {"sum.a": 2.0}, ["sum.s", "sum.both"])
    assert (moment.tick, moment.running) == (5, False)
    assert outputs["sum.s"] == pytest.approx(1.0)
    assert outputs["sum.both"].tolist() == [2.0, 0.0]


def test_one_element_has_a_name(service: Conductor) -> None:
    service.step(ME, 1, {"sum.a": 3.0})
    assert service.get(ME, ["sum.both[1]"]) == {"sum.both[1]": 3.0}


def test_steps_and_a_run_give_the_same(service: Conductor) -> None:
    service.set(ME, {"sum.a": 0.3, "sum.b": 0.1})
    for _ in range(20):
        service.step(ME)
    one_by_one = service.get(ME, ["sum.s"])["sum.s"]
    service.reset(ME)
    service.set(ME, {"sum.a": 0.3, "sum.b": 0.1})
    given = service.run(ME, until=2.0, record=["sum.s", "sum.a"])
    assert given["sum.s"][-1] == one_by_one
    assert given["time"].tolist() == [k * 1 / 10 for k in range(21)]
    assert given["sum.a"].tolist() == [0.3] * 21


def test_more_steps_than_are_made_at_once_are_made(service: Conductor) -> None:
    moment, _ = service.step(ME, 2500)
    assert moment.tick == 2500


def test_moment_follows_each_answer(service: Conductor) -> None:
    service.step(ME, 3)
    assert service.moment().tick == 3
    service.run(ME, until=1.0)
    assert (service.moment().tick, service.moment().running) == (10, False)
    service.reset(ME)
    assert service.moment().tick == 0


def test_the_schema_says_what_can_be_set(service: Conductor) -> None:
    schema = {s.name: s for s in service.schema()}
    assert [n for n, s in schema.items() if s.settable] == ["sum.a", "sum.b", "sum.k"]
    assert (schema["sum.both"].shape, schema["sum.both"].unit) == ((2,), "m/s")


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"sum.c": 1.0}, "such as sum.s, sum.k, sum.b"),
        ({"smu.a": 1.0}, "sum.a"),
        ({"sum.s": 1.0}, "output"),
        ({"sum.a": [1.0, 2.0]}, "2 values"),
        ({"sum.a": float("nan")}, "nan"),
        ({"sum.a": "1 kg"}, "kg"),
        ({"sum.a": "1 m/s", "sum.b": None}, "sum.b"),
    ],
)
def test_a_wrong_value_is_refused_and_none_is_set(
    service: Conductor, values: dict[str, Any], words: str
) -> None:
    with pytest.raises(InputInvalid, match=words):
        service.set(ME, {"sum.b": 7.0, **values})
    assert service.get(ME, ["sum.b"]) == {"sum.b": 0.0}


def test_text_with_a_unit_is_converted(service: Conductor) -> None:
    service.set(ME, {"sum.a": "3.6 km/h"})
    assert service.get(ME, ["sum.a"])["sum.a"] == pytest.approx(1.0)


@pytest.mark.parametrize("n", [0, -1, 1.5, True, "2"])
def test_a_number_of_steps_that_is_none_is_refused(service: Conductor, n: Any) -> None:
    with pytest.raises(InputInvalid, match="whole number"):
        service.step(ME, n)


def test_what_is_wrong_with_outputs_is_found_before_the_step(service: Conductor) -> None:
    with pytest.raises(InputInvalid, match=r"sum\.s"):
        service.step(ME, 1, None, ["sum.t"])
    assert service.moment().tick == 0


def test_a_restored_snapshot_is_gone_on_from_bit_for_bit(service: Conductor) -> None:
    service.step(ME, 3, {"sum.a": 0.7})
    kept = service.snapshot(ME)
    first = service.step(ME, 4, None, ["sum.s"])
    service.restore(ME, kept)
    assert service.step(ME, 4, None, ["sum.s"]) == first


def test_an_unknown_snapshot_is_refused_with_those_there_are(service: Conductor) -> None:
    name = service.snapshot(ME)
    with pytest.raises(InputInvalid, match=name):
        service.restore(ME, "s17")


def test_reset_takes_start_values(service: Conductor) -> None:
    service.reset(ME, start={"sum.a": 1.0, "sum.k": 3.0})
    assert service.step(ME, 10, None, ["sum.s"])[1]["sum.s"] == pytest.approx(3.0)


def test_a_replaced_component_begins_anew(service: Conductor) -> None:
    service.step(ME, 3)
    moment = service.replace(ME, "sum", f"{PARTS}:Fails")
    assert moment.tick == 0
    assert service.describe()["components"][0]["name"] == "Fails"


def test_a_replacement_that_does_not_fit_leaves_all_as_it_is(service: Conductor) -> None:
    service.step(ME, 3, {"sum.a": 1.0})
    with pytest.raises(UuvsimError, match="nothing"):
        service.replace(ME, "sum", f"{PARTS}:nothing")
    assert service.step(ME, 1, None, ["sum.s"])[1]["sum.s"] == pytest.approx(0.4)


def test_a_role_that_may_only_read_is_told_what_it_needs(service: Conductor) -> None:
    reader = Client("reader", "local", frozenset({"read"}))
    assert service.get(reader, ["sum.s"]) == {"sum.s": 0.0}
    with pytest.raises(InputInvalid, match="'reader' may read, but this call needs 'step'"):
        service.step(reader)


def test_names_of_clients_are_made_unique(service: Conductor) -> None:
    joined = [service.join(Client("learner", "local")).name for _ in range(3)]
    assert joined == ["learner", "learner-2", "learner-3"]


# ---- streaming --------------------------------------------------------------------------------


def test_commands_come_between_the_steps_of_a_stream(service: Conductor) -> None:
    service.run(ME, factor=50.0)
    given = service.set(ME, {"sum.a": 1.0})
    assert given.running
    Watching(service, until_tick=given.tick + 2).reached.result()
    assert service.get(ME, ["sum.s"])["sum.s"] > 0.0
    assert not service.pause(ME).running
    tick = service.moment().tick
    assert service.step(ME)[0].tick == tick + 1


def test_a_step_while_it_streams_is_refused(service: Conductor) -> None:
    service.run(ME)
    with pytest.raises(InputInvalid, match="expected pause first"):
        service.step(ME)


def test_a_run_that_is_paused_gives_what_it_has(service: Conductor) -> None:
    seen = Watching(service, until_tick=5)
    run = service.ask("run", ME, 1e6, 50.0, ["sum.s"])
    seen.reached.result()
    paused = service.pause(ME)
    given = run.result()
    assert given["time"][-1] == paused.time
    assert len(given["sum.s"]) == paused.tick + 1


def test_a_stream_keeps_to_its_factor() -> None:
    with Conductor(system()) as service:
        run = service.ask("run", ME, 2.0, 20.0, ["sum.s"])
        assert len(run.result()["time"]) == 21


# ---- lockstep ---------------------------------------------------------------------------------


def test_time_moves_when_all_have_asked(service: Conductor) -> None:
    a, b = held(service, "a", "b")
    first = service.ask("step", a, 1, {"sum.a": 1.0}, ["sum.s"])
    service.get(ME, ["sum.s"])
    assert not first.done()
    moment, outputs = service.step(b, 1, {"sum.b": 2.0}, ["sum.s"])
    assert moment.tick == 1
    assert first.result() == (moment, outputs)
    assert outputs["sum.s"] == pytest.approx(0.3)


def test_the_smallest_request_is_made_and_who_asked_for_more_waits(service: Conductor) -> None:
    a, b = held(service, "a", "b")
    more = service.ask("step", a, 3, None, [])
    service.step(b, 1)
    assert not more.done()
    service.step(b, 2)
    assert more.result()[0].tick == 3


def test_who_asks_first_does_not_change_the_result() -> None:
    given = []
    for order in ((0, 1), (1, 0)):
        with Conductor(system()) as service:
            both = held(service, "a", "b")
            inputs = [{"sum.a": 0.1}, {"sum.b": 0.7}]
            for _ in range(10):
                waiting = [service.ask("step", both[i], 1, inputs[i], ["sum.s"]) for i in order]
                [w.result() for w in waiting]
            given.append(service.get(ME, ["sum.s"]))
    assert given[0] == given[1]


def test_an_input_that_two_set_in_one_step_is_refused(service: Conductor) -> None:
    a, b = held(service, "a", "b")
    service.ask("step", a, 1, {"sum.a": 1.0}, [])
    with pytest.raises(InputInvalid, match="by 'a' already"):
        service.step(b, 1, {"sum.a": 2.0})


def test_nobody_else_moves_time_that_is_held(service: Conductor) -> None:
    held(service, "a")
    for call in (lambda: service.step(ME), lambda: service.run(ME, until=1.0)):
        with pytest.raises(InputInvalid, match="held in lockstep by a"):
            call()


def test_one_that_leaves_is_no_longer_waited_for(service: Conductor) -> None:
    a, b = held(service, "a", "b")
    waiting = service.ask("step", a, 1, None, [])
    service.leave(b)
    assert waiting.result()[0].tick == 1


def test_a_late_one_is_dropped_and_told_so(service: Conductor) -> None:
    a, late = held(service, "a", "late", lag=0.05)
    assert service.step(a)[0].tick == 1
    with pytest.raises(InputInvalid, match=r"'late' was removed .* within 0\.05 s"):
        service.step(late)


def test_a_late_one_pauses_all_where_that_is_configured() -> None:
    with Conductor(system(), fail_safe="pause") as service:
        (a,), (late,) = held(service, "a"), held(service, "late", lag=0.05)
        with pytest.raises(InputInvalid, match="'late' did not request"):
            service.step(a)
        assert service.moment().tick == 0
        waiting = service.ask("step", late, 1, None, [])
        assert service.step(a)[0] == waiting.result()[0]


def test_steps_go_on_without_a_late_one_where_that_is_configured() -> None:
    with Conductor(system(), fail_safe="go-on") as service:
        (a,), (late,) = held(service, "a"), held(service, "late", lag=0.05)
        assert service.step(a)[0].tick == 1
        assert service.step(a)[0].tick == 2
        waiting = service.ask("step", late, 1, None, [])
        assert service.step(a)[0].tick == 3
        assert waiting.result()[0].tick == 3


def test_one_that_is_lost_inside_a_step_is_no_longer_waited_for(service: Conductor) -> None:
    a, gone = held(service, "a", "gone")
    waiting = service.ask("step", gone, 5, None, [])
    service.ask("step", a, 1, None, []).result()
    service.lost(gone)
    with pytest.raises(InputInvalid, match="'gone' has disconnected"):
        waiting.result()
    assert service.step(a)[0].tick == 2


def test_one_that_is_lost_pauses_all_where_that_is_configured() -> None:
    with Conductor(system(), fail_safe="pause") as service:
        a, gone = held(service, "a", "gone")
        waiting = service.ask("step", a, 1, None, [])
        service.lost(gone)
        with pytest.raises(InputInvalid, match="'gone' has disconnected"):
            waiting.result()
        assert service.step(a)[0].tick == 1


def test_a_reset_answers_those_who_wait(service: Conductor) -> None:
    a, _ = held(service, "a", "b")
    waiting = service.ask("step", a, 1, None, [])
    service.reset(ME)
    with pytest.raises(InputInvalid, match="reset by 'me'"):
        waiting.result()


def test_a_failure_is_told_to_all_who_wait() -> None:
    with Conductor(system("Fails")) as service:
        a, b = held(service, "a", "b")
        waiting = service.ask("step", a, 9, None, [])
        with pytest.raises(ComponentFailed, match="the well is dry"):
            service.step(b, 9)
        with pytest.raises(ComponentFailed, match="the well is dry"):
            waiting.result()


def test_an_impatient_client_is_dropped_though_a_patient_one_is_missing_too(
    service: Conductor,
) -> None:
    (first,) = held(service, "first")
    (late,) = held(service, "late", lag=0.05)
    (patient,) = held(service, "patient", lag=3600.0)
    waiting = service.ask("step", first, 1, None, [])
    while "late" in service._lockstep.barrier.holders:
        service.describe()
    assert not waiting.done()
    assert service.step(patient)[0].tick == waiting.result()[0].tick == 1
    with pytest.raises(InputInvalid, match=r"did not request a step within 0\.05 s"):
        service.step(late)


def test_after_a_lockstep_failure_no_ticks_are_counted_and_a_reset_begins_at_the_first() -> None:
    with Conductor(system("Fails")) as service:
        a, b = held(service, "a", "b")
        waiting, seen = service.ask("step", a, 9, None, []), []
        waiting.add_done_callback(lambda _: seen.append(service.moment().tick))
        with pytest.raises(ComponentFailed):
            service.step(b, 9)
        assert isinstance(waiting.exception(), ComponentFailed)
        assert seen == [5]  # known when the failure is told
        assert (service.moment().tick, service.moment().running) == (5, False)  # the last before it
        again = service.ask("step", a, 1, None, [])
        with pytest.raises(InputInvalid, match="expected reset, restore or replace"):
            again.result()
        assert service.moment().tick == 5
        assert service._lockstep.barrier.asked() == []
        assert service.reset(ME).tick == 0
        waiting = service.ask("step", a, 2, None, ["sum.s"])
        assert service.step(b, 2, None, ["sum.s"]) == waiting.result()
        assert waiting.result()[0].tick == service.moment().tick == 2


def test_a_lockstep_failure_in_a_later_round_counts_the_rounds_before() -> None:
    with Conductor(system("Fails")) as service:
        a, b = held(service, "a", "b")
        waiting = service.ask("step", a, 9, None, [])
        for tick in range(1, 6):
            assert service.step(b)[0].tick == tick
        with pytest.raises(ComponentFailed):
            service.step(b)
        assert isinstance(waiting.exception(), ComponentFailed)
        assert service.moment().tick == 5


# ---- a client that holds time is dismissed ----------------------------------------------------


def test_a_dismissed_client_holds_time_no_longer_and_is_told_by_whom(service: Conductor) -> None:
    a, idle = held(service, "a", "idle", lag=3600.0)
    waiting = service.ask("step", a, 1, None, [])
    service.dismiss(ME, "idle")
    assert waiting.result()[0].tick == 1
    assert [(c["name"], c["lockstep"]) for c in service.describe()["clients"]] == [
        ("a", True), ("idle", False),
    ]  # fmt: skip
    with pytest.raises(InputInvalid, match="'idle' was removed from lockstep by 'me'; expected"):
        service.step(idle)


def test_the_step_that_a_dismissed_client_waits_for_is_answered(service: Conductor) -> None:
    held(service, "a")
    (dismissed,) = held(service, "dismissed")
    waiting = service.ask("step", dismissed, 1, None, [])
    service.dismiss(ME, "dismissed")
    with pytest.raises(InputInvalid, match="was removed from lockstep by 'me' before its step"):
        waiting.result()
    assert service.moment().tick == 0


def test_who_holds_no_time_cannot_be_dismissed(service: Conductor) -> None:
    held(service, "a")
    with pytest.raises(InputInvalid, match=r"no client 'b' holds time in lockstep; expected .*a"):
        service.dismiss(ME, "b")
    stepper = Client("c", "local", frozenset({"read", "set", "step"}))
    with pytest.raises(InputInvalid, match="this call needs 'manage'"):
        service.dismiss(stepper, "a")


# ---- snapshots of several clients -------------------------------------------------------------


def test_no_snapshot_disappears_and_a_client_that_keeps_too_many_is_told(
    service: Conductor,
) -> None:
    other = service.join(Client("other", "local"))
    kept = service.snapshot(other)
    service.step(ME)
    own = [service.snapshot(ME) for _ in range(EACH)]
    with pytest.raises(InputInvalid, match=f"'me' keeps {EACH} snapshots; .* discard one first"):
        service.snapshot(ME)
    assert service.restore(ME, own[0]).tick == 1
    assert service.restore(other, kept).tick == 0
    service.discard(ME, own[0])
    with pytest.raises(InputInvalid, match=f"no snapshot '{own[0]}', which was discarded"):
        service.restore(ME, own[0])
    assert service.restore(ME, service.snapshot(ME)).tick == 0


def test_snapshots_of_a_client_that_has_left_stay_and_do_not_count_for_the_next(
    service: Conductor,
) -> None:
    for _ in range(2):
        client = service.join(Client("python", "local"))
        own = [service.snapshot(client) for _ in range(EACH)]
        service.leave(client)
    assert service.restore(ME, "s1").tick == service.restore(ME, own[-1]).tick == 0


def test_a_snapshot_of_replaced_components_is_refused_with_the_reason(service: Conductor) -> None:
    kept = service.snapshot(ME)
    service.replace(ME, "sum", SUM)
    with pytest.raises(
        InputInvalid, match=f"'{kept}', which was taken before a component was replaced"
    ):
        service.restore(ME, kept)


# ---- figures of a run -------------------------------------------------------------------------


def test_overruns_of_a_stream_are_kept_when_it_is_paused(service: Conductor) -> None:
    seen = Watching(service, until_tick=50)
    service.run(ME, factor=1e6)  # each step is late
    seen.reached.result()
    service.pause(ME)
    overruns = service.describe()["overruns"]
    assert overruns > 0
    assert service.describe()["busy"] > 0.0
    service.run(ME, until=service.moment().time + 1.0)  # not against the clock: it has none
    service.step(ME)
    assert service.describe()["overruns"] == overruns
    service.run(ME, until=service.moment().time + 0.1, factor=1.0)
    assert service.describe()["overruns"] <= 1


def test_a_stream_that_cannot_be_kept_up_with_is_paused_at_once(service: Conductor) -> None:
    service.run(ME, factor=1e300)
    assert not service.pause(ME).running


# ---- room for what is recorded ----------------------------------------------------------------


def asking(most: int) -> Client:
    return Client("far", "tcp", ME.allowed, answer_bytes=most)


def test_a_run_whose_recording_is_too_large_is_refused_before_it_begins(service: Conductor) -> None:
    service.step(ME)
    with pytest.raises(InputInvalid, match=r"10000001 rows of 4 numbers are 320000032 bytes; exp"):
        service.run(asking(1 << 20), 1000000.1, None, ["sum.s", "sum.both"])
    assert service.moment().tick == 1
    assert len(service.run(asking(1 << 20), 2.0, None, ["sum.s"])["time"]) == 20


def test_a_large_recording_lies_in_a_file_and_has_the_same_values(
    service: Conductor, monkeypatch: pytest.MonkeyPatch
) -> None:
    service.set(ME, {"sum.a": 0.3})
    names = ["sum.both", "sum.s", "sum.a"]
    kept = service.snapshot(ME)
    here = service.run(ME, 30.0, None, names)
    monkeypatch.setattr("uuvsim_cosim.bridge.server.active_run._MEMORY", 100)
    service.restore(ME, kept)
    there = service.run(asking(1 << 20), 30.0, None, names)
    assert list(here) == list(there) == ["time", *names]
    for name in here:
        assert isinstance(there[name], np.memmap)
        assert there[name].dtype == here[name].dtype
        assert np.array_equal(there[name], here[name])
        assert np.array_equal(np.concatenate(list(pieces(there[name]))), here[name])


def test_a_long_run_without_signals_keeps_no_time_of_each_step(
    service: Conductor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("uuvsim_cosim.bridge.server.active_run._MEMORY", 100)
    assert service.run(asking(100), 3.0)["time"].tolist() == [0.0, 3.0]
    assert service.run(asking(100), 3.5)["time"].tolist() == pytest.approx(
        [3.0, 3.1, 3.2, 3.3, 3.4, 3.5]
    )


def test_a_full_disk_is_named_before_the_run(
    service: Conductor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("uuvsim_cosim.bridge.server.active_run._MEMORY", 100)
    usage = type("Usage", (), {"free": 1000})
    monkeypatch.setattr("shutil.disk_usage", lambda _: usage)
    with pytest.raises(InputInvalid, match="1000 are free"):
        service.run(asking(1 << 20), 30.0, None, ["sum.s"])


# ---- failures and recordings ------------------------------------------------------------------


@pytest.mark.parametrize("part", ["Fails", "NotANumber"])
def test_a_failed_step_pauses_in_words_and_the_recording_is_intact(
    part: str, tmp_path: Path
) -> None:
    with Conductor(system(part), record=tmp_path / "run") as service:
        with pytest.raises(ComponentFailed) as failed:
            service.step(ME, 9, {"sum.a": 1.0})
        assert failed.value.path == "sum"
        with pytest.raises(InputInvalid, match="expected reset, restore or replace"):
            service.step(ME)
        assert service.get(ME, ["sum.a"]) == {"sum.a": 1.0}
    recorded = read_signals(tmp_path / "run")
    assert recorded["sum.s"] == pytest.approx([0.1 * k for k in range(6)])


def test_a_stream_that_fails_answers_and_pauses() -> None:
    with Conductor(system("Fails")) as service:
        with pytest.raises(ComponentFailed, match="the well is dry"):
            service.run(ME, until=3.0)
        assert not service.moment().running
        assert isinstance(service.failed, ComponentFailed)


@pytest.mark.parametrize("part", ["Fails", "NotANumber"])
def test_it_goes_on_after_a_failure_by_reset(part: str) -> None:
    with Conductor(system(part)) as service:
        with pytest.raises(ComponentFailed):
            service.step(ME, 9)
        service.reset(ME)
        assert service.step(ME, 3)[0].tick == 3


def test_it_goes_on_after_a_failure_by_restore_and_by_replace() -> None:
    with Conductor(system("Fails")) as service:
        kept = service.snapshot(ME)
        for back in (lambda: service.restore(ME, kept), lambda: service.replace(ME, "sum", SUM)):
            with pytest.raises(ComponentFailed):
                service.step(ME, 9)
            back()
            assert service.step(ME, 3)[0].tick == 3


SUM = f"{PARTS}:Sum"


def test_each_run_between_resets_is_a_recording_in_which_time_goes_on(tmp_path: Path) -> None:
    with Conductor(system(), record=tmp_path / "run") as service:
        service.step(ME, 5)
        kept = service.snapshot(ME)
        service.reset(ME)
        service.step(ME, 2)
        service.restore(ME, kept)
        service.step(ME, 1)
        folders = service.folders
    names = ["run", "run-2", "run-3"]
    assert [f.name for f in folders] == names
    assert [len(read_signals(f).time) for f in folders[:2]] == [6, 3]
    assert all((np.diff(read_signals(f).time) > 0).all() for f in folders)


def test_calls_after_the_end_are_refused_in_words() -> None:
    service = Conductor(system())
    service.close()
    service.close()
    with pytest.raises(InputInvalid, match="has ended"):
        service.get(ME, ["sum.s"])


def test_those_who_wait_at_the_end_are_answered() -> None:
    service = Conductor(system())
    a, _ = held(service, "a", "b")
    waiting = service.ask("step", a, 1, None, [])
    service.close()
    with pytest.raises(InputInvalid, match="ended"):
        waiting.result()


def test_a_system_that_cannot_be_begun_is_told_where_it_was_asked_for() -> None:
    with pytest.raises(UuvsimError, match="there is no system"):
        Conductor("bluerov2_holt")


def test_calls_of_many_threads_are_carried_out_one_after_another(service: Conductor) -> None:
    def ask() -> None:
        for _ in range(50):
            service.step(ME)

    threads = [threading.Thread(target=ask) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert service.moment().tick == 200


class Watching:
    """An observer that tells when a tick is reached, so that nobody has to sleep."""

    def __init__(self, service: Conductor, until_tick: int) -> None:
        self.reached: Future[int] = Future()
        self._tick = until_tick
        service.watch(self)

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
    with Conductor(system()) as service:
        assert service.replace(ME, "sum", "mine.py:NotANumber").tick == 0
        with pytest.raises(UuvsimError, match="no such file"):
            service.replace(ME, "sum", "yours.py:Sum")


@pytest.mark.parametrize("wrong", [5, None])
def test_what_is_no_system_is_refused_by_its_kind(wrong: Any) -> None:
    with pytest.raises(InputInvalid, match="expected a system, its plan, a master"):
        Conductor(wrong)
