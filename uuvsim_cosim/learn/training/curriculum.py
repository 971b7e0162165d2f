"""Curriculum: a sequence of tasks, each of which starts from the networks of the previous one.

Scenario transfer training (STT) of the UUVSim paper is one. At each switch, the actions are exactly
unchanged (see `transfer`). A curriculum is a shipped one, or is read from a YAML file.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.algorithms.registry import ALGORITHMS, TRANSFERS
from uuvsim_cosim.learn.training.config import merged
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.models.declaration.yaml_text import YamlText, plain, shown

__all__ = ["CURRICULA", "Curriculum", "Promotion", "Stage", "curriculum_of", "read_curriculum"]


@dataclass(frozen=True)
class Promotion:
    """Condition to end a stage early: a return that several evaluations in a row have reached.

    The limit is a `share` of the scripted controller's return or, with `share` None, a return of at
    `least` the given number. `evaluations` is the number of consecutive evaluations.

    Example:

    >>> from uuvsim_cosim.learn import Promotion, Stage
    >>> nearly_scripted = Promotion(share=0.9, evaluations=2)
    >>> absolute = Promotion(share=None, least=90.0)
    >>> Stage("source", steps=32_000, promotion=absolute).promotion.evaluations
    2
    """

    share: float | None = 0.9  # of the scripted controller's return
    least: float | None = None  # a return, instead of `share`, for tasks without a controller
    evaluations: int = 2  # consecutive


@dataclass(frozen=True)
class Stage:
    """Stage of a curriculum: one task, trained for at most `steps` environment steps.

    `task` is the name of a task, or "package.module:Name". `steps` are summed over all
    environments. `options` are those of the task, and `settings` those of the algorithm; they
    override those of the curriculum. `promotion` ends the stage early. `evaluate_every` counts
    environment steps, by default those of the curriculum.

    Example:

    >>> from uuvsim_cosim.learn import Stage
    >>> stage = Stage("source", steps=32_000, settings={"batch": 256}, evaluate_every=1_600)
    >>> stage.promotion is None  # all steps are made
    True
    """

    task: str  # a name of TASKS, or "package.module:Name"
    steps: int  # environment steps, of all environments together
    options: Mapping[str, object] = field(default_factory=dict)  # the task's own
    settings: Mapping[str, object] = field(default_factory=dict)  # of the algorithm
    promotion: Promotion | None = None
    evaluate_every: int | None = None  # environment steps, instead of the curriculum's


@dataclass(frozen=True)
class Curriculum:
    """Curriculum: stages in their order, and the configuration that they share.

    `name` is part of the default folder. `stages` are a tuple of `Stage`. `algorithm` is one whose
    networks can be transferred: "masac" (with one agent, it is SAC), "isac", "ippo", "mappo" or
    "idqn". `settings` are those of the algorithm, and `options` those of every task. `envs` is the
    number of parallel environments. Each stage is evaluated every `evaluate_every` environment
    steps with `evaluation_episodes` episodes. Equal curricula and seeds give equal bits on one
    machine. Raises InputInvalid for invalid fields; tasks and settings are checked when the
    training starts.

    Example:

    >>> from uuvsim_cosim.learn import CURRICULA, Curriculum, Promotion, Stage
    >>> approach = Stage("source", steps=32_000, promotion=Promotion(share=0.9))
    >>> curriculum = Curriculum("two", (approach, Stage("transition_1", steps=64_000)))
    >>> quick = curriculum.changed(envs=8, settings={"hidden": 64})
    >>> quick.envs, quick.plain()["stages"][0]["task"]
    (8, 'source')
    >>> [stage.task for stage in CURRICULA["stt"].stages]  # the shipped curriculum
    ['source', 'transition_1', 'transition_2', 'target']
    """

    name: str
    stages: tuple[Stage, ...]
    algorithm: str = "masac"  # one of TRANSFERS; masac with one agent is sac
    settings: Mapping[str, object] = field(default_factory=dict)  # of the algorithm
    options: Mapping[str, object] = field(default_factory=dict)  # of every task
    envs: int = 64
    evaluate_every: int = 6_400  # environment steps
    evaluation_episodes: int = 100

    def __post_init__(self) -> None:
        """Check the fields of the curriculum and of its stages."""
        if not self.stages:
            raise InputInvalid(f"curriculum {self.name}", "no stages", "at least one")
        if self.algorithm not in TRANSFERS:
            kind = "transfers nothing" if self.algorithm in ALGORITHMS else "no such algorithm"
            raise InputInvalid(f"algorithm {self.algorithm!r}", kind, ", ".join(TRANSFERS))
        for name in ("envs", "evaluate_every", "evaluation_episodes"):
            _whole(f"curriculum {self.name}, {name}", getattr(self, name))
        for k, stage in enumerate(self.stages):
            place = f"curriculum {self.name}, stage {k + 1}"
            _whole(f"{place}, steps", stage.steps)
            if stage.evaluate_every is not None:
                _whole(f"{place}, evaluate_every", stage.evaluate_every)
            rule = stage.promotion
            if rule is None:
                continue
            _whole(f"{place}, promotion, evaluations", rule.evaluations)
            given = [name for name in ("share", "least") if getattr(rule, name) is not None]
            if len(given) != 1:
                raise InputInvalid(f"{place}, promotion", given or "nothing", "share or least")
            value = getattr(rule, given[0])
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise InputInvalid(f"{place}, promotion, {given[0]} {value!r}", "a number")

    def changed(self, **changes: Any) -> Curriculum:
        """Return a copy with other fields, which also override the values of the stages.

        `changes` are fields of the curriculum. Options and settings are merged with the present
        ones.
        """
        given = {name: changes.pop(name, {}) for name in ("options", "settings")}
        stages = []
        for stage in changes.pop("stages", self.stages):
            before = {**self.options, **stage.options}
            options = {k: v for k, v in merged(before, given["options"]).items()
                       if k in stage.options or k in given["options"]}  # fmt: skip
            every = None if "evaluate_every" in changes else stage.evaluate_every
            settings = {**stage.settings, **given["settings"]}
            stages.append(replace(stage, options=options, settings=settings, evaluate_every=every))
        return replace(self, stages=tuple(stages), **changes)

    def plain(self) -> dict[str, object]:
        """Return the fields as a mapping of values that JSON has."""
        return dict(json.loads(json.dumps(asdict(self))))


def _whole(name: str, value: object) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or value < 1:
        raise InputInvalid(f"{name} {value!r}", "a whole number from 1")


GOOD = Promotion()
ALONE = {"batch": 256}  # as many samples as two agents with shared networks have of 128
# With normalised critics, the policy goes closer to a resting target, for a small gain of r_a, than
# is good when the target moves: docs/learning/paper.md.
FIRST = {**ALONE, "normalised": False, "updates": 10.0}

# fmt: off
# The UUVSim paper's four scenarios. Settings that differ from the defaults were found by trials:
# docs/learning/paper.md.
CURRICULA = {
    "stt": Curriculum(
        "stt",
        (
            Stage("source", 32_000, settings=FIRST, promotion=GOOD, evaluate_every=1_600),
            Stage("transition_1", 25_600, settings=ALONE, promotion=GOOD, evaluate_every=3_200),
            Stage("transition_2", 83_200),
            Stage("target", 256_000, evaluate_every=12_800),
        ),
        settings={
            "shared": True, "batch": 128, "normalised": True, "mirror": True, "average": 0.005,
        },
        options={"rules": {"credit": "own"}},
    )
}
# fmt: on


def curriculum_of(name: str | Path) -> Curriculum:
    """Return a shipped curriculum by its name, or read a file; raises InputInvalid."""
    if str(name) in CURRICULA:
        return CURRICULA[str(name)]
    if str(name).endswith((".yaml", ".yml")):
        return read_curriculum(Path(name))
    raise InputInvalid(
        f"curriculum {str(name)!r}",
        "no such curriculum",
        f"{expected_names(name, CURRICULA)}, or a file (.yaml)",
    )


def read_curriculum(path: Path) -> Curriculum:
    """Read a YAML file with the fields of `Curriculum`; `stages` is a list.

    Raises InputInvalid with every mistake and its line.
    """
    if not path.is_file():
        raise InputInvalid(path, "no such file", "a curriculum (.yaml)")
    text = YamlText(path, "a curriculum")
    known = [f.name for f in fields(Curriculum)]
    if not text.keys([], text.data, known):
        text.refuse()
    given = {k: plain(v) for k, v in text.data.items() if k in known}
    stages = text.data.get("stages")
    if not isinstance(stages, list) or not stages:
        text.wrong(["stages"], f"{shown(stages)}; expected a list of stages")
        stages = []
    given["stages"] = tuple(
        stage for k, s in enumerate(stages) if (stage := _stage(text, ["stages", k], s)) is not None
    )
    for name in ("options", "settings"):
        _mapping(text, [name], given.get(name, {}))
    text.refuse()
    try:
        return Curriculum(**{"name": path.stem, **given})
    except InputInvalid as error:
        raise InputInvalid(f"{path}: {error}") from None


def _stage(text: YamlText, place: list[str | int], data: Any) -> Stage | None:
    if not text.keys(place, data, [f.name for f in fields(Stage)]):
        return None
    for name in ("task", "steps"):
        if name not in data:
            text.wrong(place, f"{name} missing; expected task and steps")
            return None
    if not isinstance(data["task"], str):
        text.wrong([*place, "task"], f"{shown(data['task'])}; expected a task's name")
        return None
    given: dict[str, Any] = {
        k: plain(v) for k, v in data.items() if k in {f.name for f in fields(Stage)}
    }
    for name in ("options", "settings"):
        if not _mapping(text, [*place, name], given.get(name, {})):
            return None
    rule = data.get("promotion")
    if rule is not None:
        at = [*place, "promotion"]
        if not text.keys(at, rule, [f.name for f in fields(Promotion)]):
            return None
        rules = [f.name for f in fields(Promotion)]
        read = {k: plain(v) for k, v in rule.items() if k in rules}
        given["promotion"] = Promotion(**({"share": None} if "least" in read else {}) | read)
    return Stage(**given)


def _mapping(text: YamlText, place: list[str | int], data: object) -> bool:
    if isinstance(data, Mapping):
        return True
    text.wrong(place, f"{shown(data)}; expected values by name")
    return False
