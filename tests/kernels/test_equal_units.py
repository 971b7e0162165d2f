"""Equal vehicles share C functions in a kernel, and have the bits of the master."""

from __future__ import annotations

import re
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.kernels import fuse
from uuvsim_cosim.kernels.codegen.driver import driver_text
from uuvsim_cosim.kernels.codegen.fusible import fused_of
from uuvsim_cosim.kernels.codegen.units import units_of
from uuvsim_cosim.models.declaration.parameter_files import vehicle_folder
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten


def vehicle() -> uuv.System:
    """Return a surveying vehicle with slower components, one thruster of which others power."""
    system = uuv.load("bluerov2_survey").disconnect("thruster_8.voltage")
    for path, rate in {"dvl": "0.2", "allocation": "0.02", "thruster_3": "0.04"}.items():
        source = system.components[path].source
        assert isinstance(source, str)
        system = system.replace(path, source, rate=rate)
    return system.expose("voltage", "battery.voltage").expose("power", "thruster_8.voltage")


def ring(vehicles: list[uuv.System]) -> uuv.System:
    """Return vehicles each of which powers a thruster of the next one."""
    system, n = uuv.System("ring", tick="0.01"), len(vehicles)
    for i, each in enumerate(vehicles):
        system = system.add(f"auv_{i}", each)
    for i in range(n):
        wire = f"auv_{i}.voltage", f"auv_{(i + 1) % n}.power"
        system = system.connect(*wire, factor=0.9, offset=0.1)
    return system


def fleets(n: int) -> uuv.System:
    """Return systems of three vehicles in a system."""
    system = uuv.System("fleets", tick="0.01")
    fleet = ring([vehicle() for _ in range(3)])
    for i in range(n):
        system = system.add(f"fleet_{i}", fleet)
    return system


def flat(n: int) -> uuv.System:
    """Return components without vehicles around them: motors, each with a battery."""
    system = uuv.System("flat", tick="0.01")
    for i in range(n):
        system = system.add(f"battery_{i}", "model:battery")
        system = system.add(f"motor_{i}", "model:thruster_t200", start={"u": 0.1 + 0.01 * i})
        system = system.connect(f"battery_{i}.voltage", f"motor_{i}.voltage")
        system = system.connect(f"motor_{i}.current", f"battery_{i}.current")
    return system


def agree(system: uuv.System, steps: int) -> None:
    """Compare every output at every step with the master's."""
    plan = flatten(system, seed=5)
    names = [(c.path, v.name) for c in plan.components for v in c.description.of("output")]
    with (
        Master(plan, prepare(plan, "native"), live=names) as master,
        fuse(system).batch(2, seeds=[3, 5]) as batch,
    ):
        master.initialize()
        for _ in range(steps):
            for path, name in names:
                wanted = np.ravel(np.asarray(master.get(path, name), float))
                got = np.ravel(batch.get(f"{path}.{name}")[1])
                np.testing.assert_array_equal(got, wanted, f"{path}.{name}")
            master.step()
            batch.step()


def text(system: uuv.System) -> str:
    fused = fused_of(flatten(system))
    return driver_text(fused, ["" for _ in fused.sources])


def functions(system: uuv.System) -> list[str]:
    """Return the driver's functions that several units share, without their tables."""
    found = re.findall(r"static void (?:part|initial)_\d+\(.*?\n}\n", text(system), re.S)
    assert found
    return found


def other() -> uuv.System:
    """Return a vehicle that differs in the source of one component."""
    return vehicle().replace("imu", "model:imu@stim300")


@pytest.mark.parametrize(
    "system",
    [
        ring([vehicle() for _ in range(3)]),
        ring([vehicle(), other(), vehicle(), other()]),
        fleets(2),
        flat(40),
    ],
    ids=["ring", "two kinds", "fleets", "flat"],
)
def test_units_that_share_functions_have_the_bits_of_the_master(system: uuv.System) -> None:
    assert functions(system)
    agree(system, 60)


def test_the_functions_do_not_grow_with_the_number_of_vehicles() -> None:
    assert functions(ring([vehicle()] * 4)) == functions(ring([vehicle()] * 9))
    assert functions(flat(40)) == functions(flat(90))


def test_a_unit_is_a_vehicle_also_inside_a_fleet() -> None:
    units = units_of(fused_of(flatten(fleets(2))))
    assert len(units.cells) == 6


def test_a_small_system_is_written_without_functions() -> None:
    assert "part_0" not in text(uuv.load("bluerov2_survey"))


def test_a_change_of_one_vehicles_file_gives_another_kernel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("UUVSIM_CACHE", str(tmp_path / "cache"))
    own = tmp_path / "ball" / "parameters.yaml"
    copytree(vehicle_folder("sphere"), own.parent)
    names = ["model:sphere", f"model:vehicle?id={own.parent}"]

    def speeds() -> list[float]:
        """Return the speed of each sphere after a push."""
        system = uuv.System("tank", tick="0.01")
        for i, source in enumerate(names):
            system = system.add(f"hull_{i}", source, start={"tau": [1.0, 0, 0, 0, 0, 0]})
        kernel = fuse(system)
        with kernel.batch(1) as batch:
            batch.step(10)
            return [float(batch.get(f"hull_{i}.nu")[0, 0]) for i in range(len(names))]

    first, equal = speeds()
    assert (first, equal) == (speeds()[0], first)
    own.write_text(own.read_text().replace("M_A_11: {value: 16.", "M_A_11: {value: 26."))
    again, slower = speeds()
    assert again == first
    assert 0 < slower < 0.9 * first


def test_each_parameter_set_has_its_own_kernel() -> None:
    sets = ["bluerov2_heavy@von_benzon_2022", "bluerov2_heavy@wu_2018"]
    one, other = (fuse(uuv.System("tank").add("hull", f"model:{name}")) for name in sets)
    assert one.tokens != other.tokens


def test_derivatives_are_refused_if_a_file_has_changed_since_the_kernel_was_made(
    tmp_path: Path,
) -> None:
    own = tmp_path / "ball" / "parameters.yaml"
    copytree(vehicle_folder("sphere"), own.parent)
    kernel = fuse(uuv.System("tank").add("hull", f"model:vehicle?id={own.parent}"))
    own.write_text(own.read_text().replace("M_A_11: {value: 16.", "M_A_11: {value: 26."))
    with pytest.raises(InputInvalid, match="a file that it reads has changed"):
        kernel.derivative("tangent")
