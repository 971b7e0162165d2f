from fractions import Fraction
from pathlib import Path

import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.ssp.ssd import write_ssd
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.studies import Study

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "hold_in_current.yaml"


def test_the_shipped_example_runs_in_a_small_form(tmp_path: Path) -> None:
    small = tmp_path / "small.yaml"
    text = EXAMPLE.read_text()
    for old, new in {"duration: 20 s": "duration: 6 s", "seeds: 24": "seeds: 2",
                     "count: 6": "count: 2", "every: 0.05 s": "every: 0.5 s"}.items():  # fmt: skip
        assert old in text
        text = text.replace(old, new)
    small.write_text(text)
    done = Study.read(small).run(tmp_path / "s")
    rows = done.table().to_pylist()
    assert (done.runs, done.failed, done.backend) == (8, 0, "kernel")
    still = [r["error"] for r in rows if r["hull.v_c[1]"] == 0.0]
    swept = [r["error"] for r in rows if r["hull.v_c[1]"] == 1.5]
    assert max(still) < min(swept)


def test_the_shipped_example_is_whole() -> None:
    study = Study.read(EXAMPLE)
    assert study.runs.n == 288
    assert study.duration == 20
    assert study.metrics["error"].after == Fraction(5)


BROKEN = """\
system: bluerov2_hold
sytem: x
duration: 20.005 s
every: 0.03
seeds: -1
set: {hull.mm: 3}
parameters:
  hull.m: {uniform: [14, 12]}
  hull.nabla: {grid: [1, a]}
  hull.eta: {grid: [1, 2]}
  thruster_*.T_n: {grid: [0.1, 0.2], unit: m}
  hull.v_c: {grid: {from: 0, to: 1}}
  hull.z_b: {normal: [0, 1], relativ: true}
metrics:
  a: rms(hull.eta)
  b: rms(hull.etta)
  c: hull.eta[1]
  d: {expression: "rms(hull.eta)", aftr: 3}
  e: 3
"""
EXPECTED = {
    2: "such as system", 3: "communication step, 0.01 s", 5: "at least 1", 6: "such as m",
    8: "low not above high", 9: "finite numbers", 10: "output", 11: "'s' or a unit of its kind",
    12: "a count of 2 or more", 13: "such as relative", 16: "such as eta", 17: "rms(hull.eta[1])",
    18: "such as after", 19: "expression",
}  # fmt: skip


def test_a_broken_file_is_refused_with_every_line(tmp_path: Path) -> None:
    file = tmp_path / "broken.yaml"
    file.write_text(BROKEN)
    with pytest.raises(InputInvalid) as refused:
        Study.read(file)
    said = str(refused.value).splitlines()
    for line, words in EXPECTED.items():
        assert any(f"broken.yaml:{line}:" in s and words in s for s in said), (line, words)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a: [1\nb: 2\n", ":2: .*expected YAML"),
        ("", ":1: .*expected a mapping"),
        ("- 1\n", ":1: .*expected a mapping"),
        ("system: bluerov2_hold\nsystem: b\n", ":2: .*duplicate"),
        ("system: bluerov2_hol\nduration: 1\nmetrics: {a: rms(hull.eta)}\n", "bluerov2_hold"),
        ("system: bluerov2_hold\nduration: 1\n", "metrics missing"),
        ("system: bluerov2_hold\nduration: 1\nmetrics: 3\n", ":3: .*expressions by name"),
        ("system: 3\nduration: 1\nmetrics: {a: rms(hull.eta)}\n", ":1: .*a name"),
        ("system: bluerov2_hold\nduration: 1 fortnight\nmetrics: {a: max(hull.eta)}\n", "'2 min'"),
        (
            "system: bluerov2_hold\nduration: 1\nparameters: [1]\nmetrics: {a: max(hull.eta)}\n",
            ":3: .*a mapping by name",
        ),
        (
            "system: bluerov2_hold\nduration: 1\nsets: current\nmetrics: {a: max(hull.eta)}\n",
            ":3: .*expected a list",
        ),
        (
            "system: bluerov2_hold\nduration: 1\nmetrics:\n  a: {expression: max(hull.eta), "
            "after: 2}\n",
            ":4: .*from 2 to 1 s",
        ),
    ],
)
def test_what_is_no_study_is_refused(tmp_path: Path, text: str, says: str) -> None:
    file = tmp_path / "s.yaml"
    file.write_text(text)
    with pytest.raises(InputInvalid, match=says):
        Study.read(file)


