"""A run that was steered over MAVLink repeats to the bit from its recording."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np

import uuvsim_cosim as uuv
from tests.bridge.mavlink.ground import ME, grounded

_GUIDED, _MANUAL = 4, 19


def test_a_run_with_mavlink_repeats_to_the_bit_from_its_recording(tmp_path: Path) -> None:
    with grounded(record=tmp_path / "run") as ground:
        ground.arm(_GUIDED)
        ground.link.mav.set_position_target_local_ned_send(
            0, 1, 1, 1, 0xDF8, 1.0, 0.5, 2.0, 0, 0, 0, 0, 0, 0, 0, 0
        )
        ground.wait("LOCAL_POSITION_NED", lambda m: m.x > 0.3)
        ground.link.mav.param_set_send(1, 1, b"HULL_M", 12.3, 9)
        ground.wait("PARAM_VALUE", lambda m: m.param_id == "HULL_M")
        ground.arm(_MANUAL)
        start = ahead = ground.wait("LOCAL_POSITION_NED")
        while ahead.y < start.y + 0.2:
            ground.link.mav.manual_control_send(1, 0, 1000, 300, 0, 0)
            ahead = ground.wait("LOCAL_POSITION_NED")
        ground.conductor.pause(ME)
    run = tmp_path / "run"
    steered = uuv.read_signals(run)
    assert np.ptp(steered["guidance.axes"], axis=0)[:3].min() > 0.1
    guided = steered["guidance.setpoint_kind"] == 1.0
    np.testing.assert_array_equal(
        np.unique(steered["guidance.setpoint_pose"][guided][:, :3], axis=0), [[1.0, 0.5, 2.0]]
    )
    assert set(steered["guidance.mode"].tolist()) == {-1.0, float(_GUIDED), float(_MANUAL)}
    again = tmp_path / "again"
    command = [
        *(sys.executable, "-m", "uuvsim_cosim", "run", "bluerov2_hold", "--native", "--no-report"),
        *("--replace", f"pilot=axes:{run}", "--scenario", str(run / "changes.yaml")),
        *("--until", repr(float(steered.time[-1])), "--out", str(again)),
    ]
    subprocess.run(command, check=True, capture_output=True)
    repeated = uuv.read_signals(again)
    assert set(steered) <= set(repeated)
    for name in steered:
        same = np.asarray(steered[name]).tobytes() == np.asarray(repeated[name]).tobytes()
        assert same, name
