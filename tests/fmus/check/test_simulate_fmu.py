from __future__ import annotations

import csv
import subprocess
import sys
import tempfile
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uuvsim_cosim.errors import ComponentFailed, FmuError, InputInvalid, ParameterInvalid
from uuvsim_cosim.fmus.check.simulate_fmu import (
    SimulationFile,
    SimulationInterrupted,
    SimulationResult,
    simulate_fmu,
    simulate_fmu_to_csv,
)
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.importer.input_csv import Series
from uuvsim_cosim.fmus.importer.read_description import read_fmu

CFmu = Callable[..., Path]


FMPY = """
import sys, fmpy, numpy as np
signals = np.array([(0, 0), (0.35, 1), (1, -1), (2, 0.5)], dtype=[("time", float), ("u", float)])
result = fmpy.simulate_fmu(sys.argv[1], stop_time=2, output_interval=0.1, input=signals,
    fmi_type="CoSimulation", start_values={"T": 0.7}, output=["y"], logger=lambda *_: None)
np.save(sys.argv[2], result)
"""


# FMPy binds every function that FMI 3.0 has, so it needs an FMU that exports them all. It runs in
# a process of its own because it does not unload what pythonfmu made without harm.
@pytest.mark.parametrize("name", ["first_order_fmi2", "pythonfmu2_lag", "pythonfmu3_lag"])
def test_the_result_is_that_of_fmpy(
    name: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    path: Path = request.getfixturevalue(name)
    inputs = {"time": [0.0, 0.35, 1.0, 2.0], "u": [0.0, 1.0, -1.0, 0.5]}
    ours = simulate_fmu(path, until=2, step=0.1, inputs=inputs, start={"T": 0.7})
    kept = tmp_path / "theirs.npy"
    words = subprocess.run(
        [sys.executable, "-c", FMPY, str(path), str(kept)], capture_output=True, check=False
    )
    assert kept.exists(), words.stderr
    theirs = np.load(kept)
    np.testing.assert_allclose(ours.time, theirs["time"], rtol=1e-14)
    np.testing.assert_allclose(ours["y"], theirs["y"], rtol=0, atol=1e-14)
    assert ours["y"].std() > 0.1


def test_a_constant_input_gives_the_closed_form(first_order_fmi2: Path) -> None:
    result = simulate_fmu(first_order_fmi2, until=1, step="1/64", inputs={"u": 1.0})
    k = np.arange(65)
    np.testing.assert_allclose(result["y"], 1 - (1 - 2 / 64) ** k, rtol=1e-13)
    np.testing.assert_array_equal(result.time, k / 64)


def test_a_function_of_time_is_an_input(first_order_fmi3: Path) -> None:
    def ramp(t: float) -> list[float]:
        return [t, 2 * t, 3 * t]

    result = simulate_fmu(first_order_fmi3, until=1, step=0.5, inputs={"v": ramp})
    np.testing.assert_allclose(result["w"][-1], [1.0, 2.0, 3.0])  # held since t = 0.5
    assert result["w"].shape == (3, 3)


def test_time_does_not_drift(first_order_fmi2: Path) -> None:
    result = simulate_fmu(first_order_fmi2, until=100, step=0.1)
    assert result.time[-1] == 100.0
    assert result.time[3] == float(3 * Fraction("0.1"))


def test_the_step_of_the_fmu_is_the_default(first_order_fmi2: Path) -> None:
    assert simulate_fmu(first_order_fmi2, until=1).time.size == 11


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [
        ("k", "3", 3.0),
        ("mode", "fast", 2),
        ("label", "a b", "a b"),
        ("m", "1,2,3,5", [[1, 2], [3, 5]]),
    ],
)
def test_start_values_are_read_as_a_user_types_them(
    first_order_fmi2: Path, name: str, text: str, expected: Any
) -> None:
    result = simulate_fmu(first_order_fmi2, until=0.1, step=0.1, start={name: text}, outputs=[name])
    assert result[name][-1].tolist() == expected if name == "m" else result[name][-1] == expected


def test_one_element_of_an_array_can_be_started(first_order_fmi3: Path) -> None:
    result = simulate_fmu(
        first_order_fmi3, until=0.1, step=0.1, start={"m[2,1]": 9.0, "m[1,1]": "8"}, outputs=["m"]
    )
    np.testing.assert_array_equal(result["m"][-1], [[8.0, 2.0], [9.0, 4.0]])


