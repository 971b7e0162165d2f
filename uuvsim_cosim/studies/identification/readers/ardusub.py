"""Commands of an ArduSub log's thrusters by the log's parameters.

Output n drives motor SERVOn_FUNCTION - 32. Its command follows from the pulse width w by the
neutral width w_0 and the motor's direction d (MOT_i_DIRECTION, 1 or -1):

    u_i = -d_i (w_n - w_0) / 400 us

The sign is that of the vehicles here: in the frames `vectored` and `vectored_6dof`, a positive
output of ArduSub pushes against the direction e of each thruster. The dead zone of a speed
controller is part of the thruster's model; that of the remote control (RCn_DZ) acts before the
outputs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.studies.identification.vehicle_log import VehicleLog

__all__ = ["FRAMES", "Motors", "motors_of"]

Array = NDArray[np.float64]
# FRAME_CONFIG: name, number of motors, vehicle of this package with thrusters in the same order.
FRAMES = {
    0: ("bluerov1", 6, None), 1: ("vectored", 6, "bluerov2"),
    2: ("vectored_6dof", 8, "bluerov2_heavy"), 3: ("vectored_6dof_90", 8, None),
    4: ("simplerov_3", 3, None), 5: ("simplerov_4", 4, None), 6: ("simplerov_5", 5, None),
}  # fmt: skip
_FUNCTIONS = {
    0: "disabled", 1: "RC pass-through", 6: "camera pan", 7: "camera tilt", 8: "camera roll",
    59: "RC input 9, lights", 60: "RC input 10, lights", 181: "lights 1", 182: "lights 2",
    183: "video switch", 184: "actuator 1, gripper", 185: "actuator 2", 186: "actuator 3",
    187: "actuator 4", 188: "actuator 5", 189: "actuator 6",
}  # fmt: skip
_MOTOR_1, _MOTORS = 33, 8
_NEUTRAL, _RANGE = 1500.0, 400.0  # us
_NEAR = 50.0  # us about 1500 in which a neutral width lies


@dataclass(frozen=True)
class Motors:
    """Outputs of a log's motors: channel (from 0), direction, and neutral pulse width of each."""

    channels: tuple[int, ...]
    signs: tuple[float, ...]
    neutral: tuple[float, ...]  # us
    vehicle: str | None  # of this package, with thrusters in the same order
    frame: str
    remarks: tuple[str, ...]

    def commands(self, pwm: Array) -> Array:
        """Return the thrusters' commands (n, motors), -1 to 1, of pulse widths (n, channels)."""
        w = pwm[:, self.channels]
        u = np.array(self.signs) * (w - np.array(self.neutral)) / _RANGE
        return np.where(w > 0, np.clip(u, -1.0, 1.0), 0.0) + 0.0


def motors_of(log: VehicleLog) -> Motors:
    """Assign the outputs of a log to motors by its parameters; refuses a log without them."""
    parameters = log.parameters
    width = log.series["pwm"].values.shape[1]
    lacking = [n for n in ("FRAME_CONFIG", "SERVO1_FUNCTION", "MOT_1_DIRECTION")
               if n not in parameters]  # fmt: skip
    if lacking:
        raise InputInvalid(
            log.path,
            f"lacks the parameters {', '.join(lacking)}, so that nobody knows which output drives "
            "which motor in which direction",
            "a log with its parameters, or --log-parameters with a file of them",
        )
    name, count, vehicle = FRAMES.get(int(parameters["FRAME_CONFIG"]), ("custom", 0, None))
    functions = {n: int(parameters.get(f"SERVO{n}_FUNCTION", 0.0)) for n in range(1, 17)}
    outputs: dict[int, int] = {}
    for n, function in functions.items():
        motor = function - _MOTOR_1 + 1
        if 1 <= motor <= (count or _MOTORS) and n <= width:
            if motor in outputs:
                raise InputInvalid(
                    log.path, f"outputs {outputs[motor]} and {n} both drive motor {motor}",
                    "one output for each motor",
                )  # fmt: skip
            outputs[motor] = n
    count = count or len(outputs)
    without = [str(m) for m in range(1, count + 1) if m not in outputs]
    if without or not outputs:
        raise InputInvalid(
            log.path,
            f"no output drives motor {', '.join(without) or '1'} of the frame {name}",
            f"SERVOn_FUNCTION {_MOTOR_1} to {_MOTOR_1 + max(count, 1) - 1}",
        )
    channels = [outputs[m] - 1 for m in range(1, count + 1)]
    directions = [parameters.get(f"MOT_{m}_DIRECTION", 1.0) for m in range(1, count + 1)]
    neutral, remarks = _neutral(log, channels)
    turned = [str(m) for m, d in enumerate(directions, 1) if d < 0]
    remarks.insert(
        0,
        f"frame {name}: motors 1 to {count} at outputs {', '.join(str(c + 1) for c in channels)}"
        + (f"; MOT_n_DIRECTION turns motors {', '.join(turned)}" if turned else ""),
    )
    others = [
        f"{n} ({_FUNCTIONS.get(f, f'function {f}')})" for n, f in functions.items()
        if f != 0 and n not in outputs.values()
    ]  # fmt: skip
    if others:
        remarks.append(f"outputs that are no motors are left out: {', '.join(others)}")
    sign = -1.0 if vehicle else 1.0
    if vehicle is None:
        remarks.append(
            f"frame {name}: no vehicle here has its thrusters; u is positive as ArduSub's output"
        )
    return Motors(
        tuple(channels), tuple(sign * np.sign(d) for d in directions), tuple(neutral), vehicle,
        name, tuple(remarks),
    )  # fmt: skip


def _neutral(log: VehicleLog, channels: list[int]) -> tuple[list[float], list[str]]:
    """Return each motor's neutral pulse width: SERVOn_TRIM, if its output rests there."""
    pwm, armed = log.series["pwm"], log.series.get("armed")
    resting = np.zeros(len(pwm.t), bool) if armed is None else armed.at(pwm.t, 0.0)[:, 0] == 0.0
    neutral, remarks = [], []
    for c in channels:
        trim = log.parameters.get(f"SERVO{c + 1}_TRIM", _NEUTRAL)
        at_rest = pwm.values[resting, c]
        at_rest = at_rest[at_rest > 0]
        measured = float(np.median(at_rest)) if len(at_rest) else trim
        if abs(measured - _NEUTRAL) > _NEAR:  # tests of motors, for example
            measured = trim
        if trim != measured:
            remarks.append(
                f"SERVO{c + 1}_TRIM is {trim:g} us, but the output rests at {measured:g} us while "
                f"disarmed: {measured:g} us is taken as neutral"
            )
        neutral.append(measured)
    return neutral, remarks
