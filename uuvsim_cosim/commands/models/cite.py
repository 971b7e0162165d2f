"""`uuvsim cite`: the sources of a system's or a component's models as BibTeX."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from uuvsim_cosim.cache import written
from uuvsim_cosim.commands.shared.answer import answer
from uuvsim_cosim.commands.shared.completion import systems_and_models
from uuvsim_cosim.commands.shared.terminal import file_line, line, put, remark
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from uuvsim_cosim.models.citing.component_sources import Cited
    from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["cite_command"]


def cite_command(
    target: Annotated[
        str,
        typer.Argument(
            autocompletion=systems_and_models,
            help="A system, a component (imu@stim300), a vehicle as id@set, a study file, or the "
            "folder of a run or a study.",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="The .bib file; printed if not given."),
    ] = None,
) -> None:
    """Print the sources of all models of a system as BibTeX.

    Each source is one entry. Its note names the components that use it, with their parameter sets
    and equations. A source without an entry is printed as a comment.
    """
    if out is not None and out.suffix.lower() != ".bib":
        raise InputInvalid(out, f"ending {out.suffix!r} was read", ".bib")
    from uuvsim_cosim.models.citing.citations import citations

    found = citations(*_cited(target))
    text = found.bibtex(target)
    put("entries", [
        {"key": e.key, "type": e.type, **e.fields, "used_by": uses} for e, uses in found.entries
    ])  # fmt: skip
    put("own", [{"meaning": meaning, "used_by": uses} for meaning, uses in found.own])
    put("unresolved", [{"source": source, "used_by": uses} for source, uses in found.unresolved])
    if out is None:
        put("bibtex", text)
        if answer().mode != "json":
            line(text)
        return
    written(out, text)
    file_line(out)
    for source, _ in found.unresolved:
        remark("warning", f"no entry for the source: {source}")


def _cited(target: str) -> tuple[dict[str, str], list[Cited]]:
    """Return the sources of the components that a target stands for, and of a study's draws."""
    from uuvsim_cosim.models.declaration.library import ALIASES, IN_PROCESS, LIBRARY
    from uuvsim_cosim.models.declaration.library import available as models
    from uuvsim_cosim.models.declaration.near_names import did_you_mean
    from uuvsim_cosim.models.declaration.parameter_files import is_vehicle, split_address
    from uuvsim_cosim.orchestrator.running.library import available, load

    path = Path(target).expanduser()
    if (path / "study.json").is_file():
        return _of_study_folder(path)
    if path.suffix in (".yaml", ".yml") and path.is_file() and (found := _of_study_file(path)):
        return found
    name = target.removeprefix("model:").partition("?")[0]
    id = split_address(name)[0]
    is_component = id in (*LIBRARY, *ALIASES, *IN_PROCESS) or is_vehicle(id)
    if (path / "system.ssd").is_file():
        return _components(load(path / "system.ssd")), []
    if is_component and target not in available():
        return {name: f"model:{target.removeprefix('model:')}"}, []
    if path.is_dir():
        raise InputInvalid(
            path, "a folder without a system that was simulated", "the folder of a run or a study"
        )
    if target not in available() and not path.suffix:  # `load` knows what is wrong with a file
        near = did_you_mean(target, [*available(), *models(), *ALIASES, *IN_PROCESS])
        raise InputInvalid(
            f"there is no system or component {target!r}{near}",
            "one that `uuvsim systems` or `uuvsim models` lists, or the path of a file or folder",
        )
    return _components(load(target)), []


def _of_study_folder(folder: Path) -> tuple[dict[str, str], list[Cited]]:
    """Return what a study's folder cites: its own copy of the system, and the noted sources."""
    from uuvsim_cosim.orchestrator.running.library import load

    if not (folder / "system.ssd").is_file():
        raise InputInvalid(
            folder,
            "the folder of a study without the system that was simulated (system.ssd)",
            "the system's .ssd or the study's YAML file; cite that file instead",
        )
    file = folder / "study.json"
    try:
        sources = json.loads(file.read_text(encoding="utf-8"))["sources of the draws"]
        drawn = _drawn((str(place), str(text)) for place, text in sources)
    except (OSError, ValueError, KeyError, TypeError):
        raise InputInvalid(file, "cannot be read as a study", "a file of `uuvsim study`") from None
    return _components(load(folder / "system.ssd")), drawn


def _of_study_file(file: Path) -> tuple[dict[str, str], list[Cited]] | None:
    """Return what a study's YAML file cites; None for the parameter file of a vehicle."""
    from uuvsim_cosim.commands.editor.file_checks import schema_of
    from uuvsim_cosim.models.declaration.yaml_text import YamlText
    from uuvsim_cosim.studies import Study

    schema = schema_of(file, file.read_text(encoding="utf-8"), YamlText(file).data)
    if schema == "vehicle":
        return None
    if schema != "study":
        read = "a YAML file of no known form" if schema is None else f"a file of the form {schema}"
        raise InputInvalid(file, read, "a study file, a vehicle's parameters.yaml, or a system")
    study = Study.read(file)
    return _components(study.system), _drawn(study.sources)


def _components(system: System) -> dict[str, str]:
    from uuvsim_cosim.orchestrator.plan.flatten import plan_to_inspect

    return {c.path: c.source for c in plan_to_inspect(system)[0].components}


def _drawn(sources: Iterable[tuple[str, str]]) -> list[Cited]:
    from uuvsim_cosim.models.citing.component_sources import Cited

    return [Cited(text, place, "/".join(Path(place).parts[-2:])) for place, text in sources]
