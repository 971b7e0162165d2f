"""A system's WebAssembly in node: its outputs at all communication points, and their hash."""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import ToolchainError
from uuvsim_cosim.kernels.web_assembly.events import timeline_events
from uuvsim_cosim.kernels.web_assembly.module import WebAssembly
from uuvsim_cosim.orchestrator.scenarios.scenario import Scenario

__all__ = ["NodeRun", "node", "run_in_node"]

SCRIPTS = ("system.js", "timeline.js", "node_run.js")


@dataclass(frozen=True, eq=False)
class NodeRun:
    """A run in node: its hash, and `rows` (points, elements) of outputs if they were recorded."""

    hash: str
    steps: int  # made; fewer than were asked for after a failure
    failure: str  # which value is not finite; empty: none
    seconds: float  # of the processor, for the steps
    imports: tuple[str, ...]  # functions that the module needs from outside
    rows: NDArray[np.float64]


def node() -> str | None:
    """Return the path of node, or None if this machine has none."""
    return shutil.which("node")


def run_in_node(
    compiled: WebAssembly,
    steps: int,
    *,
    seed: int = 0,
    start: Mapping[str, Sequence[float]] | None = None,
    scenario: Scenario | None = None,
    record: bool = True,
) -> NodeRun:
    """Run a system in node; `start` sets inputs and parameters by name, element by element.

    Raises InputInvalid for a wrong event of the scenario, and ToolchainError without node, or if
    node fails.
    """
    program = node()
    if program is None:
        raise ToolchainError("node is missing", "node 18 or newer on the PATH")
    own, plan = files("uuvsim_cosim.kernels.web_assembly"), compiled.parts.fused.plan
    script = "".join(own.joinpath(n).read_text("utf-8") for n in SCRIPTS)
    with tempfile.TemporaryDirectory() as folder:
        task = {
            "table": compiled.table,
            "module": str(compiled.module),
            "steps": steps,
            "seed": seed,
            "start": {name: [float(v) for v in values] for name, values in (start or {}).items()},
            "events": [] if scenario is None else timeline_events(plan, scenario),
            "record": record,
        }
        Path(folder, "task.json").write_text(json.dumps(task), encoding="utf-8")
        done = subprocess.run(
            [program, "-e", script, folder], capture_output=True, text=True, check=False
        )
        if done.returncode:
            reason = next((s for s in done.stderr.splitlines() if "Error" in s), "no message")
            raise ToolchainError(f"node failed with status {done.returncode}: {reason}")
        found = json.loads(done.stdout)
        columns = sum(row["size"] for row in task["table"]["output"])  # type: ignore[index]
        rows = np.fromfile(Path(folder, "rows.bin")).reshape(-1, columns)
    return NodeRun(
        found["hash"], found["steps"], found["failure"], found["seconds"],
        tuple(found["imports"]), rows,
    )  # fmt: skip
