import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.envs.randomisation.distributions import Choice, Normal, Uniform
from uuvsim_cosim.envs.randomisation.randomisation import Vary
from uuvsim_cosim.errors import InputInvalid, SystemInvalid
from uuvsim_cosim.fmus.export.fmu_file import build_fmu
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.system.sources import ModelSource
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.studies import Study, StudyInterrupted

METRICS = {
    "error": "rms(norm(hull.eta[1:3]))",
    "end": "final(hull.nu[1:2])",
    "force": "std(wrench.tau[1])",
}


@pytest.fixture(scope="module")
def hold() -> System:
    return uuv.load("bluerov2_hold")


def study(system: System, **options: Any) -> Study:
    given: dict[str, Any] = {
        "duration": "1",
        "every": "0.1",
        "metrics": METRICS,
        "parameters": [Vary("hull.m", Uniform(13.0, 14.0))],
        "grid": [Vary("hull.v_c[1]", Choice([0.0, 0.4]))],
        "seeds": [3, 2**40, 7],
    }
    return Study(system, **{**given, **options})


def same(a: Any, b: Any) -> bool:
    return repr(a.to_pylist()) == repr(b.to_pylist())


def test_a_row_is_a_run_and_seeds_draw_the_same_at_each_grid_point(
    hold: System, tmp_path: Path
) -> None:
    table = study(hold).run(tmp_path / "s").table()
    assert table["seed"].to_pylist() == [3, 2**40, 7] * 2
    assert table["point"].to_pylist() == [0, 0, 0, 1, 1, 1]
    assert table["hull.v_c[1]"].to_pylist() == [0.0] * 3 + [0.4] * 3
    m = table["hull.m"].to_pylist()
    assert m[:3] == m[3:]
    assert len(set(m)) == 3
    assert table.schema.field("error").metadata == {b"unit": b"m"}
    assert {"end[1]", "end[2]", "force", "failure"} <= set(table.column_names)


def test_rows_are_the_same_bits_for_every_batch_jobs_and_backend(
    hold: System, tmp_path: Path
) -> None:
    s = study(hold)
    ways: list[dict[str, Any]] = [
        {"backend": "kernel", "batch": 2, "jobs": 1},
        {"backend": "kernel", "jobs": 2},
        {"backend": "master", "jobs": 1},
        {"backend": "master", "jobs": 2, "batch": 1},
    ]
    tables = [s.run(tmp_path / str(i), **way).table() for i, way in enumerate(ways)]
    assert all(same(tables[0], t) for t in tables[1:])


def test_a_run_is_what_a_master_gives_under_that_seed(hold: System, tmp_path: Path) -> None:
    row = study(hold).run(tmp_path / "s").table().to_pylist()[4]
    plan = flatten(hold)
    with Master(plan, prepare(plan, "native")) as master:
        master.initialize()
        master.reset(row["seed"], {"hull": {"m": row["hull.m"], "v_c": [0.4, 0, 0]}})
        master.step(100)
        assert master.get("hull", "nu")[0] == row["end[1]"]


def test_a_run_that_fails_is_a_row_with_its_sentence(hold: System, tmp_path: Path) -> None:
    s = study(hold, grid=[Vary("hull.nu_0[1]", Choice([0.0, 1e200]))])
    done = s.run(tmp_path / "kernel", backend="kernel")
    rows = done.table().to_pylist()
    assert done.failed == 3
    assert [r["failure"] is None for r in rows] == [True] * 3 + [False] * 3
    assert "'hull' failed at t = " in rows[3]["failure"]
    assert np.isnan(rows[3]["error"])
    assert rows[0]["error"] >= 0
    assert same(done.table(), s.run(tmp_path / "master", backend="master", jobs=1).table())


TANK = '''
class Tap:
    """Opens at once, and bursts."""
    inputs = {}
    outputs = {"flow": "m/s"}
    parameters = {"opening": (2.0, "m/s")}
    def step(self, t, dt, u):
        return {"flow": float("nan") if self.opening > 3 and t > 0.5 else self.opening}

class Tank:
    """Fills."""
    inputs = {"flow": "m/s"}
    outputs = {"level": "m"}
    level = 0.0
    def step(self, t, dt, u):
        print("a component that prints")
        self.level += dt * u["flow"]
        return {"level": self.level}
'''


