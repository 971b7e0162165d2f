"""Reward of target tracking, equation (7): its parameters, named choices, and profiles.

`reward_terms` is for arrays of n environments, `terms_expression` for the symbols of one. Both have
the same operations in the same order, and so the same bits.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.tasks.ranges import flag, one_of, within
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import expected_names

__all__ = [
    "PROFILES",
    "Scene",
    "Terms",
    "TrackingRules",
    "distances",
    "lambda_2",
    "mean_over",
    "reward_terms",
    "rules_of",
    "terms_expression",
]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
CONNECTED = 1e-9  # lambda_2 above it


@dataclass(frozen=True)
class TrackingRules:
    """Rules of the reward of target tracking; the defaults are the profile "default".

    The reward of a tracker is w_c r_c + w_t r_t + w_a r_a + w_p (p_1 + p_2 + p_3).
    """

    d_su: float = 0.38  # m, between trackers
    d_st: float = 0.38  # m, between tracker and target
    d_so: float = 0.38  # m, between tracker and an obstacle's surface
    d_m: float = 1.2  # m, the target counts as tracked within it
    r_c: float = 1000.0  # for a connected team
    r_t: float = 2.0  # for a target that is tracked
    r_a: float = 1.0  # for a smaller distance to the target
    p_1: float = -500.0  # for a tracker within d_su of another tracker
    p_2: float = -500.0  # for a tracker within d_st of the target
    p_3: float = -500.0  # for a tracker within d_so of an obstacle
    w_c: float = 1e-3
    w_t: float = 1.0
    w_a: float = 1.0
    w_p: float = 0.01
    # "algebraic": r_c lambda_2 / N, 0 for N = 1; "literal": r_c unless lambda_2 < 0: always r_c
    connectivity: Literal["algebraic", "literal"] = "algebraic"
    # "range": an edge of weight 1 if within 2 d_m; "exponential": weight exp(-d² / (2 d_m²))
    edges: Literal["range", "exponential"] = "range"
    # "potential": clip((d_before - d) / (v_max dt), -1, 1); "literal": 1 if d has fallen, else 0
    approach: Literal["potential", "literal"] = "potential"
    # "team": each tracker gets the mean over all; "own": each tracker gets its own terms
    credit: Literal["team", "own"] = "team"
    end_on_collision: bool = False  # whether a penalty p_1 to p_3 also ends the episode


PROFILES: dict[str, TrackingRules] = {
    "default": TrackingRules(),
    # The paper, literally: no weights, r_c for lambda_2 not below 0, r_a for a reduced distance.
    "table1": TrackingRules(
        w_c=1.0, w_p=1.0, connectivity="literal", approach="literal", credit="team"
    ),
}
HEAVY = {"d_su": 0.75, "d_st": 0.75, "d_so": 0.75}  # two BlueROV2 Heavy hulls, 0.46 x 0.58 m


def rules_of(profile: str, vehicle: str, **changes: Any) -> TrackingRules:
    """Return the rules of a profile with the vehicle's safe distances and changes by name."""
    one_of("profile", profile, list(PROFILES))
    rules = PROFILES[profile]
    types = get_type_hints(TrackingRules)
    for name, value in changes.items():
        if name not in types:
            raise InputInvalid(f"no rule {name!r}", expected_names(name, list(types)))
        place = f"rules, {name}"
        if types[name] is bool:
            flag(place, value)
        elif types[name] is float:
            within(place, value, 0.0 if name.startswith("d_") else -1e9, 1e9)
        else:
            one_of(place, value, get_args(types[name]))
    return replace(rules, **{**(HEAVY if vehicle == "bluerov2_heavy" else {}), **changes})


@dataclass(frozen=True)
class Scene:
    """All positions at one instant, in the horizontal plane [m]."""

    trackers: Any  # (n, N, 2)
    target: Any  # (n, 2)
    obstacles: Any  # (n, M, 3): N, E, radius
    reaches: Any  # (n, M): obstacles that are tall enough to reach the trackers' depth


@dataclass(frozen=True)
class Terms:
    """The terms of the reward, of shape (n,) or (n, N), or expressions and lists of them."""

    r_c: Any
    r_t: Any
    r_a: Any
    p_1: Any
    p_2: Any
    p_3: Any
    nearest: Any  # m, distance of the nearest tracker to the target

    @property
    def violated(self) -> Mask:
        """The trackers with a penalty, of shape (n, N)."""
        return np.asarray((self.p_1 != 0) | (self.p_2 != 0) | (self.p_3 != 0))

    def rewards(self, rules: TrackingRules) -> Any:
        """Return each tracker's reward, of shape (n, N)."""
        own = rules.w_t * self.r_t + rules.w_a * self.r_a
        own = own + rules.w_p * (self.p_1 + self.p_2 + self.p_3)
        if rules.credit == "team":
            own = np.repeat(mean_over(own)[:, None], own.shape[1], axis=1)
        return np.asarray(own + rules.w_c * self.r_c[:, None])


def mean_over(values: Any) -> Any:
    """Return the mean over the trackers, of arrays (n, N) or of a sequence of expressions.

    The order of additions does not depend on n.
    """
    columns = values.T if isinstance(values, np.ndarray) else values
    total = columns[0]
    for column in columns[1:]:
        total = total + column
    return total / len(columns)


