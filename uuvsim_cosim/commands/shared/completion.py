"""Completion in a shell: the names and files that an argument or an option takes.

Folders are left to the shell, which puts no space behind them: a function here returns nothing
where only folders fit.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable, Iterable, Iterator, MutableMapping
from contextlib import contextmanager, redirect_stdout, suppress

import typer

from uuvsim_cosim.errors import UuvsimError

__all__ = [
    "components", "models", "of", "offered", "policies", "replacements",
    "systems", "systems_and_models", "tasks", "vehicles", "whole_words",
]  # fmt: skip

Complete = Callable[[str], list[str]]
_BREAKS = ("=", ":", "@")  # of bash: a word ends before and after each of them


def of(*words: str) -> Complete:
    """Return the completion of an option that takes one of some words."""
    return lambda incomplete: [word for word in words if word.startswith(incomplete)]


def offered(names: Callable[[str], Iterable[str]], *endings: str) -> Complete:
    """Return a completion by names, and by files that have one of the endings."""

    def complete(incomplete: str) -> list[str]:
        found: list[str] = []
        with suppress(UuvsimError, OSError):  # a key press cannot show an error
            found = [name for name in names(incomplete) if name.startswith(incomplete)]
        files = list(_files(incomplete, endings))
        return found + files if found or not all(f.endswith(os.sep) for f in files) else []

    return complete


def _files(incomplete: str, endings: tuple[str, ...]) -> Iterator[str]:
    head, part = os.path.split(incomplete)
    try:
        entries = sorted(os.scandir(os.path.expanduser(head) or "."), key=lambda e: e.name)
    except OSError:
        return
    for entry in entries:
        name = entry.name
        hidden = name.startswith(".") and not part.startswith(".")
        if hidden or not name.startswith(part) or not name.isprintable() or " " in name:
            continue
        if entry.is_dir():
            yield os.path.join(head, name) + os.sep
        elif name.lower().endswith(endings):
            yield os.path.join(head, name)


def _system_names(_: str) -> list[str]:
    from uuvsim_cosim.orchestrator.running.library import available

    return available()


def _model_names(incomplete: str) -> list[str]:
    from uuvsim_cosim.models.declaration.library import available
    from uuvsim_cosim.models.declaration.preset import presets_of

    name, at, _ = incomplete.partition("@")
    sets = [f"{name}@{preset}" for preset in presets_of(name)] if at else []
    return [n for n in available() if at or "@" not in n] + sets


def _system_or_model_names(incomplete: str) -> list[str]:
    if not incomplete.startswith("model:"):
        return [*_system_names(incomplete), "model:"]
    return [f"model:{name}" for name in _model_names(incomplete.removeprefix("model:"))]


def _vehicle_names(_: str) -> list[str]:
    from uuvsim_cosim.models.declaration.parameter_files import vehicle_ids

    return vehicle_ids()


def _task_names(_: str) -> list[str]:
    from uuvsim_cosim.learn.shared.task_ids import TASKS

    return sorted(TASKS)


systems = offered(_system_names, ".ssd", ".ssp", ".fmu", ".xml")
systems_and_models = offered(_system_or_model_names, ".ssd", ".ssp")
models = offered(_model_names)
tasks = offered(_task_names)
vehicles = offered(_vehicle_names)
policies = offered(lambda _: ("scripted", "random"), ".npz")


def components(context: typer.Context, incomplete: str) -> list[str]:
    """Return the components of the system that the command line names before."""
    from uuvsim_cosim.orchestrator.running.library import load

    given = context.params
    # Where an option still lacks its value, the arguments before it are in `args`.
    name = given.get("system") or given.get("name") or next(iter(context.args), None)
    with suppress(UuvsimError, OSError):
        return [c for c in load(str(name)).components if c.startswith(incomplete)] if name else []
    return []


def replacements(context: typer.Context, incomplete: str) -> list[str]:
    """Return `component=source` for the components of the system."""
    component, equals, source = incomplete.partition("=")
    if not equals:
        # Two of each: the shell then writes what they share, and puts no space behind "=".
        found = components(context, incomplete)
        return [f"{c}={prefix}" for c in found for prefix in ("model:", "policy:")]
    if source.startswith("model:"):
        return [
            f"{component}=model:{name}" for name in models(source[6:]) if not name.endswith(os.sep)
        ]
    if source.startswith("policy:"):
        return [f"{component}=policy:{f}" for f in _files(source[7:], (".npz",))]
    words = [w for w in ("model:", "policy:") if w.startswith(source)]
    files = _files(source, (".fmu", ".py", ".ssd", ".ssp"))
    return [f"{component}={each}" for each in [*words, *files]]


@contextmanager
def whole_words(variables: MutableMapping[str, str]) -> Iterator[None]:
    """Complete for bash as for shells that do not break words at "=", ":" and "@".

    Bash passes `imu@sti` as three words and replaces the last one alone.
    """
    if variables.get("_UUVSIM_COMPLETE") != "complete_bash" or "COMP_WORDS" not in variables:
        yield
        return
    given = variables["COMP_WORDS"].split("\n")
    current = int(variables["COMP_CWORD"])
    words: list[str] = []
    for n, word in enumerate([*given, ""][: current + 1]):
        before = given[n - 1] if n else ""
        if words and n and (word.startswith(_BREAKS) or before.endswith(_BREAKS)):
            words[-1] += word
        else:
            words.append(word)
    last = given[current] if current < len(given) else ""
    last = "" if last.startswith(_BREAKS) else last
    option, equals, value = words[-1].partition("=")
    value = value if equals and option.startswith("--") else words[-1]
    cut = len(value) - len(last)
    variables["COMP_WORDS"] = "\n".join(words)
    variables["COMP_CWORD"] = str(len(words) - 1)
    written = io.StringIO()
    try:
        with redirect_stdout(written):
            yield
    finally:
        sys.stdout.write("".join(f"{line[cut:]}\n" for line in written.getvalue().splitlines()))
