"""run.json of a run: its system, seed, components, times and warnings."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from uuvsim_cosim._version import __version__
from uuvsim_cosim.cache import write_whole
from uuvsim_cosim.orchestrator.plan.algebraic_loops import hops_of
from uuvsim_cosim.orchestrator.plan.loop_delays import loop_delays
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.running.mission import path_of
from uuvsim_cosim.orchestrator.system.sources import Backend
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.strict_json import strict

__all__ = ["SCHEMA_VERSION", "provenance_of", "write_run_json"]

SCHEMA_VERSION = 1


def provenance_of(
    system: System, plan: Plan, seed: int, backend: Backend, record_every: int, end: float,
    about: Mapping[str, object],
) -> dict[str, Any]:  # fmt: skip
    """Return the content of run.json that is known before the first step, and `about`."""
    loops = loop_delays(plan)
    path = path_of(plan)
    return {
        "schema_version": SCHEMA_VERSION,
        "version": __version__,
        "system": system.name,
        "seed": seed,
        "backend": {"fmu": "FMUs", "native": "native components"}[backend],
        "start": float(plan.start),
        "until": end,
        "tick": float(plan.tick),
        "record_every": record_every,
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "loop_delay": float(loops[0].delay) if loops else None,
        "loop_path": str(loops[0]).partition(": ")[2] if loops else "",
        "loops": plan.loops,
        "algebraic_loops": [
            {"hops": hops_of(plan, x), "iterated": x.iterated, "undeclared": list(x.undeclared)}
            for x in plan.algebraic_loops
        ],
        "notes": list(system.notes),
        "warnings": [w for w in plan.warnings if w not in system.notes],
        "waypoints": None if path is None else path.tolist(),
        "components": [
            {
                "path": c.path,
                "kind": c.description.kind if backend == "native" or "model:" not in c.source
                else "FMI 3.0",
                # Without the folders of this machine.
                "source": c.source if c.source.startswith("model:") else Path(c.source).name,
                "token": c.description.token,
                "step": float(c.step_ticks * plan.tick),
            }
            for c in plan.components
        ],
        **about,
    }  # fmt: skip


def write_run_json(path: Path, content: Mapping[str, object]) -> None:
    """Write the file run.json, never an incomplete one; raises OSError."""
    text = json.dumps(strict(content)[0], indent=2, allow_nan=False)
    write_whole(path, f"{text}\n".encode())
