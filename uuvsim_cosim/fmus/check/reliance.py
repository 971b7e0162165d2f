"""Features of an FMU that a master may use: reset, snapshots and loops, known before a run."""

from __future__ import annotations

from uuvsim_cosim.fmus.codegen.toolchain import host
from uuvsim_cosim.fmus.importer.read_description import FmuArchive

__all__ = ["reliance"]


def reliance(fmu: FmuArchive) -> dict[str, str]:
    """Return by topic the features that an FMU declares, and how a master manages without them."""
    d = fmu.description
    state, once = d.can_get_and_set_state, d.can_be_instantiated_only_once
    machine = host()
    here = {machine.fmi2, machine.fmi3} & set(fmu.binaries)
    undeclared = [v.name for v in d.of("output") if v.dependencies is None]
    more = f" and {len(undeclared) - 3} more" if len(undeclared) > 3 else ""
    return {
        "run": "yes" if here
        else "yes, its sources are compiled at first use" if fmu.sources
        else f"no: it has no binary for {machine.fmi2}",
        "reset": "restores its state of Initialization Mode" if state
        else "frees the instance, then makes another; nothing is unpacked or loaded again" if once
        else "takes a fresh instance from a pool; nothing is unpacked or loaded again",
        "snapshot": "no: the master refuses, for it cannot copy its state" if not state
        else "in memory and in files" if d.can_serialize_state
        else "in memory; not in files, for it cannot serialize its state",
        "iterated groups": "may be a member" if state
        else "no: refused, for a step cannot be repeated; so is an algebraic loop through it",
        "loops in initialization": "solved with its directional derivatives"
        if d.provides_directional_derivatives else "solved with finite differences",
        "feedthrough": "declared for every output" if not undeclared
        else f"not declared for {', '.join(undeclared[:3])}{more}: taken as none in stepping, "
        "where a loop through it is delayed and named, and as all in initialization",
        "instances": "one in a process; each further one gets a process of its own" if once
        else "any number in one process",
    }  # fmt: skip
