"""A CSV file as a component of a system."""

from pathlib import Path
from shutil import copytree
from typing import Literal

import pytest

from uuvsim_cosim.errors import SystemInvalid
from uuvsim_cosim.fmus.codegen import native
from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.models.declaration.parameter_files import vehicle_folder
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.running.library import load
from uuvsim_cosim.orchestrator.ssp.ssd import read_ssd, write_ssd
from uuvsim_cosim.orchestrator.ssp.ssp import pack
from uuvsim_cosim.orchestrator.system.resolve import resolve
from uuvsim_cosim.orchestrator.system.system import System

TABLE = "time,speed,depth\n0.1,1,0\n0.3,2,0\n0.3,5,8\n0.5,5,9\n"


def running(system: System) -> Master:
    plan = flatten(system)
    return Master(plan, prepare(plan))


def values(system: System, n: int = 7) -> list[float]:
    with running(system) as master:
        master.initialize()
        seen = [master.get("t", "speed")]
        for _ in range(n):
            master.step()
            seen.append(master.get("t", "speed"))
        return seen


def test_a_table_is_linear_between_rows_and_held_at_both_ends(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text(TABLE)
    seen = values(System("s", "0.1").add("t", str(tmp_path / "t.csv")))
    assert seen == pytest.approx([1.0, 1.0, 1.5, 5.0, 5.0, 5.0, 5.0, 5.0])


@pytest.mark.parametrize(("version", "fmi"), [("1.0", 2), ("2.0", 3)])
def test_a_table_travels_in_files(
    tmp_path: Path, version: Literal["1.0", "2.0"], fmi: Literal[2, 3]
) -> None:
    (tmp_path / "t.csv").write_text(TABLE)
    system = System("s", "0.1", base=tmp_path).add("t", "t.csv")
    write_ssd(system, tmp_path / "s.ssd", version)
    assert 'type="text/csv"' in (tmp_path / "s.ssd").read_text()
    assert values(read_ssd(tmp_path / "s.ssd")) == values(system)
    pack(system, tmp_path / "s.ssp", fmi)
    assert values(load(str(tmp_path / "s.ssp"))) == values(system)


def test_a_snapshot_of_a_table_goes_back(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text(TABLE)
    with running(System("s", "0.1").add("t", str(tmp_path / "t.csv"))) as master:
        master.initialize()
        master.step(2)
        kept = master.snapshot()
        master.step(4)
        master.restore(kept)
        assert master.get("t", "speed") == pytest.approx(1.5)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty"),
        ("x,y\n0,1\n", "'x'; expected 'time'"),
        ("time\n0\n", "only the column 'time'"),
        ("time,y,\n0,1,2\n", "column 3: no name"),
        ("time,y,y\n0,1,2\n", "'y' is given twice"),
        ("time,y\n", "no line after the header"),
        ("time,y\n1,1\n0,2\n", "do not decrease"),
        ("time,y\n0,nan\n", "finite number"),
        ("time,y\n0\n", "1 cells; expected 2"),
    ],
)
def test_a_wrong_table_is_named_by_line_and_column(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(SystemInvalid, match=said):
        System("s", "0.1").add("t", str(tmp_path / "t.csv")).validate()


def test_native_components_of_one_source_share_one_library(monkeypatch: pytest.MonkeyPatch) -> None:
    first = resolve("model:thruster_t200").instantiate("a", backend="native")
    first.free()
    monkeypatch.setattr(native, "compile_native", lambda lowered: pytest.fail("compiled again"))
    second, third = (
        resolve("model:thruster_t200").instantiate(path, backend="native") for path in "bc"
    )
    assert isinstance(second, Native)
    assert isinstance(third, Native)
    u = second.description.variables["u"]
    second.set(u, 0.5)
    assert (second.path, second.get(u), third.path, third.get(u)) == ("b", 0.5, "c", 0.0)


def test_a_native_component_is_compiled_again_after_a_change_of_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "ball" / "parameters.yaml"
    copytree(vehicle_folder("sphere"), file.parent)

    def speed() -> float:
        hull = resolve(f"model:vehicle?id={file.parent}").instantiate("hull", backend="native")
        hull.enter_initialization_mode(0.0, None)
        hull.set(hull.description.variables["tau"], [1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        hull.exit_initialization_mode()
        hull.do_step(0.0, 0.01)
        return float(hull.get(hull.description.variables["nu"])[0])

    before = speed()
    file.write_text(file.read_text().replace("M_A_11: {value: 16.", "M_A_11: {value: 26."))
    assert 0 < speed() < 0.9 * before


def test_a_table_reads_nothing_so_connections_to_its_slot_end(tmp_path: Path) -> None:
    (tmp_path / "g.csv").write_text(
        "time," + ",".join(f"{n}[{i}]" for n in ("eta_d", "nu_d") for i in range(1, 7))
        + "\n0" + ",0" * 12 + "\n"
    )  # fmt: skip
    before = load("bluerov2_hold")
    assert any(c.target.startswith("guidance.") for c in before.connections)
    names = {f"{n}[{i}]": f"{n}[{i}]" for n in ("eta_d", "nu_d") for i in range(1, 7)}
    after = before.replace("guidance", str(tmp_path / "g.csv"), map=names)
    assert not any(c.target.startswith("guidance.") for c in after.connections)
    flatten(after)
