"""The system `slocum_yo`: a Slocum glider dives and climbs in stratified water of the Baltic."""

from __future__ import annotations

from dataclasses import replace

from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["slocum_yo"]

VEHICLE = "slocum@baltic_2016"
START = (0.0, 0.0, 4.0, 0.0, -0.2, 0.0)  # N E D [m], phi theta psi [rad]


def slocum_yo() -> System:
    """Return the mission of the shipped recording: dives to 40 m by pump, battery and rudder.

    The density of the water changes the glider's buoyancy, and that of the pumped volume. The
    mission is computed once in a cycle of 4 s, as on the glider.
    """
    system = (
        System("slocum_yo", "0.02", "A Slocum glider flies three dives to 40 m in stratified water")
        .add("mission", "model:yo_yo")
        .add("water", "model:water_column")
        .add("ballast", "model:ballast?id=slocum&contact=true&stratified=true")
        .add("fins", "model:fins?vehicle=slocum&contact=true")
        .add("hull", f"model:{VEHICLE}?stratified=true", start={"eta_0": START})
    )
    for reader in ("mission", "water", "ballast"):
        system = system.connect("hull.eta", f"{reader}.eta")
    system = (
        system.connect("hull.nu", "mission.nu")
        .connect("mission.V_d", "ballast.V_d")
        .connect("mission.x_d", "ballast.x_d")
        .connect("mission.delta_d", "fins.u[1]")
        .connect("water.density", "ballast.density")
        .connect("water.density", "hull.density")
        .connect("hull.nu_r", "fins.nu_r")
        .connect("ballast.tau", "fins.contact")
        .connect("fins.tau", "hull.tau")
        .group(["mission", "water", "ballast", "fins"])
    )
    return replace(system, stop_time=1700.0)
