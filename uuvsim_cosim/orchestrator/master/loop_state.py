"""Copy and restoration of a run's whole state: the loop's image, and the components' states."""

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


def layout_hash(tables: Tables) -> str:
    """Hash the slots of the variables: they depend on the plan, on `record`, `live` and `held`."""
    placed = (*tables.inputs.items(), *tables.outputs.items())
    return content_hash([str(tables.order), *(f"{key} {p.slot}" for key, p in placed)])


def _texts(tables: Tables, outputs_only: bool = False) -> Sequence[int]:
    placed = [*([] if outputs_only else tables.inputs.values()), *tables.outputs.values()]
    return [s for p in placed if p.variable.type in ("String", "Binary") for s in p.slots]
