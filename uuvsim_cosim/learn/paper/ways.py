"""Trainings for the paper's figures: budgets, and ways of learning as chains of scenarios."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.training.curriculum import Curriculum, Stage

__all__ = [
    "BUDGETS",
    "CAREFUL",
    "FIGURES",
    "SCENARIOS",
    "Budget",
    "Chain",
    "chains_of",
    "first_of",
    "options_of",
    "place_of",
    "plan_of",
    "scenarios_of",
]

Figure = Literal["fig7", "fig8", "fig9", "fig11"]
FIGURES: tuple[Figure, ...] = get_args(Figure)
SEEDS_APART = 1000  # seed k begins at environments' seed 1000 k: none is in two of them
CAREFUL = "careful"  # the target scenario once more, under harder rules
TUNED = ("masac", "isac")  # a budget's settings are theirs; others have their defaults
SCENARIOS = ("source", "transition_1", "transition_2", "target")


@dataclass(frozen=True)
class Budget:
    """Size of the trainings: environment steps for each scenario, `envs` side by side."""

    name: str
    described: str
    envs: int
    steps: Mapping[str, int]
    evaluate_every: Mapping[str, int]  # environment steps
    settings: Mapping[str, object] = field(default_factory=dict)  # of MASAC and SAC
    options: Mapping[str, Any] = field(default_factory=dict)  # of the tasks
    alone: Mapping[str, object] = field(default_factory=dict)  # settings where there is one tracker
    of: Mapping[str, Mapping[str, object]] = field(default_factory=dict)  # settings, by scenario
    under: Mapping[str, Mapping[str, object]] = field(default_factory=dict)  # rules to learn under


BUDGETS = {
    b.name: b
    for b in (
        # About five CPU minutes for the longest; see docs/learning/paper.md for what was tried.
        Budget(
            "batched",
            "64 parallel environments, about five CPU minutes for the longest scenario; the "
            "paper's numbers, parameters shared by the trackers, each with its own reward "
            "(`credit: own`). MASAC and ISAC: critics with layer normalisation after the first "
            "scenario, mirrored copies of transitions, and the average of the last actors as the "
            "exported policy. IPPO, IDQN and MAPPO have the defaults of `uuvsim train` and a "
            "network for each tracker. `careful` trains the target scenario again, with penalties "
            "that begin at 0.45 m instead of 0.38 m and count double during training (learning "
            "rate 1e-3); it is evaluated by the paper's rules, like all others, and takes four CPU "
            "minutes more.",
            64,
            {"source": 32_000, "transition_1": 25_600, "transition_2": 83_200, "target": 256_000,
             CAREFUL: 192_000},
            {"source": 1_600, "transition_1": 3_200, "transition_2": 6_400, "target": 12_800,
             CAREFUL: 12_800},
            {"shared": True, "batch": 128, "normalised": True, "mirror": True, "average": 0.005},
            {"rules": {"credit": "own"}}, {"batch": 256},
            {"source": {"normalised": False, "updates": 10.0},
             CAREFUL: {"lr": 1e-3, "average": 0.0005}},
            {CAREFUL: {"d_su": 0.45, "d_st": 0.45, "d_so": 0.45, "w_p": 0.02}},
        ),
        # 200 episodes, one environment, one update a step: as the paper, and its numbers.
        Budget(
            "paper",
            "200 episodes of one environment per scenario, one update per step, the paper's "
            "numbers, a network for each agent.",
            1, dict.fromkeys(SCENARIOS, 10_000), dict.fromkeys(SCENARIOS, 500),
        ),
    )
}  # fmt: skip


@dataclass(frozen=True)
class Chain:
    """Scenarios learned one after the other, in one way: "stt-masac", "scratch-ippo"."""

    schooling: Literal["stt", "scratch"]
    algorithm: str
    scenarios: tuple[str, ...]
    options: Mapping[str, object] = field(default_factory=dict)
    label: str = ""  # the difference from the way without a label
    trackers: int | None = None  # where a team tracks, instead of two

    @property
    def way(self) -> str:
        """The name of the way."""
        return "-".join(x for x in (self.schooling, self.algorithm, self.label) if x)


STT = Chain("stt", "masac", (*SCENARIOS, CAREFUL))
FROM_SCRATCH = tuple(Chain("scratch", "masac", (s,)) for s in reversed(SCENARIOS[1:]))
OTHERS = tuple(
    Chain("scratch", algorithm, ("target",), label="all_steps")
    for algorithm in ("masac", "ippo", "idqn", "isac", "mappo")
)
SCHOOLED = tuple(Chain("stt", a, SCENARIOS) for a in ("ippo", "idqn", "mappo", "isac"))
TEAMS = (
    Chain("stt", "masac", ("source", "transition_1", "target"), label="one", trackers=1),
    Chain("stt", "masac", SCENARIOS, {"slots": [2, 2]}, "three", trackers=3),
)
NEEDS: dict[Figure, tuple[Chain, ...]] = {
    "fig7": (STT, *FROM_SCRATCH),
    "fig8": (STT, *TEAMS),
    "fig9": (STT, *SCHOOLED, *OTHERS),
    "fig11": (),  # of other form: `transfer_runs`
}


def chains_of(figure: str) -> tuple[Chain, ...]:
    """Return the chains that a figure needs, or all figures; raises InputInvalid otherwise."""
    names = [*FIGURES, "all"]
    if figure not in names:
        raise InputInvalid(f"figure {figure!r}", "no such figure", f"one of {', '.join(names)}")
    chosen = FIGURES if figure == "all" else (figure,)
    return tuple({c.way + c.scenarios[-1]: c for f in chosen for c in NEEDS[f]}.values())  # type: ignore[index]


def scenarios_of(chain: Chain, budget: Budget) -> tuple[str, ...]:
    """Return the scenarios of a chain for which a budget has steps."""
    return tuple(s for s in chain.scenarios if s in budget.steps)


def options_of(chain: Chain, scenario: str) -> dict[str, object]:
    """Return the task options of a way; the others are the budget's."""
    options = dict(chain.options)
    if chain.trackers is not None and _task(scenario) in ("transition_2", "target"):
        options["n_trackers"] = chain.trackers
    return options


