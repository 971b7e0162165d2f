import zipfile
from pathlib import Path
from typing import Literal

import pytest

from uuvsim_cosim.errors import FmuError, InputInvalid, SystemInvalid
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import PlannedComponent
from uuvsim_cosim.orchestrator.plan.seeds import component_seed
from uuvsim_cosim.orchestrator.running.library import available, load
from uuvsim_cosim.orchestrator.ssp.ssd import format_ssd
from uuvsim_cosim.orchestrator.ssp.ssp import pack, read_ssp, write_archive
from uuvsim_cosim.orchestrator.system.resolve import resolve
from uuvsim_cosim.orchestrator.system.system import System

Fmi = Literal[2, 3]


def power() -> System:
    """Two thrusters on a battery, in a current that meanders: small, with arrays and a seed."""
    inner = System("sea").add("current", "model:current_gauss_markov").expose("v_c", "current.v_c")
    s = System("power").add("wrench", "model:wrench").add("battery", "model:battery")
    for i in (1, 2):
        name = f"thruster_{i}"
        s = s.add(name, "model:thruster_t200", start={"u": 0.5})
        s = s.connect("battery.voltage", f"{name}.voltage")
        s = s.connect(f"{name}.thrust", f"wrench.thrust[{i}]")
        s = s.connect(f"{name}.current", f"wrench.current[{i}]")
    s = s.connect("wrench.current_total", "battery.current")
    return s.add("hull", "model:bluerov2_heavy").connect("wrench.tau", "hull.tau").add(
        "sea", inner
    ).connect("sea.v_c", "hull.v_c")  # fmt: skip


