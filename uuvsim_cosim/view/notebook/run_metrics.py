"""Figures of merit of a run as a mapping with units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.orchestrator.running.run import Run
from uuvsim_cosim.view.plots.svg import escape
from uuvsim_cosim.view.recorded.metrics import Figure, figures
from uuvsim_cosim.view.recorded.traces import provenance_of, traces_of
from uuvsim_cosim.view.reports.run_report import waypoints_of

__all__ = ["Metrics", "metrics"]


class Metrics(Mapping[str, float]):
    """Figures of merit by key; `units` and `labels` have the same keys."""

    def __init__(self, found: Sequence[Figure]) -> None:
        self._found = {f.key: f for f in found}
        self.units = {f.key: f.unit for f in found}
        self.labels = {f.key: f.label for f in found}

    def __getitem__(self, key: str) -> float:
        """Return a figure in its unit; raises InputInvalid with similar keys."""
        if key not in self._found:
            raise InputInvalid(f"no metric {key!r}", expected_names(key, sorted(self._found)))
        return self._found[key].value

    def __contains__(self, key: object) -> bool:
        """Return whether the run has this figure."""
        return key in self._found

    def __iter__(self) -> Iterator[str]:
        """Return the keys, in the order of the report."""
        return iter(self._found)

    def __len__(self) -> int:
        """Count the figures."""
        return len(self._found)

    def __repr__(self) -> str:
        """Return a line for each figure: key, value with unit, label."""
        return "\n".join(f"{f.key}: {f} ({f.label})" for f in self._found.values())

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td><code>{f.key}</code></td><td>{escape(str(f))}</td>"
            f"<td>{escape(f.label)}</td></tr>"
            for f in self._found.values()
        )
        return f"<table><tr><th>metric</th><th>value</th><th>meaning</th></tr>{rows}</table>"


def metrics(run: Run) -> Metrics:
    """Compute the figures of merit of a run from its recording, as its report shows them."""
    provenance = provenance_of(run.folder)
    return Metrics(figures(traces_of(run.folder), waypoints_of(provenance)))