@pytest.mark.parametrize("jobs", [1, 2])
def test_what_cannot_be_fused_is_run_by_masters(tmp_path: Path, jobs: int) -> None:
    (tmp_path / "parts.py").write_text(TANK)
    tank = System("tank", "0.1", base=tmp_path).add("tap", "parts.py:Tap")
    tank = tank.add("tank", "parts.py:Tank").connect("tap.flow", "tank.flow")
    s = Study(tank, duration="1", metrics={"level": "final(tank.level)"}, seeds=2,
              grid=[Vary("tap.opening", Choice([1.0, 2.0, 4.0]))])  # fmt: skip
    done = s.run(tmp_path / "s", jobs=jobs)
    rows = done.table().to_pylist()
    assert done.backend == "master"
    assert "cannot be fused" in done.remarks[0]
    assert [r["failure"] is None for r in rows] == [True] * 4 + [False] * 2
    assert "tap" in rows[4]["failure"]
    np.testing.assert_allclose([r["level"] for r in rows[:4]], [0.9, 0.9, 1.8, 1.8])


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_study_over_an_fmu_has_the_bits_of_the_model_it_was_made_of(
    hold: System, tmp_path: Path, jobs: int
) -> None:
    fmu = build_fmu(ModelSource("model:bluerov2_heavy").declare(), fmi=3, target=tmp_path / "h.fmu")
    with_fmu = hold.replace("hull", str(fmu))
    options: dict[str, Any] = {"duration": "0.5", "seeds": 2}
    done = study(with_fmu, **options).run(tmp_path / "fmu", jobs=jobs)
    assert done.backend == "master"
    assert "an FMU" in done.remarks[0]
    assert done.failed == 0
    declared = study(hold, **options).run(tmp_path / "declared").table()
    assert same(done.table(), declared)


def test_an_interrupted_study_goes_on_where_it_was(hold: System, tmp_path: Path) -> None:
    def interrupt(stage: str, done: float, total: float) -> None:
        if stage == "running" and done >= 2:
            raise KeyboardInterrupt

    s = study(hold)
    with pytest.raises(StudyInterrupted, match="2 of 6 runs are kept"):
        s.run(tmp_path / "s", batch=2, progress=interrupt)
    done = s.run(tmp_path / "s")
    assert done.resumed == 2
    assert same(done.table(), s.run(tmp_path / "whole").table())


KILLED = """
import os, sys
from uuvsim_cosim.studies import Study
def killed(stage, done, total):
    if stage == "running" and done >= 4:
        os._exit(9)
Study.read(sys.argv[1]).run(sys.argv[2], batch=2, jobs=1, progress=killed)
"""


def test_a_killed_study_keeps_what_was_finished(tmp_path: Path) -> None:
    file = tmp_path / "s.yaml"
    file.write_text(
        "system: bluerov2_hold\nduration: 1 s\nevery: 0.1\nseeds: 6\n"
        "parameters:\n  hull.m: {uniform: [13, 14]}\nmetrics:\n  e: rms(hull.eta[1])\n"
    )
    code = [sys.executable, "-c", KILLED, str(file), str(tmp_path / "s")]
    assert subprocess.run(code, check=False).returncode == 9
    done = uuv.study(file, tmp_path / "s")
    assert (done.resumed, done.runs) == (4, 6)
    assert same(done.table(), Study.read(file).run(tmp_path / "whole").table())


def test_another_study_is_refused_in_the_same_folder_unless_it_restarts(
    hold: System, tmp_path: Path
) -> None:
    study(hold).run(tmp_path / "s")
    other = study(hold, duration="2")
    with pytest.raises(InputInvalid, match=r'duration was "1", now "2".*--restart'):
        other.run(tmp_path / "s")
    assert other.run(tmp_path / "s", restart=True).resumed == 0
    with pytest.raises(InputInvalid, match="version of the system"):
        study(hold.set("controller.Kp[1]", 81), duration="2").run(tmp_path / "s")


def test_a_study_that_cannot_be_read_is_refused_unless_it_restarts(
    hold: System, tmp_path: Path
) -> None:
    study(hold).run(tmp_path / "s")
    (tmp_path / "s" / "study.json").write_text("{")
    with pytest.raises(InputInvalid, match=r"study.json: cannot be read as a study; --restart"):
        study(hold).run(tmp_path / "s")
    assert study(hold).run(tmp_path / "s", restart=True).resumed == 0