@pytest.fixture(scope="module", params=[2, 3])
def packed(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("pack") / f"power_fmi{request.param}.ssp"
    pack(power(), path, fmi=request.param, seed=7)
    return path


def test_a_packed_system_is_the_same_wiring_over_fmus(packed: Path) -> None:
    system = load(packed)
    original = power()
    assert system.connections == original.connections
    assert list(system.components) == list(original.components)
    assert system.components["thruster_1"].source == "resources/thruster_t200.fmu"
    kind = "FMI 2.0" if "fmi2" in packed.name else "FMI 3.0"
    plan = flatten(system)
    assert {c.description.kind for c in plan.components} == {kind}
    assert plan.components[2].start == {"u": 0.5}


def test_packing_writes_each_components_seed(packed: Path) -> None:
    current = load(packed).nested("sea").components["current"]
    assert current.start["seed"] == component_seed(7, "sea.current")


def test_packing_twice_gives_the_same_bytes(packed: Path, tmp_path: Path) -> None:
    fmi: Fmi = 2 if "fmi2" in packed.name else 3
    pack(power(), tmp_path / "again.ssp", fmi=fmi, seed=7)
    assert (tmp_path / "again.ssp").read_bytes() == packed.read_bytes()


def test_equal_components_share_one_fmu(packed: Path) -> None:
    with zipfile.ZipFile(packed) as archive:
        names = archive.namelist()
    assert names[0] == "SystemStructure.ssd"
    assert len([n for n in names if "thruster" in n]) == 1


def test_fmpy_reads_and_validates_a_packed_system(packed: Path) -> None:
    if "fmi3" in packed.name:
        with zipfile.ZipFile(packed) as archive:
            assert b'version="2.0"' in archive.read("SystemStructure.ssd")[:600]
        return
    from fmpy.ssp.ssd import read_ssd

    found = read_ssd(str(packed))  # validates against the schema of SSP 1.0
    assert found.system.name == "power"
    assert {e.name for e in found.system.elements} == set(power().components)
    assert all(c.startConnector for c in found.system.connections)


@pytest.mark.filterwarnings("ignore")
def test_fmpy_simulates_a_packed_system(tmp_path: Path) -> None:
    from fmpy.ssp.simulation import simulate_ssp

    s = System("drive").add("battery", "model:battery").add("t", "model:thruster_t200")
    s = s.connect("battery.voltage", "t.voltage").connect("t.current", "battery.current")
    pack(s.expose("u", "t.u").expose("thrust", "t.thrust"), tmp_path / "drive.ssp")
    path = str(tmp_path / "drive.ssp")
    result = simulate_ssp(path, stop_time=1.0, step_size=0.01, input={"u": lambda t: 0.5})
    assert 5.0 < result["thrust"][-1] < 50.0


@pytest.mark.parametrize("fmi", [2, 3])
def test_the_master_gives_the_same_bits_before_and_after_packing(fmi: Fmi, tmp_path: Path) -> None:
    from uuvsim_cosim.orchestrator.master.master import Master

    def thrust_and_pose(system: System) -> tuple[float, bytes]:
        def instantiate(planned: PlannedComponent) -> Component:
            return resolve(planned.source).instantiate(planned.path)

        with Master(flatten(system, seed=7), instantiate) as master:
            master.initialize()
            master.step(100)
            return master.get("thruster_1", "thrust"), master.get("hull", "eta").tobytes()

    pack(power(), tmp_path / "x.ssp", fmi=fmi, seed=7)
    packed, original = thrust_and_pose(load(tmp_path / "x.ssp")), thrust_and_pose(power())
    assert packed == original
    assert packed[0] > 5.0


def test_a_python_component_cannot_be_packed(tmp_path: Path) -> None:
    s = System("s").add("a", "fake:filter")
    with pytest.raises(SystemInvalid, match="a: a fake component; expected an FMU or a model"):
        pack(s, tmp_path / "x.ssp")
    assert list(tmp_path.iterdir()) == []


def archive(path: Path, **members: bytes) -> Path:
    with zipfile.ZipFile(path, "w") as z:
        for name, data in members.items():
            z.writestr(name.replace("__", "/").replace("_dot_", "."), data)
    return path


def test_a_package_is_read_like_its_ssd(vehicle: System, tmp_path: Path) -> None:
    write_archive({"SystemStructure.ssd": format_ssd(vehicle)}, tmp_path / "x.ssp")
    assert read_ssp(tmp_path / "x.ssp") == vehicle
    assert load(tmp_path / "x.ssp") == vehicle


def test_a_variant_is_read_by_its_name(vehicle: System, tmp_path: Path) -> None:
    other = vehicle.set("hull.mass", 3)
    members = {"SystemStructure.ssd": format_ssd(vehicle), "Heavy.ssd": format_ssd(other)}
    write_archive(members, tmp_path / "x.ssp")
    assert load(f"{tmp_path / 'x.ssp'}#Heavy.ssd") == other


@pytest.mark.parametrize("source", ["../secret.fmu", "/etc/secret.fmu", "my.py:../x"])
def test_a_package_cannot_name_files_outside_itself(tmp_path: Path, source: str) -> None:
    text = format_ssd(System("s").add("a", "fake:filter")).replace(b"fake:filter", source.encode())
    path = archive(tmp_path / "x.ssp", SystemStructure_dot_ssd=text)
    with pytest.raises(SystemInvalid, match=r"outside the archive|an unknown kind"):
        read_ssp(path)


def test_an_archive_without_a_system_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FmuError, match=r"has no SystemStructure\.ssd"):
        read_ssp(archive(tmp_path / "x.ssp", other=b""))
    (tmp_path / "y.ssp").write_bytes(b"nothing")
    with pytest.raises(FmuError, match="not a zip archive"):
        read_ssp(tmp_path / "y.ssp")


def test_a_member_that_leaves_its_folder_is_refused(vehicle: System, tmp_path: Path) -> None:
    path = archive(tmp_path / "x.ssp", SystemStructure_dot_ssd=format_ssd(vehicle))
    with zipfile.ZipFile(path, "a") as z:
        z.writestr("../evil.py", b"")
    with pytest.raises(FmuError, match="would leave its folder"):
        read_ssp(path)


def test_nothing_is_written_into_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputInvalid, match="expected a folder that can be written"):
        write_archive({"a": b""}, tmp_path / "gone" / "x.ssp")


def test_a_system_that_does_not_exist_is_refused_with_those_that_do() -> None:
    with pytest.raises(InputInvalid, match="there is no system 'bluerov_survey'"):
        load("bluerov_survey")
    assert available() == sorted(available())


def test_a_single_fmu_is_a_system_of_one(packed: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(packed) as z:
        (tmp_path / "battery.fmu").write_bytes(z.read("resources/battery.fmu"))
    system = load(tmp_path / "battery.fmu")
    assert list(system.components) == ["battery"]


def test_a_fault_of_the_xml_names_the_package_not_the_cache(tmp_path: Path) -> None:
    path = tmp_path / "mine.ssp"
    write_archive({"SystemStructure.ssd": b"<a>"}, path)
    with pytest.raises(InputInvalid) as caught:
        read_ssp(path)
    assert str(caught.value).startswith(f"{path}/SystemStructure.ssd: malformed XML")