def first_of(seed: int) -> int:
    """Return the first environment's seed of the trainings with a seed of the benchmark."""
    return SEEDS_APART * seed


def place_of(work: Path, budget: Budget, chain: Chain, seed: int) -> Path:
    """Return the folder of a chain's checkpoints."""
    return work / budget.name / f"{chain.way}-{scenarios_of(chain, budget)[-1]}-{seed}"


def plan_of(chain: Chain, budget: Budget) -> Curriculum | dict[str, Any]:
    """Return a chain as a curriculum, or as one training's fields.

    Without schooling, a curriculum of MASAC and SAC has one stage.
    """
    tuned = chain.algorithm in TUNED
    scenarios = scenarios_of(chain, budget)
    steps = dict(budget.steps)
    if chain.label == "all_steps":  # the sum over all scenarios of the schooling
        steps = dict.fromkeys(scenarios, sum(budget.steps[s] for s in SCENARIOS))
    if chain.schooling != "stt" and not tuned:
        (scenario,) = scenarios
        return {
            "algorithm": chain.algorithm, "envs": budget.envs, "steps": steps[scenario],
            "evaluate_every": budget.evaluate_every[scenario],
            "task_options": {**budget.options, **chain.options},
        }  # fmt: skip
    stages = []
    for s in scenarios:
        options, under = options_of(chain, s), budget.under.get(s)
        alone = s in ("source", "transition_1") or options.get("n_trackers") == 1
        settings = {**(budget.alone if alone else {}), **budget.of.get(s, {})} if tuned else {}
        if under:
            options["rules"] = {**budget.options.get("rules", {}), **under}
        every = budget.evaluate_every[s]
        stages.append(Stage(_task(s), steps[s], options, settings, evaluate_every=every))
    return Curriculum(
        chain.way, tuple(stages), algorithm=chain.algorithm,
        settings=budget.settings if tuned else {}, options={**budget.options}, envs=budget.envs,
    )  # fmt: skip


def _task(scenario: str) -> str:
    return "target" if scenario == CAREFUL else scenario
