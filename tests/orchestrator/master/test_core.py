"""The stepping loop in C: values, order, time, and failures, over every kind of component."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uuvsim_cosim.errors import ComponentFailed
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu
from uuvsim_cosim.orchestrator.master import core
from uuvsim_cosim.orchestrator.master.core import columns_of
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.observer import Chunk
from uuvsim_cosim.orchestrator.plan.plan import Group

KINDS = ["fmi2", "fmi3", "native", "python"]


def chain(make: Any, n: int) -> tuple[dict[str, Any], list[str]]:
    paths = [f"lag_{i}" for i in range(n)]
    links = [f"{a}.y -> {b}.u" for a, b in pairwise(paths)]
    return dict.fromkeys(paths, make), links


@pytest.mark.parametrize("kind", ["fmi2", "fmi3", "python"])
def test_jacobi_on_a_chain_equals_plain_python_bit_for_bit(
    kind: str, wired: Any, watcher: Any, request: pytest.FixtureRequest
) -> None:
    n, steps, h = 5, 300, 0.01
    makers, links = chain(request.getfixturevalue(kind), n)
    start = {"lag_0": {"u": 1.25}, "lag_3": {"k": 0.7}}
    with Master(*wired(makers, links, start=start), observers=[watcher]) as master:
        master.initialize()
        master.step(steps)
    k, y = [1.0, 1.0, 1.0, 0.7, 1.0], [0.0] * n
    rows = [list(y)]
    for _ in range(steps):
        u = [1.25, *y[:-1]]
        y = [y[i] + h * (k[i] * u[i] - y[i]) / 0.5 for i in range(n)]
        rows.append(list(y))
    for i in range(n):
        assert watcher.values[f"lag_{i}.y"] == [row[i] for row in rows]


@pytest.mark.parametrize("kind", KINDS)
def test_the_loop_equals_get_set_and_do_step_in_python(
    kind: str, wired: Any, watcher: Any, request: pytest.FixtureRequest
) -> None:
    makers, links = chain(request.getfixturevalue(kind), 3)
    links.append("lag_2.y -> lag_0.u")
    w = wired(makers, links, tick="1/60", conversions={links[-1]: (-2.0, 1.5)})
    with Master(*w, observers=[watcher]) as master:
        master.initialize()
        master.step(50)
        parts = [w.instantiate(p) for p in w.plan.components]
        outs = [p.description.variables["y"] for p in parts]
        ins = [p.description.variables["u"] for p in parts]
        for p in parts:
            p.enter_initialization_mode(0.0, None)
            p.exit_initialization_mode()
        for step in range(50):
            y = [p.get(v) for p, v in zip(parts, outs, strict=True)]
            for p, v, u in zip(parts, ins, (-2.0 * y[2] + 1.5, y[0], y[1]), strict=True):
                p.set(v, u)
                p.do_step(step / 60, 1 / 60)
        assert [master.get(p.path, "y") for p in parts] == [
            p.get(v) for p, v in zip(parts, outs, strict=True)
        ]
        for p in parts:
            p.free()


def test_every_type_arrives_unchanged(wired: Any, fmi3: Any) -> None:
    values = {
        "float32": 1.5, "int8": -128, "uint8": 255, "int16": -32768, "uint16": 65535,
        "uint32": 2**32 - 1, "int64": -(2**63), "uint64": 2**64 - 1, "boolean": True,
        "int32": np.array([-(2**31), 2**31 - 1]), "string": np.array(["Tiefe", ""], object),
        "binary": b"\x00\xff\x00",
    }  # fmt: skip
    links = [f"a.{t}_out -> b.{t}_in" for t in values]
    start = {"a": {f"{t}_in": v for t, v in values.items()}}
    with Master(*wired({"a": fmi3, "b": fmi3}, links, start=start)) as master:
        master.initialize()
        master.step(2)
        for t, v in values.items():
            assert np.array_equal(master.get("a", f"{t}_out"), v), t
            assert np.array_equal(master.get("b", f"{t}_in"), v), t
        master.step(1)
        assert master.get("b", "string_out").tolist() == ["Tiefe", ""]
        assert master.get("b", "binary_out") == b"\x00\xff\x00"


@pytest.mark.parametrize("kind", KINDS)
def test_gauss_seidel_sees_what_earlier_members_made_in_this_step(
    kind: str, wired: Any, request: pytest.FixtureRequest
) -> None:
    make = request.getfixturevalue(kind)
    for algorithm, expected in (("jacobi", False), ("gauss-seidel", True)):
        w = wired(
            {"a": make, "b": make},
            ["a.y -> b.u"],
            groups=[Group(algorithm, (0, 1))],
            start={"a": {"u": 1.0}},
        )
        with Master(*w) as master:
            master.initialize()
            master.step(1)
            assert master.get("a", "y") > 0
            assert (master.get("b", "y") > 0) is expected


@pytest.mark.parametrize("algorithm", ["jacobi", "gauss-seidel"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_slow_component_is_not_visible_early(
    kind: str, algorithm: Any, wired: Any, watcher: Any, request: pytest.FixtureRequest
) -> None:
    make = request.getfixturevalue(kind)
    w = wired(
        {"slow": make, "fast": make},
        ["slow.y -> fast.u"],
        groups=[Group(algorithm, (0, 1))],
        step_ticks={"slow": 4},
        start={"slow": {"u": 1.0}},
    )
    with Master(*w, observers=[watcher]) as master:
        master.initialize()
        master.step(9)
    slow, fast = watcher.values["slow.y"], watcher.values["fast.y"]
    assert slow[:4] == [0.0] * 4
    assert slow[4] > 0
    assert slow[4:8] == [slow[4]] * 4
    assert slow[8] > slow[4]
    assert fast[:5] == [0.0] * 5
    assert fast[5] > 0


def test_a_slow_follower_in_gauss_seidel_sees_the_fast_leader(wired: Any, fmi3: Any) -> None:
    w = wired(
        {"fast": fmi3, "slow": fmi3},
        ["fast.y -> slow.u"],
        groups=[Group("gauss-seidel", (0, 1))],
        step_ticks={"slow": 2},
        start={"fast": {"u": 1.0}},
    )
    with Master(*w) as master:
        master.initialize()
        master.step(2)
        assert master.get("slow", "y") > 0


def test_time_is_rounded_once_from_integers(wired: Any, python: Any, watcher: Any) -> None:
    with Master(*wired({"a": python}, tick="1/60"), observers=[watcher]) as master:
        master.initialize()
        master.run_until(100)
        assert master.tick == 6000
    assert watcher.time == [k / 60 for k in range(6001)]


def test_elements_go_where_they_are_connected(wired: Any, fmi3: Any) -> None:
    start = {"a": {"v": np.array([1.0, 2.0, 4.0])}, "b": {"v": np.array([7.0, 8.0, 9.0])}}
    w = wired({"a": fmi3, "b": fmi3}, ["a.w[3] -> b.v[1]", "a.y -> b.v[3]"], start=start)
    with Master(*w) as master:
        master.initialize()
        master.step(2)
        assert master.get("b", "v").tolist() == [8.0, 8.0, 0.0]


def test_a_number_that_does_not_fit_names_the_input(wired: Any, fmi3: Any) -> None:
    w = wired({"a": fmi3, "b": fmi3}, ["a.int16_out -> b.int8_in"], start={"a": {"int16_in": 200}})
    with Master(*w) as master:
        master.initialize()
        with pytest.raises(ComponentFailed, match=r"'b' failed at t = 0.01 s.*int8_in.*Int8"):
            master.step(3)


@pytest.mark.parametrize(
    ("fault", "text"),
    [
        (1, r"output y is -?nan; expected a finite number"),
        (2, r"fmi3DoStep returned error: .*too hot"),
        (4, r"fmi3DoStep returned discard"),
        (5, r"fmi3DoStep returned fatal"),
        (7, r"asks to end"),
        (8, r"returned from a step before"),
    ],
)
def test_a_failure_names_component_and_time(
    fault: int, text: str, wired: Any, fmi3: Any, watcher: Any
) -> None:
    start = {"b": {"fault": fault, "fault_time": 0.03}}
    w = wired({"a": fmi3, "b": fmi3}, ["a.y -> b.u", "b.y -> a.u"], start=start)
    with Master(*w, observers=[watcher]) as master:
        master.initialize()
        with pytest.raises(ComponentFailed, match=f"'b' failed at t = 0.0[34] s: .*{text}"):
            master.step(100)
        master.free()
    # A step at whose end a component asks to end is one of the run.
    assert watcher.ticks == [0, 1, 2, 3, *([4] if fault == 7 else [])]
    assert watcher.ended == 1


def test_a_native_state_that_is_not_finite_is_named(wired: Any, native: Any) -> None:
    with Master(*wired({"a": native}, start={"a": {"k": 1e308, "u": 1e308}})) as master:
        master.initialize()
        with pytest.raises(ComponentFailed, match=r"'a' failed at t = 0 s: x is not finite"):
            master.step()


def test_nan_in_one_element_names_it(wired: Any, python: Any) -> None:
    w = wired({"a": python}, start={"a": {"v": np.array([1.0, np.inf, 2.0])}})
    with Master(*w) as master:
        master.initialize()
        with pytest.raises(ComponentFailed, match=r"output w\[2\] is inf"):
            master.step()


def test_the_loop_returns_when_its_wall_time_is_over(wired: Any, fmi3: Any) -> None:
    with Master(*wired({"a": fmi3})) as master:
        master.initialize()
        core = master._ready().core
        assert core.run(10**12, 0.02) is None
        assert 0 < core.tick < 10**12


def test_a_component_in_its_own_process_gives_the_same(wired: Any, first_order_fmi3: Any) -> None:
    got = []
    for isolate in (False, True):
        makers = {
            p: lambda path: instantiate_fmu(first_order_fmi3, path, isolate=isolate)  # noqa: B023
            for p in ("a", "b")
        }
        start = {"a": {"u": 1.0, "string_in": np.array(["x", "y"], object)}}
        w = wired(makers, ["a.y -> b.u", "a.string_out -> b.string_in"], start=start)
        with Master(*w) as master:
            master.initialize()
            master.step(20)
            got.append([master.get("b", "y"), master.get("b", "string_in").tolist()])
    assert got[0] == got[1]
    assert got[0][0] > 0
    assert got[0][1] == ["x", "y"]


# ---- memory of rows --------------------------------------------------------------------------


@given(st.integers(1, 70), st.integers(0, 3000))
def test_columns_have_memory_and_do_not_share_a_set_of_the_cache(columns: int, rows: int) -> None:
    memory = columns_of(columns, rows)
    assert memory.dtype == np.uint64
    assert memory.shape[0] == columns
    assert rows <= memory.shape[1] <= rows + 16
    assert memory.strides[0] // 64 % 2 == 1
    assert not memory.any()
    memory[:] = 1
    assert memory.flags.c_contiguous


class Rows:
    """Observer that keeps the ticks and all values of the rows."""

    def __init__(self) -> None:
        self.found: list[tuple[Any, ...]] = []

    def begin(self, plan: object, columns: object) -> None:
        """Do nothing."""

    def observe(self, chunk: Chunk) -> None:
        columns = (chunk.values(i).tolist() for i in range(len(chunk.columns)))
        self.found += zip(chunk.ticks.tolist(), *columns, strict=True)

    def end(self) -> None:
        """Do nothing."""


def test_rows_have_the_same_values_stored_row_by_row_or_column_by_column(
    wired: Any, fmi3: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    start = {"a": {"u": 1.0, "v": np.array([1.0, 2.0, 4.0])}}

    def rows(wide: int) -> list[tuple[Any, ...]]:
        monkeypatch.setattr(core, "_WIDE", wide)
        with Master(*wired({"a": fmi3}, start=start), observers=[kept := Rows()]) as master:
            master.initialize()
            master.step(3)
            master.set("a", "string_in", np.array(["hot", "cold"], object))
            master.step(2)
        return kept.found

    found = rows(0)
    assert found == rows(1 << 30)
    assert [row[0] for row in found] == list(range(6))
    assert ["hot" in row for row in found] == [False] * 4 + [True] * 2


def test_large_memory_is_zero_and_can_be_written() -> None:
    memory = columns_of(9, 40_000)
    assert not memory.any()
    memory[8, 39_999] = 7
    assert int(memory.sum()) == 7
