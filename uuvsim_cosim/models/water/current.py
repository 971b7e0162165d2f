"""Ocean currents: steps and ramps, meandering, sheared with depth, of a file; and the hull's nu_r.

A current v_c in `n` is uniform in space and does not rotate. Held constant over a step it still
accelerates in the rotating body frame:

    nu_c = (R^T v_c, 0),   d(nu_c)/dt = (-S(omega) R^T v_c, 0),   nu_r = nu - nu_c.

The term R^T dv_c/dt is left out: v_c is an input, and piecewise constant.

`current_profile` changes with depth. With z the height above the sea bed, d the depth below the
surface and h the water's depth:

    power    V(d) = V_s (z / h)^alpha                  tidal current, alpha = 1/7
    log      V(z) = V_s ln(z / z_0) / ln(h / z_0)      boundary layer over a rough bed, 0 below z_0
    table    V(d) linear between levels, and held above the first and below the last

V_s is the speed at the surface. Power law: DNV-RP-C205, section 4.1.4; logarithmic: Soulsby 1997,
Dynamics of Marine Sands, chapter 3, where z_0 is 0.2 mm for mud, 6 mm for ripples.

`current_grid` is that of a netCDF file at the vehicle's place, depth and time (current_file.py):

    v_c = sum over the 16 nodes around (t, depth, N, E) of their weights times (v_N, v_E)

Above the highest level and below the lowest it is that level's; outside of the file in time, and
beside its grid, v_c is NaN, and the run ends there with the component's name.
"""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.files_read import noted
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.safe_math import clip
from uuvsim_cosim.models.declaration.vectors import ETA
from uuvsim_cosim.models.intrinsics.field import field
from uuvsim_cosim.models.water.current_file import read_current_file

__all__ = [
    "current_gauss_markov",
    "current_grid",
    "current_profile",
    "current_ramps",
    "nu_c",
    "nu_c_dot",
]

LAWS = ("power", "log", "table")
LEVELS = ((0.0, 0.5, 0.0), (10.0, 0.4, 0.1), (30.0, 0.2, 0.1), (60.0, 0.1, 0.0))


def nu_c(Rnb: ca.SX, v_c: ca.SX) -> ca.SX:
    """Return nu_c (6) in `b` of the current v_c (3) [m/s] in `n`."""
    return ca.vertcat(ca.mtimes(Rnb.T, v_c), ca.SX.zeros(3))


def nu_c_dot(omega: ca.SX, v_c_b: ca.SX) -> ca.SX:
    """Return d(nu_c)/dt (6) in `b`, of omega [rad/s] and the current v_c_b (3) [m/s] in `b`."""
    return ca.vertcat(-ca.cross(omega, v_c_b), ca.SX.zeros(3))


def current_gauss_markov(
    speed: float = 0.2,
    direction: float = 0.5,
    sigma: float = 0.05,
    tau: float = 60.0,
    sigma_direction: float = 0.2,
    tau_direction: float = 120.0,
    period: str = "0.1",
) -> Model:
    """Speed and direction meander about their means, each a first-order Gauss-Markov process.

    x_{k+1} = phi x_k + sigma sqrt(1 - phi²) w_k,  phi = exp(-T / tau): exact for every T, so
    that the statistics do not depend on it. It starts in its stationary distribution.
    """
    m = Model("current_gauss_markov", "Water current that meanders (Gauss-Markov), in NED")
    T = float(Fraction(period))
    V = m.parameter("speed", speed, unit="m/s", description="mean speed of the water")
    beta = m.parameter(
        "direction", direction, unit="rad", description="mean direction it flows to, from N to E"
    )
    v_D = m.parameter("v_D", 0.0, unit="m/s", description="mean velocity downwards")
    s_V = m.parameter("sigma", sigma, unit="m/s", min=0, description="deviation of the speed")
    T_V = m.parameter("tau", tau, unit="s", min=1e-3, description="correlation time of the speed")
    s_b = m.parameter(
        "sigma_direction", sigma_direction, unit="rad", min=0, description="and of the direction"
    )
    T_b = m.parameter("tau_direction", tau_direction, unit="s", min=1e-3, description="its time")
    phi = m.derived("phi", ca.vertcat(ca.exp(-T / T_V), ca.exp(-T / T_b)))
    drive = m.derived(
        "drive", ca.sqrt(1.0 - ca.vertcat(ca.exp(-2 * T / T_V), ca.exp(-2 * T / T_b)))
    )

    sample = m.clock("sample", period)
    w = m.normal(sample, 2)
    started = m.discrete("started", unit="1", description="0 before the first sample")
    x = m.discrete("x", (0.0, 0.0), unit="1", description="deviations in units of their sigma")
    m.update(sample, x, ca.if_else(started > 0.5, phi * x + drive * w, w))
    m.update(sample, started, 1.0)

    U = V + s_V * x[0]
    angle = beta + s_b * x[1]
    m.output(
        "v_c",
        ca.vertcat(U * ca.cos(angle), U * ca.sin(angle), v_D),
        unit="m/s",
        description="velocity of the water in NED",
        discrete=True,
    )
    return m


