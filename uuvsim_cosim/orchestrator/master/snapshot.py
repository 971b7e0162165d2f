"""Snapshots: the state of a whole system at a communication point, in memory or in a file."""

from __future__ import annotations

import itertools
import json
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

from uuvsim_cosim.cache import content_hash, whole_file
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.component import BindingKind, Component
from uuvsim_cosim.orchestrator.master.core_library import read_blob, write_blob
from uuvsim_cosim.orchestrator.master.core_tables import Tables
from uuvsim_cosim.orchestrator.master.faults import Fault, Faults, KeptFault
from uuvsim_cosim.orchestrator.plan.plan import Plan

__all__ = ["SCHEMA_VERSION", "LoopState", "Snapshot", "load_snapshot", "plan_hash", "save_snapshot"]

SCHEMA_VERSION = 2


@dataclass(frozen=True)
class Snapshot:
    """The loop's image (see `Core.get_image`), its texts, and the states of other components.

    States are in the plan's order; those of native components are None, because the image holds
    them. Immutable. A snapshot of Initialization Mode has no image and is used by `reset` only:
    its `states` are those of all components, None for one that cannot copy its state.
    """

    plan: str
    states: tuple[object, ...]
    image: bytes | None = None
    texts: tuple[bytes, ...] = ()
    faults: tuple[KeptFault, ...] = ()
    layout: str = ""  # hash of the slots of the variables in the image

    def with_state(self, i: int, state: object) -> Snapshot:
        """Return the snapshot with another state of component i."""
        return replace(self, states=(*self.states[:i], state, *self.states[i + 1 :]))


def plan_hash(plan: Plan) -> str:
    """Hash all parts of a plan on which states depend: components, steps, transfers, groups."""
    parts = [str(plan.tick), repr(plan.groups)]
    for c in plan.components:
        parts.append(f"{c.path} {c.description.name} {c.description.token} {c.step_ticks}")
        variables = c.description.variables.values()
        parts += [f"{v.name} {v.type} {v.causality} {v.shape} {v.units}" for v in variables]
    for t in plan.transfers:
        ends = (t.source, t.source_variable.name, t.target, t.target_variable.name)
        parts.append(f"{ends} {t.source_elements} {t.target_elements} {t.factor!r} {t.offset!r}")
        parts += [repr(t.table)] if t.table else []
    return content_hash(parts)


def save_snapshot(
    snapshot: Snapshot, path: Path, plan: Plan, components: Sequence[Component]
) -> None:
    """Write a snapshot to a file, never an incomplete one; raises FmuError, InputInvalid."""
    if snapshot.image is None:
        raise InputInvalid("a snapshot of Initialization Mode cannot be written", "one taken later")
    header = {
        "schema_version": SCHEMA_VERSION,
        "plan": snapshot.plan,
        "layout": snapshot.layout,
        "texts": [len(t) for t in snapshot.texts],
        "components": [c.path for c in plan.components],
        "faults": [
            [k.number, k.fault.signal, k.fault.kind, k.fault.value,
             [[head, past.hex()] for head, past in k.past]]
            for k in snapshot.faults
        ],
    }  # fmt: skip
    # Before the file is opened: a component may refuse to serialize its state.
    data = {
        i: component.serialize_fmu_state(state)
        for i, (component, state) in enumerate(zip(components, snapshot.states, strict=True))
        if state is not None
    }
    try:
        with (
            whole_file(path) as fresh,
            zipfile.ZipFile(fresh, "w", zipfile.ZIP_DEFLATED) as archive,
        ):
            archive.writestr("snapshot.json", json.dumps(header, indent=1))
            archive.writestr("image", snapshot.image)
            archive.writestr("texts", b"".join(snapshot.texts))
            for i, state in data.items():
                archive.writestr(f"states/{i}", state)
    except OSError as error:
        raise InputInvalid(
            f"snapshot {path}",
            f"cannot be written ({error.strerror})",
            "a folder that can be written",
        ) from error