def test_a_folder_of_something_else_is_never_touched(hold: System, tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("years of work")
    for restart in (False, True):
        with pytest.raises(InputInvalid, match="other files"):
            study(hold).run(tmp_path, restart=restart)
    assert (tmp_path / "thesis.txt").read_text() == "years of work"


def test_a_part_that_was_torn_is_run_again(hold: System, tmp_path: Path) -> None:
    s = study(hold)
    before = s.run(tmp_path / "s", batch=3).table()
    next((tmp_path / "s" / "parts").iterdir()).write_bytes(b"PAR1 torn")
    done = s.run(tmp_path / "s")
    assert done.resumed == 3
    assert same(done.table(), before)


def test_means_come_with_intervals_for_each_grid_point(hold: System, tmp_path: Path) -> None:
    done = study(hold).run(tmp_path / "s")
    errors = [i for i in done.intervals if i["metric"] == "error"]
    assert [i["at"] for i in errors] == [{"hull.v_c[1]": 0.0}, {"hull.v_c[1]": 0.4}]
    assert all(i["low"] <= i["mean"] <= i["high"] and i["n"] == 3 for i in errors)


def test_a_grid_over_vectors_and_instances_has_a_column_a_number(hold: System) -> None:
    s = study(
        hold,
        grid=[
            Vary("hull.v_c", Choice([[0.1, 0.0, 0.0], [0.0, 0.2, 0.0]])),
            Vary("thruster_*.voltage", Choice([12.0, 16.0]), together=True),
        ],
        seeds=1,
    )
    columns = s.runs.columns()
    assert s.runs.n == 4
    assert columns["hull.v_c[1]"].tolist() == [0.1, 0.1, 0.0, 0.0]
    assert columns["thruster_*.voltage"].tolist() == [12.0, 16.0] * 2
    assert s.runs.start["thruster_8.voltage"].tolist() == [12.0, 16.0] * 2


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"duration": "0.005"}, "whole number of communication steps of 0.01 s"),
        ({"every": 0}, "every: 0 s"),
        ({"seeds": 0}, "at least 1"),
        ({"seeds": [1, 1]}, "distinct whole numbers"),
        ({"metrics": {}}, "at least one"),
        ({"metrics": {"m": "rms(hull.etta)"}}, "such as eta"),
        ({"metrics": {"hull.m": "rms(hull.eta[1])"}}, "names a parameter too"),
        ({"grid": [Vary("hull.m", Choice([13.0]))]}, "each element drawn once"),
        ({"grid": [Vary("hull.v_c", Choice([0.0]))]}, "a grid over 3 numbers at once"),
        ({"grid": [Vary("hull.g", Uniform(9, 10))]}, "expected Choice"),
        ({"grid": [Vary("hull.M_A_11", Choice([-20.0]))]}, "no possible body"),
        ({"parameters": [Vary("hull.m", Normal(13, 1))]}, r"\[1e-09, inf\] kg"),
        (
            {"seeds": 10**9},
            "under 1,000,000,000 seeds are .* 500 GB of memory, .* at most 10,000,0",
        ),
        (
            {
                "grid": [
                    Vary("hull.v_c[1]", Choice([0.1] * 4000)),
                    Vary("hull.v_c[2]", Choice([0.1] * 4000)),
                ]
            },
            "16,000,000 grid points under 3 seeds are 48,000,000 runs",
        ),
        ({"duration": 10**14}, "1,000,000,000,000,001 samples of 18 numbers .* a larger `every`"),
        ({"grid": ["hull.m"]}, "grid: 'hull.m'; expected a Vary"),
        ({"grid": Vary("hull.m", Choice([13.0]))}, "expected a list of Vary"),
    ],
)
def test_a_study_that_cannot_be_is_refused(
    hold: System, options: dict[str, Any], says: str
) -> None:
    with pytest.raises((InputInvalid, SystemInvalid), match=says):
        study(hold, **options)


def test_what_is_assumed_of_a_system_is_said_once(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "parts.py").write_text(
        TANK.replace('outputs = {"flow": "m/s"}', 'outputs = {"flow": None}')
    )
    tank = System("tank", "0.1", base=tmp_path).add("tap", "parts.py:Tap")
    tank = tank.add("tank", "parts.py:Tank").connect("tap.flow", "tank.flow")
    s = Study(tank, duration="1", metrics={"level": "final(tank.level)"}, seeds=4)
    capfd.readouterr()
    done = s.run(tmp_path / "s", jobs=2)
    assert [r for r in done.remarks if "no unit given" in r] == [
        "tap.flow: no unit given; m/s is used, that of tank.flow"
    ]
    assert "no unit given" not in capfd.readouterr().err


def test_differences_are_paired_run_by_run(hold: System, tmp_path: Path) -> None:
    a = study(hold).run(tmp_path / "a")
    b = study(hold.set("hull.eta_0", [0.0, 0.0, 1.5, 0.0, 0.0, 0.0])).run(tmp_path / "b")
    difference = a.difference(b)
    paired = np.asarray(a.table()["error"]) - np.asarray(b.table()["error"])
    first, second = (r for r in difference.rows() if r.metric == "error")
    assert [first.mean, second.mean] == pytest.approx([paired[:3].mean(), paired[3:].mean()])
    assert (first.n, first.unit, first.at) == (3, "m", {"hull.v_c[1]": 0.0})
    assert first.low <= first.mean <= first.high
    assert "mean difference" in difference.to_latex({"error": "position error"})


def test_differences_of_studies_that_are_no_pairs_are_refused(hold: System, tmp_path: Path) -> None:
    a = study(hold).run(tmp_path / "a")
    for name, options in {"seed": {"seeds": [3, 4, 7]}, "v_c": {"grid": []}}.items():
        with pytest.raises(InputInvalid, match=r"differs between their runs"):
            a.difference(study(hold, **options).run(tmp_path / name))
    other = study(hold, metrics={"way": "final(hull.eta[3])"}).run(tmp_path / "metric")
    with pytest.raises(InputInvalid, match="metrics way"):
        a.difference(other)


def test_a_table_for_latex_has_the_chosen_metrics(hold: System, tmp_path: Path) -> None:
    result = study(hold).run(tmp_path / "s")
    assert result.to_latex().count("error") == 2
    assert "force" not in result.to_latex({"error": "position error"})
    with pytest.raises(InputInvalid, match="'eror'"):
        result.to_latex({"eror": "position error"})
