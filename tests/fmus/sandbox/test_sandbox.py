"""FMUs as WebAssembly: the bits of native code, and one message for each misbehaviour."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import uuvsim_cosim as uuv
from tests.conftest import SourceFmu
from tests.fmus.conftest import lag
from uuvsim_cosim.errors import ComponentFailed, FmuError, InputInvalid, ToolchainError
from uuvsim_cosim.fmus import build_fmu
from uuvsim_cosim.fmus.component import BindingKind, Component
from uuvsim_cosim.fmus.importer.read_description import read_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_here
from uuvsim_cosim.fmus.sandbox.sandbox import instantiate_sandboxed

pytest.importorskip("wasmtime")

(LOOPS, ABORTS, DIVIDES, OUTSIDE, RECURSES, GROWS, EXITS, READS, PRINTS, NULL_CALL, LOGS, TIME,
 BAD_TEXT) = range(1, 14)  # fmt: skip


def begun(component: Component, **start: object) -> Component:
    for name, value in start.items():
        component.set(component.description.variables[name], value)
    component.enter_initialization_mode(0.0, None)
    component.exit_initialization_mode()
    return component


def outputs(component: Component) -> list[object]:
    found = [component.get(v) for v in component.description.of("output")]
    return [v.tolist() if isinstance(v, np.ndarray) else v for v in found]


def stepped(component: Component, steps: int, first: int = 0) -> list[list[object]]:
    rows = []
    for k in range(first, first + steps):
        component.do_step(0.01 * k, 0.01)
        rows.append(outputs(component))
    return rows


@pytest.mark.parametrize("file", ["first_order_fmi2.c", "first_order_fmi3.c", "ball_fmi2.c",
                                  "ball_fmi3.c"])  # fmt: skip
def test_a_foreign_fmu_has_the_bits_of_native_code(source_fmu: SourceFmu, file: str) -> None:
    archive = read_fmu(source_fmu(file))
    native, sandboxed = instantiate_here(archive, "a"), instantiate_sandboxed(archive, "a")
    rows = [stepped(begun(c), 100) for c in (native, sandboxed)]
    assert rows[0] == rows[1]
    native.free()
    sandboxed.free()


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_fmu_of_this_package_has_the_bits_of_native_code(fmi: Any) -> None:
    archive = read_fmu(build_fmu(uuv.declare("bluerov2"), fmi=fmi))
    native, sandboxed = instantiate_here(archive, "a"), instantiate_sandboxed(archive, "a")
    tau = [3.0, -2.0, 1.0, 0.1, 0.2, -0.3]
    rows = [stepped(begun(c, tau=tau), 50) for c in (native, sandboxed)]
    assert rows[0] == rows[1]
    assert sandboxed.binding().kind in (BindingKind.FMI2, BindingKind.FMI3)
    native.free()
    sandboxed.free()


@pytest.mark.parametrize("file", ["first_order_fmi2.c", "first_order_fmi3.c"])
def test_every_kind_of_value_goes_in_and_comes_out(source_fmu: SourceFmu, file: str) -> None:
    archive = read_fmu(source_fmu(file))
    pair = [begun(make(archive, "a")) for make in (instantiate_here, instantiate_sandboxed)]
    for variable in archive.description.of("input"):
        value: Any = pair[0].get(variable)
        if variable.type in ("Float64", "Float32"):
            value = np.asarray(value) + 0.375
        elif variable.type == "Boolean":
            value = np.logical_not(value)
        elif variable.type == "String":
            value = np.full_like(np.asarray(value, object), "naïve ≥ 3")
        elif variable.type == "Binary":
            value = np.full_like(np.asarray(value, object), b"\x00\x01two")
        elif variable.type != "Clock":
            value = np.asarray(value) + 1
        value = value if variable.shape else np.asarray(value, object).item()
        for component in pair:
            component.set(variable, value)
        assert np.array_equal(pair[0].get(variable), pair[1].get(variable)), variable.name
    rows = [stepped(c, 3) for c in pair]
    assert rows[0] == rows[1]
    for component in pair:
        component.free()


@pytest.mark.parametrize("file", ["first_order_fmi2.c", "first_order_fmi3.c"])
def test_states_can_be_restored_and_moved_to_another_instance(
    source_fmu: SourceFmu, file: str
) -> None:
    archive = read_fmu(source_fmu(file))
    one, other = (begun(instantiate_sandboxed(archive, n), u=1.0) for n in ("a", "b"))
    stepped(one, 5)
    state = one.get_fmu_state()
    data = one.serialize_fmu_state(state)
    expected = stepped(one, 5, 5)
    one.set_fmu_state(state)
    assert stepped(one, 5, 5) == expected
    other.set_fmu_state(other.deserialize_fmu_state(data))
    assert stepped(other, 5, 5) == expected
    one.reset()
    assert stepped(begun(one, u=1.0), 5) == stepped(begun(instantiate_here(archive, "n"), u=1.0), 5)


@pytest.mark.parametrize("fmi", [2, 3])
def test_directional_derivatives_are_those_of_native_code(fmi: Any) -> None:
    archive = read_fmu(build_fmu(lag(), fmi=fmi))
    of = archive.description
    found = []
    for make in (instantiate_here, instantiate_sandboxed):
        component = begun(make(archive, "a"))
        unknowns, knowns = of.of("output")[-1:], of.of("input")[:1]
        found.append(component.directional_derivative(unknowns, knowns, [2.0]).tolist())
        component.free()
    assert found[0] == found[1] != [0.0]


MISBEHAVES = {
    LOOPS: "it did not answer in time and was interrupted",
    ABORTS: "it aborted",
    DIVIDES: "it divided an integer by zero",
    OUTSIDE: "it used memory outside its own",
    RECURSES: "its stack overflowed|it used memory outside its own",
    EXITS: r"it called exit\(3\)",
    NULL_CALL: "it called a null pointer|it called a function that does not exist|it aborted",
}


@pytest.mark.parametrize("act", MISBEHAVES)
def test_a_misbehaviour_ends_one_instance_with_its_reason(runaway: Path, act: int) -> None:
    archive = read_fmu(runaway)
    bad = begun(instantiate_sandboxed(archive, "bad", watchdog=0.2), act=act)
    good = begun(instantiate_sandboxed(archive, "good", watchdog=0.2))
    bad.do_step(0.0, 0.01)
    with pytest.raises(
        ComponentFailed,
        match=rf"'bad' failed at t = 0\.01 s: fmi3DoStep returned fatal: ({MISBEHAVES[act]})",
    ):
        bad.do_step(0.01, 0.01)
    with pytest.raises(FmuError, match="used after a fatal error"):
        bad.do_step(0.02, 0.01)
    bad.free()
    assert stepped(good, 3)[-1] == [pytest.approx(0.03), 0]
    good.free()


def test_memory_without_end_is_refused_by_name(runaway: Path) -> None:
    bad = begun(instantiate_sandboxed(read_fmu(runaway), "bad", grants=["memory:64MiB"]), act=GROWS)
    assert stepped(bad, 2)[-1][1] == -1
    ((status, text),) = bad.messages  # type: ignore[attr-defined]
    assert status == "note"
    assert re.search(
        r"it asked for 16 MiB of memory, which its C library rounds up to 32 MiB, has 33\.\d+ MiB, "
        "and may have 64 MiB in all, which WebAssembly",
        text,
    )
    bad.free()


def test_a_file_is_refused_by_name(runaway: Path, tmp_path: Path) -> None:
    secret = tmp_path / "id"
    secret.write_text("secret")
    bad = begun(instantiate_sandboxed(read_fmu(runaway), "bad"), act=READS, path=str(secret))
    assert stepped(bad, 3)[-1][1] == -1
    ((status, text),) = bad.messages  # type: ignore[attr-defined]
    assert status == "note"
    assert f"it tried to open the file {secret}, which WebAssembly refuses" in text
    bad.free()


def test_messages_and_printed_lines_come_out(runaway: Path) -> None:
    archive = read_fmu(runaway)
    bad = begun(instantiate_sandboxed(archive, "bad"), act=LOGS, path="too warm")
    stepped(bad, 2)
    assert bad.messages == [("warning", "too warm")]  # type: ignore[attr-defined]
    bad = begun(instantiate_sandboxed(archive, "bad"), act=PRINTS, path="hello")
    stepped(bad, 2)
    assert bad.messages == [("ok", "hello 7")]  # type: ignore[attr-defined]


def test_the_clock_can_be_read(runaway: Path) -> None:
    assert stepped(begun(instantiate_sandboxed(read_fmu(runaway), "a"), act=TIME), 2)[-1][1] == 1


def test_a_text_outside_the_memory_is_not_read(runaway: Path) -> None:
    bad = begun(instantiate_sandboxed(read_fmu(runaway), "bad"), act=BAD_TEXT)
    with pytest.raises(ComponentFailed, match="it returned a text that is outside its memory"):
        bad.get(bad.description.variables["path"])


def test_instances_share_nothing_even_if_the_fmu_may_exist_once(runaway: Path) -> None:
    archive = read_fmu(runaway)
    one, other = (begun(instantiate_sandboxed(archive, n), path=n) for n in ("one", "other"))
    assert [c.get(c.description.variables["path"]) for c in (one, other)] == ["one", "other"]


@pytest.mark.parametrize("grant", ["network", "all"])
def test_a_grant_other_than_memory_is_refused(runaway: Path, grant: str) -> None:
    with pytest.raises(InputInvalid, match="memory:SIZE only, or isolation in a process"):
        instantiate_sandboxed(read_fmu(runaway), "a", grants=[grant])


def test_a_binary_fmu_is_refused_with_the_way_that_it_has(first_order_fmi3: Path) -> None:
    with pytest.raises(FmuError, match=r"cannot run as WebAssembly: .*`--isolate NAME` runs it in"):
        instantiate_sandboxed(read_fmu(first_order_fmi3), "a")


def test_without_wasmtime_the_extra_is_named(
    runaway: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from uuvsim_cosim.fmus.sandbox import engine

    monkeypatch.setattr(engine, "find_spec", lambda name: None)
    with pytest.raises(ToolchainError, match=r"pip install 'uuvsim-cosim\[sandbox\]'"):
        instantiate_sandboxed(read_fmu(runaway), "a")
