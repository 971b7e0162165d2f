"""Systems for target tracking: vehicles that a policy drives in a pool, and a moving target.

A tracker is a nested system: pilot, allocation, thrusters, contact with the pool, wrench, hull,
stepped in sequence within a tick. Its unconnected inputs are ``tracker_1.pilot.a`` [m/s2] and
``tracker_1.pilot.omega`` [rad/s]; its state is ``tracker_1.hull.eta`` and ``.nu``. With links, the
unconnected input is ``tracker_1.radio.x`` (a, omega), and ``tracker_1.positioning.y`` is the
measured eta.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.guidance.target import MOTIONS
from uuvsim_cosim.orchestrator.system.system import System

__all__ = [
    "ARENA",
    "DEPTH",
    "TRACKED",
    "TRACKERS_MAX",
    "TrackedVehicle",
    "propelled",
    "start_positions",
    "target_tracking",
    "tracker",
    "with_quarry",
]

ARENA = (2.6, 4.8, 1.1)  # m along N, E, D: the UUVSim paper's pool; its middle is N = E = 0
DEPTH = 0.55  # m, of the plane in which all vehicles move
TRACKERS_MAX = 8
NOISE = 0.007  # m, the paper's positioning
LATENCY = 0.4  # s, assumed of the paper's narrow-band radio link


@dataclass(frozen=True)
class TrackedVehicle:
    """Parts of a tracker that depend on its vehicle."""

    thruster: str  # component of each thruster
    allocation: str  # component that commands them
    radius: float  # m, of the upright cylinder that touches walls
    height: float  # m, of that cylinder


TRACKED: Mapping[str, TrackedVehicle] = {
    "pool8": TrackedVehicle(
        "model:thruster_jet",
        "model:allocation_quadratic?vehicle=pool8",
        radius=0.149,  # half its diagonal
        height=0.12,
    ),
    "bluerov2_heavy": TrackedVehicle(
        "model:thruster_t200",
        "model:allocation?vehicle=bluerov2_heavy",
        radius=0.37,  # half the diagonal of 0.457 x 0.575 m
        height=0.254,
    ),
}


def propelled(system: System, thruster: str) -> tuple[System, tuple[str, ...]]:
    """Add eight thrusters, and connect pilot, allocation, thrusters, pool, wrench and hull.

    Return the system, and the thrusters' names in order.
    """
    system = (
        system.connect("pilot.tau_d", "allocation.tau_d")
        .connect("hull.eta[1:3]", "pool.position")
        .connect("hull.q", "pool.q")
        .connect("hull.nu", "pool.nu")
        .connect("pool.tau", "wrench.contact")
        .connect("wrench.tau", "hull.tau")
    )
    names = tuple(f"thruster_{i}" for i in range(1, 9))
    for i, name in enumerate(names, 1):
        system = (
            system.add(name, thruster)
            .connect(f"allocation.u[{i}]", f"{name}.u")
            .connect(f"{name}.thrust", f"wrench.thrust[{i}]")
        )
    return system, names


def tracker(
    name: str = "tracker",
    *,
    vehicle: str = "pool8",
    tick: Fraction | str | float = "0.02",
    eta_0: Sequence[float] = (0.0, 0.0, DEPTH, 0.0, 0.0, 0.0),
    obstacles: int = 0,
    links: bool = False,
    link_period: str = "0.1",
) -> System:
    """Return one vehicle with its pilot, in a pool; it exposes a, omega, eta and nu."""
    if vehicle not in TRACKED:
        raise InputInvalid(f"vehicle {vehicle!r}", f"one of {', '.join(TRACKED)}")
    tracked = TRACKED[vehicle]
    step = Fraction(str(tick))
    contact = (
        f"model:pool?vehicle={vehicle}&radius={tracked.radius}&height={tracked.height}"
        f"&obstacles={obstacles}&step={float(step)}"
    )
    system = (
        System(name, step, f"A {vehicle} that a policy drives in a pool")
        .add("pilot", f"model:pilot?vehicle={vehicle}&period={step}", {"depth": eta_0[2]})
        .add("allocation", tracked.allocation)
        .add("pool", contact)
        .add("wrench", f"model:wrench?vehicle={vehicle}&contact=1")
        .add("hull", f"model:{vehicle}", {"eta_0": tuple(eta_0)})
        .connect("hull.eta", "pilot.eta")
        .connect("hull.nu", "pilot.nu")
    )
    system, thrusters = propelled(system, tracked.thruster)
    chain = ["pilot", "allocation", *thrusters, "pool", "wrench", "hull"]
    if links:
        system = _linked(system, link_period)
        chain = ["radio", *chain, "positioning"]
        system = system.expose("radio", "radio.x").expose("known", "positioning.y")
    else:
        system = system.expose("a", "pilot.a").expose("omega", "pilot.omega")
    # In sequence within a step, so that a force acts on the state from which it was computed.
    return system.group(chain).expose("eta", "hull.eta").expose("nu", "hull.nu")


def target_tracking(
    n_trackers: int = 1,
    *,
    tick: Fraction | str | float = "0.02",
    vehicle: str = "pool8",
    motion: str = "random_heading",
    obstacles: int = 0,
    links: bool = False,
    link_period: str = "0.1",
    arena: Sequence[float] = ARENA,
    target_vehicle: bool = False,
) -> System:
    """Return trackers ``tracker_1`` … and the ``target`` in one pool of size `arena` [m].

    Obstacles are cylinders, set by the parameter ``obstacles`` of every ``pool`` and the target.
    With `target_vehicle` a vehicle ``quarry``, with a scripted helm, follows the target's motion:
    then ``quarry.hull.eta`` is what is tracked.
    """
    if not 1 <= n_trackers <= TRACKERS_MAX:
        raise InputInvalid(f"{n_trackers} trackers", f"1 to {TRACKERS_MAX}")
    if motion not in MOTIONS:
        raise InputInvalid(f"motion {motion!r}", f"one of {', '.join(MOTIONS)}")
    step = Fraction(str(tick))
    steer = step * max(1, round(Fraction("0.1") / step))
    source = f"model:target?motion={motion}&obstacles={obstacles}&period={step}"
    source += f"&heading_period={steer}" if motion != "path" else ""
    source += f"&trackers={n_trackers}" if motion == "flee" else ""
    start: dict[str, object] = {"position_0": (0.0, 0.0, DEPTH), "size": tuple(arena)}
    system = System(
        "target_tracking", step, f"{n_trackers} tracking a target that moves: {motion}"
    ).add("target", source, start)
    for i, (x, y) in enumerate(start_positions(n_trackers), 1):
        one = tracker(
            f"tracker_{i}",
            vehicle=vehicle,
            tick=step,
            eta_0=(x, y, DEPTH, 0.0, 0.0, 0.0),
            obstacles=obstacles,
            links=links,
            link_period=link_period,
        )
        system = system.add(f"tracker_{i}", one, {"pool.size": tuple(arena)})
        if motion == "flee":
            for k in (1, 2, 3):
                system = system.connect(f"tracker_{i}.eta[{k}]", f"target.tracker_{i}[{k}]")
    if target_vehicle:
        system = with_quarry(system, vehicle, obstacles, arena)
    if links:
        system = system.add(
            "positioning",
            f"model:link?size=3&period={link_period}&delay_max={LATENCY}",
            {"sigma": (NOISE,) * 3},
        )
        if target_vehicle:
            for k in (1, 2, 3):
                system = system.connect(f"quarry.eta[{k}]", f"positioning.x[{k}]")
        else:
            system = system.connect("target.position", "positioning.x")
    return system


def start_positions(n: int) -> list[tuple[float, float]]:
    """Return N and E of n trackers at their start [m]: two rows, away from walls and each other."""
    return [(0.6 if i % 2 else -0.6, (-1.8, 1.8, -0.6, 0.6)[i // 2]) for i in range(n)]


def with_quarry(system: System, vehicle: str, obstacles: int, arena: Sequence[float]) -> System:
    """Add a vehicle, ``quarry``, that starts at the ``target`` and follows its motion."""
    quarry = tracker(
        "quarry",
        vehicle=vehicle,
        tick=system.tick,
        eta_0=(0.0, 0.0, DEPTH, 0.0, 0.0, 0.0),
        obstacles=obstacles,
    )
    return (
        system.add("quarry", quarry, {"pool.size": tuple(arena)})
        .add("helm", "model:helm")
        .connect("quarry.eta", "helm.eta")
        .connect("quarry.nu", "helm.nu")
        .connect("target.position", "helm.position_d")
        .connect("target.velocity", "helm.velocity_d")
        .connect("helm.a", "quarry.a")
        .connect("helm.omega", "quarry.omega")
    )


def _linked(system: System, period: str) -> System:
    """Add a radio for the commands, and a positioning, both with delay."""
    units = "m,m,m,rad,rad,rad"
    return (
        system.add(
            "radio",
            f"model:link?size=2&unit=m/s2,rad/s&period={period}&delay_max={LATENCY}",
            {"delay": LATENCY},
        )
        .add(
            "positioning",
            f"model:link?size=6&unit={units}&period={period}&delay_max={LATENCY}",
            {"sigma": (NOISE,) * 3 + (0.0,) * 3},
        )
        .connect("radio.y[1]", "pilot.a")
        .connect("radio.y[2]", "pilot.omega")
        .connect("hull.eta", "positioning.x")
    )