# ---- input files -----------------------------------------------------------------------------


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_a_csv_gives_scalars_and_elements(first_order_fmi2: Path, tmp_path: Path) -> None:
    table = write(tmp_path / "in.csv", 'time,u,v[2],on,"v[3]"\n0,0,1,true,5\n\n1,2,3,true,5\n')
    result = simulate_fmu(
        first_order_fmi2, until=1, step=0.5, inputs=table, outputs=["u", "v", "on", "y"]
    )
    np.testing.assert_array_equal(result["u"], [0.0, 0.0, 1.0])
    np.testing.assert_array_equal(result["v"][-1], [0.0, 2.0, 5.0])


def test_discrete_inputs_are_held_and_continuous_ones_interpolated() -> None:
    time, values = np.array([0.0, 1.0, 1.0, 2.0]), np.array([0, 4, 10, 20])
    continuous = Series(Variable("u", "Float64", "input", "continuous"), 0, time, values)
    discrete = Series(Variable("n", "Int32", "input", "discrete"), 0, time, values)
    at = [-1.0, 0.5, 1.0, 1.5, 3.0]
    assert [continuous.at(t) for t in at] == [0, 2, 10, 15, 20]
    assert [discrete.at(t) for t in at] == [0, 0, 10, 10, 20]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,uu\n0,1\n", r"in\.csv, line 1, column 2: unknown name 'uu'; expected one such as u"),
        ("time,u\n0,1\n1,x\n", r"in\.csv, line 3, column 2 \(u\): 'x'; expected a finite number"),
        ("time,u\n0,nan\n", r"line 2, column 2 \(u\): 'nan'"),
        ("time,u\n0,\n", r"line 2, column 2 \(u\): ''"),
        ("time,u\n0,1\nx,1\n", r"line 3, column 1 \(time\): 'x'"),
        ("time,u\n1,1\n0,1\n", r"line 3, column 1 \(time\): 0 s after 1 s"),
        ("time,u\n0,1,2\n", "line 2: 3 cells; expected 2"),
        ("time;u\n0;1\n", "expected 'time' .columns are separated by commas."),
        ("u,time\n0,1\n", "line 1, column 1: 'u'; expected 'time'"),
        ("time,u,u\n0,1,2\n", "column 'u' is given twice"),
        ("time,on\n0,2\n", r"line 2, column 2 \(on\): '2'; expected true or false"),
        ("time,v[4]\n0,2\n", r"unknown name 'v\[4\]'; expected one such as v\[3\]"),
        ("time,v\n0,2\n", r"unknown name 'v'; .*v\[1\]"),
        ("time,k\n0,2\n", "unknown name 'k'"),
        ("time,u\n", "has no line after the header"),
        ("", "is empty; expected a header"),
    ],
)
def test_a_faulty_table_is_refused_at_line_and_column(
    first_order_fmi2: Path, tmp_path: Path, text: str, message: str
) -> None:
    with pytest.raises(InputInvalid, match=message):
        simulate_fmu(first_order_fmi2, until=1, inputs=write(tmp_path / "in.csv", text))


def test_a_missing_or_binary_table_is_refused(first_order_fmi2: Path, tmp_path: Path) -> None:
    with pytest.raises(InputInvalid, match=r"gone\.csv: cannot be read"):
        simulate_fmu(first_order_fmi2, until=1, inputs=tmp_path / "gone.csv")
    (tmp_path / "in.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputInvalid, match="is not UTF-8 text"):
        simulate_fmu(first_order_fmi2, until=1, inputs=tmp_path / "in.csv")


# ---- what is refused -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"until": 1, "step": 0.3},
            "1 s is not a whole multiple of step = 0.3 s; expected 0.9 s or 1.2",
        ),
        ({"until": 0}, "expected more than 0"),
        ({"until": 1, "step": -1}, "expected more than 0"),
        ({"until": "soon"}, "expected seconds"),
        ({"until": 1, "inputs": {"w": 1.0}}, "unknown name 'w'; expected one of u, v, on"),
        ({"until": 1, "outputs": ["z"]}, "outputs: unknown name 'z'; expected one of y, w, steps"),
        ({"until": 1, "start": {"kk": 1.0}}, "unknown name 'kk'; expected one such as k"),
        (
            {"until": 1, "inputs": {"time": [0, 1], "v": [[1, 2], [3, 4]]}},
            "expected 3 values at each",
        ),
    ],
)
def test_wrong_options_are_refused_with_what_would_be_right(
    first_order_fmi2: Path, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputInvalid, match=message):
        simulate_fmu(first_order_fmi2, **options)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("u", 6.0, r"u: 6.0 is out of range; expected \[-10, 5\] cm"),
        ("fault", "9", r"expected \[0, 6\]"),
        ("k", "three", "start value k: 'three'; expected a number"),
        ("mode", "medium", "or one of slow, fast"),
        ("k", float("nan"), "expected a finite number"),
        ("v", [1.0], r"shape \(1,\); expected \(3,\)"),
    ],
)
def test_wrong_start_values_are_refused(
    first_order_fmi2: Path, name: str, value: Any, message: str
) -> None:
    with pytest.raises(ParameterInvalid, match=message):
        simulate_fmu(first_order_fmi2, until=1, start={name: value})


