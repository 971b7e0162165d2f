"""Ready-made randomisations: published intervals of a hull, sensors, current, thrusters, delays."""

from __future__ import annotations

from collections.abc import Callable

from uuvsim_cosim.envs.randomisation import sets
from uuvsim_cosim.envs.randomisation.distributions import Distribution
from uuvsim_cosim.envs.randomisation.randomisation import Randomisation
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["current", "delays", "published", "sensor_noise", "thruster_strength"]


def published(
    vehicle: str,
    prefix: str = "hull",
    set: str | None = None,
    distribution: Callable[[float, float], Distribution] | None = None,
) -> Randomisation:
    """Return a randomisation of a hull's parameters over the intervals of their published values.

    `vehicle` is a shipped vehicle or a folder, and `set` one of its parameter sets (None: its
    default). Both must be those of the system's hull, since a parameter that a set does not have is
    structurally zero and cannot be drawn. `prefix` is the path of the hull in the system.
    `distribution` makes a distribution from the least and the greatest value, by default a uniform
    one. An identified set (`uuvsim identify --save-as`) has its own intervals, and only those are
    used for the fitted numbers: their errors are normal, within three deviations, and have the
    correlation of the fit. Units are those of the parameters. Values and sources:
    models/vehicles/<vehicle>/published.yaml. Raises InputInvalid for a vehicle without published
    intervals.

    Example:

    >>> from uuvsim_cosim.envs import published
    >>> hull = published("bluerov2_heavy", prefix="hull")
    >>> [vary.name for vary in hull.parameters][:3]
    ['hull.m', 'hull.rho', 'hull.nabla']
    """
    return Randomisation(*sets.published_intervals(vehicle, prefix, set, distribution))


def sensor_noise(system: System, low: float = 0.5, high: float = 2.0) -> Randomisation:
    """Scale the noise of every sensor: densities, deviations and biases, independently.

    A sensor is a component with an output ``t_sample`` (the time of its sample) that reads no
    other sensor.
    """
    return Randomisation(*sets.noise_of_sensors(system, low, high))


def current(system: System, speed: float = 0.5) -> Randomisation:
    """Return a randomisation of a system's current: up to `speed` [m/s], from any direction.

    A component that makes a current gets a speed from 0 to `speed` and a direction [rad]. A hull
    whose input `v_c` is unconnected gets a horizontal velocity, each part (N and E) within
    ± speed / sqrt(2). Raises InputInvalid for a system without either.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> from uuvsim_cosim.envs import current
    >>> water = current(uuv.load("bluerov2_task"), speed=0.3)
    >>> [vary.name for vary in water.parameters]
    ['current.speed', 'current.direction']
    """
    return Randomisation(*sets.current_of_any_direction(system, speed))


def thruster_strength(
    system: System, low: float = 0.8, high: float = 1.1, voltage: tuple[float, float] = (13.0, 16.0)
) -> Randomisation:
    """Scale each thruster's `K_n`; where strength follows the supply, draw the supply's voltage.

    A voltage that no battery feeds is one for all thrusters; a battery's state of charge is drawn
    from 0.3 to 1.
    """
    return Randomisation(*sets.strength_of_thrusters(system, low, high, voltage))


def delays(system: System, most: float = 0.2) -> Randomisation:
    """Draw every delay from 0 to `most` [s], or to what its component allows."""
    return Randomisation(*sets.delays_of_components(system, most))
