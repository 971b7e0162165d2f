"""The rules of target tracking: the numbers and named choices of its reward, by profile."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal, get_args, get_type_hints

from uuvsim_cosim.envs.tasks.ranges import flag, one_of, within
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import expected_names

__all__ = ["PROFILES", "TrackingRules", "rules_of"]


@dataclass(frozen=True)
class TrackingRules:
    """Distances, rewards and weights; the defaults are the profile `default`.

    A reward is  w_c r_c + w_t r_t + w_a r_a + w_p (p_1 + p_2 + p_3).
    """

    d_su: float = 0.38  # m, between trackers
    d_st: float = 0.38  # m, between tracker and target
    d_so: float = 0.38  # m, between tracker and an obstacle's surface
    d_m: float = 1.2  # m, the target counts as tracked within it
    r_c: float = 1000.0  # for a connected team
    r_t: float = 2.0  # for a target that is tracked
    r_a: float = 1.0  # for coming closer
    p_1: float = -500.0  # a tracker within d_su of another
    p_2: float = -500.0  # within d_st of the target
    p_3: float = -500.0  # within d_so of an obstacle
    w_c: float = 1e-3
    w_t: float = 1.0
    w_a: float = 1.0
    w_p: float = 0.01
    # "algebraic": r_c lambda_2 / N, 0 for N = 1; "literal": r_c unless lambda_2 < 0, that is always
    connectivity: Literal["algebraic", "literal"] = "algebraic"
    # "range": an edge iff within 2 d_m, of weight 1; "exponential": weight exp(-d² / (2 d_m²))
    edges: Literal["range", "exponential"] = "range"
    # "potential": clip((d_before - d) / (v_max dt), -1, 1); "literal": 1 if d has fallen, else 0
    approach: Literal["potential", "literal"] = "potential"
    # "team": the mean of all, the same for each agent; "own": each its own terms
    credit: Literal["team", "own"] = "team"
    end_on_collision: bool = False  # what p_1 to p_3 punish also ends the episode


PROFILES: dict[str, TrackingRules] = {
    "default": TrackingRules(),
    # The paper to the letter: no weights, a bonus for lambda_2 not below 0, r_a for "reduced".
    "table1": TrackingRules(
        w_c=1.0, w_p=1.0, connectivity="literal", approach="literal", credit="team"
    ),
}
HEAVY = {"d_su": 0.75, "d_st": 0.75, "d_so": 0.75}  # two BlueROV2 Heavy hulls, 0.46 x 0.58 m


def rules_of(profile: str, vehicle: str, **changes: Any) -> TrackingRules:
    """Return a profile's rules, with the distances that the vehicle needs, and changes by name."""
    one_of("profile", profile, list(PROFILES))
    rules = PROFILES[profile]
    unknown = [name for name in changes if name not in TrackingRules.__dataclass_fields__]
    if unknown:
        known = list(TrackingRules.__dataclass_fields__)
        raise InputInvalid(f"no rule {unknown[0]!r}", expected_names(unknown[0], known))
    types = get_type_hints(TrackingRules)
    for name, value in changes.items():
        place = f"rules, {name}"
        if types[name] is bool:
            flag(place, value)
        elif types[name] is float:
            within(place, value, 0.0 if name.startswith("d_") else -1e9, 1e9)
        else:
            one_of(place, value, get_args(types[name]))
    return replace(rules, **{**(HEAVY if vehicle == "bluerov2_heavy" else {}), **changes})
