"""Preparation of components: each distinct declaration is compiled once, then instantiated."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.isolation.grants import Grants
from uuvsim_cosim.fmus.isolation.isolated import Isolated
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.notebook_bar import Progress
from uuvsim_cosim.orchestrator.master.isolation import isolations
from uuvsim_cosim.orchestrator.plan.plan import Plan, PlannedComponent
from uuvsim_cosim.orchestrator.system.resolve import resolve
from uuvsim_cosim.orchestrator.system.sources import Backend, FmuSource, ModelSource
from uuvsim_cosim.share import compute_in_threads

if TYPE_CHECKING:
    from uuvsim_cosim.fmus.instantiation.instantiate import Isolation
    from uuvsim_cosim.fmus.tracing.trace import Trace

__all__ = ["instance_of", "prepare"]


def prepare(
    plan: Plan,
    backend: Backend = "fmu",
    progress: Progress | None = None,
    isolate: Collection[str] = (),
    watchdog: float | None = 30.0,
    trace: Trace | None = None,
    grants: Mapping[str, Sequence[str]] | None = None,
) -> Callable[[PlannedComponent], Component]:
    """Compile the declarations of a `plan` in parallel; return a function that makes a component.

    `backend` "fmu" makes FMUs, "native" native components; both give the same bits.
    ``progress("building", done, total)`` is called after each. The components that `isolate`
    names by path (or all, by "*") get a process of their own, which fails if it does not answer
    within `watchdog` seconds. An isolated FMU is in a sandbox, to which `grants` by path, such as
    ``{"controller": ["files:/data"]}`` (or by "*"), are exceptions. ``path=wasm``, or "wasm" for
    all, runs FMUs as WebAssembly in this process instead (see `isolations`). FMUs write their calls
    into `trace`. Raises ToolchainError, InputInvalid.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> from uuvsim_cosim.orchestrator import flatten, prepare
    >>> plan = flatten(uuv.System("bench").add("battery", "model:battery"))
    >>> with uuv.Master(plan, prepare(plan, "native")) as master:
    ...     master.initialize()
    ...     print(f"{master.get('battery', 'voltage'):.1f} V")
    16.8 V
    """
    paths = [c.path for c in plan.components]
    isolated = isolations(isolate, paths)
    granted = grants or {}
    for path, texts in granted.items():
        _expect_sandbox(path, plan, isolated, backend)
        Grants.of(texts, f"grants {path}")
    declared = {c.source for c in plan.components if c.source.startswith("model:")}
    built: dict[str, Path] = {}
    total = len(declared)
    if progress is not None and total:
        progress("building", 0, total)
    if backend == "fmu" and declared:

        def build(source: str) -> Path:
            return ModelSource(source).fmu()

        for source, fmu in compute_in_threads(build, sorted(declared), os.cpu_count() or 1):
            built[source] = fmu
            if progress is not None:
                progress("building", len(built), total)

    eventful = {plan.components[i].path for i in plan.event_group_of}
    for path in sorted(eventful):
        if trace is not None or path in isolated:
            other = "--trace-fmi" if trace is not None else "--isolate"
            expected = f"no {other} for it, or a run without events"
            raise InputInvalid(
                f"events: {path}", f"uses Event Mode together with {other}", expected
            )

    def instantiate(planned: PlannedComponent) -> Component:
        fmu = built.get(planned.source)
        text = str(fmu) if fmu is not None else planned.source
        source = resolve(text)
        if trace is not None and isinstance(source, FmuSource):
            return source.traced(planned.path, trace)
        way = isolated.get(planned.path)
        if way is None and planned.path in eventful and isinstance(source, FmuSource):
            return source.with_event_mode(planned.path)
        if way is None:
            return source.instantiate(planned.path, backend=backend)
        texts = (*granted.get("*", ()), *granted.get(planned.path, ()))
        if way != "process":
            if isinstance(source, ModelSource):
                source = FmuSource(source.fmu())
            if way == "wasm" and not isinstance(source, FmuSource):
                raise InputInvalid(
                    f"isolate {planned.path}=wasm",
                    f"a component of the kind {source.kind}",
                    "an FMU",
                )
        if isinstance(source, FmuSource):
            return source.limited(planned.path, way, watchdog, texts)
        made = Isolated(
            planned.path,
            source.describe(),
            instance_of,
            (text, planned.path, backend),
            watchdog=watchdog,
            wait=False,
        )
        if way == "preferred":
            made.lacking.append(
                f"{planned.path} ({source.kind}) is no WebAssembly: it has its own process"
            )
        return made

    return instantiate


def _expect_sandbox(
    path: str, plan: Plan, isolated: Mapping[str, Isolation], backend: Backend
) -> None:
    """Raise InputInvalid for a grant to a component that has no sandbox: it would do nothing."""
    sources = {c.path: c.source for c in plan.components}
    if path not in sources and path != "*" and isolated.keys() == sources.keys():
        raise InputInvalid("grants", f"no component {path!r}", expected_names(path, sources))
    if path not in isolated and not (path == "*" and isolated):
        expected = f"a component of isolate: {', '.join(isolated) or 'there is none'}"
        raise InputInvalid("grants", f"{path!r} is not isolated", expected)
    if path == "*" or isolated[path] != "process":
        return
    source = resolve(sources[path])
    if not isinstance(source, FmuSource) and not (
        isinstance(source, ModelSource) and backend == "fmu"
    ):
        kind = "native" if isinstance(source, ModelSource) else source.kind
        raise InputInvalid(
            "grants", f"{path!r} is a {kind} component, which has no sandbox", "an FMU"
        )


def instance_of(source: str, path: str, backend: Backend) -> Component:
    """Instantiate a source; called in the process of an isolated component."""
    return resolve(source).instantiate(path, backend=backend)
