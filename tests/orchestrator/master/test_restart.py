"""FMUs that cannot copy their state: a reset takes another instance, and reloads nothing."""

import ctypes
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fmpy
import pytest

from uuvsim_cosim.errors import FmuError
from uuvsim_cosim.fmus.check.inspect_fmu import reliance
from uuvsim_cosim.fmus.codegen.toolchain import compile_shared, host
from uuvsim_cosim.fmus.importer import archive, fmu_library, read_description
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.system.resolve import resolve

NO_STATE: dict[int, list[tuple[str, str]]] = {
    1: [],
    2: [('canGetAndSetFMUstate="true"', 'canGetAndSetFMUstate="false"')],
    3: [('canGetAndSetFMUState="true"', 'canGetAndSetFMUState="false"')],
}
ONCE = ('OnlyOncePerProcess="false"', 'OnlyOncePerProcess="true"')
FOREIGN = Path(__file__).parents[2] / "fmus" / "foreign"


@pytest.fixture(params=[1, 2, 3])
def stateless(request: pytest.FixtureRequest, c_fmu: Callable[..., Path]) -> Path:
    return c_fmu(request.param, edits=NO_STATE[request.param])


@pytest.fixture
def ball_without_state(tmp_path: Path) -> Path:
    include = [Path(fmpy.__file__).parent / "c-code", FOREIGN]
    library = compile_shared([FOREIGN / "ball_fmi3.c"], name="ball", include=include)
    (old, new) = NO_STATE[3][0]
    description = (FOREIGN / "ball_fmi3.xml").read_text()
    assert old in description
    path = tmp_path / "ball.fmu"
    with zipfile.ZipFile(path, "w") as fmu:
        fmu.writestr("modelDescription.xml", description.replace(old, new))
        fmu.writestr(f"binaries/{host().fmi3}/ball{host().suffix}", library.read_bytes())
    return path


def make(fmu: Path) -> Callable[[str], Any]:
    return lambda path: resolve(str(fmu)).instantiate(path)


def system(wired: Any, fmu: Path, other: Any) -> Any:
    return wired({"a": make(fmu), "b": other}, ["a.y -> b.u"], start={"a": {"u": 1.0}})


def test_a_reset_repeats_the_run_with_another_instance(
    stateless: Path, wired: Any, fmi3: Any
) -> None:
    with Master(*system(wired, stateless, fmi3)) as master:
        master.initialize()
        master.step(20)
        first = master.get("a", "y"), master.get("b", "y")
        used = master.components[0]
        master.reset()
        assert master.components[0] is not used
        assert master.get("a", "y") == 0.0
        master.step(20)
        assert (master.get("a", "y"), master.get("b", "y")) == first
        master.reset(start={"a": {"k": 2.0}})
        master.step(20)
        assert master.get("a", "y") == pytest.approx(2 * first[0], rel=1e-12)
        with pytest.raises(FmuError, match=r"a: .* says that it cannot copy its state"):
            master.snapshot()


def test_neither_reset_nor_pool_unpacks_or_loads_again(
    stateless: Path, wired: Any, fmi3: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Master(*system(wired, stateless, fmi3)) as master:
        master.initialize()
        unpacked: list[Any] = []
        loaded: list[Any] = []
        monkeypatch.setattr(read_description, "unpack", unpacked.append)
        monkeypatch.setattr(archive, "unpack", unpacked.append)
        load = ctypes.CDLL

        def count(name: str) -> Any:
            loaded.append(name)
            return load(name)

        monkeypatch.setattr(fmu_library.ctypes, "CDLL", count)
        master.make_ahead(2)
        for _ in range(3):
            master.reset()
            master.step(3)
        assert unpacked == []
        assert loaded == []


def test_instances_made_ahead_are_used_by_resets_and_freed(
    stateless: Path, wired: Any, fmi3: Any
) -> None:
    plan, instantiate = system(wired, stateless, fmi3)
    made: list[Any] = []

    def counted(planned: Any) -> Any:
        made.append(instantiate(planned))
        return made[-1]

    with Master(plan, counted) as master:
        master.initialize()
        assert len(made) == 2
        master.make_ahead(2)
        assert len(made) == 4  # b copies its state and needs none
        master.reset()
        assert len(made) == 4
        assert master.components[0] in made[2:]
        spare = next(c for c in made[2:] if c is not master.components[0])
    with pytest.raises(FmuError, match="freed"):
        spare.set(spare.description.variables["u"], 1.0)


@pytest.mark.parametrize("version", [1, 3])
def test_an_fmu_that_lives_once_is_freed_before_it_is_made_anew(
    version: int, c_fmu: Callable[..., Path], wired: Any, fmi3: Any
) -> None:
    fmu = c_fmu(version, edits=[*NO_STATE[version], ONCE])
    with Master(*system(wired, fmu, fmi3)) as master:
        master.initialize()
        master.make_ahead(3)
        master.step(4)
        first = master.get("a", "y")
        master.reset()
        master.step(4)
        assert master.get("a", "y") == first


def test_a_model_exchange_fmu_without_state_is_pooled_too(
    ball_without_state: Path, wired: Any, fmi3: Any
) -> None:
    with Master(*wired({"a": make(ball_without_state), "b": fmi3})) as master:
        master.initialize()
        master.step(40)
        first = master.get("a", "h")
        master.reset()
        assert master.get("a", "h") != first
        master.step(40)
        assert master.get("a", "h") == first


def test_inspection_says_beforehand_what_a_master_will_do(c_fmu: Callable[..., Path]) -> None:
    able = reliance(read_description.read_fmu(c_fmu(3)))
    assert able["reset"].startswith("restores its state")
    assert able["snapshot"] == "in memory and in files"
    assert able["iterated groups"] == "possible"
    unable = reliance(read_description.read_fmu(c_fmu(3, edits=NO_STATE[3])))
    assert unable["reset"].startswith("takes a fresh instance from a pool")
    assert unable["snapshot"].startswith("no: the master refuses")
    assert unable["iterated groups"].startswith("no: refused")
    once = reliance(read_description.read_fmu(c_fmu(3, edits=[*NO_STATE[3], ONCE])))
    assert once["reset"].startswith("frees the instance")
    assert once["instances"].startswith("one per process")


def test_instantiate_takes_what_was_read_already(c_fmu: Callable[..., Path]) -> None:
    read = read_description.read_fmu(c_fmu(3))
    component = instantiate_fmu(read, "x")
    assert component.description is read.description
    component.free()
