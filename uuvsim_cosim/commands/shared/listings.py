"""Tables of models, systems and environments, kept until a file changes.

A later listing needs no NumPy.
"""

from __future__ import annotations

from importlib import import_module
from inspect import getdoc

from uuvsim_cosim.content import content
from uuvsim_cosim.models.declaration.files_read import kept_until_changed, noted

__all__ = ["listed_environments", "listed_models", "listed_systems"]


@kept_until_changed
def listed_environments(_: str) -> tuple[tuple[str, str], ...]:
    """Return the id of each environment, and the first paragraph on its task."""
    from uuvsim_cosim.envs.registration import SHIPPED

    rows = []
    for id, target in SHIPPED.items():
        module, _, name = target.partition(":")
        text = getdoc(getattr(import_module(module), name)) or ""
        rows.append((id, " ".join(text.split("\n\n")[0].split())))
    return tuple(rows)


@kept_until_changed
def listed_models(_: str) -> tuple[tuple[str, str], ...]:
    """Return the name and the description of each model."""
    from uuvsim_cosim.models.declaration.library import IN_PROCESS, available
    from uuvsim_cosim.orchestrator.system.sources import ModelSource

    noted(content("models", "vehicles") / "any")  # its folder: a new vehicle is listed
    rows = []
    for name in available():
        description = ModelSource(f"model:{name}").describe().description
        rows.append((name, " ".join(description.split())))
    rows += [(name, f"Python component, in process only: {where}")
             for name, where in IN_PROCESS.items()]  # fmt: skip
    return tuple(rows)


@kept_until_changed
def listed_systems(_: str) -> tuple[tuple[str, int, str], ...]:
    """Return the name, the number of components and the description of each system."""
    from uuvsim_cosim.orchestrator.running.library import available, load

    for file in content("orchestrator", "systems").rglob("*"):
        noted(file)
    rows = []
    for name in available():
        system = load(name)
        rows.append((name, len(system.components), " ".join(system.description.split())))
    return tuple(rows)