@pytest.mark.parametrize("time", ["ten", "1/0"])
def test_a_start_time_that_is_no_number_is_refused(first_order_fmi2: Path, time: str) -> None:
    with pytest.raises(InputInvalid, match=f"start time = {time}; expected seconds"):
        simulate_fmu(first_order_fmi2, until=20, start_time=time)


def test_nan_names_variable_and_time(first_order_fmi2: Path) -> None:
    with pytest.raises(ComponentFailed, match=r"t = 0.6 s: y is not finite: nan") as failed:
        simulate_fmu(first_order_fmi2, until=1, step=0.1, start={"fault": 1, "fault_time": 0.5})
    partial = failed.value.partial
    assert isinstance(partial, SimulationResult)
    assert partial.time[-1] == 0.5
    assert np.all(np.isfinite(partial["y"]))


# ---- what is written -------------------------------------------------------------------------

finite = st.floats(allow_nan=False, allow_infinity=False)


@given(st.lists(st.tuples(finite, finite, st.booleans()), min_size=1, max_size=5))
def test_a_written_table_reads_back_to_the_last_bit(rows: list[tuple[float, float, bool]]) -> None:
    x = Variable("x", "Float64", "output", "continuous", shape=(2,))
    on = Variable("on", "Boolean", "output", "discrete")
    vectors = np.array([r[:2] for r in rows])
    flags = np.array([r[2] for r in rows])
    time = np.arange(len(rows), dtype=float)
    result = SimulationResult(time, {"x": vectors, "on": flags}, {"x": x, "on": on})
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "out.csv"
        result.write_csv(path)
        with path.open(newline="") as source:
            header, *lines = list(csv.reader(source))
        assert list(Path(folder).iterdir()) == [path]
    assert header == ["time", "x[1]", "x[2]", "on"]
    np.testing.assert_array_equal([[float(c) for c in line[1:3]] for line in lines], vectors)
    assert [bool(int(line[3])) for line in lines] == flags.tolist()


def test_an_unwritable_place_is_refused(first_order_fmi2: Path, tmp_path: Path) -> None:
    result = simulate_fmu(first_order_fmi2, until=0.1, step=0.1)
    with pytest.raises(InputInvalid, match="cannot be written"):
        result.write_csv(tmp_path / "no" / "folder" / "out.csv")


def test_fmus_by_other_tools_simulate(pythonfmu2_lag: Path, pythonfmu3_lag: Path) -> None:
    for path in (pythonfmu2_lag, pythonfmu3_lag):
        result = simulate_fmu(path, until=1, step=0.1, inputs={"u": 1.0})
        np.testing.assert_allclose(result["y"], 1 - 0.8 ** np.arange(11), rtol=1e-12)
        assert ("warning", "y is 0.200") in result.messages


# ---- start and end, rows on the disk, interface, structure -----------------------------------


def test_a_run_starts_where_the_default_experiment_does(c_fmu: CFmu) -> None:
    edits = [('startTime="0" stopTime="2"', 'startTime="5" stopTime="10"')]
    fmu = c_fmu(2, edits=edits)
    result = simulate_fmu(fmu, inputs={"u": lambda t: t})
    assert (result.time[0], result.time[-1], result.time.size) == (5.0, 10.0, 51)
    earlier = simulate_fmu(fmu, start_time=0, until=0.1, step=0.1, inputs={"u": lambda t: t})
    assert (earlier.time.tolist(), earlier["y"][1]) == ([0.0, 0.1], 0.0)
    assert result["y"][1] == pytest.approx(0.2 * 5.0)  # u is that of t = 5 s
    with pytest.raises(InputInvalid, match="until = 3 s, but the start is 5 s"):
        simulate_fmu(fmu, until=3)


