"""The battery: open-circuit voltage over charge, an inner resistance, and the delivered energy.

    dV/dt = (OCV(soc) - R_i I - V) / T_V,   dsoc/dt = -I / Q,   dE/dt = V I

The terminal voltage V is a state, so that no algebraic loop arises with the consumers of the
current.
"""

from __future__ import annotations

from dataclasses import dataclass

from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.intrinsics.table import table1

__all__ = ["BatteryParameters", "battery"]


@dataclass(frozen=True)
class BatteryParameters:
    """Parameters of a battery."""

    Q: float  # C, charge of the full battery
    R_i: float  # Ohm, inner resistance
    T_V: float  # s, time constant of the terminal voltage
    n_cells: float  # cells in series
    soc: tuple[float, ...]  # 1, grid of the state of charge
    cell: tuple[float, ...]  # V, open-circuit voltage of one cell on that grid


# Blue Robotics 14.8 V, 18 Ah (4 cells in series, 16.8 V full): the maker's data sheet. R_i, T_V
# and the curve between 3.0 and 4.2 V are assumptions, typical of lithium-ion cells of this kind.
BLUE_ROBOTICS_18_AH = BatteryParameters(
    Q=18.0 * 3600.0,
    R_i=0.03,
    T_V=0.05,
    n_cells=4.0,
    soc=(0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0),
    cell=(3.0, 3.33, 3.45, 3.55, 3.61, 3.65, 3.70, 3.79, 3.88, 3.98, 4.08, 4.2),
)


def battery(p: BatteryParameters = BLUE_ROBOTICS_18_AH) -> Model:
    """Declare a battery; an empty one holds its lowest voltage (it has no cut-off)."""
    m = Model("battery", "Battery: open-circuit voltage, inner resistance, charge", h_max=0.01)
    current = m.input("current", unit="A", description="drawn, positive discharges")
    Q = m.parameter("Q", p.Q, unit="C", min=1e-9, description="charge when full (data sheet)")
    R_i = m.parameter("R_i", p.R_i, unit="Ohm", min=0, description="inner resistance (assumption)")
    T_V = m.parameter("T_V", p.T_V, unit="s", min=1e-3, description="time constant of the voltage")
    n_cells = m.parameter("n_cells", p.n_cells, unit="1", min=1, description="cells in series")
    soc_0 = m.parameter("soc_0", 1.0, unit="1", min=0, max=1, description="initial charge")
    cell = table1(p.soc, p.cell)
    soc = m.state("soc", soc_0, unit="1")
    V = m.state("V", n_cells * cell(soc_0), unit="V")
    E = m.state("E", unit="J")
    m.der(soc, -current / Q)
    m.der(V, (n_cells * cell(soc) - R_i * current - V) / T_V)
    m.der(E, V * current)
    m.output("voltage", V, unit="V", description="at the terminals")
    m.output("state_of_charge", soc, unit="1", description="1 is full")
    m.output("energy", E, unit="J", description="delivered since the start")
    return m
