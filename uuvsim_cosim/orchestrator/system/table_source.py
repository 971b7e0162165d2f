"""CSV file as a component: its columns over time are outputs (as OMSimulator's tables)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.fmus.importer.input_csv import Series, read_input_csv
from uuvsim_cosim.orchestrator.python.component import PythonComponent
from uuvsim_cosim.orchestrator.system.sources import Backend

__all__ = ["TableSource"]


@dataclass(frozen=True)
class TableSource:
    """A table whose first column is the time [s]; the others are Float64 outputs without units.

    Between two times outputs are interpolated linearly; before the first and after the last they
    are held. Of two rows at one time the later one is used.
    """

    path: Path
    kind: str = "table"

    @property
    def text(self) -> str:
        """Return the absolute path."""
        return str(self.path)

    def describe(self) -> Description:
        """Read the file for its columns; raises InputInvalid by line and column."""
        return self.instantiate("description").description

    def instantiate(self, path: str, *, backend: Backend = "fmu") -> Component:
        """Make a component whose outputs are the columns; the stepping loop calls Python for it."""
        series = _series(self.path)

        class Table:
            """Columns of a file over time."""

            inputs: ClassVar[dict[str, object]] = {}
            outputs: ClassVar[dict[str, object]] = dict.fromkeys(s.variable.name for s in series)

            def initialize(self, t: float) -> dict[str, float]:
                return {s.variable.name: float(s.at(t)) for s in series}

            def step(self, t: float, dt: float, u: dict[str, object]) -> dict[str, float]:
                return self.initialize(t + dt)

        Table.__name__ = Table.__qualname__ = self.path.stem
        return PythonComponent(Table, path)


def _series(path: Path) -> list[Series]:
    """Read the columns, named by the file itself."""
    import csv

    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            header = next((row for row in csv.reader(file) if any(row)), [])
    except (OSError, UnicodeDecodeError, csv.Error):
        header = []  # `read_input_csv` reports it
    names = [name.strip() for name in header[1:]]
    if header and not names:
        raise InputInvalid(path, f"only the column {header[0]!r}", "time and others")
    unnamed = next((c for c, name in enumerate(names, 2) if not name), None)
    if unnamed is not None:
        raise InputInvalid(f"{path}, line 1, column {unnamed}", "no name", "one")
    variables = {
        name: Variable(name, "Float64", "input", "continuous") for name in dict.fromkeys(names)
    }
    return read_input_csv(path, Description(path.stem, "python", variables))
