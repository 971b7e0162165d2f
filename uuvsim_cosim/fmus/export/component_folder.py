"""The folder of a shipped component in ``fmus/components/``: its interface and its results."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from uuvsim_cosim.content import content
from uuvsim_cosim.fmus.codegen.describe import describe
from uuvsim_cosim.fmus.codegen.lowering import lower
from uuvsim_cosim.fmus.export.documentation import csv_text, variables_markdown
from uuvsim_cosim.fmus.export.experiment import reference_result
from uuvsim_cosim.fmus.export.fmu_file import compile_fmu
from uuvsim_cosim.fmus.export.model_description import model_description
from uuvsim_cosim.models.declaration.library import available, declare
from uuvsim_cosim.models.declaration.model import Model

__all__ = ["folder_texts", "shipped", "stale", "write_all", "write_folder"]

TOLERANCE = 1e-9  # of a reference result, relative to the largest value of its column


def write_folder(model: Model, root: Path | None = None) -> Path:
    """Write the folder of a component below `root`, by default ``fmus/components/``."""
    folder = (content("fmus", "components") if root is None else root) / model.name
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in folder_texts(model).items():
        (folder / name).write_text(text)
    return folder


def write_all(root: Path | None = None) -> list[Path]:
    """Write the folders of all components of the library below `root`; return them.

    Each folder holds modelDescription.xml, variables.md, input.csv and reference.csv of the
    component with its default parameter set. Without `root`, they are those of this package.
    Raises ToolchainError without a compiler.

    Example:

    >>> from pathlib import Path
    >>> from uuvsim_cosim.fmus import write_all
    >>> folders = write_all(Path("components"))
    >>> folders[0].name, sorted(file.name for file in folders[0].iterdir())
    ('allocation', ['input.csv', 'modelDescription.xml', 'reference.csv', 'variables.md'])
    """
    return [write_folder(declare(name), root) for name in available() if "@" not in name]


def stale(model: Model, folder: Path) -> list[str]:
    """Return the files of a component's folder that differ from those of its declaration now."""
    wrong = []
    for name, text in folder_texts(model).items():
        file = folder / name
        there = file.read_text() if file.is_file() else ""
        same = _close(there, text) if name == "reference.csv" else there == text
        if not same:
            wrong.append(name)
    return wrong


def shipped(root: Path | None = None) -> list[str]:
    """Return the names of the components that have a folder."""
    top = content("fmus", "components") if root is None else root
    return sorted(p.parent.name for p in top.glob("*/modelDescription.xml"))


def folder_texts(model: Model) -> dict[str, str]:
    """Return the files of a component's folder.

    The model description is that of FMI 3.0, with a token and a tool that do not change with
    every build, so that a difference is always one of the interface.
    """
    lowered = lower(model)
    description = describe(model, lowered.equations)
    given, results = reference_result(lowered, compile_fmu(lowered))
    return {
        "modelDescription.xml": model_description(
            lowered.equations, fmi=3, token="of each build", release=False
        ),
        "variables.md": variables_markdown(description),
        "input.csv": csv_text(description.of("input"), given),
        "reference.csv": csv_text(description.of("output"), results),
    }


def _close(there: str, now: str) -> bool:
    """Return whether two CSV tables have the same columns, and numbers within the tolerance."""
    tables = [list(csv.reader(text.splitlines())) for text in (there, now)]
    if not tables[0] or tables[0][0] != tables[1][0] or len(tables[0]) != len(tables[1]):
        return False
    old, new = (np.array(rows[1:], dtype=float) for rows in tables)
    scale = np.maximum(np.max(np.abs(new), axis=0), 1e-12)
    return bool(np.all(np.abs(old - new) <= TOLERANCE * scale))