HOLD = "system: bluerov2_hold\nduration: 1\nmetrics: {a: max(hull.eta)}\n"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("seeds: 1000000000\n", ":4: seeds: .*1,000,000,000 runs, about 500 GB .* 278 hours"),
        (
            "parameters:\n  hull.m: {grid: {from: 13, to: 14, count: 1000000000}}\n",
            ":5: parameters.hull.m.grid.count: 1,000,000,000 grid points .* a coarser grid",
        ),
        (
            "seeds: 10000\nparameters:\n  hull.m: {grid: {from: 13, to: 14, count: 10000}}\n",
            ":5: parameters: 10,000 grid points under 10,000 seeds are 100,000,000 runs",
        ),
    ],
)
def test_a_study_too_large_for_any_machine_is_refused_at_its_line(
    tmp_path: Path, text: str, says: str
) -> None:
    (tmp_path / "s.yaml").write_text(HOLD + text)
    with pytest.raises(InputInvalid, match=says):
        Study.read(tmp_path / "s.yaml")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("parameters:\n  hull.m: {grid: {from: 0, to: 1}}\n", "a count of 2 or more"),
        ("parameters:\n  hull.m: {grid: [a]}\n", "finite numbers"),
        (
            "correlation:\n  - {between: [hull.m, hull.nabla], value: 0.8}\n",
            "expected a parameter that has a distribution, but there is none",
        ),
    ],
)
def test_a_mistake_is_told_without_its_consequences(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "s.yaml").write_text(HOLD + text)
    with pytest.raises(InputInvalid, match=says) as refused:
        Study.read(tmp_path / "s.yaml")
    assert "drawn from" not in str(refused.value)
    assert "one of " not in str(refused.value)


def test_a_system_file_is_looked_for_beside_the_study(tmp_path: Path) -> None:
    import uuvsim_cosim as uuv

    uuv.load("bluerov2_hold").write(tmp_path / "mine.ssd")
    file = tmp_path / "s.yaml"
    file.write_text("system: mine.ssd\nduration: 1 min\nmetrics: {a: 'max(hull.eta[1])'}\n")
    study = Study.read(file)
    assert (study.system.name, study.duration, study.name) == ("bluerov2_hold", 60, "s")


def test_the_loop_policy_is_the_files_or_the_callers(tmp_path: Path) -> None:
    looped = System("loop", "0.1").add("a", "function:sum?inputs=1")
    write_ssd(looped.connect("a.y", "a.u", factor=-6.0, offset=1.0), tmp_path / "loop.ssd")
    file = tmp_path / "s.yaml"
    text = "system: loop.ssd\nduration: 1 s\nmetrics: {y: final(a.y)}\nloops: refuse\n"
    file.write_text(text)
    with pytest.raises(InputInvalid, match=r"s\.yaml:4: loops: algebraic loop a\.y -> a\.u"):
        Study.read(file)
    file.write_text(text.replace("refuse", "dealy"))
    with pytest.raises(InputInvalid, match="expected iterate, refuse or delay"):
        Study.read(file)
    done = Study.read(file, "iterate").run(tmp_path / "iterated", jobs=1)
    assert done.table().to_pylist()[0]["y"] == pytest.approx(1 / 7)
    delayed = Study.read(file, "delay").run(tmp_path / "delayed", jobs=1)
    assert any("its estimated gain is -6" in r for r in delayed.remarks)
