"""Groups of options in the `--help` of commands that have many."""

from __future__ import annotations

from typing import Any

__all__ = ["GROUPS", "OUTPUT", "group"]

OUTPUT = "Output"
_SYSTEM, _TIME, _INPUTS, _CONNECTIONS = "System", "Time", "Inputs", "Connections"
_TASK, _LENGTH = "Task and policy", "Length and evaluation"
_FMU = {
    _SYSTEM: ("--replace", "--set"),
    "FMU": ("--fmi", "--platform", "--signals", "--inputs", "--names"),
    OUTPUT: ("--out",),
}

GROUPS: dict[str, dict[str, tuple[str, ...]]] = {
    "run": {
        _SYSTEM: ("--set", "--replace", "--map", "--loops", "--native", "--isolate", "--watchdog"),
        _TIME: ("--until", "--start", "--rate", "--real-time", "--overruns"),
        _INPUTS: ("--input", "--waypoints", "--origin", "--scenario", "--seed"),
        OUTPUT: ("--out", "--record-every", "--no-report", "--open", "--view", "--port",
                 "--trace-fmi"),
        "One FMU": ("--step", "--interface"),
    },
    "serve": {
        _SYSTEM: ("--set", "--replace", "--map", "--loops", "--fmu", "--seed"),
        _TIME: ("--real-time", "--paused", "--until", "--rate", "--fail-safe"),
        _CONNECTIONS: ("--host", "--port", "--tcp-port", "--http-port"),
        "Access": ("--access", "--anyone", "--no-code"),
        OUTPUT: ("--out", "--no-record"),
    },
    "terrain": {
        "Area": ("--around", "--size", "--resolution"),
        "Reading": ("--datum", "--unit", "--positive", "--crs", "--local"),
        "Surface": ("--land", "--relief", "--fill"),
        OUTPUT: ("--out",),
    },
    "identify": {
        _SYSTEM: ("--system", "--replace", "--set", "--hull"),
        "Recording": ("--map", "--from", "--to", "--step"),
        "Fit": ("--parameters", "--no-proposals"),
        OUTPUT: ("--save-as", "--manoeuvre"),
    },
    "train": {
        _TASK: ("--task-set", "--curriculum", "--profile"),
        "Algorithm": ("--algo", "--set", "--config", "--seed", "--seeds"),
        _LENGTH: ("--envs", "--steps", "--evaluate-every", "--evaluation-episodes", "--ray"),
        OUTPUT: ("--out", "--restart", "--no-report", "--open"),
    },
    "collect": {
        _TASK: ("--policy", "--task-set", "--episodes", "--seed", "--ray"),
        "Recorded runs": ("--recorded", "--signal"),
        OUTPUT: ("--out", "--overwrite"),
    },
    "play": {
        _TASK: ("--policy", "--task-set", "--other-task", "--seed"),
        OUTPUT: ("--out", "--window", "--open", "--view", "--port"),
    },
    "fmu system": _FMU,
    "fmu client": {**_FMU, _CONNECTIONS: ("--host", "--port")},
}  # fmt: skip


def group(path: str, command: Any) -> None:
    """Assign a group to each option of a command, and sort the options by group."""
    groups = GROUPS.get(path)
    if groups is None:
        return
    place = {option: name for name, options in groups.items() for option in options}
    order = list(place)
    for parameter in command.params:
        if (name := place.get(parameter.opts[0])) is not None:
            parameter.rich_help_panel = name
    command.params.sort(key=lambda p: order.index(p.opts[0]) if p.opts[0] in place else -1)
