"""Components made ready: each distinct declaration is compiled once, then instantiated."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.orchestrator.plan import Plan, PlannedComponent
from uuvsim_cosim.orchestrator.sources import Backend, ModelSource, resolve

__all__ = ["Progress", "prepare"]

Progress = Callable[[str, float, float], None]  # stage, done, total


def prepare(
    plan: Plan, backend: Backend = "fmu", progress: Progress | None = None
) -> Callable[[PlannedComponent], Component]:
    """Compile the plan's declarations side by side, and give what instantiates a component.

    ``progress("building", done, total)`` is called after each. Raises ToolchainError.
    """
    declared = {c.source for c in plan.components if c.source.startswith("model:")}
    built: dict[str, Path] = {}
    total = len(declared)
    if progress is not None and total:
        progress("building", 0, total)
    if backend == "fmu":
        workers = max(1, min(len(declared), os.cpu_count() or 1))
        with ThreadPoolExecutor(workers) as pool:
            waiting = {pool.submit(_fmu, source): source for source in sorted(declared)}
            try:
                for done, future in enumerate(as_completed(waiting), start=1):
                    built[waiting[future]] = future.result()
                    if progress is not None:
                        progress("building", done, total)
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise

    def instantiate(planned: PlannedComponent) -> Component:
        fmu = built.get(planned.source)
        source = resolve(str(fmu) if fmu is not None else planned.source)
        return source.instantiate(planned.path, backend=backend)

    return instantiate


def _fmu(source: str) -> Path:
    from uuvsim_cosim.fmus.export import build_fmu

    return build_fmu(ModelSource(source).declare(), fmi=3)
