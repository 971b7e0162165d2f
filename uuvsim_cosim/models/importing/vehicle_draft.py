"""A vehicle that was read or estimated, as the folder that every other vehicle is."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.hull_parameters import meaning_of
from uuvsim_cosim.models.declaration.modeline import BY_FILE_NAME, headed, keep_schemas
from uuvsim_cosim.models.declaration.parameter_files import Quantity, vehicle_file

__all__ = ["Draft", "PlacedThruster", "check_id", "quoted", "row_of", "write_draft"]


@dataclass(frozen=True)
class PlacedThruster:
    """A thruster: its name, its place r [m] from CO and its direction e, both in b (FRD)."""

    name: str
    r: Sequence[float]
    e: Sequence[float]


@dataclass(frozen=True)
class Draft:
    """One parameter set with its file's other data.

    `known` lists closed forms that it violates, and `files` other files of the folder by name.
    """

    set_name: str
    description: str
    citation: str
    obtained: str
    quantities: Mapping[str, Quantity]
    size: tuple[float, float, float]
    at: tuple[float, float, float]
    shape: str
    size_source: str
    readme: str
    known: Mapping[str, str] = field(default_factory=dict)
    thrusters: tuple[PlacedThruster, ...] = ()
    thrusters_source: str = ""
    files: Mapping[str, str] = field(default_factory=dict)


def check_id(id: str) -> str:
    """Return the id; raises InputInvalid if no vehicle can have it."""
    if not re.fullmatch(r"[a-z][a-z0-9_]*", id):
        raise InputInvalid(f"vehicle {id!r}", "lower case letters, digits and _, as my_rov")
    return id


def write_draft(draft: Draft, folder: Path) -> Path:
    """Write the folder, whole and checked, or nothing; raises InputInvalid if one is there."""
    id = check_id(folder.name)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputInvalid(f"{folder} exists already", "an unused name")
    for name in draft.quantities:
        assert meaning_of(name) is not None, name
    where = f", at: [{_listed(draft.at, '.6g')}]" if any(draft.at) else ""
    parameters = (
        f"# {id}: hull. Each number stands with its unit and source; what is left out is zero.\n"
        "# Frames: body FRD (x ahead, y starboard, z down) with its origin CO, world NED.\n"
        f"id: {id}\n"
        f"description: {quoted(draft.description)}\n"
        "frames: {body: FRD, world: NED}\n"
        f"size: {{value: [{_listed(draft.size, '.6g')}]{where}, unit: m, shape: {draft.shape}, "
        f"source: {quoted(draft.size_source)}}}\n"
        f"default: {draft.set_name}\n"
        "sets:\n"
        f"  {draft.set_name}:\n"
        f"    citation: {quoted(draft.citation)}\n"
        f"    obtained: {quoted(draft.obtained)}\n"
        "    parameters:\n"
    )
    parameters += "".join(row_of(name, quantity) for name, quantity in draft.quantities.items())
    texts = {"parameters.yaml": parameters, "README.md": f"# {id}\n\n{draft.readme}", **draft.files}
    if draft.thrusters:
        rows = [
            f"  - name: {quoted(t.name)}\n"
            f"    r: {{value: [{_listed(t.r, '.9g')}], unit: m}}\n"
            f'    e: {{value: [{_listed(t.e, ".9g")}], unit: "1"}}\n'
            for t in draft.thrusters
        ]
        texts["thrusters.yaml"] = (
            "# Thrusters: r from CO, and direction e of positive thrust, both in b (FRD).\n"
            f"vehicle: {id}\n"
            f"source: {quoted(draft.thrusters_source)}\n"
            "model: thruster\n"
            "thrusters:\n" + "".join(rows)
        )
    if draft.known:
        rows = [
            f"  - {{check: {check}, set: {draft.set_name}, because: {quoted(because)}}}\n"
            for check, because in draft.known.items()
        ]
        head = "# Closed forms that this set does not keep, and why.\n"
        texts["checks.yaml"] = f"{head}vehicle: {id}\nknown:\n" + "".join(rows)
    made = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            schema = BY_FILE_NAME.get(name)
            (folder / name).write_text(headed(schema, text) if schema else text, encoding="utf-8")
        vehicle_file(str(folder / "parameters.yaml"))
        keep_schemas(*(folder / name for name in texts))
    except (OSError, InputInvalid) as error:
        for name in texts:
            (folder / name).unlink(missing_ok=True)
        if made and folder.is_dir():
            folder.rmdir()
        if isinstance(error, OSError):
            raise InputInvalid(f"{folder}: cannot be written: {error.strerror}") from None
        raise
    return folder


def _listed(values: Sequence[float], digits: str) -> str:
    return ", ".join(f"{v + 0.0:{digits}}" for v in values)


def quoted(text: str) -> str:
    """Write a text as YAML's double-quoted scalar, on one line."""
    return json.dumps(" ".join(text.split()), ensure_ascii=False)


def row_of(name: str, quantity: Quantity) -> str:
    """Return the line of one number in a parameters.yaml."""
    unit = quantity.unit
    text = f'"{unit}"' if unit == "1" or "(" in unit else unit
    value = f"{quantity.value:.9g}"
    return f"      {name}: {{value: {value}, unit: {text}, source: {quoted(quantity.source)}}}\n"
