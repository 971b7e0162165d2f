"""Co-simulation of a system: many components become one simulation.

It may import `fmus` and `models`. Its packages are layers, from top to bottom: `shipped`,
`running`; `ssp`, `osp`, `scenarios`, `recording`; `master`, `plan`, `system`; `python`,
`parameters`; `values`. Each imports only layers below it. Start reading with `running/run.py`;
the stepping loop is called in `master/master.py`, and is in C in the folder
``orchestrator/core`` at the top. The shipped systems are in ``orchestrator/systems``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from uuvsim_cosim.lazy import lazy

if TYPE_CHECKING:
    from uuvsim_cosim.orchestrator.master.faults import Fault
    from uuvsim_cosim.orchestrator.master.master import Master
    from uuvsim_cosim.orchestrator.master.prepared import prepare
    from uuvsim_cosim.orchestrator.plan.flatten import flatten
    from uuvsim_cosim.orchestrator.ssp.ssd import write_ssd
    from uuvsim_cosim.orchestrator.system.system import System

__all__ = [
    "Fault",
    "Master",
    "System",
    "flatten",
    "prepare",
    "write_ssd",
]

__getattr__, __dir__ = lazy(
    __name__,
    {
        "Fault": "master.faults",
        "Master": "master.master",
        "System": "system.system",
        "flatten": "plan.flatten",
        "prepare": "master.prepared",
        "write_ssd": "ssp.ssd",
    },
)
