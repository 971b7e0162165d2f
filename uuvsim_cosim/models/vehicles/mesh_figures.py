"""The mesh of a vehicle beside its parameters: the volume that it has to displace."""

from __future__ import annotations

from uuvsim_cosim.models.control.vehicle_design import weight_and_buoyancy
from uuvsim_cosim.models.declaration.parameter_files import parameter_set, split_address

__all__ = ["displaced_volume"]

RHO, G = 1025.0, 9.81  # kg/m3 and m/s2, where a set states B alone


def displaced_volume(vehicle: str) -> tuple[float, float, bool]:
    """Return B / (rho g) [m3] of a vehicle's set, rho [kg/m3], and whether the set states rho."""
    numbers = parameter_set(*split_address(vehicle)).quantities
    rho = numbers["rho"].value if "rho" in numbers else RHO
    g = numbers["g"].value if "g" in numbers else G
    return weight_and_buoyancy(vehicle)[1] / (rho * g), rho, "rho" in numbers
