"""Net weight: a vehicle that sinks or rises whatever its controller does is refused.

The net weight (weight less buoyancy) of each hull is compared with the largest that the actuators
beside it carry, in the same nested system. A hull without actuators of a known vehicle is not
compared: it may sink deliberately. Neither is one whose actuators have figures that a user sets.

Thrusters carry `USED` of their largest vertical force. Fins carry the net weight for which level
flight at the speed of the guidance needs `TRIM_SHARE` of their deflection.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from uuvsim_cosim.errors import InputInvalid, Problem
from uuvsim_cosim.models.declaration.files_read import kept_until_changed
from uuvsim_cosim.models.declaration.library import LIBRARY
from uuvsim_cosim.models.declaration.parameter_files import split_address, vehicle_folder
from uuvsim_cosim.orchestrator.plan.compared_figures import floats, is_hull, scalars
from uuvsim_cosim.orchestrator.plan.plan import PlannedComponent

__all__ = ["WEIGHT", "net_weight", "net_weight_findings", "with_values"]

# Parameters of a hull that decide its net weight, and the sign of their influence; 0: g, of both.
WEIGHT = {"m": 1, "W": 1, "B": -1, "rho": -1, "nabla": -1, "g": 0}
ACTUATORS = ("wrench", "fins")  # by their places, one of each vehicle's actuators
SHARE_OF_GAINS = 0.2  # of what fins carry: the LAUV leaves its depth from 0.24 on
THRUSTERS = ("thruster", "thruster_t200", "thruster_jet", "propeller")


@dataclass(frozen=True)
class _Carried:
    """Largest net weights that the actuators of a vehicle carry.

    `rows` are (speed [m/s], largest net weight of a light and of a heavy vehicle [N]), by speed.
    `by` are the words of a message, with places for ``{way}`` ("up" or "down"), ``{speed}`` [m/s]
    and ``{most}`` [N]. `more` names what would carry more.
    """

    rows: tuple[tuple[float, float, float], ...]
    by: str
    more: str

    def most(self, heavy: bool, speed: float | None = None) -> tuple[float, str]:
        """Return the largest net weight [N] of a heavy or light vehicle at a speed, and words.

        The speed [m/s] is by default the largest.
        """
        from numpy import interp

        speeds = [row[0] for row in self.rows]
        at = min(max(speeds[0], speeds[-1] if speed is None else speed), speeds[-1])
        most = float(interp(at, speeds, [row[2 if heavy else 1] for row in self.rows]))
        way = "up" if heavy else "down"
        return most, self.by.format(way=way, speed=f"{at:.2g}", most=f"{most:.3g}")


def net_weight_findings(components: Iterable[PlannedComponent]) -> tuple[list[Problem], list[str]]:
    """Return a problem for each hull whose actuators cannot carry its net weight, and warnings.

    A warning is about a hull with fins whose net weight is far from that of its autopilot's gains,
    and about a hull whose weight W does not follow a mass that was set.
    """
    components = list(components)
    problems: list[Problem] = []
    warnings = [
        f"{c.path}: m is set, and the weight W, a parameter of its own, stays "
        f"{_values(c)['W']:.4g} N; expected W beside it, if the vehicle's weight changes"
        for c in components
        if is_hull(c) and "m" in c.start and "W" not in c.start and "W" in scalars(c)
    ]
    for b in _balances(components):
        net, (most, by) = b.net, b.carried.most(b.net > 0.0, b.speed)
        if abs(net) > most + b.ballast:
            sinks, more = ("sinks", "more") if net > 0.0 else ("rises", "less")
            read = (
                f"it {sinks}, because its weight of {b.weight:.4g} N is {abs(net):.3g} N {more} "
                f"than its buoyancy of {b.buoyancy:.4g} N, and {by}"
            )
            neutral = (
                f"W near B, {b.buoyancy:.4g} N"
                if "W" in b.values
                else f"m near {b.buoyancy / b.values['g']:.4g} kg, the mass at neutral buoyancy"
            )
            problems.append(Problem(b.path, read, f"{neutral}, {b.carried.more}"))
        elif len(b.carried.rows) > 1 and abs(net - b.own_net) > SHARE_OF_GAINS * most:
            warnings.append(
                f"{b.path}: its net weight (weight less buoyancy) is {net:.3g} N, and the "
                f"autopilot is designed for {b.own_net:.3g} N; the fins carry {most:.3g} N, but "
                "the vehicle may leave its depth. Check the depth, or change the mass in the "
                "vehicle's folder"
            )
    return problems, warnings


@dataclass(frozen=True)
class _Balance:
    """Weight and buoyancy [N] of a hull, and what its actuators carry.

    `own_net` is the net weight of the hull's files, `ballast` what variable ballast takes away.
    """

    path: str
    values: Mapping[str, float]
    weight: float
    buoyancy: float
    own_net: float
    carried: _Carried
    speed: float | None
    ballast: float

    @property
    def net(self) -> float:
        return self.weight - self.buoyancy


def _balances(components: Iterable[PlannedComponent]) -> Iterator[_Balance]:
    levels: dict[str, list[PlannedComponent]] = {}
    for c in components:
        levels.setdefault(c.path.rpartition(".")[0], []).append(c)
    for members in levels.values():
        hulls = [c for c in members if is_hull(c)]
        if len(hulls) != 1:
            continue
        hull = hulls[0]
        values = _values(hull)
        now, own = net_weight(values), net_weight(scalars(hull))
        carried = _carried(members, hull) if now else None
        if now is None or own is None or carried is None:
            continue
        ballast = _of_ballast(members, now[0] > now[1])
        speed = _speed(members)
        yield _Balance(hull.path, values, *now, own[0] - own[1], carried, speed, ballast)


def net_weight(values: Mapping[str, Any]) -> tuple[Any, Any] | None:
    """Return weight and buoyancy [N] of a submerged hull; None if parameters are missing."""
    if {"W", "B"} <= values.keys():
        return values["W"], values["B"]
    if {"m", "g", "rho", "nabla"} <= values.keys():
        return values["m"] * values["g"], values["rho"] * values["g"] * values["nabla"]
    return None


def with_values(
    components: Iterable[PlannedComponent], values: Mapping[str, Any]
) -> list[PlannedComponent]:
    """Return the components with other start values, by ``path.variable``."""
    own: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        path, _, variable = name.rpartition(".")
        own.setdefault(path, {})[variable] = value
    return [
        replace(c, start={**c.start, **own[c.path]}) if c.path in own else c for c in components
    ]


def _values(c: PlannedComponent) -> dict[str, float]:
    """Return the scalar parameters of a component, as the plan sets them."""
    given = {n: x[0] for n, v in c.start.items() if len(x := floats(v)) == 1}
    return scalars(c) | given


def _carried(members: list[PlannedComponent], hull: PlannedComponent) -> _Carried | None:
    """Return what the actuators of a level carry; None if their figures are not those of files."""
    for c in members:
        own = c.description.name
        if own in THRUSTERS and c.start.keys() - {"u", "voltage", "T_n"}:
            return None
        if own in ACTUATORS and c.start.keys() - {"thrust", "u"}:
            return None
    own_hull = hull.description.made_for.get("hull", "")
    for c in members:
        vehicle = c.description.made_for.get("figures", "")
        if c.description.name in ACTUATORS and vehicle:
            # Actuators of another vehicle are a mismatch already.
            same = split_address(vehicle)[0] == split_address(own_hull)[0]
            return _carried_by(own_hull or vehicle) if same or not own_hull else None
    return None


@kept_until_changed
def _carried_by(vehicle: str) -> _Carried | None:
    """Return the net weights that a vehicle's actuators carry.

    None: they make no force in heave, or no gains can be designed for them.
    """
    from uuvsim_cosim.models.control.fin_design import TRIM_SHARE, net_weight_of_level_flight
    from uuvsim_cosim.models.control.vehicle_design import USED, VOLTAGE, thrusters_of

    try:
        if (vehicle_folder(split_address(vehicle)[0]) / "fins.yaml").is_file():
            by = (
                f"level flight at {{speed}} m/s carries {{most}} N with {100 * TRIM_SHARE:.0f} % "
                "of the fins' deflection"
            )
            return _Carried(net_weight_of_level_flight(vehicle), by, "larger fins, a higher speed")
        thrusters = thrusters_of(vehicle)
    except InputInvalid:
        return None
    largest = float(thrusters.tau_max[2])
    if largest == 0.0:
        return None
    supply = f" at {VOLTAGE:g} V" if thrusters.model == "thruster_t200" else ""
    by = (
        f"its thrusters push {{way}} with {{most}} N ({100 * USED:.0f} % of the largest vertical "
        f"force both ways, {largest:.3g} N{supply})"
    )
    return _Carried(((0.0, USED * largest, USED * largest),), by, "stronger vertical thrusters")


def _speed(members: list[PlannedComponent]) -> float | None:
    """Return the speed of the guidance [m/s]; None if there is none."""
    for c in members:
        if ".guidance." in LIBRARY.get(c.description.name, ""):
            return _values(c).get("speed")
    return None


def _of_ballast(members: list[PlannedComponent], heavy: bool) -> float:
    """Return the net weight that variable ballast takes away at most [N]."""
    most = 0.0
    for c in members:
        if c.description.name == "ballast":
            v = _values(c)
            volume = v["V_max"] - v["V_0"] if heavy else v["V_0"] - v["V_min"]
            most += v["rho"] * v["g"] * max(volume, 0.0)
    return most
