"""Contact in kernels: it never adds energy, walls hold what hits them, and slopes what rests."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.kernels import fuse
from uuvsim_cosim.models.declaration.parameter_files import (
    parameter_set,
    propelled_ids,
    vehicle_size,
)
from uuvsim_cosim.models.hull.contact_reference import GRIP
from uuvsim_cosim.models.hull.matrices import nominal
from uuvsim_cosim.models.worlds.obstacles import Box, Capsule, Cylinder, Obstacle, Sphere
from uuvsim_cosim.models.worlds.scene import Scene, save_scene
from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.system.system import System

DEPTH = 20.0  # m, of the middle of a room


def pressed(
    vehicle: str,
    scene: Path,
    h: float,
    parameters: dict[str, Any],
    *,
    wrench: bool,
    mu: float = 0.3,
) -> System:
    """A hull and its contact, led through a wrench (a force then comes two steps late) or not."""
    source = f"model:contact?vehicle={vehicle}&scene={scene}&step={h}"
    s = System("pressed", str(h)).add("hull", f"model:{vehicle}", parameters)
    s = s.add("contact", source, {"mu": mu})
    for signal in ("eta", "q", "nu"):
        s = s.connect(f"hull.{signal}", f"contact.{signal}")
    if not wrench:
        return s.connect("contact.tau", "hull.tau")
    s = s.add("wrench", f"model:wrench?vehicle={vehicle}&contact=true")
    return s.connect("contact.tau", "wrench.contact").connect("wrench.tau", "hull.tau")


def in_a_vacuum(vehicle: str, heavy: float = 0.0) -> dict[str, Any]:
    """Parameters of a hull without drag, CG and CB at CO; its weight in water is `heavy` m g."""
    q = {k: v.value for k, v in parameter_set(vehicle).quantities.items()}
    off = [k for k in q if k.startswith("D_") or k in ("z_g", "z_b")]
    return dict.fromkeys(off, 0.0) | {"nabla": (1.0 - heavy) * q["m"] / q["rho"]}


def room(folder: Path, inside: tuple[Obstacle, ...] = (), terrain: Terrain | None = None) -> Path:
    """Six walls of 0.01 m around a cube of 5 m, and what stands in it."""
    walls = []
    for axis in range(3):
        for side in (-1, 1):
            centre, half = [0.0, 0.0, DEPTH], [3.5, 3.5, 3.5]
            centre[axis] += side * 2.505
            half[axis] = 0.005
            walls.append(Box((centre[0], centre[1], centre[2]), (half[0], half[1], half[2])))
    obstacles = (*walls, *inside)
    save_scene(Scene(folder.name, terrain, obstacles, None, "a room", "made up"), folder)
    return folder


INSIDE = (
    Cylinder((1.2, 1.2, DEPTH), 0.25, 3),
    Cylinder((-1.3, 0.9, DEPTH), 0.01, 3),  # a thin pile
    Capsule((-1, -1.5, DEPTH - 2), (1.5, -1.2, DEPTH + 2), 0.1),
    Sphere((1.3, -0.2, DEPTH + 0.5), 0.3),
    Box((-1.3, -0.6, DEPTH + 0.5), (0.3, 0.2, 0.25), 0.5),
)


def thrown(n: int, seed: int, spread: float = 0.9) -> tuple[np.ndarray, np.ndarray]:
    """Poses about the middle, velocities of 0.2 to 2 m/s and up to 1 rad/s."""
    rng = np.random.default_rng(seed)
    eta, nu = np.zeros((n, 6)), rng.uniform(-1, 1, (n, 6))
    eta[:, :3] = rng.uniform(-spread, spread, (n, 3))
    eta[:, 2] += DEPTH
    eta[:, 3:] = rng.uniform(-1, 1, (n, 3)) * [1, 1, 3]
    way = rng.normal(size=(n, 3))
    nu[:, :3] = rng.uniform(0.2, 2, (n, 1)) * way / np.linalg.norm(way, axis=1)[:, None]
    return eta, nu


@pytest.mark.parametrize("mu", [0.3, 0.0])
@pytest.mark.parametrize(
    ("vehicle", "h", "wrench"),
    [
        ("bluerov2_heavy", 0.01, True),
        ("bluerov2_heavy", 0.02, True),
        ("bluerov2_heavy", 0.02, False),
        ("lauv", 0.02, True),
        ("sphere", 0.02, True),
        ("pool8", 0.02, True),
    ],
)
def test_many_random_hits_never_add_energy_and_no_wall_lets_through(
    tmp_path: Path, vehicle: str, h: float, wrench: bool, mu: float
) -> None:
    """Without drag and weight only contact changes the kinetic energy: 128 hulls, 10 s each."""
    parameters = in_a_vacuum(vehicle)
    scene = room(tmp_path, INSIDE)
    kernel = fuse(pressed(vehicle, scene, h, parameters, wrench=wrench, mu=mu), lanes=8)
    M, (eta, nu) = np.array(nominal(vehicle)[0]), thrown(128, seed=1)
    with kernel.batch(128, start={"hull.eta_0": eta, "hull.nu_0": nu}) as batch:
        outside = batch.get("contact.depth") == 0.0
        first = 0.5 * nu**2 @ M
        hits, touching = np.zeros(128), np.zeros(128, bool)
        for _ in range(int(10 / h)):
            batch.step()
            energy = 0.5 * batch.get("hull.nu") ** 2 @ M
            assert np.all(energy[outside] <= first[outside] * (1 + 1e-5))  # of RK4
            now = np.any(batch.get("contact.tau") != 0.0, axis=1)
            hits += now & ~touching
            touching = now
        assert np.all(np.abs(batch.get("hull.eta")[outside, :3] - [0, 0, DEPTH]) < 2.5)
    assert outside.sum() > 100
    assert hits[outside].mean() > 1.5


@pytest.mark.parametrize("vehicle", ["bluerov2_heavy", "lauv"])
def test_on_a_rough_bed_a_hull_has_no_more_than_its_fall_gives(
    tmp_path: Path, vehicle: str
) -> None:
    """Within 1 %: without drag, the Munk moment turns a hull before a force acts."""
    rng, n = np.random.default_rng(3), 64
    z = DEPTH + 4 + rng.normal(size=(41, 41))
    terrain = Terrain(z.astype(np.float32), 2.0, (-40.0, -40.0))
    save_scene(Scene("bed", terrain, (), None, "a rough bed", "made up"), tmp_path)
    parameters = in_a_vacuum(vehicle, heavy=0.05)
    kernel = fuse(pressed(vehicle, tmp_path, 0.02, parameters, wrench=True), lanes=8)
    quantities = parameter_set(vehicle).quantities
    weight = 0.05 * quantities["m"].value * quantities["g"].value
    M, (eta, nu) = np.array(nominal(vehicle)[0]), thrown(n, seed=2, spread=6.0)
    eta[:, 2] = DEPTH

    with kernel.batch(n, start={"hull.eta_0": eta, "hull.nu_0": nu}) as batch:
        outside = batch.get("contact.depth") == 0.0
        first = 0.5 * nu**2 @ M - weight * eta[:, 2]
        touched = np.zeros(n, bool)
        for _ in range(750):
            batch.step()
            energy = 0.5 * batch.get("hull.nu") ** 2 @ M - weight * batch.get("hull.eta")[:, 2]
            assert np.all((energy - first)[outside] <= 0.01 * 0.5 * nu[outside] ** 2 @ M)
            touched |= batch.get("contact.depth") > 0
    assert (touched & outside).sum() > n // 2


@pytest.mark.slow
@pytest.mark.parametrize("h", [0.01, 0.02])
@pytest.mark.parametrize("vehicle", propelled_ids())
def test_each_shipped_vehicle_is_stopped_at_each_shipped_step(
    tmp_path: Path, vehicle: str, h: float
) -> None:
    """Thrown at 2 m/s, from near: ahead, obliquely and abeam, at a wall of 0.01 m and a pile."""
    size = vehicle_size(vehicle)
    assert size is not None
    reach = 0.8 * max(size.length, size.breadth) + 0.3
    walls = (Box((reach, 0, DEPTH), (0.005, 50, 50)), Cylinder((-reach, 0, DEPTH), 0.01, 50))
    save_scene(Scene("walls", None, walls, None, "a wall and a pile", "made up"), tmp_path)
    kernel = fuse(pressed(vehicle, tmp_path, h, {}, wrench=True), lanes=8)
    eta, nu = [], []
    for side in (1.0, -1.0):
        for psi in (0.0, 0.6, np.pi / 2):
            eta.append([0, 0, DEPTH, 0, 0, psi])
            nu.append([side * 2 * np.cos(psi), -side * 2 * np.sin(psi), 0, 0, 0, 0])
    start = {"hull.eta_0": np.array(eta), "hull.nu_0": np.array(nu)}
    fastest = 0.0
    with kernel.batch(len(eta), start=start) as batch:
        for _ in range(int(2 * reach / h)):
            batch.step()
            seen, speed = batch.get("hull.eta"), np.linalg.norm(batch.get("hull.nu")[:, :3], axis=1)
            assert np.all(np.isfinite(seen))
            assert np.all(seen[:3, 0] < reach)
            fastest = max(fastest, float(speed.max()))
        assert np.all(
            batch.get("contact.depth") < 0.25 * min(size.length, size.breadth, size.height)
        )
    assert fastest < 2.2


@pytest.mark.slow
@pytest.mark.parametrize("h", [0.05, 0.1])
@pytest.mark.parametrize("vehicle", propelled_ids())
def test_no_shipped_vehicle_passes_a_wall_of_5_cm_at_long_steps(
    tmp_path: Path, vehicle: str, h: float
) -> None:
    """With its drag, at 0.5 to 5 m/s, from anywhere in the last twelve steps before the wall."""
    size, rng, n = vehicle_size(vehicle), np.random.default_rng(0), 96
    assert size is not None
    reach = 0.5 * np.linalg.norm([size.length, size.breadth, size.height])
    reach += float(np.linalg.norm(size.at))
    wall = (Box((0.025, 0, 500), (0.025, 490, 490)),)
    save_scene(Scene("wall", None, wall, None, "a wall", "made up"), tmp_path)
    kernel = fuse(pressed(vehicle, tmp_path, h, {}, wrench=True), lanes=8)
    speed, way, psi = rng.choice([0.5, 1, 2, 5], n), rng.uniform(-1, 1, n), rng.uniform(-3, 3, n)
    eta, nu = np.zeros((n, 6)), np.zeros((n, 6))
    eta[:, 0] = -reach - 0.01 - rng.uniform(0, 12, n) * (rng.random(n) < 0.5) * speed * h
    eta[:, 2], eta[:, 5] = 500, psi
    nu[:, 0], nu[:, 1] = speed * np.cos(way - psi), speed * np.sin(way - psi)
    with kernel.batch(n, start={"hull.eta_0": eta, "hull.nu_0": nu}) as batch:
        batch.step(int(12 / h))
        assert np.all(batch.get("hull.eta")[:, 0] < 0.0)


def test_a_hull_on_a_slope_creeps_below_the_angle_of_friction_and_slides_above(
    tmp_path: Path,
) -> None:
    h, heavy, vehicle = 0.02, 0.1, "bluerov2_heavy"
    drift = {}
    for slope in (0.2, 0.5):  # tan of 11 and 27 degrees; mu = 0.3 is 17 degrees
        x = np.array([-200.0, 200.0])
        z = DEPTH - slope * x[:, None] + 0 * x[None, :]
        terrain = Terrain(z.astype(np.float32), 400.0, (-200.0, -200.0))
        folder = tmp_path / f"{slope:g}"
        save_scene(Scene("slope", terrain, (), None, "a slope", "made up"), folder)
        angle = np.arctan(slope)
        eta = [0, 0, DEPTH - 0.127 / np.cos(angle), 0, angle, 0]
        parameters = in_a_vacuum(vehicle, heavy) | {"eta_0": eta}
        with fuse(pressed(vehicle, folder, h, parameters, wrench=True)).batch(1) as batch:
            batch.step(200)
            before = batch.get("hull.nu")[0].copy()
            batch.step(100)
            drift[slope] = before, batch.get("hull.nu")[0].copy()
    q, M = parameter_set(vehicle).quantities, nominal(vehicle)[0]
    W = heavy * q["m"].value * q["g"].value
    before, after = drift[0.2]
    gives = 1.0 / M[0] + 0.127**2 / M[4]  # 1/kg, of a point of its underside
    creep = -W * np.sin(np.arctan(0.2)) * h / GRIP * gives
    assert after[0] == pytest.approx(before[0], abs=1e-3)
    assert after[0] == pytest.approx(creep, rel=0.1)
    before, after = drift[0.5]
    angle = np.arctan(0.5)
    wanted = -W * (np.sin(angle) - 0.3 * np.cos(angle)) / M[0] * 100 * h
    assert after[0] - before[0] == pytest.approx(wanted, rel=0.05)


def test_a_hull_that_starts_inside_is_not_shot_out(tmp_path: Path) -> None:
    save_scene(
        Scene("ball", None, (Sphere((0, 0, DEPTH), 1.0),), None, "a ball", "made up"), tmp_path
    )
    parameters = in_a_vacuum("bluerov2_heavy") | {"eta_0": [0.6, 0, DEPTH, 0, 0, 0]}
    with fuse(pressed("bluerov2_heavy", tmp_path, 0.01, parameters, wrench=True)).batch(1) as batch:
        assert batch.get("contact.depth")[0] == pytest.approx(1.0 + 0.2285 - 0.6, abs=1e-6)
        assert batch.get("contact.touched")[0] == 1
        batch.step(300)
        assert batch.get("contact.depth")[0] == 0.0
        assert 0.3 < np.linalg.norm(batch.get("hull.nu")[0, :3]) <= 1.25


def test_a_box_in_a_kernel_of_eight_lanes_has_the_masters_bits(tmp_path: Path) -> None:
    rng = np.random.default_rng(8)
    z = DEPTH + 1.5 + 0.3 * rng.normal(size=(9, 9))
    terrain = Terrain(z.astype(np.float32), 1.0, (-4.0, -4.0))
    given = in_a_vacuum("bluerov2_heavy")
    system = pressed("bluerov2_heavy", room(tmp_path, INSIDE, terrain), 0.02, given, wrench=True)
    (eta, nu), names = thrown(3, seed=5), ("hull.eta", "hull.nu", "contact.tau", "contact.depth")
    plan, wanted = flatten(system), []
    instantiate = prepare(plan, "native")
    for k in range(3):
        with Master(plan, instantiate) as master:
            master.initialize()
            master.reset(start={"hull": {"eta_0": eta[k], "nu_0": nu[k]}})
            mine = []
            for _ in range(15):
                master.step(20)
                mine.append(np.hstack([np.ravel(master.get(*n.split("."))) for n in names]))
            wanted.append(mine)
    touched = 0.0
    with fuse(system, lanes=8).batch(3, start={"hull.eta_0": eta, "hull.nu_0": nu}) as batch:
        for i in range(15):
            for _ in range(20):
                batch.step()
                touched = max(touched, float(np.abs(batch.get("contact.tau")).max()))
            seen = np.hstack([batch.get(n).reshape(3, -1) for n in names])
            np.testing.assert_array_equal(seen, np.array(wanted)[:, i])
    assert touched > 0.0


def test_derivatives_through_a_landing_are_finite_and_those_of_differences() -> None:
    system = System("landing", "0.02").add("hull", "model:bluerov2_heavy")
    system = system.add("contact", "model:contact?step=0.02")
    for signal in ("eta", "q", "nu"):
        system = system.connect(f"hull.{signal}", f"contact.{signal}")
    kernel = fuse(system.connect("contact.tau", "hull.tau"), lanes=4)
    start = {
        "hull.eta_0": np.array([0, 0, 24.75, 0.1, 0.05, 0.3]),
        "hull.nu_0": np.array([0.6, 0.1, 0.4, 0.1, 0.2, 0.1]),
    }
    by = {n: 0.1 * np.arange(1.0, 7.0) for n in start}
    steps, out = 40, ["hull.nu", "contact.depth"]
    values, change = kernel.jvp(start, by, out, steps=steps, n_envs=1)
    assert values["contact.depth"].max() > 0.0

    def end(e: float) -> np.ndarray:
        with kernel.batch(1, start={n: start[n] + e * by[n] for n in start}) as batch:
            batch.step(steps)
            return batch.get("hull.nu")[0].copy()

    wanted = (end(1e-6) - end(-1e-6)) / 2e-6
    np.testing.assert_allclose(change["hull.nu"][-1, 0], wanted, rtol=1e-4, atol=1e-5)
    _, pull = kernel.vjp(start, out, steps=steps, n_envs=1)
    seed = np.zeros((steps, 1, 6))
    seed[-1, 0] = np.arange(6.0)
    gradient = pull({"hull.nu": seed})
    along = sum(float(np.sum(gradient[n] * by[n])) for n in by)
    assert along == pytest.approx(float(np.arange(6.0) @ change["hull.nu"][-1, 0]), rel=1e-4)
