"""Bench rows of a thruster become grids over command, shaft speed and voltage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.files_read import shared_until_changed
from uuvsim_cosim.models.declaration.parameter_files import in_unit, read_yaml

__all__ = ["Bench", "read_bench"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Bench:
    """Rows of one thruster, [voltage][row]; shaft speed n [rad/s] bears the thrust's sign.

    `u` is (pwm - neutral) / span. Each grid holds every point at which some voltage has a row.
    """

    voltage: tuple[float, ...]
    u: tuple[Array, ...]
    n: tuple[Array, ...]
    current: tuple[Array, ...]
    thrust: tuple[Array, ...]
    T_n: float
    source: str

    def over_u(self, values: tuple[Array, ...]) -> tuple[Array, Array]:
        """Return (grid of u, table [voltage][u]) of n or current."""
        grid = np.unique(np.concatenate(self.u))
        rows = [np.interp(grid, u, v) for u, v in zip(self.u, values, strict=True)]
        return grid, np.array(rows)

    def thrust_over_n(self) -> tuple[Array, Array]:
        """Return (grid of n, table [voltage][n]) of the thrust.

        A shaft may turn faster than a lower voltage's bench rows reach, while the voltage drops:
        there the column follows that of the highest voltage, scaled to join without a step.
        """
        grid = np.unique(np.concatenate(self.n))
        top = np.interp(grid, self.n[-1], self.thrust[-1])
        rows = []
        for n, thrust in zip(self.n, self.thrust, strict=True):
            row = np.interp(grid, n, thrust)
            for beyond, end in ((grid > n[-1], -1), (grid < n[0], 0)):
                scale = thrust[end] / np.interp(n[end], self.n[-1], self.thrust[-1])
                row[beyond] = scale * top[beyond]
            rows.append(row)
        return grid, np.array(rows)


@shared_until_changed
def read_bench(id: str) -> Bench:
    """Read the bench rows of a thruster in models/thrusters/<id>; raises ParameterInvalid."""
    path = content("models", "thrusters", id, "bench.yaml")
    if not path.is_file():
        known = sorted(p.parent.name for p in content("models", "thrusters").glob("*/bench.yaml"))
        raise ParameterInvalid(f"bench={id}", "no such bench rows", ", ".join(known))
    data = read_yaml(path, "bench.schema.json")
    neutral, span = float(data["neutral"]["value"]), float(data["span"]["value"])
    units = [str(c["unit"]) for c in data["columns"]]
    kgf = in_unit(1.0, units[3], "N")
    rpm = in_unit(1.0, units[1], "rpm") * np.pi / 30.0
    rows = [np.array(b["rows"], dtype=float) for b in data["bench"]]
    n = tuple(np.sign(a[:, 3]) * a[:, 1] * rpm for a in rows)
    voltage = tuple(float(b["voltage"]["value"]) for b in data["bench"])
    for name, sequence in (("voltage", np.array(voltage)), *(("pwm", a[:, 0]) for a in rows)):
        if not np.all(np.diff(sequence) > 0):
            raise ParameterInvalid(path, f"{name} = {list(sequence)}", "rising")
    if not all(np.all(np.diff(s) >= 0) for s in n):
        raise ParameterInvalid(path, "n of some voltage falls", "it to rise with pwm")
    return Bench(
        voltage,
        tuple((a[:, 0] - neutral) / span for a in rows),
        n,
        tuple(a[:, 2] for a in rows),
        tuple(a[:, 3] * kgf for a in rows),
        float(data["T_n"]["value"]),
        str(data["source"]),
    )
