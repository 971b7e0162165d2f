"""State of a whole run, copied and restored: an image of the loop, and the states of components."""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

from uuvsim_cosim.cache import content_hash
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.component import BindingKind, Component
from uuvsim_cosim.orchestrator.master.callback import CallbackBinding
from uuvsim_cosim.orchestrator.master.core_tables import Tables
from uuvsim_cosim.orchestrator.master.faults import Faults
from uuvsim_cosim.orchestrator.master.slots import read_blob, write_blob
from uuvsim_cosim.orchestrator.master.snapshot import Snapshot

__all__ = ["LoopState"]


@final
class LoopState:
    """Takes and restores snapshots of a running loop; `plan` is the hash of its plan.

    What a snapshot has to visit is looked up once: the components whose states are not in the
    image, and the slots that point to texts.
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
            states = self._copied()
        texts = tuple(read_blob(raw, s) for raw, s in self._texts) if self._texts else ()
        kept = self._faults.kept() if self._faults.active else ()
        image = self._core.get_image()
        return Snapshot(self._plan, states, image, texts, kept, self._layout)

    def restore(self, snapshot: Snapshot, without: int | None = None) -> None:
        """Go back to a snapshot; one component may be gone, and is left out."""
        image = snapshot.image
        if snapshot.plan != self._plan or image is None:
            raise InputInvalid(
                "restore: the snapshot is of another system; expected one of this master"
            )
        if snapshot.layout != self._layout or len(image) != self._core.image_size:
            raise InputInvalid(
                "restore: the snapshot was taken while other variables were recorded or live; "
                "expected the same `record`, `live` and `held`"
            )
        for i in self._others:
            if i == without:
                continue
            self._components[i].set_fmu_state(snapshot.states[i])
        self._core.set_image(image)
        for (raw, s), text in zip(self._texts, snapshot.texts, strict=True):
            write_blob(raw, s, text)
        if self._faults.active or snapshot.faults:
            self._faults.restore(snapshot.faults)
        self.forget()

    def forget(self) -> None:
        """Let callbacks set every input at the next step, also those that have not changed."""
        for binding in self._tables.bindings:
            if isinstance(binding, CallbackBinding):
                binding.callbacks.forget()

    def _copied(self) -> tuple[object, ...]:
        states: list[object] = list(self._none)
        for i in self._others:
            states[i] = self._components[i].get_fmu_state()
        return tuple(states)


def layout_hash(tables: Tables) -> str:
    """Hash where values lie in the loop: it depends on the plan and on what is read beside it."""
    placed = (*tables.inputs.items(), *tables.outputs.items())
    return content_hash([str(tables.order), *(f"{key} {p.slot}" for key, p in placed)])


def _texts(tables: Tables, outputs_only: bool = False) -> Sequence[int]:
    placed = [*([] if outputs_only else tables.inputs.values()), *tables.outputs.values()]
    return [s for p in placed if p.variable.type in ("String", "Binary") for s in p.slots]
