"""A recording that is not whole is told by name, never read as another; what is cut is counted."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.envs.drift import drifting
from uuvsim_cosim.cli import status_of
from uuvsim_cosim.content import content
from uuvsim_cosim.envs.tasks.tracking_scenarios import SCENARIOS
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.data.recorded import from_recordings
from uuvsim_cosim.learn.shared.task_ids import make_task
from uuvsim_cosim.orchestrator.recording.export import export
from uuvsim_cosim.orchestrator.running.run import run

ETA = "tracker_1.hull.eta"


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    policy = content("models", "policies") / "source_sac.npz"
    system = SCENARIOS["transition_1"]().system.replace("tracker_1.pilot", f"policy:{policy}")
    folder = tmp_path_factory.mktemp("recorded") / "run"
    return run(system, until=2.0, out=folder, backend="native").folder / "signals.parquet"


@pytest.fixture
def changed(whole: Path, tmp_path: Path) -> Callable[[Callable[[pa.Table], pa.Table]], Path]:
    def write(change: Callable[[pa.Table], pa.Table]) -> Path:
        pq.write_table(change(pq.read_table(whole)), tmp_path / "x.parquet")
        return tmp_path / "x.parquet"

    return write


Changed = Callable[[Callable[[pa.Table], pa.Table]], Path]


def filled(table: pa.Table, name: str, values: Any, *, bare: bool = False) -> pa.Table:
    i = table.column_names.index(name)
    field = pa.field(
        name, pa.array(values).type, metadata=None if bare else table.field(i).metadata
    )
    return table.set_column(i, field, pa.array(values))


def refused(file: Path, **options: Any) -> str:
    with pytest.raises(InputInvalid) as error:
        from_recordings("transition_1", [file], **options)
    assert str(error.value).startswith((str(file), "signal"))
    assert "; expected" in str(error.value)
    return str(error.value)


# ---- what is missing ------------------------------------------------------------------------


@pytest.mark.parametrize(
    "names",
    [
        [f"{ETA}[1]"],
        [f"{ETA}[6]"],
        [f"{ETA}[1]", f"{ETA}[2]", f"{ETA}[3]"],
        [f"{ETA}[6]", "target.position[1]"],
        ["tracker_1.pilot.action[1]"],
    ],
)
def test_an_element_that_was_not_recorded_is_named(names: list[str], changed: Changed) -> None:
    file = changed(lambda t: t.drop_columns(names))
    assert f"{file}: {', '.join(names)} not recorded; expected" in refused(file)


def test_a_column_that_tells_nothing_of_itself_is_named(changed: Changed) -> None:
    name = f"{ETA}[3]"
    file = changed(lambda t: filled(t, name, t[name].to_numpy(), bare=True))
    assert f"{name} not recorded, or without the Arrow metadata" in refused(file)
    bare = changed(lambda t: pa.table({c: t[c].to_numpy() for c in t.column_names}))
    assert f"{ETA}, " in refused(bare)


def test_columns_in_another_order_are_the_same_signal(whole: Path, changed: Changed) -> None:
    mixed = changed(lambda t: t.select(t.column_names[:2] + t.column_names[:1:-1]))
    (a,), (b,) = (from_recordings("transition_1", [f]).episodes for f in (whole, mixed))
    assert np.array_equal(a.observation, b.observation)
    assert np.array_equal(a.action, b.action)


def test_a_vector_that_an_mcap_holds_a_part_of_is_refused(changed: Changed, tmp_path: Path) -> None:
    short = export(changed(lambda t: t.drop_columns([f"{ETA}[1]"])), tmp_path / "x.mcap")
    assert f"{ETA} has 5 elements; expected 6" in refused(short)


def test_what_is_no_number_is_refused(changed: Changed) -> None:
    name = f"{ETA}[1]"
    file = changed(lambda t: filled(t, name, [str(x) for x in t[name].to_numpy()]))
    assert f"{ETA} holds str; expected numbers" in refused(file)


# ---- other names ----------------------------------------------------------------------------


def test_a_name_given_for_a_signal_is_not_ignored(whole: Path) -> None:
    said = refused(whole, renamed={"tracker_1.pilot.a": "joystick.a"})
    assert "joystick.a (given for tracker_1.pilot.a) not recorded" in said


def test_a_signal_that_a_task_does_not_read_is_refused_with_near_names(whole: Path) -> None:
    said = refused(whole, renamed={"tracker_1.pilot.b": "tracker_1.pilot.a"})
    assert re.search(r"'tracker_1\.pilot\.b': .*; expected one such as tracker_1\.pilot\.a, ", said)


def test_a_signal_of_another_width_is_refused(whole: Path) -> None:
    said = refused(whole, renamed={ETA: "tracker_1.wrench.current_total"})
    assert "tracker_1.wrench.current_total has 1 elements; expected 6" in said


# ---- time -----------------------------------------------------------------------------------


def test_a_time_that_falls_is_told_with_its_row(changed: Changed) -> None:
    file = changed(lambda t: filled(t, "time", t["time"].to_numpy()[::-1]))
    assert "in row 2, after 2 s; expected times that rise" in refused(file)


def test_a_time_that_is_no_number_is_told_with_its_row(changed: Changed) -> None:
    def late(t: pa.Table) -> pa.Table:
        time = t["time"].to_numpy()
        return filled(t, "time", np.where(np.arange(len(time)) < 40, time, np.nan))

    assert "time nan in row 41; expected a number" in refused(changed(late))


@pytest.mark.parametrize(
    ("keep", "instants"),
    [
        (lambda k, step: k % step == 0, 6),  # none between
        (lambda k, step: k != 2 * step, 101 - 1),  # one action begins at no instant
        (lambda k, step: k == 0, 1),
    ],
)
def test_instants_that_an_action_cannot_be_read_from_are_refused(
    keep: Callable[[Any, int], Any], instants: int, changed: Changed
) -> None:
    def thinned(t: pa.Table) -> pa.Table:
        rows = np.arange(len(t))
        return t.filter(pa.array(keep(rows, (len(t) - 1) // 5)))

    said = refused(changed(thinned))
    assert f"{instants} instants; expected one at each action step of 0.4 s" in said


# ---- beyond limits --------------------------------------------------------------------------


def test_nothing_of_a_run_within_limits_is_clipped(whole: Path) -> None:
    told = from_recordings("transition_1", [whole]).told
    assert told["clipped"] == {"observations": 0, "actions": 0}


def test_what_is_clipped_is_said(
    changed: Changed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def far(t: pa.Table) -> pa.Table:
        n = t.num_rows
        return filled(filled(t, f"{ETA}[1]", np.full(n, 1000.0)), "tracker_1.pilot.action[1]",
                      np.full(n, 50.0))  # fmt: skip

    file = changed(far)
    arguments = ["collect", "transition_1", "--recorded", str(file)]
    assert status_of([*arguments, "-o", str(tmp_path / "x.npz")]) == 0
    said = capsys.readouterr().out
    assert "warning: 5 of 10 numbers in actions clipped to their limits" in said
    # Of 6 observations: where it is, how far ahead and to starboard the target is, and how far.
    count = re.search(r"warning: (\d+) of 186 numbers in observations clipped", said)
    assert count
    assert 6 * 3 <= int(count[1]) <= 6 * 4


def test_what_a_task_of_one_agent_sees_beyond_its_limits_is_counted(tmp_path: Path) -> None:
    folder = run(drifting(), until=1.0, out=tmp_path / "run", backend="native").folder
    table = pq.read_table(folder / "signals.parquet")
    pq.write_table(
        filled(table, "hull.eta[2]", np.full(table.num_rows, -1e3)), tmp_path / "x.parquet"
    )
    found = from_recordings(
        "tests.envs.drift:Drift", [tmp_path / "x.parquet"], renamed={"hull.tau": "hull.nu"}
    )
    assert found.told["clipped"] == {"observations": 6, "actions": 0}


def test_an_observation_that_a_task_clips_by_itself_is_counted(tmp_path: Path) -> None:
    folder = run(make_task("uuvsim/StationKeeping-v0").system, until=2.0, out=tmp_path / "run",
                 backend="native").folder  # fmt: skip
    table = pq.read_table(folder / "signals.parquet")
    pq.write_table(
        filled(table, "hull.nu[1]", np.full(table.num_rows, 1e3)), tmp_path / "x.parquet"
    )
    found = from_recordings(
        "uuvsim/StationKeeping-v0", [tmp_path / "x.parquet"],
        renamed={"allocation.tau_d": "hull.nu_dot"},
    )  # fmt: skip
    assert found.told["clipped"]["observations"] == len(found.episodes[0].observation)