def load_snapshot(path: Path, plan: Plan, components: Sequence[Component]) -> Snapshot:
    """Read a snapshot of the same plan; raises InputInvalid for any other."""
    try:
        with zipfile.ZipFile(path) as archive:
            header = json.loads(archive.read("snapshot.json"))
            if header["schema_version"] != SCHEMA_VERSION:
                raise InputInvalid(
                    f"snapshot {path}",
                    f"has schema version {header['schema_version']}",
                    f"{SCHEMA_VERSION}, as written by this version of the package",
                )
            if header["plan"] != plan_hash(plan):
                differing = set(header["components"]) ^ {c.path for c in plan.components}
                listed = ", ".join(sorted(differing)) or "their variables, steps or connections"
                raise InputInvalid(
                    f"snapshot {path}",
                    f"is of another system (plan {header['plan']}; they differ in {listed})",
                    f"one of plan {plan_hash(plan)}",
                )
            joined = archive.read("texts")
            ends = list(itertools.accumulate(header["texts"], initial=0))
            texts = tuple(joined[a:b] for a, b in itertools.pairwise(ends))
            image = archive.read("image")
            present = set(archive.namelist())
            names = [f"states/{i}" for i in range(len(plan.components))]
            data = [archive.read(n) if n in present else None for n in names]
    except OSError as error:
        raise InputInvalid(f"snapshot {path}: cannot be read ({error.strerror})") from error
    except (zipfile.BadZipFile, zlib.error, KeyError, ValueError, TypeError,
            NotImplementedError, EOFError) as error:  # fmt: skip
        raise InputInvalid(
            f"snapshot {path}",
            f"is no snapshot, or damaged ({error})",
            "a file written by save_snapshot",
        ) from error
    states = tuple(
        None if d is None else c.deserialize_fmu_state(d)
        for c, d in zip(components, data, strict=True)
    )
    faults = tuple(
        KeptFault(number, Fault(*fault), tuple((head, bytes.fromhex(p)) for head, p in past))
        for number, *fault, past in header.get("faults", ())
    )
    return Snapshot(header["plan"], states, image, texts, faults, header["layout"])


@final
class LoopState:
    """Snapshots of a running loop; `plan` is the hash of its plan.

    The components whose states are not in the image, and the slots that point to texts, are
    looked up once, because snapshots may be frequent.
    """

    def __init__(
        self, plan: str, tables: Tables, components: list[Component], faults: Faults
    ) -> None:
        self._plan = plan
        self._tables, self._core = tables, tables.core
        self._components, self._faults = components, faults
        native = {
            i
            for i, b in zip(tables.order, tables.bindings, strict=True)
            if b.kind == BindingKind.NATIVE
        }
        self._others = [i for i in range(len(components)) if i not in native]
        self._none: tuple[object, ...] = (None,) * len(components)
        outputs = _texts(tables, outputs_only=True)
        self._layout = layout_hash(tables)
        self._texts = [(self._core.slots, s) for s in _texts(tables)]
        self._texts += [(self._core.fresh, s) for s in outputs]

    def take(self) -> Snapshot:
        """Copy the whole state; raises FmuError if a component cannot."""
        states = self._none
        if self._others:
            copies = list(states)
            for i in self._others:
                copies[i] = self._components[i].get_fmu_state()
            states = tuple(copies)
        texts = tuple(read_blob(raw, s) for raw, s in self._texts) if self._texts else ()
        kept = self._faults.kept() if self._faults.active else ()
        image = self._core.get_image()
        return Snapshot(self._plan, states, image, texts, kept, self._layout)

    def restore(self, snapshot: Snapshot, without: int | None = None) -> None:
        """Go back to a snapshot; a component that is to be replaced is left out."""
        image = snapshot.image
        if snapshot.plan != self._plan or image is None:
            raise InputInvalid("restore", "the snapshot is of another system", "one of this master")
        if snapshot.layout != self._layout or len(image) != self._core.image_size:
            raise InputInvalid(
                "restore",
                "the snapshot was taken while other variables were recorded or live",
                "the same `record`, `live` and `held`",
            )
        for i in self._others:
            if i == without:
                continue
            self._components[i].set_fmu_state(snapshot.states[i])
        # Last: if a component refuses its state, the loop's values are still those before.
        self._core.set_image(image)
        for (raw, s), text in zip(self._texts, snapshot.texts, strict=True):
            write_blob(raw, s, text)
        if self._faults.active or snapshot.faults:
            self._faults.restore(snapshot.faults)
        self._tables.forget_inputs()


def layout_hash(tables: Tables) -> str:
    """Hash the slots of the variables: they depend on the plan, on `record`, `live` and `held`."""
    placed = (*tables.inputs.items(), *tables.outputs.items())
    return content_hash([str(tables.order), *(f"{key} {p.slot}" for key, p in placed)])


def _texts(tables: Tables, outputs_only: bool = False) -> Sequence[int]:
    placed = [*([] if outputs_only else tables.inputs.values()), *tables.outputs.values()]
    return [s for p in placed if p.variable.type in ("String", "Binary") for s in p.slots]