def current_ramps(events: int | str = 3) -> Model:
    """Add ramps to a current:  v_c = v + sum_k dv_k clip((t - t_k) / T_k, 0, 1).

    A T_k that is shorter than a communication step makes a step.
    """
    n = int(events)
    m = Model("current_ramps", f"Current with {n} ramps or steps on top, in NED")
    v = m.input("v", 3, unit="m/s", description="current without them, in n")
    dv = m.parameter("dv", ca.DM.zeros(n, 3).full(), unit="m/s", description="each one's rise in n")
    t = m.parameter("t", (0.0,) * n, (n,), unit="s", description="when each begins")
    T = m.parameter("T", (1.0,) * n, (n,), unit="s", min=1e-6, description="how long each lasts")
    rise = sum(dv[k, :].T * clip((m.t - t[k]) / T[k], 0.0, 1.0) for k in range(n))
    m.output("v_c", v + rise, unit="m/s", description="velocity of the water in NED")
    return m


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
        rows = _read_levels(Path(file).expanduser()) if file else np.array(LEVELS)
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


def _read_levels(file: Path) -> NDArray[np.float64]:
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


def current_grid(
    file: str = "",
    u: str = "",
    v: str = "",
    latitude: float | str = "",
    longitude: float | str = "",
    northing: float | str = "",
    easting: float | str = "",
    start: str = "",
    extent: float | str = "",
    holes: str = "refuse",
    unit: str = "",
) -> Model:
    """Declare the current of a netCDF file; without `file`, a made-up eddy that ships.

    The file's axes are time, depth, latitude and longitude, or y and x [m]; without time or depth
    it is steady, or the same at all depths. For the options see `read_current_file`.
    """
    path = Path(file).expanduser() if file else content("models", "currents") / "eddy" / "eddy.nc"
    grid = read_current_file(
        path,
        u=u,
        v=v,
        origin=_pair("latitude", latitude, longitude) or _pair("northing", northing, easting),
        start=str(start),
        extent=float(extent) if str(extent) else None,
        holes=holes,
        unit=unit,
    )
    time, _, north, east = grid.axes
    m = Model("current_grid", f"Current of {path.name}, {grid.words}", h_max=1.0)
    m.peers["eta"] = "hull.eta"
    eta = m.input("eta", 6, unit=ETA, description="of the hull")
    added = m.input("v", 3, unit="m/s", description="current on top of it, in n")
    t_0 = m.parameter(
        "t_0", grid.start, unit="s", min=0, max=float(time[-1]),
        description=f"simulation begins so long after the file does, which lasts {time[-1]:g} s",
    )  # fmt: skip
    scale = m.parameter("scale", 1.0, unit="1", description="factor on the file's speeds")
    held = (len(time) == 1, True, len(north) == 1, len(east) == 1)
    at = field([a.tolist() for a in grid.axes], grid.nodes, held)
    flow = at(ca.vertcat(t_0 + m.t, eta[2], eta[0], eta[1]))
    m.output(
        "v_c",
        ca.vertcat(scale * flow, 0.0) + added,
        unit="m/s",
        description=f"velocity of the water in NED; NaN outside of {path.name}, which has "
        f"{_range(time)} s, N {_range(north)} m, E {_range(east)} m",
    )
    return m


def _range(axis: NDArray[np.float64]) -> str:
    return f"{axis[0]:.0f} to {axis[-1]:.0f}" if len(axis) > 1 else "any"


def _pair(name: str, first: float | str, second: float | str) -> tuple[float, float] | None:
    other = {"latitude": "longitude", "northing": "easting"}[name]
    if (str(first) == "") != (str(second) == ""):
        raise InputInvalid("current_grid", f"{name}={first!r}, {other}={second!r}", "both")
    return (float(first), float(second)) if str(first) else None
