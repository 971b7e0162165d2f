"""Images of a sonar that the tests of this folder make: noise, one object, its shadow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from uuvsim_cosim.view.sonar.scans import SonarScans


def forward_looking(n: int = 3, beams: int = 31, bins: int = 60) -> SonarScans:
    """Return pings with an object of label 2 at 12 m, 15 degrees to starboard, one beam a ping."""
    rng = np.random.default_rng(5)
    bearings, ranges = np.radians(np.linspace(-45.0, 45.0, beams)), np.linspace(1.0, 30.5, bins)
    magnitude = np.sqrt(rng.exponential(size=(n, beams, bins))).astype(np.float32) * 0.01
    labels = np.ones((n, beams, bins), np.uint16)
    beam, b = int(np.argmin(abs(bearings - np.radians(15.0)))), int(np.argmin(abs(ranges - 12.0)))
    for k in range(n):
        magnitude[k, beam + k, b] = 10.0
        magnitude[k, beam + k, b + 1 : b + 9] = 0.0
        labels[k, beam + k, b] = 2
        labels[k, beam + k, b + 1 : b + 9] = 0
    return SonarScans(
        "rov.sonar", 0.2 * np.arange(n), bearings, ranges, magnitude, labels=labels,
        detections=np.full((n, beams), 12.0), shown=("no echo", "seabed", "mine"),
        frequency=900e3, sound_speed=1480.0,
    )  # fmt: skip


def side_scan(n: int = 20, bins: int = 50) -> SonarScans:
    """Return pings of a towed sonar; ping 4 has an object to starboard in bin 30."""
    rng = np.random.default_rng(6)
    magnitude = rng.uniform(0.1, 1.0, (n, 2, bins)).astype(np.float32)
    magnitude[4, 1, 30] = 20.0
    eta = np.zeros((n, 6))
    eta[:, 0], eta[:, 1], eta[:, 2], eta[:, 5] = np.arange(n), 7.0, 3.0, np.radians(-30.0)
    return SonarScans(
        "sidescan", 10.0 + 0.5 * np.arange(n), np.radians([-90.0, 90.0]),
        np.linspace(0.5, 49.5, bins), magnitude, eta=eta, frequency=450e3, sound_speed=1500.0,
    )  # fmt: skip


def without(scans: SonarScans, *parts: str) -> SonarScans:
    """Return pings without some of the optional arrays."""
    return replace(scans, **dict.fromkeys(parts))
