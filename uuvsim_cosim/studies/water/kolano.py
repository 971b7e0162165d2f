"""Runs of a BlueROV2 with an arm in a basin: motion capture, and the moments of the arm's weight.

hkolano/UVMS-SysID-with-EAs: no thruster runs; the arm moves, and the vehicle floats. Its files hold
position and attitude of motion capture (forward, port, up) at 99 Hz and the joints' angles. The
weight of the arm's links in water acts at their centres, which the angles determine (dimensions,
masses and volumes: alpha arm in that repository's urdf and MagicNumAlpha.jl). The first joint is
turned by pi: only then do measured roll and pitch agree with the weight's sign.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.recording.signals import Signals
from uuvsim_cosim.studies.water.recordings import runs_joined

__all__ = ["moments_of_arm", "read_kolano"]

Array = NDArray[np.float64]
_STEP = 0.1  # s
_NEIGHBOURS, _JUMP = 51, 0.05  # samples; m and rad from their median
_TILT, _NEAR = 0.45, 0.5  # rad from a run's median; s
_DEPTH = 5.0  # m of the origin of motion capture: far from the surface
_G, _RHO = 9.81, 0.997  # m/s2, kg/l
_BASE = (0.25, -0.10965, 0.005)  # m, of the arm on the vehicle
# Of each link: mass [kg], volume [l], its centre [m] in its own axes, and from the link before it:
# displacement [m] and rotation (roll, pitch, yaw) [rad], before the joint turns about z.
_LINKS = (
    (0.194, 0.018, (0.005, -0.001, 0.016), (0.0, 0.0, 0.0), (0.0, 0.0, np.pi)),
    (0.429, 0.203, (0.073, 0.0, 0.0), (0.02, 0.0, 0.046), (np.pi / 2, 1.3, 0.0)),
    (0.115, 0.025, (0.017, -0.026, -0.002), (0.15, 0.0, 0.0), (np.pi, 0.0, 1.3)),
    (0.333, 0.155, (0.0, 0.0, -0.098), (0.02, 0.0, 0.0), (-np.pi / 2, 0.0, 0.0)),
)
_JAW = (0.05, 0.02, (0.0, 0.0, -0.19))  # in the axes of the last link
_JOINTS = ("axis_e_pos", "axis_d_pos", "axis_c_pos", "axis_b_pos")


def moments_of_arm(angles: Array) -> Array:
    """Return (Z, K, M) [N, N.m] about CO of the arm's weight at joint angles (n, 4), in FRD.

    The vehicle counts as level: the weight acts along its z axis.
    """
    from scipy.spatial.transform import Rotation

    n = len(angles)
    place = np.tile(_BASE, (n, 1))
    turned = Rotation.identity(n)
    found = np.zeros((n, 3))
    for i, (mass, volume, centre, along, rpy) in enumerate(_LINKS):
        place = place + turned.apply(along)
        turned = turned * Rotation.from_euler("xyz", rpy)
        turned = turned * Rotation.from_rotvec(angles[:, i, None] * (0.0, 0.0, 1.0))
        parts = [(mass, volume, centre), *([_JAW] if i == len(_LINKS) - 1 else [])]
        for m, v, at in parts:
            weight = (m - _RHO * v) * _G
            forward, port, _ = (place + turned.apply(at)).T
            found += weight * np.stack([np.ones(n), -port, -forward], axis=1)
    return found


def read_kolano(files: list[Path]) -> Signals:
    """Read runs by their files of motion capture; those of the joints lie beside them."""
    runs = []
    for file in files:
        capture, joints = _table(file), _table(Path(str(file).replace("_mocap", "_joint_states")))
        t_c, t_j = capture["time_secs"], joints["time_secs"]
        t = np.arange(max(t_c[0], t_j[0]) + _STEP, min(t_c[-1], t_j[-1]) - _STEP, _STEP)
        motion = _motion(capture)
        good = _without_confusion(t_c, motion)
        motion, t_c = motion[good], t_c[good]
        edges = np.searchsorted(t_c, np.stack([t - _STEP / 2, t + _STEP / 2]))
        total = np.concatenate([np.zeros((1, 6)), np.cumsum(motion, axis=0)])
        count = edges[1] - edges[0]
        with np.errstate(invalid="ignore"):
            eta = (total[edges[1]] - total[edges[0]]) / count[:, None]
        angles = np.stack([np.interp(t, t_j, joints[name]) for name in _JOINTS], axis=1)
        tau = np.zeros((len(t), 6))
        tau[:, 2:5] = moments_of_arm(angles)
        runs.append((t, {"eta": eta, "tau": tau}))
    return runs_joined(runs)


def _motion(capture: dict[str, Array]) -> Array:
    """Return eta (n, 6) in NED and FRD."""
    x, y, z, w = (capture[f"{n}_ori"] for n in "xyzw")
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
    yaw = np.unwrap(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
    north, west, up = (capture[f"{n}_pose"] for n in "xyz")
    return np.stack([north, -west, _DEPTH - up, roll, -pitch, -yaw], axis=1)


def _without_confusion(t: Array, motion: Array) -> NDArray[np.bool_]:
    """Return which samples are not near a time at which motion capture confused its markers."""
    from scipy.ndimage import median_filter

    away = np.abs(motion - median_filter(motion, (_NEIGHBOURS, 1), mode="nearest"))
    tilted = np.abs(motion[:, 3:5] - np.median(motion[:, 3:5], axis=0))
    wrong = t[(away > _JUMP).any(axis=1) | (tilted > _TILT).any(axis=1)]
    near = np.searchsorted(t, np.stack([wrong - _NEAR, wrong + _NEAR]))
    change = np.bincount(near[0], minlength=len(t) + 1) - np.bincount(near[1], minlength=len(t) + 1)
    return np.asarray(np.cumsum(change)[:-1] == 0)


def _table(file: Path) -> dict[str, Array]:
    try:
        with file.open(encoding="utf-8") as text:
            names = text.readline().strip().split(",")
            body = np.genfromtxt(text, delimiter=",")
    except OSError as error:
        raise InputInvalid(file, f"cannot be read: {error}", "a CSV of a run") from None
    body = body[np.isfinite(body[:, : min(8, len(names))]).all(axis=1)]
    body = body[np.concatenate([[True], np.diff(body[:, 0]) > 0])]
    return {name: body[:, i] for i, name in enumerate(names)}
