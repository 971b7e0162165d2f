"""`models check`: every comparison holds or its cause is known, and the docs say the same."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest

from uuvsim_cosim.cli import main, status_of
from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.checks.checks import COMPARISONS, checks_of, every_check, groups_of
from uuvsim_cosim.models.checks.comparison import GROUPS, Checked, compared, known_groups
from uuvsim_cosim.models.checks.compiled_run import end_of, rows_of
from uuvsim_cosim.models.checks.reference_trajectory import deviations, read_reference
from uuvsim_cosim.models.checks.table import BEGIN, END, tables
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.parameter_files import vehicle_ids, vehicle_sets
from uuvsim_cosim.models.importing.new_vehicle import write_vehicle

TRUST = Path(__file__).parents[3] / "docs" / "trust.md"
SURGE = content("models", "vehicles", "bluerov2_heavy", "reference") / "wu_2018_const_surge.csv"


@pytest.fixture(scope="module")
def rows() -> list[Checked]:
    return list(every_check())


def test_every_comparison_holds_or_its_cause_is_known(rows: list[Checked]) -> None:
    assert [(c.address, c.what, c.off) for c in rows if c.verdict == "FAILS"] == []
    assert len(rows) >= 290


def test_every_set_of_every_vehicle_is_compared(rows: list[Checked]) -> None:
    of: dict[str, int] = defaultdict(int)
    for c in rows:
        of[c.address] += 1
    for id in vehicle_ids():
        assert all(of[f"{id}@{name}"] >= 7 for name in vehicle_sets(id)), id


def test_every_source_has_rows_and_is_said_by_its_word(rows: list[Checked]) -> None:
    assert {c.group for c in rows} == set(GROUPS) - {"published"}
    assert {c.group for c in rows} >= {group for group, _, _ in COMPARISONS}


def test_a_known_cause_is_said_of_rows_that_break_their_tolerance_alone(
    rows: list[Checked],
) -> None:
    """Else a list of excuses would outlive what it excuses."""
    assert [(c.address, c.what) for c in rows if c.known and c.holds] == []


def test_the_tables_of_the_docs_are_those_rows(rows: list[Checked]) -> None:
    """Differences may vary by a third of their decade. Written by models/checks/table.py."""
    _, _, rest = TRUST.read_text(encoding="utf-8").partition(BEGIN)
    printed, found = (text.strip().splitlines() for text in (rest.partition(END)[0], tables(rows)))
    assert len(printed) == len(found)
    for one, other in zip(printed, found, strict=True):
        cells = list(zip(one.split("|"), other.split("|"), strict=True))
        assert all(_alike(a.strip(), b.strip()) for a, b in cells), f"{one}\n{other}"


def _alike(printed: str, found: str) -> bool:
    if printed == found:
        return True
    try:
        one, other = (float(x.removeprefix("< ").split(" (")[0]) for x in (printed, found))
    except ValueError:
        return False
    return max(one, other) <= 2e-7 or 1 / 3 < one / max(other, 1e-300) < 3


# ---- choosing what is run -----------------------------------------------------------------------


def test_a_source_may_be_called_by_its_other_names() -> None:
    assert known_groups(["PVS", "gz-sim", "mss"]) == {"fossen", "gz_sim", "mss"}
    with pytest.raises(InputInvalid, match=r"'prestro' \(did you mean prestero\?\); expected one"):
        known_groups(["prestro"])


def test_a_source_alone_gives_its_rows_alone() -> None:
    assert {c.group for c in every_check({"gz_sim"})} == {"gz_sim"}
    assert {c.group for c in checks_of("rexrov2", {"uuv_simulator"})} == {"uuv_simulator"}


def test_a_set_alone_gives_its_rows_alone() -> None:
    found = {c.address for c in checks_of("remus100@scrimmage", {"prestero", "closed_form"})}
    assert found == {"remus100@scrimmage", "remus100"}  # the fins are of every set


def test_the_sources_of_a_vehicle_are_listed_without_running_them() -> None:
    assert groups_of("remus100") == ["closed_form", "fossen", "prestero", "typed_again"]
    assert groups_of("thruster_t200") == ["blue_robotics"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (
            "models check rexrof",
            "there is nothing to compare 'rexrof' with; expected one such as rexrov",
        ),
        ("models check lauv --source mss", "has no comparison with mss; expected closed_"),
        ("models check --source mms", "did you mean mss?"),
        ("models check remus100@prestro", "there is no parameter set 'prestro'; expected prest"),
        (f"models check --against {SURGE}", "needs a vehicle before it"),
        (f"models check rexrov --source mss --against {SURGE}", "expected one of them"),
        (f"models check dvl --against {SURGE}", "there is no vehicle 'dvl'"),
        (f"models check rexrov --against {SURGE} --tolerance nan", "expected a number, 0 or more"),
        (f"models check bluerov2_heavy --against {SURGE}", "expected at most 1e-05"),
    ],
)
def test_a_wrong_choice_is_one_sentence(
    arguments: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments.split())
    assert ended.value.code == 2
    assert said in capsys.readouterr().err


def test_the_command_says_why_a_known_comparison_breaks_its_tolerance(
    capsys: pytest.CaptureFixture[str], rows: list[Checked]
) -> None:
    known = next(c for c in rows if c.verdict == "known" and c.group == "mss")
    assert status_of(["models", "check", "--source", "mss"]) == 0
    said = " ".join("".join(capsys.readouterr()).split())
    assert f"{known.what}: {known.known}" in said
    assert said.count("known: ") == sum(c.verdict == "known" for c in rows if c.group == "mss")


def test_a_file_of_ones_own_is_compared_with_its_notes_shown(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["models", "check", "bluerov2_heavy@wu_2018", "--against", str(SURGE), "--relative",
              "--tolerance", "1e-6"])  # fmt: skip
    said = capsys.readouterr().out
    assert not ended.value.code
    assert "inputs: tau=[4,0,0,0,0,0] N const" in said
    assert "within 1e-06 relative" in said


# ---- how they are run ---------------------------------------------------------------------------


def test_a_comparison_that_is_not_finite_fails() -> None:
    assert compared("mss", "", "x", [np.nan], [1.0], 1e9).verdict == "FAILS"


def test_all_steps_in_one_call_are_the_steps_of_simulate() -> None:
    model = declare("bluerov2_heavy", surface=False)
    t, tau = np.array([0.0, 0.1, 0.25, 1.0]), np.array([9.0, -4.0, 2.0, 0.1, -0.2, 0.3])
    start = {"eta_0": [0, 0, 9, 0.3, -0.2, 0.1], "nu_0": [0.4, 0, 0, 0, 0.1, 0]}
    push = lambda s: np.sin(3.0 * s) * tau  # noqa: E731
    by_steps = simulate(model, at=list(t), h=0.02, tau=push, parameters=start)
    inputs = lambda s: np.column_stack([np.outer(np.sin(3.0 * s), tau), np.zeros((len(s), 3))])  # noqa: E731
    at_once = rows_of(model, t, 0.02, inputs, start)
    for name in ("eta", "nu", "nu_dot", "q"):
        np.testing.assert_allclose(at_once[name], by_steps[name], rtol=0, atol=1e-12)
    held = simulate(model, at=[0.0, 1.0], h=0.02, tau=tau, parameters=start)
    end = end_of(model, 1.0, 0.02, {"tau": tau}, start)
    np.testing.assert_allclose(end["eta"], held["eta"][-1], rtol=0, atol=1e-12)


def test_the_relative_deviation_is_of_each_columns_greatest_value() -> None:
    reference = read_reference(SURGE)
    by = {d.column: d for d in deviations("bluerov2_heavy@wu_2018", reference, 0.01)}
    assert by["u_mps"].relative == by["u_mps"].max / np.abs(reference.nu[:, 0]).max()
    assert by["v_mps"].relative == 0.0


def test_a_thruster_is_no_vehicle_to_compare_a_trajectory_with() -> None:
    with pytest.raises(ParameterInvalid, match="there is no vehicle 'thruster'"):
        deviations("thruster", read_reference(SURGE))


# ---- mistakes in a vehicle's own files ----------------------------------------------------------

ENTRY = "vehicle: mine\nchecks:\n  - {{what: abc, set: estimated, until: 0, {}, source: nobody}}\n"


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("expect: {nuu: [1, 0, 0, 0, 0, 0]}, tolerance: 1", "'nuu'; expected eta, nu, nu_dot"),
        ("parameters: {mm: 3}, expect: {nu: [1, 0, 0, 0, 0, 0]}, tolerance: 1", "'mm'; expected m"),
        ("parameters: {nu_0: [1]}, expect: {nu: [1, 0, 0, 0, 0, 0]}, tolerance: 1", "expected 6"),
        ("parameters: {m: [a]}, expect: {nu: [1, 0, 0, 0, 0, 0]}, tolerance: 1", "expected a numb"),
        ("group: mms, expect: {nu: [1, 0, 0, 0, 0, 0]}, tolerance: 1", "whose number it is"),
    ],
)
def test_a_mistake_in_a_check_is_said_with_its_line(entry: str, said: str, tmp_path: Path) -> None:
    folder = write_vehicle("mine", tmp_path)
    (folder / "checks.yaml").write_text(ENTRY.format(entry))
    with pytest.raises(InputInvalid, match=rf"checks\.yaml:3: .*{said}"):
        list(checks_of(str(folder)))


def test_a_file_of_another_vehicle_in_a_folder_is_refused(tmp_path: Path) -> None:
    folder = write_vehicle("mine", tmp_path).rename(tmp_path / "copied")
    with pytest.raises(ParameterInvalid) as refused:
        list(checks_of(str(folder)))
    said = str(refused.value).splitlines()
    assert len(said) == 2
    assert "parameters.yaml:5: id: 'mine'; expected 'copied', the folder's name" in said[0]
    assert "thrusters.yaml:3: vehicle: 'mine'; expected 'copied'" in said[1]


def test_a_folder_without_parameters_is_said_to_be_one(tmp_path: Path) -> None:
    with pytest.raises(InputInvalid, match=r"without a parameters\.yaml"):
        list(checks_of(str(tmp_path)))
