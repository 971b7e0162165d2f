"""A current from a netCDF file, at the vehicle's place, depth and time (current_file.py).

    v_c = sum over the 16 nodes around (t, depth, N, E) of their weights times (v_N, v_E)

Above the highest level and below the lowest it is that level's; outside of the file in time, and
beside its grid, v_c is NaN, and the run ends there with the component's name.
"""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.vectors import ETA
from uuvsim_cosim.models.intrinsics.field import field
from uuvsim_cosim.models.water.current_file import read_current_file

__all__ = ["current_grid"]


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