def test_points_count_from_the_start(first_order_fmi3: Path) -> None:
    result = simulate_fmu(first_order_fmi3, start_time=-0.05, until=0.25, step="0.1")
    assert result.time.tolist() == [-0.05, 0.05, 0.15, 0.25]
    with pytest.raises(InputInvalid, match=r"after -0\.05 s; expected 0\.15 s or 0\.25 s"):
        simulate_fmu(first_order_fmi3, start_time=-0.05, until=0.2, step="0.1")


@pytest.mark.parametrize("version", [2, 3])
def test_the_step_that_asks_to_end_is_recorded(c_fmu: CFmu, version: int) -> None:
    edits = [('max="6"', 'max="10"')] if version == 2 else []
    start = {"fault": 7, "fault_time": 0.5}
    result = simulate_fmu(
        c_fmu(version, edits=edits), until=2, step="0.1", start=start, inputs={"u": 1.0}
    )
    assert result.asked_to_end
    assert result.time[-1] == 0.6
    np.testing.assert_allclose(result["y"], 1 - 0.8 ** np.arange(7), rtol=1e-12)


def test_rows_go_to_the_file_as_they_come(first_order_fmi3: Path, tmp_path: Path) -> None:
    table = tmp_path / "out.csv"
    seen: list[int] = []

    def count(t: float) -> float:
        seen.append(len(table.read_text().splitlines()) if table.exists() else 0)
        return 1.0

    options: dict[str, Any] = {"until": 1, "step": "0.1", "inputs": {"u": count}}
    done = simulate_fmu_to_csv(first_order_fmi3, table, **options)
    assert (done.rows, done.end, done.begin) == (11, 1.0, 0.0)
    again = tmp_path / "again.csv"
    simulate_fmu(first_order_fmi3, **options).write_csv(again)
    assert again.read_bytes() == table.read_bytes()


def test_memory_does_not_grow_with_the_rows(first_order_fmi3: Path, tmp_path: Path) -> None:
    import tracemalloc

    def peak(steps: int) -> int:
        tracemalloc.start()
        simulate_fmu_to_csv(first_order_fmi3, tmp_path / "out.csv", until=steps, step=1)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    peak(10)
    assert peak(4000) < peak(400) + 50_000


def test_a_file_that_the_disk_cannot_hold_is_refused(
    first_order_fmi3: Path, tmp_path: Path
) -> None:
    with pytest.raises(InputInvalid, match=r"its 1\.00e\+301 rows would take about .* GB"):
        simulate_fmu_to_csv(first_order_fmi3, tmp_path / "out.csv", until=1e300)
    assert not (tmp_path / "out.csv").exists()


def test_a_failure_leaves_the_rows_up_to_then(first_order_fmi3: Path, tmp_path: Path) -> None:
    table = tmp_path / "out.csv"
    start = {"fault": 2, "fault_time": 0.5}
    with pytest.raises(ComponentFailed, match="too hot") as failed:
        simulate_fmu_to_csv(first_order_fmi3, table, until=1, step="0.1", start=start)
    assert isinstance(failed.value.partial, SimulationFile)
    assert table.read_text().splitlines()[-1].startswith("0.5,")


def test_an_interruption_leaves_the_rows_up_to_then(first_order_fmi3: Path, tmp_path: Path) -> None:
    def interrupt(t: float) -> float:
        if t > 0.45:
            raise KeyboardInterrupt
        return 1.0

    table = tmp_path / "out.csv"
    with pytest.raises(SimulationInterrupted) as interrupted:
        simulate_fmu_to_csv(first_order_fmi3, table, until=1, step="0.1", inputs={"u": interrupt})
    assert interrupted.value.partial.end == 0.5
    assert table.read_text().splitlines()[-1].startswith("0.5,")


def test_an_interface_is_chosen_where_there_are_two(kinetics: Path) -> None:
    options: dict[str, Any] = {"start_time": 0, "until": 1e-4, "step": "1e-4"}
    kinds = [
        simulate_fmu(kinetics, interface=name, **options)["kind"][-1]
        for name in (None, "CoSimulation", "ModelExchange")
    ]
    assert kinds == [1, 1, 2]


def test_a_structural_parameter_leaves_the_interface_that_an_fmu_was_read_with(
    kinetics: Path,
) -> None:
    read = read_fmu(kinetics, "ModelExchange")
    options: dict[str, Any] = {"start_time": 0, "until": 1e-4, "step": "1e-4"}
    start = {"n": "2", "u": "[3, 4]", "gain": "[[1, 10], [2, 100]]"}
    assert simulate_fmu(read, start=start, **options)["kind"][-1] == 2


