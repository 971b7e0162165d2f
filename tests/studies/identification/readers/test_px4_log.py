"""Logs of PX4: motors by places and axes in the parameters, measurements, and bad input."""

from __future__ import annotations

from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.studies.identification.readers.ulog_files import HEAVY_ROTORS, MOTORS, ulog
from uuvsim_cosim.bridge.autopilots.px4 import thruster_commands
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.studies.identification.logs import read_log
from uuvsim_cosim.studies.identification.readers.channels import read_channels

U = thruster_commands(MOTORS).tolist()


def mean(values: Any) -> list[float]:
    return [float(v) for v in np.nanmean(np.asarray(values), axis=0)]


def test_motors_are_thrusters_of_the_vehicle_with_the_same_places_and_axes(tmp_path: Path) -> None:
    signals = read_log(ulog(tmp_path / "1.ulg"))
    assert mean(signals["u"]) == pytest.approx(U)
    assert signals.metadata["vehicle"] == "bluerov2_heavy"
    assert "axes of motors 3, 4, 6, 7 point the other way" in signals.metadata["remarks"][0]


def test_motors_in_another_order_are_assigned_by_their_places(tmp_path: Path) -> None:
    order = [4, 5, 6, 7, 0, 1, 2, 3]
    moved = dict(HEAVY_ROTORS)
    for to, of in enumerate(order):
        for k in ("AX", "AY", "AZ", "PX", "PY"):
            moved[f"CA_ROTOR{to}_{k}"] = HEAVY_ROTORS[f"CA_ROTOR{of}_{k}"]
    signals = read_log(ulog(tmp_path / "1.ulg", moved, motors=[MOTORS[i] for i in order]))
    assert mean(signals["u"]) == pytest.approx(U)


def test_another_vehicle_keeps_its_motors_and_axes_and_this_is_reported(tmp_path: Path) -> None:
    one = {k: v for k, v in HEAVY_ROTORS.items() if "ROTOR0" in k or k == "MAV_TYPE"}
    signals = read_log(ulog(tmp_path / "1.ulg", one | {"CA_ROTOR_COUNT": 1}, motors=[0.5]))
    assert mean(signals["u"]) == pytest.approx([0.5])
    assert signals.metadata["vehicle"] is None
    assert any("in the order of PX4's motors" in r for r in signals.metadata["remarks"])


def test_outputs_become_commands_by_their_functions_and_limits(tmp_path: Path) -> None:
    settings = dict(HEAVY_ROTORS)
    for i in range(8):
        settings |= {f"PWM_MAIN_FUNC{i + 1}": 108 - i}  # motor 8 at output 1
        settings |= {f"PWM_MAIN_MIN{i + 1}": 1100.0, f"PWM_MAIN_MAX{i + 1}": 1900.0}
    widths = [1500 + 400 * c for c in reversed(MOTORS)]
    signals = read_log(ulog(tmp_path / "1.ulg", settings, motors=None, outputs=widths))
    assert mean(signals["u"]) == pytest.approx(U)


def test_measurements_are_in_si_units_and_each_message_keeps_its_time(tmp_path: Path) -> None:
    signals = read_log(ulog(tmp_path / "1.ulg"))
    assert mean(signals["eta"])[2:] == pytest.approx([5.0, 0.1, 0.0, pi / 2], abs=1e-6)
    # Of visual odometry only velocities in the body's axes count: those of a DVL.
    assert mean(signals["nu"]) == pytest.approx([0.9, 0.1, 0.0, 0.01, 0.02, 0.03], abs=1e-6)
    assert signals.time[np.isfinite(signals["eta"][:, 3])][0] == pytest.approx(0.01)
    assert np.nanmean(signals["voltage"]) == pytest.approx(15.8)
    # A range to the front is none to the bottom.
    assert mean(signals["range"][:, None]) == [4.0]


def test_an_estimate_that_is_not_valid_is_not_read(tmp_path: Path) -> None:
    signals = read_log(ulog(tmp_path / "1.ulg", valid=False))
    assert not np.isfinite(signals["eta"][:, :2]).any()
    assert np.nanmean(signals["eta"][:, 2]) == pytest.approx(5.0)


