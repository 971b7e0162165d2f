"""The actuators of a vehicle's folder, added to a system: thrusters, propellers and fins."""

from __future__ import annotations

from urllib.parse import quote

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.control.vehicle_design import Thrusters, thrusters_of
from uuvsim_cosim.models.declaration.parameter_files import split_address, vehicle_folder
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["CELLS", "has_fins", "quoted", "with_actuators", "with_allocation"]

CELLS = {"thruster_t200": 4, "thruster_jet": 3, "propeller": 6, "thruster": 4}  # of the battery


def quoted(vehicle: str) -> str:
    """Return a vehicle's address as it stands in a source."""
    return quote(vehicle, safe="/:@~ ")


def has_fins(vehicle: str) -> bool:
    """Return whether a vehicle's folder has fins."""
    return (vehicle_folder(split_address(vehicle)[0]) / "fins.yaml").is_file()


def with_allocation(system: System, vehicle: str) -> System:
    """Add the allocation to a vehicle's thrusters; its thrust curve is that of their model."""
    thrusters = thrusters_of(vehicle)
    place = quoted(split_address(vehicle)[0])
    if thrusters.model == "thruster_t200":
        return system.add("allocation", f"model:allocation?vehicle={place}")
    limit: dict[str, object] = {"f_max": thrusters.forward}  # thrust is quadratic in the command
    return system.add("allocation", f"model:allocation_quadratic?vehicle={place}", limit)


def with_actuators(
    system: System, vehicle: str, *, battery: bool = False
) -> tuple[System, list[str]]:
    """Connect a vehicle's actuators to its ``hull``; return the system and the commands.

    The commands are inputs, ``thruster_1.u`` …, and ``fins.u`` of a vehicle with fins, which has
    one propeller, ``propeller.u``. With an ``allocation`` in the system, it commands the thrusters.
    With `battery` there is one that feeds them.
    """
    thrusters = thrusters_of(vehicle)
    place = quoted(split_address(vehicle)[0])
    finned = has_fins(vehicle)
    n = len(thrusters.geometry.names)
    if finned and n != 1:
        raise InputInvalid(f"{vehicle}: fins, and {n} thrusters", "one propeller with fins")
    names = ["propeller"] if finned else [f"thruster_{i}" for i in range(1, n + 1)]
    if not finned:
        system = system.add("wrench", f"model:wrench?vehicle={place}")
        system = system.connect("wrench.tau", "hull.tau")
    if battery:
        cells: dict[str, object] = {"n_cells": CELLS[thrusters.model]}
        system = system.add("battery", "model:battery", cells)
    allocated = "allocation" in system.components
    for i, name in enumerate(names, 1):
        system = system.add(name, _source(thrusters, vehicle, i))
        system = system.connect("hull.nu_r", f"{name}.nu_r")
        if not finned:
            system = system.connect(f"{name}.thrust", f"wrench.thrust[{i}]")
            system = system.connect(f"{name}.current", f"wrench.current[{i}]")
        if allocated:
            system = system.connect(f"allocation.u[{i}]", f"{name}.u")
        if battery:
            system = system.connect("battery.voltage", f"{name}.voltage")
    if battery:
        drawn = "propeller.current" if finned else "wrench.current_total"
        system = system.connect(drawn, "battery.current")
    commands = [f"{name}.u" for name in names]
    if not finned:
        return system, commands
    system = (
        system.add("fins", f"model:fins?vehicle={place}&contact=true")
        .connect("hull.nu_r", "fins.nu_r")
        .connect("propeller.tau", "fins.contact")  # its torque counts too
        .connect("fins.tau", "hull.tau")
    )
    return system, [*commands, "fins.u"]


def _source(thrusters: Thrusters, vehicle: str, number: int) -> str:
    source = f"model:{thrusters.model}"
    if thrusters.model == "propeller":
        return f"{source}?vehicle={quoted(split_address(vehicle)[0])}&number={number}"
    return f"{source}?vehicle={quoted(vehicle)}&number={number}" if thrusters.has_set else source