def test_an_interface_that_is_not_there_is_refused(first_order_fmi3: Path) -> None:
    with pytest.raises(FmuError, match="has no ModelExchange; expected one of CoSimulation"):
        simulate_fmu(first_order_fmi3, until=1, interface="ModelExchange")


def test_a_structural_parameter_sets_the_shapes(kinetics: Path) -> None:
    start = {"n": "2", "u": "[3, 4]", "gain": "[[1, 10], [2, 100]]"}
    result = simulate_fmu(kinetics, until=5.001, step="0.001", start=start, outputs=["y", "n"])
    assert result["y"].tolist() == [[31.0, 402.0]] * 2
    assert result["n"].tolist() == [2, 2]


@pytest.mark.parametrize(
    ("start", "message"),
    [
        ({"n": "9"}, r"structural parameter n: 9 is out of range; expected \[0, 8\]"),
        ({"n": "two"}, "'two'; expected a number that fits UInt64"),
        ({"n": 2, "u": "1,2,3"}, r"such as '0,1' or '\[0, 1\]'"),
        ({"u": "5,6"}, r"such as '0,1,2' or '\[0, 1, 2\]'"),
        ({"gain": "[[1,2,3],[4,5,6]]"}, r"or '\[\[0, 1\], \[2, 3\], \[4, 5\]\]'"),
        ({"gain": "[[1,2],[3],[4,5,6]]"}, "such as"),
    ],
)
def test_wrong_structure_and_arrays_are_refused_with_the_accepted_form(
    kinetics: Path, start: dict[str, Any], message: str
) -> None:
    with pytest.raises(ParameterInvalid, match=message):
        simulate_fmu(kinetics, until=5.001, step="0.001", start=start)


def test_a_long_default_experiment_without_a_step_gets_one_that_is_reported(
    kinetics: Path,
) -> None:
    result = simulate_fmu(kinetics, interface="ModelExchange")
    assert result.time.size == 1001
    assert "states no step for its experiment of 999995 s: 999.995 s was chosen" in result.notes[0]
    assert "its equations are stiff" in result.notes[1]


# ---- integers of 64 bits ----------------------------------------------------------------------


def test_integers_of_64_bits_stay_exact_from_a_csv_to_a_csv(
    first_order_fmi3: Path, tmp_path: Path
) -> None:
    rows = [(0, 5, -(2**63)), (1, 2**63, 2**63 - 1), (2, 2**64 - 1, 2**53 + 1), (3, 2**53 + 1, 7)]
    table = write(
        tmp_path / "in.csv",
        "time,uint64_in,int64_in\n" + "".join(f"{t},{u},{i}\n" for t, u, i in rows),
    )
    out = tmp_path / "out.csv"
    names = ["uint64_in", "int64_in", "uint64_out", "int64_out"]
    simulate_fmu_to_csv(
        first_order_fmi3, out, until=4, step=1, inputs=table, outputs=names,
        start={"uint64_in": str(2**64 - 1), "int64_in": -(2**63)},
    )  # fmt: skip
    lines = list(csv.reader(out.read_text().splitlines()))[2:]
    assert [(int(r[3]), int(r[4])) for r in lines] == [(u, i) for _, u, i in rows]


def test_integers_of_64_bits_stay_exact_in_a_mapping(first_order_fmi3: Path) -> None:
    samples = {"time": [0.0, 1.0], "uint64_in": [5, 2**64 - 1], "int64_in": [2**53 + 1, -(2**63)]}
    result = simulate_fmu(
        first_order_fmi3, until=2, step=1, inputs=samples, outputs=["uint64_out", "int64_out"]
    )
    assert result["uint64_out"].tolist()[1:] == [5, 2**64 - 1]
    assert result["int64_out"].tolist()[1:] == [2**53 + 1, -(2**63)]


def test_bounds_of_integers_are_compared_exactly(c_fmu: CFmu) -> None:
    edits = [
        (
            'name="int64_in" valueReference="108" causality="input"',
            f'name="int64_in" valueReference="108" causality="input" max="{2**53 + 1}"',
        )
    ]
    fmu = c_fmu(3, edits=edits)
    simulate_fmu(fmu, until=0.1, step=0.1, start={"int64_in": 2**53 + 1})
    with pytest.raises(ParameterInvalid, match=rf"\[-inf, {2**53 + 1}\]"):
        simulate_fmu(fmu, until=0.1, step=0.1, start={"int64_in": 2**53 + 2})
