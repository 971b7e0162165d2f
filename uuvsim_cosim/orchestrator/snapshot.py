"""A snapshot: the state of a whole system at a communication point, in memory or in a file."""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from uuvsim_cosim.cache import content_hash
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.orchestrator.core_tables import Tables
from uuvsim_cosim.orchestrator.faults import Fault, KeptFault
from uuvsim_cosim.orchestrator.plan import Plan
from uuvsim_cosim.orchestrator.slots import read_blob, write_blob

__all__ = ["SCHEMA_VERSION", "Snapshot", "get_slots", "load_snapshot", "plan_hash", "save_snapshot",
           "set_slots"]  # fmt: skip

SCHEMA_VERSION = 1


@dataclass(frozen=True)
class Slots:
    """The loop's values: visible and fresh slots, and the texts that some of them point to."""

    numbers: bytes
    texts: tuple[bytes, ...]


@dataclass(frozen=True)
class Snapshot:
    """States by component (in the plan's order), the loop's values and clock; immutable.

    `slots` and `clock` are None for a snapshot taken in Initialization Mode, `states` holds
    None for a component that cannot copy its state (then only `reset` can use it).
    """

    plan: str
    states: tuple[Any, ...]
    slots: Slots | None = None
    clock: tuple[int, tuple[int, ...]] | None = None
    faults: tuple[KeptFault, ...] = ()


def plan_hash(plan: Plan) -> str:
    """Hash what makes states of a plan fit: components, variables, steps, transfers, groups."""
    parts = [str(plan.tick), repr(plan.groups)]
    for c in plan.components:
        parts.append(f"{c.path} {c.description.name} {c.description.token} {c.step_ticks}")
        variables = c.description.variables.values()
        parts += [f"{v.name} {v.type} {v.causality} {v.shape} {v.units}" for v in variables]
    for t in plan.transfers:
        ends = (t.source, t.source_variable.name, t.target, t.target_variable.name)
        parts.append(f"{ends} {t.source_elements} {t.target_elements} {t.factor!r} {t.offset!r}")
    return content_hash(parts)


def get_slots(tables: Tables) -> Slots:
    """Copy the loop's values."""
    core = tables.core
    texts = [read_blob(core.slots, s) for s in _texts(tables)]
    texts += [read_blob(core.fresh, s) for s in _texts(tables, outputs_only=True)]
    return Slots(core.slots.tobytes() + core.fresh.tobytes(), tuple(texts))


def set_slots(tables: Tables, slots: Slots) -> None:
    """Restore what `get_slots` gave; pointers to texts stay, texts are written."""
    core = tables.core
    both = np.frombuffer(slots.numbers, np.uint64).reshape(2, -1)
    pointers = np.zeros(len(core.slots), bool)
    pointers[_texts(tables)] = True
    for live, kept in zip((core.slots, core.fresh), both, strict=True):
        live[~pointers] = kept[~pointers]
    texts = iter(slots.texts)
    for s in _texts(tables):
        write_blob(core.slots, s, next(texts))
    for s in _texts(tables, outputs_only=True):
        write_blob(core.fresh, s, next(texts))


def _texts(tables: Tables, outputs_only: bool = False) -> list[int]:
    placed = [*([] if outputs_only else tables.inputs.values()), *tables.outputs.values()]
    return [s for p in placed if p.variable.type in ("String", "Binary") for s in p.slots]


def save_snapshot(
    snapshot: Snapshot, path: Path, plan: Plan, components: Sequence[Component]
) -> None:
    """Write a snapshot to a file, at once or not at all; raises FmuError, InputInvalid."""
    if snapshot.slots is None or snapshot.clock is None:
        raise InputInvalid(
            "a snapshot of Initialization Mode cannot be written; expected one taken later"
        )
    header = {
        "schema_version": SCHEMA_VERSION,
        "plan": snapshot.plan,
        "tick": snapshot.clock[0],
        "due": snapshot.clock[1],
        "texts": [len(t) for t in snapshot.slots.texts],
        "components": [c.path for c in plan.components],
        "faults": [
            [k.number, k.fault.signal, k.fault.kind, k.fault.value,
             [[head, past.hex()] for head, past in k.past]]
            for k in snapshot.faults
        ],
    }  # fmt: skip
    data = [
        component.serialize_fmu_state(state)
        for component, state in zip(components, snapshot.states, strict=True)
    ]
    fresh = path.with_name(path.name + ".part")
    try:
        with zipfile.ZipFile(fresh, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("snapshot.json", json.dumps(header, indent=1))
            archive.writestr("slots", snapshot.slots.numbers)
            archive.writestr("texts", b"".join(snapshot.slots.texts))
            for i, state in enumerate(data):
                archive.writestr(f"states/{i}", state)
        os.replace(fresh, path)
    except OSError as error:
        fresh.unlink(missing_ok=True)
        raise InputInvalid(
            f"snapshot {path}: cannot be written ({error.strerror}); expected a folder that can"
        ) from error


def load_snapshot(path: Path, plan: Plan, components: Sequence[Component]) -> Snapshot:
    """Read a snapshot of the same plan; raises InputInvalid for any other."""
    try:
        with zipfile.ZipFile(path) as archive:
            header = json.loads(archive.read("snapshot.json"))
            _check(header, path, plan)
            texts = archive.read("texts")
            slots = Slots(archive.read("slots"), tuple(_split(texts, header["texts"])))
            data = [archive.read(f"states/{i}") for i in range(len(plan.components))]
    except OSError as error:
        raise InputInvalid(f"snapshot {path}: cannot be read ({error.strerror})") from error
    except (zipfile.BadZipFile, KeyError, ValueError) as error:
        raise InputInvalid(
            f"snapshot {path}: is no snapshot, or damaged ({error}); expected a file written by "
            "save_snapshot"
        ) from error
    states = [c.deserialize_fmu_state(d) for c, d in zip(components, data, strict=True)]
    clock = header["tick"], tuple(header["due"])
    faults = tuple(
        KeptFault(number, Fault(*fault), tuple((head, bytes.fromhex(p)) for head, p in past))
        for number, *fault, past in header.get("faults", ())
    )
    return Snapshot(header["plan"], tuple(states), slots, clock, faults)


def _split(data: bytes, sizes: Sequence[int]) -> list[bytes]:
    parts, at = [], 0
    for size in sizes:
        parts.append(data[at : at + size])
        at += size
    return parts


def _check(header: Mapping[str, Any], path: Path, plan: Plan) -> None:
    if header["schema_version"] != SCHEMA_VERSION:
        raise InputInvalid(
            f"snapshot {path}: has schema version {header['schema_version']}; expected "
            f"{SCHEMA_VERSION}, so one written by this version of the package"
        )
    if header["plan"] == plan_hash(plan):
        return
    theirs, ours = set(header["components"]), {c.path for c in plan.components}
    differing = ", ".join(sorted(theirs ^ ours)) or "their variables, steps or connections"
    raise InputInvalid(
        f"snapshot {path}: is of another system (plan {header['plan']}; they differ in "
        f"{differing}); expected one of plan {plan_hash(plan)}"
    )
