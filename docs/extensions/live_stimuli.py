"""Stimulus of each component on its page: which inputs step, from which values, and how long.

A component without an entry whose name is that of a vehicle has a step of the surge force.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from uuvsim_cosim.models.declaration.library import LIBRARY

__all__ = ["STIMULI", "Stimulus", "stimulus_of"]


@dataclass(frozen=True)
class Stimulus:
    """A run of `seconds` from the start values; at a tenth of it, the inputs in `after` step.

    `after` has the value after the step of each element ("tau[1]"). `start` has values of inputs
    and parameters that are not the declared ones. Inputs in `clocks` follow the time, so that each
    sample is a new one. `shown` are the outputs that are plotted at first. `tick` [s] is the
    communication step, if not that of the reference response.
    """

    seconds: float
    after: Mapping[str, float] = field(default_factory=dict)
    start: Mapping[str, object] = field(default_factory=dict)
    clocks: tuple[str, ...] = ()
    shown: tuple[str, ...] = ()
    tick: str = ""


_LAW = Stimulus(5.0, {"eta_d[1]": 0.2})  # m
_PATH = Stimulus(
    20.0, {"eta[2]": 1.0}, {"eta": [0, 0, 5, 0, 0, 0], "nu": [0.4, 0, 0, 0, 0, 0]},
    shown=("cross_track", "eta_d", "nu_d"),
)  # fmt: skip
_QUATERNION = {"q[1]": 0.70710678, "q[4]": 0.70710678}  # heading 90 degrees
# Over the level bottom at 25 m, of which sonars see an echo.
_SONAR = Stimulus(
    4.0, {"eta[3]": 20.0}, {"eta": [0, 0, 18, 0, 0, 0]}, shown=("range", "mean", "peak")
)
_AHEAD = {"nu_r": [1.5, 0, 0, 0, 0, 0]}  # m/s

STIMULI = {
    "allocation": Stimulus(1.0, {"tau_d[1]": 40.0, "tau_d[6]": 5.0}),
    "allocation_qp": Stimulus(1.0, {"tau_d[1]": 40.0, "tau_d[6]": 5.0}),
    "allocation_quadratic": Stimulus(1.0, {"tau_d[1]": 40.0, "tau_d[6]": 5.0}),
    "altimeter": Stimulus(20.0, {"eta[3]": 10.0}),
    "autopilot": Stimulus(
        20.0, {"eta_d[3]": 2.0},
        {"nu": [1.5, 0, 0, 0, 0, 0], "nu_d": [1.5, 0, 0, 0, 0, 0]},
    ),
    "backstepping": _LAW,
    "ballast": Stimulus(120.0, {"V_d": 0.0007, "x_d": 0.02}),
    "battery": Stimulus(300.0, {"current": 40.0}),
    "color_camera": Stimulus(
        2.0, {"eta[3]": 20.0}, {"eta": [0, 0, 18, 0, 0, 0]}, shown=("mean", "saturated")
    ),
    "compass": Stimulus(20.0, {"eta[6]": 0.5}),
    "contact": Stimulus(
        1.0, {"eta[3]": 24.9}, {"eta": [0, 0, 24, 0, 0, 0], "nu": [0.5, 0, 0, 0, 0, 0]}
    ),
    "controller": _LAW,
    "current_gauss_markov": Stimulus(600.0),
    "current_grid": Stimulus(600.0, {"eta[1]": 100.0}),
    "current_profile": Stimulus(20.0, {"eta[3]": 20.0}),
    "current_ramps": Stimulus(
        20.0, {"v[1]": 0.3}, {"t": [5.0, 10.0, 15.0], "dv": [0, 0.2, 0, 0.1, 0, 0, 0, 0, 0.05]}
    ),
    "depth_camera": Stimulus(10.0, {"eta[3]": 20.0}, {"eta": [0, 0, 10, 0, 0, 0]}),
    "dvl": Stimulus(20.0, {"nu[1]": 1.0, "nu[2]": -0.3}),
    "feedback_linearisation": _LAW,
    "fins": Stimulus(2.0, {"u[1]": 0.2}, _AHEAD),
    "gps": Stimulus(60.0, {"eta[1]": 10.0}),
    "guidance": _PATH,
    "helm": Stimulus(2.0, {"position_d[1]": 0.5, "position_d[2]": 0.5}),
    "imaging_sonar": _SONAR,
    "imu": Stimulus(5.0, {"nu_dot[1]": 0.5, "nu[6]": 0.1}),
    "lbl": Stimulus(30.0, {"eta[1]": 20.0}),
    "leak": Stimulus(30.0, {"eta[3]": 20.0}, {"A_hole": 1e-6, "eta": [0, 0, 1, 0, 0, 0]}),
    "link": Stimulus(2.0, {"x[1]": 1.0}),
    "lqr": _LAW,
    "magnetometer": Stimulus(10.0, _QUATERNION),
    "modem": Stimulus(20.0, {"x_1[1]": 1.0}, shown=("y_2", "t_sample_2", "received_2", "lost_2")),
    "mpc": _LAW,
    "multibeam": Stimulus(10.0, {"eta[3]": 20.0}, {"eta": [0, 0, 10, 0, 0, 0]}),
    "multibeam_sonar": _SONAR,
    "navigation": Stimulus(
        20.0, {"imu_acc[1]": 0.1, "compass_psi": 0.2},
        {"imu_acc": [0, 0, -9.81], "imu_valid": 1, "imu_t_sample": 0.0,
         "compass_valid": 1, "compass_t_sample": 0.0},
        ("imu_t_sample", "compass_t_sample"), ("eta", "nu", "acc_bias", "gyro_bias"),
    ),
    "navigation_fixes": Stimulus(
        10.0, {"imu_acc[1]": 0.05, "fix[1]": 0.03},
        {"imu_acc": [0, 0, -9.81], "imu_t_sample": 0.0, "compass_t_sample": 0.0,
         "fix_t_sample": 0.0},
        ("imu_t_sample", "compass_t_sample", "fix_t_sample"), ("eta", "nu", "age"),
    ),
    "path_following": _PATH,
    "pilot": Stimulus(5.0, {"a": 0.2, "omega": 0.3}),
    "policy": Stimulus(5.0, {"target[1]": 0.5, "target[2]": 0.5}),
    "pool": Stimulus(1.0, {"position[1]": 1.2}, {"position": [0.0, 0.0, 0.5]}),
    "predictor": Stimulus(
        5.0, {"position[1]": 0.05}, {"t_sample": 0.0}, ("t_sample",), ("now", "velocity")
    ),
    "pressure": Stimulus(10.0, {"eta[3]": 10.0}),
    "propeller": Stimulus(2.0, {"u": 0.5}, _AHEAD),
    "reference": Stimulus(60.0),
    "scanning_sonar": _SONAR,
    "side_scan_sonar": _SONAR,
    "sliding_mode": _LAW,
    "target": Stimulus(60.0),
    "tether": Stimulus(
        2.0, {"nu[1]": 0.5}, {"eta": [30, 0, 40, 0, 0, 0], "l_0": 49.0, "w": 0.1}
    ),
    "thruster": Stimulus(2.0, {"u": 0.5}),
    "thruster_faults": Stimulus(
        10.0, {"thrust_in[1]": 20.0},
        {"thrust_in": [10.0] * 8, "t": [5.0] + [0.0] * 7, "efficiency": [0.5] + [1.0] * 7},
    ),
    "thruster_jet": Stimulus(2.0, {"u": 0.5}),
    "thruster_t200": Stimulus(2.0, {"u": 0.5}),
    "trajectory": Stimulus(120.0, shown=("eta_d", "nu_d", "waypoint")),
    "usbl": Stimulus(30.0, {"eta[1]": 20.0}, {"eta": [0, 0, 20, 0, 0, 0]}),
    "water_column": Stimulus(20.0, {"eta[3]": 25.0}),
    "waves": Stimulus(60.0, {"eta[3]": 5.0}, tick="0.1"),
    "wrench": Stimulus(1.0, {"thrust[1]": 20.0, "thrust[2]": 20.0, "current[1]": 5.0}),
    "yo_yo": Stimulus(120.0, {"eta[3]": 41.0, "eta[5]": 0.4}, {"eta": [0, 0, 20, 0, -0.38, 0]}),
}  # fmt: skip

_FORCE = {  # N: the surge force of a vehicle's step, of the size of its propulsion
    "bluerov2": 10.0, "bluerov2_heavy": 40.0, "desistek_saga": 20.0, "eca_a9": 15.0, "lauv": 8.0,
    "npsauv": 400.0, "pool8": 2.0, "remus100": 8.0, "rexrov": 500.0, "rexrov2": 500.0,
    "slocum": 2.0, "sphere": 10.0, "tethys_lrauv": 10.0,
}  # fmt: skip


def stimulus_of(name: str) -> Stimulus:
    """Return the stimulus of a component of the library."""
    if name in LIBRARY:
        return STIMULI[name]
    return Stimulus(20.0, {"tau[1]": _FORCE[name]}, shown=("eta", "nu", "nu_dot"))
