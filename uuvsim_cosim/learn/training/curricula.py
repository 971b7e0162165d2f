"""Curricula by name, and as a YAML file writes them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.training.curriculum import Curriculum, Promotion, Stage
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.models.declaration.yaml_text import YamlText, plain, shown

__all__ = ["CURRICULA", "curriculum_of", "read_curriculum"]

GOOD = Promotion()
ALONE = {"batch": 256}  # rows for the networks; two agents that share them make 256 of 128
# Normalised critics teach to go closer to a target that rests, for the little that r_a gives, than
# is good once it moves: docs/learning/paper.md.
FIRST = {**ALONE, "normalised": False, "updates": 10.0}

# fmt: off
# The UUVSim paper's four scenarios. What differs from the defaults is what trials have shown:
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
    """Return a curriculum that ships, or read a file's; raises InputInvalid."""
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
    """Read a YAML file with Curriculum's fields, `stages` a list; every mistake with its line."""
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
