"""Integers of 64 bits stay exact: set, connected, converted, recorded, exported, restored."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import ComponentFailed, FmuError, InputInvalid
from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.orchestrator.master.faults import Fault
from uuvsim_cosim.orchestrator.master.initial_values import set_inputs
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.plan.plan import Transfer
from uuvsim_cosim.orchestrator.recording.export import export
from uuvsim_cosim.orchestrator.recording.mcap import read_mcap
from uuvsim_cosim.orchestrator.running.run import run
from uuvsim_cosim.orchestrator.ssp.ssd import read_ssd
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.orchestrator.values.values import Misfit, as_array, fit

PAIRS = [(2**64 - 1, -(2**63)), (2**63, 2**53 + 1), (2**53 + 1, 2**63 - 1)]
NAMES = ("b.uint64_out", "b.int64_out")


@pytest.fixture
def echoes(first_order_fmi3: Path) -> System:
    system = System("echoes", "0.1")
    for name in "ab":
        system = system.add(name, str(first_order_fmi3))
    for type_ in ("uint64", "int64"):
        system = system.connect(f"a.{type_}_out", f"b.{type_}_in")
    return system


def last(signals: Any) -> list[int]:
    return [int(signals[name][-1]) for name in NAMES]


@pytest.mark.parametrize("pair", PAIRS)
@pytest.mark.parametrize("how", ["here", "isolated", "traced"])
def test_they_pass_from_start_values_to_a_recording(
    echoes: System, tmp_path: Path, pair: tuple[int, int], how: str
) -> None:
    more: dict[str, Any] = {
        "here": {}, "isolated": {"isolate": ["*"]}, "traced": {"trace_fmi": tmp_path / "calls.csv"},
    }[how]  # fmt: skip
    system = echoes.set("a.uint64_in", str(pair[0])).set("a.int64_in", pair[1])
    done = run(system, until=0.4, out=tmp_path / "r", **more)
    assert last(done.signals()) == list(pair)
    again = read_ssd(done.folder / "system.ssd").components["a"].start
    assert (again["uint64_in"], again["int64_in"]) == pair


@pytest.mark.parametrize("pair", PAIRS)
def test_they_pass_through_every_export(
    echoes: System, tmp_path: Path, pair: tuple[int, int]
) -> None:
    import scipy.io

    system = echoes.set("a.uint64_in", pair[0]).set("a.int64_in", pair[1])
    folder = run(system, until=0.4, out=tmp_path / "r").folder
    for suffix in ("csv", "mcap", "mat"):
        export(folder, tmp_path / f"e.{suffix}")
    header, *rows = [line.split(",") for line in (tmp_path / "e.csv").read_text().splitlines()]
    bare = [name.partition(" ")[0] for name in header]
    assert [int(rows[-1][bare.index(name)]) for name in NAMES] == list(pair)
    assert last(read_mcap(tmp_path / "e.mcap")) == list(pair)
    found = scipy.io.loadmat(tmp_path / "e.mat", squeeze_me=True, struct_as_record=False)
    signals = found["signals"].b
    assert (int(signals.uint64_out[-1]), int(signals.int64_out[-1])) == pair


def test_they_pass_through_the_master_and_its_snapshots(
    wired: Any, first_order_fmi3: Path, tmp_path: Path
) -> None:
    from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu

    def make(path: str) -> Any:
        return instantiate_fmu(first_order_fmi3, path)

    links = ["a.uint64_out -> b.uint64_in", "a.int64_out -> b.int64_in"]
    with Master(*wired({"a": make, "b": make}, links)) as master:
        master.initialize()
        master.set("a", "uint64_in", 2**64 - 1)
        master.set("a", "int64_in", -(2**63))
        master.step(3)
        master.save_snapshot(tmp_path / "s")
        master.set("a", "uint64_in", 2**63)
        master.step(3)
        assert master.get("b", "uint64_out") == 2**63
        master.load_snapshot(tmp_path / "s")
        assert [master.get("b", n) for n in ("uint64_out", "int64_out")] == [2**64 - 1, -(2**63)]


class Held:
    """A component of one variable, which it keeps."""

    def __init__(self, path: str, variable: Variable, value: Any) -> None:
        self.path, self.value = path, value
        self.description = Description(path, "python", {variable.name: variable})

    def get(self, variable: Variable) -> Any:
        return self.value

    def set(self, variable: Variable, value: Any) -> None:
        self.value = value


def passed(source: str, target: str, value: Any, factor: float = 1.0) -> Any:
    """Pass a value over a connection in Initialization Mode."""
    y = Variable("y", source, "output", "discrete")  # type: ignore[arg-type]
    u = Variable("u", target, "input", "discrete")  # type: ignore[arg-type]
    components: list[Any] = [Held("a", y, value), Held("b", u, 0)]
    set_inputs(components, [Transfer(0, y, (0,), 1, u, (0,), factor)])
    return components[1].value


@pytest.mark.parametrize(
    ("source", "target", "value"),
    [
        ("UInt64", "UInt64", 2**64 - 1),
        ("Int64", "Int64", -(2**63)),
        ("UInt64", "Int64", 2**63 - 1),
        ("Int64", "UInt64", 2**53 + 1),
        ("UInt64", "Float64", 2**63),
        ("Float64", "Int32", -2.0),
        ("Float64", "Int64", 2.0**60),
    ],
)
def test_they_pass_a_connection_in_initialization(source: str, target: str, value: Any) -> None:
    assert passed(source, target, value) == value


@pytest.mark.parametrize(
    ("value", "rounded"),
    [(2.5, 3), (-2.5, -3), (0.49, 0), (1000.6, 1001), (-99999.5, -100000), (2.0**31 + 0.25, 2**31)],
)
def test_a_float_is_rounded_half_away_from_zero_for_an_integer(value: float, rounded: int) -> None:
    assert passed("Float64", "Int64", value) == rounded


def test_a_float_becomes_the_nearest_integer_in_initialization_as_in_a_step() -> None:
    assert [passed("Float64", "Int32", x) for x in (2.7, -2.7, 2.5, -2.5)] == [3, -3, 3, -3]


@pytest.mark.parametrize(
    ("source", "target", "value", "factor"),
    [
        ("UInt64", "Int64", 2**63, 1.0),
        ("Int64", "UInt64", -1, 1.0),
        ("UInt64", "Float64", 2**53 + 1, 1.0),
        ("Int64", "Int8", 128, 1.0),
        ("Float64", "UInt64", 2.0**64, 1.0),
        ("Int64", "Int64", 2**62 + 1, 2.5),
    ],
)
def test_one_that_does_not_fit_is_refused_in_initialization(
    source: str, target: str, value: Any, factor: float
) -> None:
    with pytest.raises(FmuError, match=rf"b\.u: the value .* of a\.y does not fit {target}"):
        passed(source, target, value, factor)


@pytest.mark.parametrize(
    ("link", "value", "fits"),
    [
        ("a.int64_out -> b.u", 2**53 + 1, False),
        ("a.int64_out -> b.u", -(2**62), True),
        ("a.uint64_out -> b.u", 2**64 - 1, False),
        ("a.uint64_out -> b.u", 2**63, True),
        ("a.uint64_out -> b.int64_in", 2**63, False),
        ("a.uint64_out -> b.int64_in", 2**63 - 1, True),
    ],
)
def test_a_step_converts_exactly_or_says_what_does_not_fit(
    echoes: System, tmp_path: Path, link: str, value: int, fits: bool
) -> None:
    source, _, target = link.partition(" -> ")
    if target == "b.int64_in":
        echoes = echoes.disconnect(target)
    system = echoes.connect(source, target).set(source.replace("out", "in"), value)
    if fits:
        run(system, until=0.4, out=tmp_path / "r")
        return
    with pytest.raises(ComponentFailed, match=rf"connected to input {target[2:]} does not fit"):
        run(system, until=0.4, out=tmp_path / "r")


def test_a_bias_on_an_integer_loses_no_digit(wired: Any, first_order_fmi3: Path) -> None:
    from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu

    def make(path: str) -> Any:
        return instantiate_fmu(first_order_fmi3, path)

    with Master(*wired({"a": make, "b": make}, ["a.int64_out -> b.int64_in"])) as master:
        master.initialize()
        master.set("a", "int64_in", 2**53 + 1)
        master.faults.add(Fault("a.int64_out", "bias", 2.0))
        master.step(3)
        assert master.get("b", "int64_out") == 2**53 + 3
        with pytest.raises(InputInvalid, match="override"):
            master.faults.add(Fault("a.int64_out", "override", 2**53 + 1))


def test_an_array_of_them_is_fitted_exactly() -> None:
    pair = Variable("n", "UInt64", "parameter", "tunable", shape=(2,))
    array = as_array(pair, fit(pair, f"[{2**64 - 1}, 5]"))
    assert array.tolist() == [2**64 - 1, 5]
    assert array.dtype == np.uint64


def test_a_bound_of_them_is_told_with_all_digits() -> None:
    n = Variable("n", "Int64", "parameter", "tunable", max=2**53 + 1)
    assert fit(n, 2**53 + 1) == 2**53 + 1
    with pytest.raises(Misfit) as caught:
        fit(n, 2**53 + 2)
    assert str(2**53 + 2) in caught.value.read
    assert str(2**53 + 1) in caught.value.expected


def test_a_matrix_may_have_brackets_about_its_rows() -> None:
    m = Variable("m", "Float64", "parameter", "tunable", shape=(2, 2), unit="m")
    assert fit(m, "[[1, 2], [3, 4]]") == fit(m, "1 2 3 4") == ((1.0, 2.0), (3.0, 4.0))
    assert fit(m, "[[100, 200], [300, 400]] cm") == ((1.0, 2.0), (3.0, 4.0))
    for wrong in ("[[1, 2, 3], [4, 5, 6]]", "[[1, 2], [3]]"):
        with pytest.raises(Misfit) as caught:
            fit(m, wrong)
        assert "such as '[[0.4, 0.4], [0.4, 0.4]] m'" in caught.value.expected
