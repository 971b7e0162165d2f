"""Systems in which an autopilot replaces controller and allocation, as `bluerov2_ardusub`."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from urllib.parse import quote

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["AUTOPILOTS", "autopilot_of", "bluerov2_with", "with_autopilot", "with_binary"]

# Names, and numbers of the modes in which they follow a desired pose.
AUTOPILOTS = {"ardusub": ("ArduSub", 4), "px4": ("PX4", 6)}
LOOP = Fraction(1, 400)  # s, step of ArduSub's loop, and the fastest that PX4 integrates its IMU
_MEASURED = {  # outputs of sensors, by component, and inputs of the autopilot
    "dvl": {"velocity": "dvl_velocity", "valid": "dvl_valid", "t_sample": "dvl_t_sample"},
    "usbl": {"position": "usbl_position", "sigma": "usbl_sigma", "valid": "usbl_valid",
             "t_sample": "usbl_t_sample"},
    "gps": {"position": "gps_position", "sigma": "gps_sigma", "valid": "gps_valid",
            "t_sample": "gps_t_sample"},
    "altimeter": {"altitude": "altitude"},
    "battery": {"voltage": "voltage"},
    "wrench": {"current_total": "current"},
}  # fmt: skip


def autopilot_of(source: object) -> str | None:
    """Return the autopilot of a source such as ``px4`` or ``px4:?option=value``; None without."""
    scheme = source.partition(":")[0] if isinstance(source, str) else ""
    return scheme if scheme in AUTOPILOTS else None


def with_autopilot(system: System, name: str, source: str = "ardusub:") -> System:
    """Return a system in which the autopilot `source` is the component `name`.

    It replaces the component `name` (a controller, or an allocation) and the allocation that feeds
    the thrusters, and gets the true state of the hull, the readings of sensors that are there, and
    the desired pose and velocity that the component `name` had, connected or as start values; all
    start values if it is the same autopilot with other options. The base step becomes 2.5 ms if it
    is longer. Raises InputInvalid if the system has no such component, hull or allocation of 8
    thrusters.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> from uuvsim_cosim.orchestrator.shipped.autopilot import with_autopilot
    >>> system = with_autopilot(uuv.load("bluerov2_hold"), "controller")
    >>> "allocation" in system.components, system.components["controller"].source
    (False, 'ardusub:')
    """
    known = system.components
    scheme, _, options = source.partition(":")
    if name not in known:
        raise InputInvalid(f"--replace {name}={scheme}", "no such component",
                           f"one of {', '.join(known)}")  # fmt: skip
    wires = system.checked.wires
    hull = next((c for c in known if {"eta", "q", "nu", "nu_dot"} <= _outputs(system, c)), None)
    driven = [w for w in wires if (w.source.variable.name, w.target.variable.name) == ("u", "u")]
    allocations = {w.source.element for w in driven}
    ends = [(i, t) for w in driven for i, t in zip(w.source.elements, w.target.texts(),
                                                   strict=True)]  # fmt: skip
    if hull is None or len(allocations) != 1 or len(ends) != 8:
        raise InputInvalid(
            f"--replace {name}={scheme}",
            "the system has no hull, or no allocation of 8 thrusters",
            "a system of one BlueROV2 Heavy, such as bluerov2_hold or bluerov2_survey",
        )
    wanted = [
        (w.connection.source, w.target.variable.name)
        for w in wires
        if w.target.element == name and w.target.variable.name in ("eta_d", "nu_d")
    ]
    values = {  # of the component before: its desired pose, or all if it is the same autopilot
        n: value
        for n, value in known[name].start.items()
        if n in ("eta_d", "nu_d") or autopilot_of(known[name].source) == scheme
    }
    for gone in {name, *allocations}:
        system = system.remove(gone)
    system = replace(system, tick=min(system.tick, LOOP)).add(name, f"{scheme}:{options}")
    for signal in ("eta", "q", "nu", "nu_dot"):
        system = system.connect(f"{hull}.{signal}", f"{name}.{signal}")
    for i, target in ends:
        system = system.connect(f"{name}.u[{i + 1}]", target)
    reads = system.describe(name).variables
    for sensor, readings in _MEASURED.items():
        if sensor in system.components:
            for output, input_ in readings.items():
                if input_ not in reads:
                    continue  # PX4 gets the true position at the surface
                system = system.connect(f"{sensor}.{output}", f"{name}.{input_}")
    for output, target in wanted:
        system = system.connect(output, f"{name}.{target}")
    for variable, value in {"arm": True, "mode": AUTOPILOTS[scheme][1], **values}.items():
        system = system.set(f"{name}.{variable}", value)
    return system


def with_binary(system: System, path: str, autopilot: str = "ardusub") -> System:
    """Return the system with an autopilot's binary at `path`; raises InputInvalid without it."""
    flown = [n for n, c in system.components.items() if autopilot_of(c.source) == autopilot]
    if not flown:
        raise InputInvalid(
            f"--{autopilot} {path}", f"no component of the system is {AUTOPILOTS[autopilot][0]}",
            f"--replace controller={autopilot} as well",
        )  # fmt: skip
    for name in flown:
        source = str(system.components[name].source)
        if "binary=" not in source:
            mark = "&" if "?" in source else "?"
            system = system.replace(name, f"{source}{mark}binary={quote(path, safe='/:~')}")
    return system


def bluerov2_with(autopilot: str, survey: System) -> System:
    """Return the survey's vehicle with an autopilot on board: it dives to 5 m.

    The autopilot replaces navigation, guidance, controller and allocation. The start is 1 m deep.
    """
    system = with_autopilot(survey, "controller", f"{autopilot}:")
    for gone in ("navigation", "guidance", "current"):
        system = system.remove(gone)
    system = replace(
        system, name=f"bluerov2_{autopilot}", stop_time=60.0,
        description=f"A BlueROV2 Heavy with the autopilot {AUTOPILOTS[autopilot][0]} on board "
                    "dives to 5 m",
    )  # fmt: skip
    return system.set("controller.eta_d", (0.0, 0.0, 5.0, 0.0, 0.0, 0.0))


def _outputs(system: System, component: str) -> set[str]:
    return {v.name for v in system.describe(component).of("output")}