def distances(a: Array, b: Array) -> Array:
    """Return distances (n, A, B) between points (n, A, 2) and (n, B, 2)."""
    d = a[:, :, None, :2] - b[:, None, :, :2]
    return np.sqrt(d[..., 0] ** 2 + d[..., 1] ** 2)


def lambda_2(trackers: Array, rules: TrackingRules) -> Array:
    """Return the second smallest eigenvalue of the team graph's Laplacian, (n,); 0 for one."""
    n, N, _ = trackers.shape
    if N == 1:
        return np.zeros(n)
    d = distances(trackers, trackers)
    if rules.edges == "range":
        weight = (d <= 2.0 * rules.d_m).astype(float)
    else:
        weight = np.exp(-0.5 * (d / rules.d_m) ** 2)
    if N == 2:
        return np.asarray(2.0 * weight[:, 0, 1])
    weight[:, np.arange(N), np.arange(N)] = 0.0
    laplacian = -weight
    laplacian[:, np.arange(N), np.arange(N)] = weight.sum(axis=2)
    # Row by row, so that the last bit does not depend on n; 0 is exact only up to rounding.
    second = np.linalg.eigvalsh(laplacian)[:, 1]
    return np.where(second > CONNECTED, second, 0.0)


def reward_terms(now: Scene, before: Scene, rules: TrackingRules, stride: float) -> Terms:
    """Return the terms of the action that led from `before` to `now`; `stride` is v_max dt [m]."""
    N = now.trackers.shape[1]
    d = distances(now.trackers, now.target[:, None])[:, :, 0]
    earlier = distances(before.trackers, before.target[:, None])[:, :, 0]
    second = lambda_2(now.trackers, rules)
    connected = second / N if rules.connectivity == "algebraic" else (second >= 0.0).astype(float)
    if rules.approach == "potential":
        approach = np.clip((earlier - d) / stride, -1.0, 1.0)
    else:
        approach = (d < earlier).astype(float)
    others = distances(now.trackers, now.trackers)
    others[:, np.arange(N), np.arange(N)] = np.inf
    surfaces = distances(now.trackers, now.obstacles) - now.obstacles[:, None, :, 2]
    surfaces = np.where(now.reaches[:, None, :], surfaces, np.inf)
    return Terms(
        r_c=rules.r_c * connected,
        r_t=np.where(d <= rules.d_m, rules.r_t, 0.0),
        r_a=rules.r_a * approach,
        p_1=np.where(others.min(axis=2) < rules.d_su, rules.p_1, 0.0),
        p_2=np.where(d < rules.d_st, rules.p_2, 0.0),
        p_3=np.where(surfaces.min(axis=2, initial=np.inf) < rules.d_so, rules.p_3, 0.0),
        nearest=d.min(axis=1),
    )


def terms_expression(now: Any, before: Any, rules: TrackingRules, stride: float) -> Terms | None:
    """Return `reward_terms` as CasADi expressions; None for rules that only NumPy has.

    `now` and `before` are scenes of symbols without the first axis. Each term of N trackers is a
    list. An eigenvalue of more than two trackers has no expression.
    """
    import casadi as ca

    from uuvsim_cosim.models.declaration.safe_math import clip

    N = len(now.trackers)
    if N > 2 or rules.edges != "range":
        return None

    def apart(a: Any, b: Any) -> Any:
        x, y = a[0] - b[0], a[1] - b[1]
        return ca.sqrt(x * x + y * y)

    def least(values: list[Any]) -> Any:
        smallest = values[0]
        for value in values[1:]:
            smallest = ca.if_else(value < smallest, value, smallest)
        return smallest

    d = [apart(p, now.target) for p in now.trackers]
    earlier = [apart(p, before.target) for p in before.trackers]
    between = apart(*now.trackers) if N == 2 else ca.SX(np.inf)
    second = 2.0 * (between <= 2.0 * rules.d_m) if N == 2 else ca.SX(0.0)
    connected = second / N if rules.connectivity == "algebraic" else second >= 0.0
    if rules.approach == "potential":
        approach = [clip((b - a) / stride, -1.0, 1.0) for a, b in zip(d, earlier, strict=True)]
    else:
        approach = [a < b for a, b in zip(d, earlier, strict=True)]
    surfaces = [
        [
            ca.if_else(reaches, apart(p, o) - o[2], np.inf)
            for o, reaches in zip(now.obstacles, now.reaches, strict=True)
        ]
        for p in now.trackers
    ]
    return Terms(
        r_c=rules.r_c * connected,
        r_t=[ca.if_else(x <= rules.d_m, rules.r_t, 0.0) for x in d],
        r_a=[rules.r_a * x for x in approach],
        p_1=[ca.if_else(between < rules.d_su, rules.p_1, 0.0)] * N,
        p_2=[ca.if_else(x < rules.d_st, rules.p_2, 0.0) for x in d],
        p_3=[
            ca.if_else(least(s) < rules.d_so, rules.p_3, 0.0) if s else ca.SX(0.0) for s in surfaces
        ],
        nearest=least(d),
    )
