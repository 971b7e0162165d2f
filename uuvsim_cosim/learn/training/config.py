"""Configuration of a training: task, algorithm, seed and sizes, from Python or a YAML file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from uuvsim_cosim.envs.tasks.tracking_reward import PROFILES
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.algorithms.registry import ALGORITHMS, check_settings
from uuvsim_cosim.learn.shared.task_ids import TASKS, short_name
from uuvsim_cosim.learn.training.training_seeds import EVALUATION_SEED, MOST_ENVS
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.models.declaration.yaml_text import YamlText, plain, shown

__all__ = ["TrainingConfig", "merged", "read_config"]


@dataclass(frozen=True)
class TrainingConfig:
    """Configuration of a training; equal ones give equal bits on one machine.

    `task` is a name of `TASKS` or "package.module:Name", and `task_options` are its options.
    `settings` are the settings of the algorithm that differ from its defaults. The `profile`
    "table1" has exactly the numbers of the UUVSim paper's table. Raises InputInvalid for invalid
    values.
    """

    task: str
    algorithm: str | None = None  # None: sac for one agent, masac for several
    seed: int = 0  # of the learner and of the environments; below EVALUATION_SEED
    envs: int = 64  # number of parallel environments
    steps: int = 96_000  # environment steps, summed over all environments
    profile: str = "default"
    task_options: Mapping[str, object] = field(default_factory=dict)
    settings: Mapping[str, object] = field(default_factory=dict)
    evaluate_every: int = 6_400  # environment steps
    evaluation_episodes: int = 100
    checkpoint_every: int | None = None  # environment steps; the default is evaluate_every

    def __post_init__(self) -> None:
        """Check the fields; task options and settings are checked when they are used."""
        for name, value, problem in problems_of(self):
            raise InputInvalid(f"{name} {value!r}; {problem}")

    @property
    def name(self) -> str:
        """The name of the folder: "transition_1-sac-0"."""
        return f"{short_name(self.task)}-{self.algorithm or 'auto'}-{self.seed}"

    def changed(self, **changes: Any) -> TrainingConfig:
        """Return a copy with other fields.

        Task options and settings are merged with the present ones.
        """
        for name in ("task_options", "settings"):
            if name in changes:
                changes[name] = merged(getattr(self, name), changes[name])
        return replace(self, **changes)

    def plain(self) -> dict[str, Any]:
        """Return the fields as a mapping of values that JSON and YAML have."""
        return {f.name: plain(getattr(self, f.name)) for f in fields(self)}


def problems_of(config: TrainingConfig) -> list[tuple[str, object, str]]:
    """Return (field, value, what was expected) of each invalid field."""
    found: list[tuple[str, object, str]] = []
    if not isinstance(config.task, str) or (config.task not in TASKS and ":" not in config.task):
        found.append(("task", config.task, f"expected {expected_names(config.task, TASKS)}"))
    for name, known in (("algorithm", ALGORITHMS), ("profile", PROFILES)):
        value = getattr(config, name)
        if value not in known and not (name == "algorithm" and value is None):
            found.append((name, value, f"expected {expected_names(value, known)}"))
    limits = {
        "seed": (0, EVALUATION_SEED - 1),
        "envs": (1, MOST_ENVS),
        "steps": (1, 10**12),
        "evaluate_every": (1, 10**12),
        "evaluation_episodes": (1, 100_000),
        "checkpoint_every": (1, 10**12),
    }
    for name, (least, most) in limits.items():
        value = getattr(config, name)
        if name == "checkpoint_every" and value is None:
            continue
        if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= most:
            found.append((name, value, f"expected a whole number, {least} … {most}"))
    for name in ("task_options", "settings"):
        value = getattr(config, name)
        if not isinstance(value, Mapping) or not all(isinstance(k, str) for k in value):
            found.append((name, value, "expected values by name"))
    return found


def read_config(path: str | Path, **changes: Any) -> TrainingConfig:
    """Read a YAML file with the fields of `TrainingConfig`, then apply `changes`.

    Raises InputInvalid with every mistake and its line.
    """
    path = Path(path)
    if not path.is_file():
        raise InputInvalid(path, "no such file", "a training's configuration (.yaml)")
    text = YamlText(path, "a training's configuration")
    known = [f.name for f in fields(TrainingConfig)]
    if not text.keys([], text.data, known):
        text.refuse()
    given = {k: plain(v) for k, v in text.data.items() if k in known}
    if "task" not in given and "task" not in changes:
        text.wrong([], f"task missing; expected {expected_names('', TASKS)}")
    probe = object.__new__(TrainingConfig)
    for f in fields(TrainingConfig):
        default = {} if f.name in ("task_options", "settings") else f.default
        value = given.get(f.name, next(iter(TASKS)) if f.name == "task" else default)
        object.__setattr__(probe, f.name, value)
    for name, value, problem in problems_of(probe):
        if name in given:
            text.wrong([name], f"{shown(value)}; {problem}")
    algorithm, settings = changes.get("algorithm") or given.get("algorithm"), given.get("settings")
    if algorithm in ALGORITHMS and isinstance(settings, Mapping):
        for key, value in settings.items():
            try:
                check_settings(ALGORITHMS[algorithm], {key: value})
            except InputInvalid as error:
                text.wrong(["settings", key], str(error))
    text.refuse()
    added = {k: changes.pop(k, {}) for k in ("task_options", "settings")}
    return TrainingConfig(**{**given, **changes}).changed(**added)


def merged(old: Mapping[str, object], new: Mapping[str, object]) -> dict[str, object]:
    """Merge two mappings and the mappings inside them; `new` takes precedence."""
    both = dict(old)
    for key, value in new.items():
        inner = both.get(key)
        if isinstance(inner, Mapping) and isinstance(value, Mapping):
            both[key] = merged(inner, value)
        else:
            both[key] = value
    return both
