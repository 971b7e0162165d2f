"""A curriculum: tasks one after the other, each begun with the networks of the last.

Scenario transfer training (STT) of the UUVSim paper is one; at each switch the actions are exactly
unchanged (see `transfer`).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.algorithms.registry import ALGORITHMS, TRANSFERS
from uuvsim_cosim.learn.training.config import merged

__all__ = [
    "Curriculum",
    "Promotion",
    "Stage",
]


@dataclass(frozen=True)
class Promotion:
    """Condition to end a stage early: a return reached in consecutive evaluations."""

    share: float | None = 0.9  # of the scripted controller's return
    least: float | None = None  # a return, instead of `share`, for tasks without a controller
    evaluations: int = 2  # consecutive


@dataclass(frozen=True)
class Stage:
    """One task of a curriculum, for at most `steps` environment steps."""

    task: str  # a name of TASKS, or "package.module:Name"
    steps: int  # environment steps, of all environments together
    options: Mapping[str, object] = field(default_factory=dict)  # the task's own
    settings: Mapping[str, object] = field(default_factory=dict)  # of the algorithm
    promotion: Promotion | None = None
    evaluate_every: int | None = None  # environment steps, instead of the curriculum's


@dataclass(frozen=True)
class Curriculum:
    """Stages in their order, and their common options; the same one gives the same bits."""

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
        """Return a copy with changes, which take precedence over those of the stages.

        Options and settings are merged with the present ones.
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
        """Return the fields as values of JSON."""
        return dict(json.loads(json.dumps(asdict(self))))


def _whole(name: str, value: object) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or value < 1:
        raise InputInvalid(f"{name} {value!r}", "a whole number from 1")
