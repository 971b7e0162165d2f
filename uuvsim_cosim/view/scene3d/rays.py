"""Directions of a sensor's rays, from the parameters of its component.

Known are: the instruments of `models/sensors/multibeam_and_camera.py`; ``directions`` (n, 3), unit
vectors in sensor axes; beams in a ring by ``tilt`` and ``azimuth`` (n), a DVL's; else
one beam along the sensor's z axis. The sensor stands at ``r_s`` in `b`, turned by ``Theta_s``. The
values of a depth image are the components of its rays along the optical axis.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from urllib.parse import parse_qsl

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.models.sensors.multibeam_and_camera import beams_of
from uuvsim_cosim.orchestrator.plan.plan import Plan, PlannedComponent
from uuvsim_cosim.view.scene3d.scene import Rays

__all__ = ["rays_of", "rotation"]

Array = NDArray[np.float64]
Value = Callable[[PlannedComponent, str], Array | None]
RANGES = ("range", "image", "altitude")


def rays_of(plan: Plan, hull: int, value: Value, notes: list[str]) -> Iterator[Rays]:
    """Return the rays of each sensor that sees a hull's pose."""
    seeing = {
        t.target for t in plan.transfers if t.source == hull and t.source_variable.name == "eta"
    }
    for index in sorted(seeing):
        sensor = plan.components[index]
        variables = sensor.description.variables
        for name in RANGES:
            variable = variables.get(name)
            if variable is None or variable.causality != "output" or len(variable.shape) > 2:
                continue
            n = max(variable.size, 1)
            instrument = _instrument(sensor, value, n, name)
            if instrument is not None:
                yield instrument
                break
            if value(sensor, "r_s") is None:  # no sensor, but a controller that reads an altitude
                break
            directions, tilt, azimuth = (
                value(sensor, wanted) for wanted in ("directions", "tilt", "azimuth")
            )
            if directions is not None and directions.shape in ((n, 3), (3, n)):
                directions = directions if directions.shape == (n, 3) else directions.T
            elif tilt is not None and azimuth is not None and azimuth.shape == (n,):
                t = np.broadcast_to(tilt, (n,))
                s = np.sin(t)
                directions = np.column_stack([s * np.cos(azimuth), s * np.sin(azimuth), np.cos(t)])
            else:
                directions = np.array([[0.0, 0.0, 1.0]]) if n == 1 else None
            if directions is None:
                notes.append(f"{sensor.path}.{name}: the directions of its {n} rays are not known")
                break
            r, theta = value(sensor, "r_s"), value(sensor, "Theta_s")
            turn = np.eye(3) if theta is None else rotation(*theta.tolist())
            valid = next((v for v in ("beam_valid", "hit", "valid") if v in variables), "")
            yield Rays(
                sensor.path,
                f"{sensor.path}.{name}",
                np.zeros(3) if r is None else r,
                directions @ turn.T,
                f"{sensor.path}.{valid}" if valid else "",
            )
            break


def _instrument(sensor: PlannedComponent, value: Value, n: int, output: str) -> Rays | None:
    """Return the rays of an instrument whose beams are declared with its model, if it is one."""
    name, _, query = sensor.source.removeprefix("model:").partition("?")
    if not sensor.source.startswith("model:"):
        return None
    kind, _, preset = name.partition("@")
    options = dict(parse_qsl(query))
    preset = preset or options.pop("id", "")
    try:
        beams = beams_of(kind, preset, **options)
        along = np.asarray(beams.directions, float)
    except (UuvsimError, TypeError, ValueError):
        return None
    if along.shape != (n, 3):
        return None
    if output == "image" and options.get("reading", "depth") == "depth":
        along = along / along[:, 2:]
    r, theta = value(sensor, "r_s"), value(sensor, "Theta_s")
    turn = beams.R_bs if theta is None else rotation(*theta.tolist())
    place = beams.r_s if r is None else r
    return Rays(sensor.path, f"{sensor.path}.{output}", place, along @ turn.T)


def rotation(phi: float, theta: float, psi: float) -> Array:
    """Return R of Euler angles zyx [rad]; Fossen (2021), equation 2.31."""
    c, s = np.cos, np.sin
    x = np.array([[1, 0, 0], [0, c(phi), -s(phi)], [0, s(phi), c(phi)]])
    y = np.array([[c(theta), 0, s(theta)], [0, 1, 0], [-s(theta), 0, c(theta)]])
    z = np.array([[c(psi), -s(psi), 0], [s(psi), c(psi), 0], [0, 0, 1]])
    return np.asarray(z @ y @ x)
