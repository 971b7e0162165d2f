"""A current that changes with depth: a power law, a logarithmic layer, or levels of a table.

With z the height above the sea bed, d the depth below the surface and h the water's depth:

    power    V(d) = V_s (z / h)^alpha                  tidal current, alpha = 1/7
    log      V(z) = V_s ln(z / z_0) / ln(h / z_0)      boundary layer over a rough bed, 0 below z_0
    table    V(d) linear between levels, and held above the first and below the last

V_s is the speed at the surface. Power law: DNV-RP-C205, section 4.1.4; logarithmic: Soulsby 1997,
Dynamics of Marine Sands, chapter 3, where z_0 is 0.2 mm for mud, 6 mm for ripples.
"""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.files_read import noted
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.safe_math import clip
from uuvsim_cosim.models.declaration.vectors import ETA

__all__ = ["current_profile"]

LAWS = ("power", "log", "table")
LEVELS = ((0.0, 0.5, 0.0), (10.0, 0.4, 0.1), (30.0, 0.2, 0.1), (60.0, 0.1, 0.0))


def current_profile(law: str = "power", file: str = "") -> Model:
    """Declare a current sheared with depth; `file` is a CSV of the law `table`.

    Its first line is ``depth,north,east``, in m and m/s; the depths rise.
    """
    if law not in LAWS or (file and law != "table"):
        read = f"law={law!r}" if law not in LAWS else f"file={file!r} with law={law!r}"
        raise InputInvalid("current_profile", read, f"{', '.join(LAWS)}; file with table")
    m = Model("current_profile", f"Current that changes with depth ({law}), in NED", h_max=1.0)
    m.peers["eta"] = "hull.eta"
    eta = m.input("eta", 6, unit=ETA, description="of the hull")
    added = m.input("v", 3, unit="m/s", description="current on top of it, in n")
    depth = eta[2]
    if law == "table":
        rows = _read(Path(file).expanduser()) if file else np.array(LEVELS)
        n = len(rows)
        d = m.parameter("depths", rows[:, 0], (n,), unit="m", description="of the levels, rising")
        v = m.parameter(
            "velocities", rows[:, 1:], (n, 2), unit="m/s", description="of each level: N, E"
        )
        flow = v[0, :].T
        for i in range(n - 1):
            share = clip((depth - d[i]) / (d[i + 1] - d[i]), 0.0, 1.0)
            flow += share * (v[i + 1, :] - v[i, :]).T
    else:
        V = m.parameter("speed", 0.5, unit="m/s", description="at the surface")
        beta = m.parameter(
            "direction", 0.0, unit="rad", description="direction it flows to, from N to E"
        )
        h = m.parameter("h", 50.0, unit="m", min=0.01, description="depth of the water")
        if law == "power":
            alpha = m.parameter(
                "alpha", 1.0 / 7.0, unit="1", min=0.01, max=2, description="exponent"
            )
            share = clip(1.0 - depth / h, 0.0, 1.0)
            tall = ca.if_else(share > 1e-12, share, 1.0)
            speed = ca.if_else(share > 1e-12, ca.exp(alpha * ca.log(tall)), 0.0 * share)
        else:
            z_0 = m.parameter("z_0", 0.006, unit="m", min=1e-7, description="roughness of the bed")
            z = clip(h - depth, z_0, h)
            speed = ca.log(z / z_0) / ca.log(h / z_0)
        flow = V * speed * ca.vertcat(ca.cos(beta), ca.sin(beta))
    m.output("v_c", ca.vertcat(flow, 0.0) + added, unit="m/s",
             description="velocity of the water in NED")  # fmt: skip
    return m


def _read(file: Path) -> NDArray[np.float64]:
    try:
        lines = [x for x in noted(file).read_text(encoding="utf-8-sig").splitlines() if x.strip()]
    except (OSError, UnicodeDecodeError) as error:
        raise InputInvalid(f"{file}: cannot be read ({error})") from None
    head = [x.strip() for x in lines[0].split(",")] if lines else []
    if head != ["depth", "north", "east"]:
        raise InputInvalid(
            file, f"first line {','.join(head)!r}", "'depth,north,east', in m and m/s"
        )
    rows = []
    for k, line in enumerate(lines[1:], 2):
        try:
            row = [float(x) for x in line.split(",")]
        except ValueError:
            row = []
        if len(row) != 3 or not np.all(np.isfinite(row)):
            raise InputInvalid(file, f"line {k}: {line!r}", "three numbers")
        rows.append(row)
    found = np.array(rows)
    if len(found) < 2 or len(found) > 64 or np.any(np.diff(found[:, 0]) <= 0):
        raise InputInvalid(file, f"{len(found)} levels", "2 to 64, their depths rising")
    return found
