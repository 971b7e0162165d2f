"""`uuvsim models show VEHICLE`: derived figures of a vehicle, then its parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from uuvsim_cosim.commands.shared.terminal import Shown, line, number, table

__all__ = ["show_vehicle"]

AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
FORCES, VELOCITIES = "XYZKMN", "uvwpqr"


def show_vehicle(address: str) -> None:
    """Write the figures of a vehicle's parameter set, and its numbers with their sources."""
    from uuvsim_cosim.models.declaration.parameter_files import (
        parameter_set,
        split_address,
        vehicle_sets,
        vehicle_size,
    )
    from uuvsim_cosim.models.vehicles.vehicle_figures import (
        FASTEST,
        ambiguous_numbers,
        vehicle_figures,
    )

    id, _ = split_address(address)
    given = parameter_set(*split_address(address))
    size = vehicle_size(id)
    long = size is not None and size.shape == "torpedo"
    f = vehicle_figures(address, 1.5 if long else 0.5)
    sets = vehicle_sets(id)
    _pairs(
        "",
        [
            ("vehicle", f"{given.vehicle}@{given.name}"),
            ("from", given.citation),
            ("sets", ", ".join(sets)),
            ("frames", "n: north east down; b: forward starboard down; about CO, SI and rad"),
            *([("size", f"{size.length:g} x {size.breadth:g} x {size.height:g} m, {size.shape}")]
              if size else []),
        ],
    )  # fmt: skip
    surplus = f.buoyancy - f.weight
    drift = "rises" if surplus > 0 else "sinks"
    if math.isfinite(f.drift):
        drift += f" at {abs(f.drift):.3g} m/s"
    else:
        drift += f" faster than {FASTEST:g} m/s"
    _pairs(
        "balance",
        [
            ("mass", f"{f.mass:.4g} kg; with added mass {_row(np.diag(f.M)[:3])} kg"),
            ("inertia", f"with added mass {_row(np.diag(f.M)[3:])} kg.m2"),
            ("weight", f"{f.weight:.4g} N, buoyancy {f.buoyancy:.4g} N: {surplus:+.3g} N"),
            ("CG, CB", f"{_row(f.r_g)} m, {_row(f.r_b)} m from CO"),
            ("by itself", "hovers" if abs(surplus) < 1e-6 * f.weight else drift),
        ],
    )
    low, high = f.forces
    table(
        ("terminal speed", f"by {low:.3g} N or N.m", f"by {high:.3g} N or N.m", "unit"),
        [
            (
                f"{axis} alone",
                *(
                    Shown(v, f"{v:.3g}" if math.isfinite(v) else f"none below {FASTEST:g}")
                    for v in f.speeds[i]
                ),
                "m/s" if i < 3 else "rad/s",
            )
            for i, axis in enumerate(AXES)
        ],
        key="terminal_speed",
    )
    line()
    table(
        ("at rest", "natural period [s]", "linear damping ratio"),
        [
            (
                name,
                number(o.period, ".3g") if o.period else "none",
                number(abs(o.damping), ".2g") if o.period else "",
            )
            for name, o in (("roll", f.roll), ("pitch", f.pitch))
        ],
        key="at_rest",
    )
    line()
    table(
        (f"at {f.U:g} m/s ahead", "poles [1/s]", ""),
        [
            (name, _poles(poles), "stable" if max(poles.real) < 1e-9 else "unstable by itself")
            for name, poles in (("sway, yaw", f.lateral), ("heave, pitch", f.vertical))
        ],
        key="poles",
    )
    line()
    line(f"stability derivatives at {f.U:g} m/s ahead, such as Y_r = dY/dr, added mass included")
    table(
        ("", *VELOCITIES),
        [
            (name, *(Shown(v, "." if abs(v) < 1e-9 else f"{v:.4g}") for v in f.derivatives[i]))
            for i, name in enumerate(FORCES)
        ],
        key="stability_derivatives",
    )
    line()
    several = list(ambiguous_numbers(id))
    if several:
        line(
            f"{len(several)} numbers of which sources differ; a set that has one is named beside it"
        )
        table(("number", "value", "unit", "in set"), [
            (Shown(a.name, a.name if i == 0 else ""), number(value, ".6g"),
             Shown(a.unit, a.unit if i == 0 else ""), sets or "(print)")
            for a in several
            for i, (value, sets) in enumerate(a.values)
        ], key="ambiguous")  # fmt: skip
        line()
    table(
        ("parameter", "value", "unit", "source"),
        [(k, number(q.value, ".6g"), q.unit, q.source) for k, q in given.quantities.items()],
        key="parameters",
    )


def _pairs(title: str, rows: Sequence[tuple[str, str]]) -> None:
    table((title, ""), rows, key=title or "vehicle")
    line()


def _row(values: Sequence[float] | np.ndarray) -> str:
    return " ".join(f"{v:.4g}" for v in np.asarray(values) + 0.0)


def _poles(poles: np.ndarray) -> str:
    shown = []
    for p in sorted(poles, key=lambda p: (p.real, p.imag)):
        if abs(p.imag) < 1e-9:
            shown.append(f"{p.real + 0.0:.3g}")
        elif p.imag > 0:
            shown.append(f"{p.real:.3g} ± {p.imag:.3g}i")
    return "  ".join(shown)
