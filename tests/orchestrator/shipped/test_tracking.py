"""Target tracking as a system: what its vehicles can do, and that a kernel is its master."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.kernels import fuse
from uuvsim_cosim.models.guidance.target import MOTIONS
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.loop_delays import loop_delays
from uuvsim_cosim.orchestrator.shipped.tracking import (
    ARENA,
    DEPTH,
    TRACKED,
    target_tracking,
    tracker,
)

TICK = 0.02
COMMANDS = [(0.4, 0.0), (0.0, 1.5), (0.4, 1.5), (-0.4, -1.5)]


@cache
def stepped(vehicle: str, weak: bool = False) -> dict[str, np.ndarray]:
    """Ten seconds of constant commands in a wide pool, from rest: (ticks, commands, size)."""
    system = tracker(vehicle=vehicle).set("pool.size", (40, 40, 5))
    names = ("hull.nu", "hull.eta", "pilot.nu_d", "allocation.saturation")
    rows: dict[str, list[Any]] = {n: [] for n in names}
    with fuse(system).batch(len(COMMANDS)) as batch:
        if weak:
            for i in range(1, 9):
                wider = batch.get(f"thruster_{i}.d_jet") / np.sqrt(0.8)
                batch.set(f"thruster_{i}.d_jet", wider)
        batch.set("pilot.a", [c[0] for c in COMMANDS])
        batch.set("pilot.omega", [c[1] for c in COMMANDS])
        for _ in range(500):
            batch.step()
            for n in names:
                rows[n].append(batch.get(n))
    return {n: np.array(v) for n, v in rows.items()}


@pytest.mark.parametrize("vehicle", sorted(TRACKED))
def test_speed_and_yaw_rate_reach_what_is_wanted_and_overshoot_little(vehicle: str) -> None:
    nu = stepped(vehicle)["hull.nu"]
    for i, (a, omega) in enumerate(COMMANDS):
        wanted = np.array([np.sign(a) * 0.4, omega])
        np.testing.assert_allclose(nu[-1, i, [0, 5]], wanted, atol=5e-3)
        assert np.max(np.abs(nu[:, i, 0])) <= 0.4 * 1.03
        assert np.max(np.abs(nu[:, i, 5])) <= 1.5 * 1.03


@pytest.mark.parametrize("vehicle", sorted(TRACKED))
def test_a_step_is_followed_quickly_and_within_the_thrusters_limits(vehicle: str) -> None:
    seen = stepped(vehicle)
    u, r = seen["hull.nu"][:, 0, 0], seen["hull.nu"][:, 1, 5]
    assert np.max(np.abs(u - seen["pilot.nu_d"][:, 0, 0])) < 0.02
    assert np.argmax(r > 0.63 * 1.5) * TICK < 0.3
    assert np.min(seen["allocation.saturation"]) == 1.0


@pytest.mark.parametrize("vehicle", sorted(TRACKED))
def test_sway_depth_and_trim_are_held_while_it_turns_at_speed(vehicle: str) -> None:
    seen = stepped(vehicle)
    assert np.max(np.abs(seen["hull.nu"][:, :, 1])) < 0.01
    assert np.max(np.abs(seen["hull.eta"][:, :, 2] - DEPTH)) < 0.015
    assert np.max(np.abs(seen["hull.eta"][:, :, 3:5])) < 0.01


def test_a_fifth_less_thrust_still_follows() -> None:
    seen = stepped("pool8", weak=True)
    u = seen["hull.nu"][:, 0, 0]
    assert np.max(np.abs(u - seen["pilot.nu_d"][:, 0, 0])) < 0.04
    assert np.min(seen["allocation.saturation"]) == 1.0


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"motion": "flee", "obstacles": 2, "links": True},
        {"target_vehicle": True},
    ],
    ids=["plain", "flee, obstacles, links", "target is a vehicle"],
)
def test_a_kernel_has_the_bits_of_the_master(options: dict[str, Any]) -> None:
    system = target_tracking(2, **options)
    plan = flatten(system)
    names = [(c.path, v.name) for c in plan.components for v in c.description.of("output")]
    rng = np.random.default_rng(1)
    with (
        fuse(system).batch(3, seeds=[5, 6, 7]) as batch,
        Master(plan, prepare(plan, "native")) as master,
    ):
        master.initialize()
        master.reset(seed=6)
        for k in range(400):
            if k % 20 == 0:
                for i in (1, 2):
                    a, omega = rng.uniform(-0.4, 0.4), rng.uniform(-1.5, 1.5)
                    if "links" in options:
                        batch.set(f"tracker_{i}.radio.x", [a, omega])
                        master.set(f"tracker_{i}.radio", "x", [a, omega])
                    else:
                        batch.set(f"tracker_{i}.pilot.a", a)
                        batch.set(f"tracker_{i}.pilot.omega", omega)
                        master.set(f"tracker_{i}.pilot", "a", a)
                        master.set(f"tracker_{i}.pilot", "omega", omega)
            batch.step()
            master.step()
            if k % 10 == 9:
                for path, name in names:
                    np.testing.assert_array_equal(
                        np.ravel(batch.get(f"{path}.{name}")[1]), np.ravel(master.get(path, name))
                    )


@pytest.mark.parametrize("motion", MOTIONS)
def test_eight_trackers_fuse_and_stay_in_the_pool(motion: str) -> None:
    kernel = fuse(target_tracking(8, motion=motion))
    with kernel.batch(8) as batch:
        edge = np.array(ARENA[:2]) / 2 - TRACKED["pool8"].radius
        for i in range(1, 9):
            batch.set(f"tracker_{i}.pilot.a", 0.4)
        for _ in range(20):
            batch.step(50)
            for i in range(1, 9):
                eta = batch.get(f"tracker_{i}.hull.eta")
                assert np.all(np.abs(eta[:, :2]) <= edge + 0.03)
                assert np.all(np.abs(eta[:, 2] - DEPTH) < 0.05)


@pytest.mark.parametrize("tick", ["0.01", "0.04"])
def test_another_tick_flies_the_same_way(tick: str) -> None:
    ends = []
    for step in ("0.02", tick):
        with fuse(tracker(tick=step)).batch(1) as batch:
            batch.set("pilot.a", 0.2)
            batch.set("pilot.omega", 0.5)
            batch.step(round(4.0 / float(step)))
            ends.append(batch.get("hull.eta")[0])
    np.testing.assert_allclose(ends[0], ends[1], atol=0.03)


def test_equal_components_of_all_trackers_are_compiled_once() -> None:
    kernel = fuse(target_tracking(8))
    assert len(kernel.fused.sources) == 7


def test_a_vehicle_as_target_stays_with_the_motion_it_follows() -> None:
    with fuse(target_tracking(1, target_vehicle=True)).batch(16) as batch:
        away = []
        for _ in range(40):
            batch.step(50)
            d = batch.get("quarry.hull.eta")[:, :2] - batch.get("target.position")[:, :2]
            away.append(np.hypot(*d.T))
    assert np.mean(away) < 0.1
    assert np.max(away) < 0.45  # where the motion is reflected, a vehicle has to turn round


def test_the_radio_delays_commands_by_its_latency() -> None:
    with fuse(target_tracking(1, links=True)).batch(1) as batch:
        batch.step(50)
        assert batch.get("tracker_1.pilot.nu_d")[0, 0] == 0.0
        batch.set("tracker_1.radio.x", [0.4, 0.0])
        begun = next(
            k for k in range(100) if batch.step() or batch.get("tracker_1.pilot.nu_d")[0, 0] > 0
        )
        assert begun * TICK == pytest.approx(0.4)


def test_positions_are_as_noisy_as_the_papers() -> None:
    with fuse(target_tracking(1, links=True)).batch(256) as batch:
        batch.step(5)
        known, true = batch.get("positioning.y"), batch.get("target.position")
        assert np.std((known - true)[:, 2]) == pytest.approx(0.007, rel=0.15)


@pytest.mark.parametrize("links", [False, True])
def test_no_control_loop_is_slower_than_a_tick(links: bool) -> None:
    plan = flatten(target_tracking(2, links=links))
    assert max(loop.delay for loop in loop_delays(plan)) <= TICK


def test_every_start_keeps_the_papers_distances() -> None:
    for n in range(1, 9):
        plan = flatten(target_tracking(n))
        starts = [c.start["eta_0"][:2] for c in plan.components if "eta_0" in c.start]
        starts.append(np.zeros(2))
        gaps = [np.linalg.norm(a - b) for i, a in enumerate(starts) for b in starts[:i]]
        assert min(gaps) > 0.38


def test_wrong_numbers_and_names_are_refused() -> None:
    with pytest.raises(InputInvalid, match="9 trackers; expected 1 to 8"):
        target_tracking(9)
    with pytest.raises(InputInvalid, match="'pool9'; expected one of pool8, bluerov2_heavy"):
        target_tracking(1, vehicle="pool9")
    with pytest.raises(InputInvalid, match="'hide'; expected one of random_heading"):
        target_tracking(1, motion="hide")
