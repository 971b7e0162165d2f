"""Stratified water: density, temperature and salinity at the vehicle's depth.

Temperature and salinity are linear between levels, and held above the first and below the last one.
The density is that of EOS-80 (seawater.py) at the pressure  p = rho_0 g D  of the depth D, with the
density rho_0 of 1025 kg/m3. A glider's net weight is a few newtons, so one part in a thousand of
the density is a seventh of its speed.
"""

from __future__ import annotations

from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.safe_math import clip
from uuvsim_cosim.models.declaration.vectors import ETA
from uuvsim_cosim.models.water.seawater import density

__all__ = ["water_column"]

RHO_G = 1025.0 * 9.81  # Pa/m
# Means of models/recordings/slocum_2016 within 0.6 m of each level: depth, temperature, salinity.
LEVELS = (
    (0.0, 16.8, 7.65), (10.0, 15.2, 7.77), (15.0, 14.7, 7.77), (20.0, 13.0, 7.81),
    (25.0, 10.8, 7.95), (30.0, 7.6, 8.07), (35.0, 6.1, 8.26), (40.0, 5.3, 8.49),
)  # fmt: skip


def water_column() -> Model:
    """Declare the water at the depth of a hull; its default levels are those of the Baltic."""
    m = Model("water_column", "Density of stratified water at the hull's depth", h_max=1.0)
    m.peers["eta"] = "hull.eta"
    eta = m.input("eta", 6, unit=ETA, description="of the hull")
    n = len(LEVELS)
    d = m.parameter(
        "depths", [row[0] for row in LEVELS], (n,), unit="m", description="of the levels, rising"
    )
    levels = {
        name: m.parameter(name, [row[i] for row in LEVELS], (n,), unit=unit, description=words)
        for i, name, unit, words in (
            (1, "temperatures", "degC", "of each level"),
            (2, "salinities", "1", "of each level, practical"),
        )
    }
    T, S = levels["temperatures"][0], levels["salinities"][0]
    for i in range(n - 1):
        share = clip((eta[2] - d[i]) / (d[i + 1] - d[i]), 0.0, 1.0)
        T += share * (levels["temperatures"][i + 1] - levels["temperatures"][i])
        S += share * (levels["salinities"][i + 1] - levels["salinities"][i])
    p = RHO_G * clip(eta[2], 0.0, 12000.0)
    m.output("density", density(S, T, p), unit="kg/m3", description="of the water at the hull")
    m.output("temperature", T, unit="degC", description="of the water at the hull")
    m.output("salinity", S, unit="1", description="of the water at the hull, practical")
    return m
