"""Actuators against published data: bench rows of thrusters, derivatives of fins."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from uuvsim_cosim.content import content
from uuvsim_cosim.models.checks.comparison import Checked, compared
from uuvsim_cosim.models.checks.compiled_run import end_of
from uuvsim_cosim.models.declaration.evaluation import Evaluation
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.parameter_files import read_yaml

__all__ = ["fins_of_lauv", "fins_of_npsauv", "t200"]

G = 9.80665


def t200() -> Iterator[Checked]:
    """Yield thrust, speed and current where dn/dt = 0, against every row of each bench."""
    path = content("models", "thrusters", "t200", "bench.yaml")
    f = Evaluation(declare("thruster_t200"))
    p = f.values_of("parameter", {})
    d = f.derived(p)
    for bench in read_yaml(path, "bench.schema.json")["bench"]:
        volt = float(bench["voltage"]["value"])
        ours, theirs = [], []
        for pwm, rpm, current, kgf in bench["rows"]:
            u = f.values_of("input", {"u": (pwm - 1500) / 400, "voltage": volt})
            n = float(p[0] * f.rhs(0, u, p, d, 0.0, []))
            ours.append(np.array(f.outputs(0, u, p, d, n, [])).ravel())
            theirs.append([kgf * G, np.sign(kgf) * rpm * np.pi / 30, current])
        size = np.max(np.abs(theirs), axis=0)  # of each column
        ours, theirs = ours / size, theirs / size
        what = f"{len(ours)} bench rows at {volt:g} V: thrust, speed, current, of the greatest"
        yield compared("blue_robotics", "thruster_t200", what, ours, theirs, 1e-10)


def fins_of_npsauv() -> Iterator[Checked]:
    """Yield the moments of its planes that hold at any angle: N_dr, M_ds, M_db / 2 each."""
    delta, u, q2 = 1e-4, 1.5, 0.5 * 1025 * 5.3**2
    found = [
        _tau("npsauv", [delta * (i == k) for k in range(4)], u)[[4, 5]]
        for i in range(4)
    ]  # fmt: skip
    theirs = [[0, -0.013], [-0.041, 0], [0.0035, 0], [0.0035, 0]]
    ours = np.array(found) / (delta * u * u * q2 * 5.3)
    what = "N_dr, M_ds, M_db of the planes"
    yield compared("healey_lienard", "npsauv", what, ours, theirs, 1e-6, relative=True)


def fins_of_lauv() -> Iterator[Checked]:
    """Yield lift and drag of two rudders: k_l = 9.8688, k_d = 6.513408 N.s2/m2."""
    u, delta = 1.2, 0.01
    found = _tau("lauv", [delta, 0, delta, 0], u)
    ours = [found[1] / (2 * u * u * delta), -found[0] / (2 * u * u * delta**2)]
    theirs = [9.8688, 6.513408]
    what = "lift and drag of two rudders at 0.01 rad"
    yield compared("lauv_gazebo", "lauv", what, ours, theirs, 1e-3, relative=True)


def _tau(vehicle: str, delta: list[float], u: float) -> Any:
    inputs = {"u": delta, "nu_r": [u, 0, 0, 0, 0, 0]}
    return end_of(declare("fins", vehicle=vehicle), 8.0, 0.02, inputs)["tau"]