def test_a_copter_is_refused_by_its_type(tmp_path: Path) -> None:
    copter = HEAVY_ROTORS | {"MAV_TYPE": 2}
    with pytest.raises(InputInvalid, match=r"vehicle type 2 \(MAV_TYPE\); expected a submarine"):
        read_log(ulog(tmp_path / "1.ulg", copter))


def test_missing_parameters_are_refused_by_name_and_can_be_given(tmp_path: Path) -> None:
    path = ulog(tmp_path / "1.ulg", {"MAV_TYPE": 12, "CA_ROTOR_COUNT": 8})
    with pytest.raises(InputInvalid, match=r"lacks the parameters CA_ROTOR0_PX, .* expected a log"):
        read_log(path)
    assert mean(read_log(path, HEAVY_ROTORS)["u"]) == pytest.approx(U)
    path = ulog(tmp_path / "2.ulg", motors=None, outputs=[1500] * 8)
    with pytest.raises(InputInvalid, match=r"do not name the output of motor 1, .*PWM_MAIN_FUNCn"):
        read_log(path)


def test_logs_without_commands_armed_time_or_water_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputInvalid, match=r"lacks the thrusters' commands \(actuator_motors"):
        read_log(ulog(tmp_path / "1.ulg", motors=None))
    with pytest.raises(InputInvalid, match=r"no part to fit: 0.0 to 6.0 s: disarmed"):
        read_log(ulog(tmp_path / "2.ulg", armed=False))
    with pytest.raises(InputInvalid, match=r"no part to fit: .*at the surface"):
        read_log(ulog(tmp_path / "3.ulg", depth=0.1))


def test_a_clock_that_jumps_is_refused_with_its_times(tmp_path: Path) -> None:
    back = [*range(60_000_000, 63_000_000, 100_000), *range(5_000_000, 9_000_000, 100_000)]
    with pytest.raises(InputInvalid, match=r"jumps back from 62.* to 5.* s"):
        read_log(ulog(tmp_path / "1.ulg", times=back))
    ahead = [*range(5_000_000, 9_000_000, 100_000), *range(10**13, 10**13 + 4_000_000, 100_000)]
    with pytest.raises(InputInvalid, match=r"jumps ahead by 1e\+07 s at 8.96"):
        read_log(ulog(tmp_path / "2.ulg", times=ahead))


def test_truncated_and_damaged_logs_are_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = ulog(tmp_path / "1.ulg")
    data = path.read_bytes()
    path.write_bytes(data[:-7])
    assert f"within a message, after {len(data) - 7} bytes" in read_log(path).metadata["remarks"][0]
    path.write_bytes(data[:9000] + b"\xff" * 50 + data[9050:])
    assert (
        "are damaged: messages behind them may be missing"
        in (read_log(path).metadata["remarks"][0])
    )
    path.write_bytes(data[:1500])
    with pytest.raises(InputInvalid, match=r"holds no message .*ends within a message, after 1500"):
        read_log(path)
    path.write_bytes(b"no log at all")
    with pytest.raises(InputInvalid, match=r"begins with 6e 6f 20.*expected a ULog of PX4"):
        read_log(path)
    assert capsys.readouterr().out == ""


def test_channels_name_a_topic_and_its_fields(tmp_path: Path) -> None:
    path = ulog(tmp_path / "1.ulg")
    chosen = read_channels([
        "depth=vehicle_local_position:z?factor=2", "attitude=vehicle_attitude:q",
        "dvl=vehicle_visual_odometry:velocity",
    ])  # fmt: skip
    signals = read_log(path, None, chosen)
    assert mean(signals["eta"])[2:] == pytest.approx([10.0, 0.1, 0.0, pi / 2], abs=1e-6)
    assert mean(signals["nu"])[0] == pytest.approx((0.9 + 7.0) / 2)
    for place, message in (
        ("vehicle_locl_position:z", "no topic 'vehicle_locl_position'; expected .*_local_position"),
        ("vehicle_local_position:w", "no field 'w'"),
        ("vehicle_local_position", "no field; expected vehicle_local_position:FIELD"),
    ):
        with pytest.raises(InputInvalid, match=message):
            read_log(path, None, read_channels([f"depth={place}"]))
