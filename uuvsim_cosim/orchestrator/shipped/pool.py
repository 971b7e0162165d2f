"""System `pool_tracking`: the test pool of the UUVSim paper, figure 11, with sensors only.

A station beside the pool measures the positions of vehicle and target to ±7 mm and sends both by a
slow radio, in one direction. On board, an IMU and a compass are fused with the received positions,
which are at least 0.4 s old. A predictor extrapolates the target's position to the present time;
the pilot is a trained policy. The target is a vehicle of the same type, the ``quarry``, with a
scripted helm.
"""

from __future__ import annotations

from fractions import Fraction

from uuvsim_cosim.orchestrator.shipped.tracking import (
    ARENA,
    DEPTH,
    TRACKED,
    propelled,
    start_positions,
    with_quarry,
)
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["PACKET", "PILOT", "pool_tracking"]

VEHICLE = "pool8"
TICK = Fraction(1, 50)
PILOT = "model:policy?id=transition_1_dt&period=1/50"
# A packet has five numbers of 12 bits and 36 bits of overhead: 0.15 s on the air at 640 bit/s. The
# rest of the 0.4 s that the tracking tasks assume is processing. One packet in ten is lost.
PACKET = {"bits": 96.0, "processing": 0.25, "loss": 0.1}
INTERVAL = "0.2"  # s between packets


def pool_tracking(pilot: str = PILOT, motion: str = "random_heading") -> System:
    """Return the system; `pilot` is a policy with an input ``target``, or a plain pilot.

    With a plain pilot (``model:pilot``), ``pilot.a`` and ``pilot.omega`` are unconnected inputs,
    for a policy outside of the system.
    """
    north, east = start_positions(1)[0]
    eta_0 = (north, east, DEPTH, 0.0, 0.0, 0.0)
    tracked = TRACKED[VEHICLE]
    arena: dict[str, object] = {"size": ARENA}
    steer = "model:target?motion={}&obstacles=0&period={}&heading_period=0.1"
    system = System(
        "pool_tracking", TICK, "A pool8 tracks another by a slow radio and its own sensors"
    )
    system = system.add(
        "target", steer.format(motion, TICK), {"position_0": (0.0, 0.0, DEPTH), **arena}
    )
    system = with_quarry(system, VEHICLE, 0, ARENA)
    contact = f"model:pool?vehicle={VEHICLE}&radius={tracked.radius}&height={tracked.height}"
    system = (
        system.add("pilot", pilot, {"depth": DEPTH})
        .add("allocation", tracked.allocation)
        .add("pool", f"{contact}&obstacles=0&step={float(TICK)}", arena)
        .add("wrench", f"model:wrench?vehicle={VEHICLE}&contact=1")
        .add("hull", f"model:{VEHICLE}", {"eta_0": eta_0})
    )
    system, thrusters = propelled(system, tracked.thruster)
    system = _on_board(_station(system), eta_0)
    if "target" in system.describe("pilot").variables:
        system = system.connect("predictor.now", "pilot.target")
    # In sequence within a step, from sensors to forces, so that all values belong to one time.
    return system.group([
        *("positioning", "radio", "imu", "compass", "navigation", "predictor", "pilot"),
        *("allocation", *thrusters, "pool", "wrench", "hull"),
    ])  # fmt: skip


def _station(system: System) -> System:
    """Add the positioning of both vehicles from outside, and the radio that sends it."""
    system = system.add("positioning", "model:link@pool_positioning?size=6&period=0.02").add(
        "radio",
        f"model:modem@pool_radio?nodes=2&size=6&interval={INTERVAL}&publish_period=0.02&in_flight=4",
        {**PACKET, "slots": 1, "slot": (0, 0), "send_2": False, "position_1": (0.0, 0.0, 0.0)},
    )
    for k in (1, 2, 3):
        system = (
            system.connect(f"hull.eta[{k}]", f"positioning.x[{k}]")
            .connect(f"quarry.eta[{k}]", f"positioning.x[{k + 3}]")
            .connect(f"hull.eta[{k}]", f"radio.position_2[{k}]")
        )
    return system.connect("positioning.y", "radio.x_1")


def _on_board(system: System, eta_0: tuple[float, ...]) -> System:
    """Add IMU, compass, the navigation that fuses them with delayed positions, and predictor."""
    system = (
        system.add("imu", "model:imu?period=0.02", {"r_s": (0.0, 0.0, 0.0)})
        .add("compass", "model:compass")
        .add("navigation", "model:navigation_fixes?period=0.02", {"eta_0": eta_0})
        .add("predictor", "model:predictor?period=0.02")
    )
    for name in ("q", "nu", "nu_dot"):
        system = system.connect(f"hull.{name}", f"imu.{name}")
    system = system.connect("hull.eta", "compass.eta")
    for reading in ("imu.acc", "imu.gyro", "imu.t_sample", "compass.psi", "compass.t_sample"):
        system = system.connect(reading, f"navigation.{reading.replace('.', '_')}")
    return (
        system.connect("radio.y_2[1:3]", "navigation.fix")
        .connect("radio.t_sample_2", "navigation.fix_t_sample")
        .connect("radio.y_2[4:6]", "predictor.position")
        .connect("radio.t_sample_2", "predictor.t_sample")
        .connect("navigation.eta", "pilot.eta")
        .connect("navigation.nu", "pilot.nu")
    )
