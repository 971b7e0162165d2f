"""Registry of the algorithms: number of agents, settings, and how a learner is made."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, get_type_hints

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.shared.errors import check_torch
from uuvsim_cosim.models.declaration.near_names import expected_names

if TYPE_CHECKING:
    from uuvsim_cosim.envs.task.task import Symmetry
    from uuvsim_cosim.learn.algorithms.learner import Learner

__all__ = [
    "ALGORITHMS",
    "TRANSFERS",
    "Algorithm",
    "algorithm_for",
    "check_settings",
    "default_settings",
    "learner_of",
]


@dataclass(frozen=True)
class Algorithm:
    """Algorithm by its name; one that is `alone` learns for one agent only."""

    name: str
    alone: bool


# sac, ppo and dqn are for one agent; masac and mappo have central critics; in isac, ippo and idqn
# each agent learns by itself.
ALGORITHMS = {
    name: Algorithm(name, name in ("sac", "ppo", "dqn"))
    for name in ("sac", "masac", "isac", "ppo", "ippo", "mappo", "dqn", "idqn")
}
TRANSFERS = ("masac", "isac", "ippo", "mappo", "idqn")  # Transferable: for curricula


def algorithm_for(name: str | None, agents: int) -> Algorithm:
    """Return the named algorithm; without a name, SAC for one agent and MASAC for several.

    Raises InputInvalid for an unknown name, and for an algorithm of one agent with several agents.
    """
    if name is None:
        return ALGORITHMS["sac" if agents == 1 else "masac"]
    if name not in ALGORITHMS:
        raise InputInvalid(
            f"algorithm {name!r}", "no such algorithm", expected_names(name, ALGORITHMS)
        )
    chosen = ALGORITHMS[name]
    if chosen.alone and agents > 1:
        several = {"sac": "masac or isac", "ppo": "ippo or mappo", "dqn": "idqn"}[name]
        raise InputInvalid(
            f"algorithm {name}", f"learns for one agent, the task has {agents}", several
        )
    return chosen


def learner_of(
    algorithm: Algorithm,
    settings: Mapping[str, object],
    *,
    agents: int,
    observed: int,
    acted: int,
    n: int,
    seed: int,
    symmetries: Sequence[Symmetry] = (),
) -> Learner:
    """Make a learner for n environments, with `settings` by name instead of the defaults.

    By default, an off-policy learner makes n / 16 updates, at least one, each time that all
    environments have made one step. Raises InputInvalid for wrong settings.
    """
    makers = _makers(algorithm.name, symmetries)
    given = check_settings(algorithm, settings)
    known = [f.name for kind in makers.settings for f in fields(kind)]
    if "updates" in known:
        given.setdefault("updates", max(1.0, n / 16))
        if given.get("buffer", 100_000) < n:
            raise InputInvalid(
                f"{algorithm.name}, buffer {given['buffer']}", f"at least {n}, one a step"
            )
    made = [
        kind(**{f.name: given[f.name] for f in fields(kind) if f.name in given}, **{
            k: v for k, v in makers.fixed.items() if k in kind.__dataclass_fields__
        })
        for kind in makers.settings
    ]  # fmt: skip
    return makers.make(agents, observed, acted, seed, made)


def check_settings(algorithm: Algorithm, settings: Mapping[str, object]) -> dict[str, float]:
    """Return settings with their types; raises InputInvalid for unknown names and wrong values."""
    makers = _makers(algorithm.name)
    hints: dict[str, type] = {}
    for kind in makers.settings:
        hints |= {k: v for k, v in get_type_hints(kind).items() if k not in makers.fixed}
    given: dict[str, float] = {}
    value: Any
    for name, value in settings.items():
        if name not in hints:
            raise InputInvalid(f"{algorithm.name}, setting {name!r}", expected_names(name, hints))
        place = f"{algorithm.name}, {name} {value!r}"
        if hints[name] is bool:
            if not isinstance(value, bool):
                raise InputInvalid(place, "true or false")
            given[name] = value
            continue
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if hints[name] is int:
            least = 0 if name in _MAY_BE_0 else 2 if name in ("batch", "samples") else 1
            if not number or value != int(value) or not least <= value <= 10**9:
                raise InputInvalid(place, f"a whole number from {least}")
            given[name] = int(value)
            continue
        low, high = _LIMITS.get(name, (1e-12, 1e6))
        if not number or not low <= value <= high:
            expected = "more than 0, at most 1e6" if low == 1e-12 else f"{low:g} … {high:g}"
            raise InputInvalid(place, f"a number, {expected}")
        given[name] = float(value)
    return given


def default_settings(name: str) -> dict[str, float]:
    """Return the defaults of all settings of an algorithm."""
    makers = _makers(name)
    given: dict[str, Any] = {f.name: f.default for kind in makers.settings for f in fields(kind)}
    return {**given, **makers.fixed}


@dataclass(frozen=True)
class _Makers:
    settings: tuple[type[Any], ...]  # dataclasses
    fixed: Mapping[str, bool]  # settings that the algorithm's name decides
    make: Callable[..., Learner]


def _makers(name: str, symmetries: Sequence[Symmetry] = ()) -> _Makers:
    check_torch()
    if name in ("sac", "masac", "isac"):
        from uuvsim_cosim.learn.algorithms.masac import MasacSettings
        from uuvsim_cosim.learn.algorithms.off_policy_learner import MasacLearner, OffPolicySettings

        return _Makers(
            (MasacSettings, OffPolicySettings),
            {"central": name != "isac"},
            lambda N, d, a, seed, s: MasacLearner(
                N, d, a, seed=seed, network=s[0], schedule=s[1], symmetries=symmetries
            ),
        )
    if name in ("ippo", "mappo", "ppo"):
        from uuvsim_cosim.learn.algorithms.ppo import PpoLearner, PpoSettings

        return _Makers(
            (PpoSettings,), {},
            lambda N, d, a, seed, s: PpoLearner(
                N, d, a, seed=seed, settings=s[0], central=name == "mappo", name=name
            ),
        )  # fmt: skip
    from uuvsim_cosim.learn.algorithms.dqn import DqnLearner, DqnSettings

    return _Makers(
        (DqnSettings,), {},
        lambda N, d, a, seed, s: DqnLearner(N, d, a, seed=seed, settings=s[0], name=name),
    )  # fmt: skip


_LIMITS = {  # (least, greatest) value of some settings; the others are positive
    "gamma": (0.0, 1.0), "tau": (0.0, 1.0), "epsilon": (0.0, 1.0), "epsilon_end": (0.0, 1.0),
    "gae_lambda": (0.0, 1.0), "log_std": (-10.0, 2.0), "entropy": (0.0, 1e3),
    "value": (0.0, 1e3), "updates": (1e-3, 1e3), "centre": (0.0, 1.0), "alpha": (1e-9, 1e3),
    "average": (1e-6, 1.0),
}  # fmt: skip
_MAY_BE_0 = ("warm_up", "critic_only", "epsilon_steps")
