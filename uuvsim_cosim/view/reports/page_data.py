"""Numbers of a run report's plots, decimated to a budget and encoded for the page's script.

A column keeps the least and the greatest sample of each of at most `PANEL_BINS` intervals of time
(recorded signals: as many intervals as fit into `SIGNAL_BYTES` characters), in the order in which
they occur, so that no peak is lost. A run with fewer samples is kept whole. Each value has 16 bits
between the least and the greatest value of its column.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from uuvsim_cosim.orchestrator.recording.samples import Array, Samples, blocks
from uuvsim_cosim.view.plots.page import encoded
from uuvsim_cosim.view.recorded.traces import Traces

__all__ = ["MOST_ELEMENTS", "PANEL_BINS", "SIGNAL_BYTES", "Bins", "coded", "signal_bins"]

PANEL_BINS = 700  # intervals of the panels that a report shows by default
SIGNAL_BYTES = 700_000  # characters of the recorded signals that the search field adds
SIGNAL_BINS, FEWEST_BINS = 500, 50  # intervals of a recorded signal: at most, at least
MOST_ELEMENTS = 64  # of an array; a longer one is not in the page
CODES = 65_534  # 65535 stands for a value that is not finite


@dataclass(frozen=True)
class Bins:
    """Intervals of time that the columns of one or two runs share."""

    times: Sequence[Array]  # of each run, (T,) [s]
    most: int

    @cached_property
    def exact(self) -> bool:
        """Whether all samples are kept: there are few, at equal times."""
        first = self.times[0]
        same = all(np.array_equal(first, other) for other in self.times[1:])
        return same and len(first) <= 2 * self.most

    @cached_property
    def edges(self) -> Array:
        """The limits of the intervals; none is shorter than the distance of two samples."""
        low, high = min(t[0] for t in self.times), max(t[-1] for t in self.times)
        apart = max(_apart(t) for t in self.times)
        count = int(np.clip((high - low) / max(apart, 1e-12), 1, self.most))
        return np.asarray(np.linspace(low, high, count + 1), float)

    @property
    def x(self) -> Array:
        """The times of a column's values [s]: two in each interval."""
        if self.exact:
            return self.times[0]
        width = self.edges[1] - self.edges[0]
        middle = (self.edges[:-1, None] + width * np.array([0.25, 0.75])).reshape(-1)
        return np.concatenate([self.edges[:1], middle[1:-1], self.edges[-1:]])

    def of(self, samples: Samples, run: int = 0) -> Array:
        """Return the column of samples (T,) of a run."""
        if self.exact:
            return np.asarray(samples)
        starts = np.searchsorted(self.times[run], self.edges[:-1], side="left")
        ends = np.append(starts[1:], len(samples))
        low, high, first, last = np.full((4, len(starts)), np.nan)
        row = 0
        # Samples before the first interval that has some belong to none.
        for block in blocks(samples):
            begins = np.clip(starts - row, 0, len(block))
            stops = np.clip(ends - row, 0, len(block))
            some = np.flatnonzero(stops > begins)
            if len(some):
                low[some] = np.fmin(low[some], np.fmin.reduceat(block, begins[some]))
                high[some] = np.fmax(high[some], np.fmax.reduceat(block, begins[some]))
                begun = some[starts[some] >= row]
                first[begun] = block[begins[begun]]
                last[some] = block[stops[some] - 1]
            row += len(block)
        falls = last < first
        column: Array = np.empty((len(starts), 2))
        column[:, 0], column[:, 1] = np.where(falls, high, low), np.where(falls, low, high)
        return column.reshape(-1)


def _apart(time: Array) -> float:
    """Return the usual distance of two samples [s]: the median of at most 4,096 of them."""
    rows = np.unique(np.linspace(0, len(time) - 2, 4096).astype(np.intp))
    return float(np.median(time[rows + 1] - time[rows]))


def signal_bins(runs: Sequence[Traces], names: Sequence[str]) -> tuple[Bins, list[str]]:
    """Return the intervals in which recorded signals fit, and the names of those that do not.

    Signals that do not fit are arrays of more than `MOST_ELEMENTS` elements, and then the largest.
    """
    sizes: dict[str, int] = {}
    for name in names:
        each_run = [run.size(name) for run in runs if name in run.values]
        size = max(each_run)
        sizes[name] = (2 * len(each_run) - 1) * size if size <= MOST_ELEMENTS else 1 << 30
    each = 2 * 2 * 4 / 3  # characters of an interval: two values of two bytes in base64
    fitting, total = 0, 0
    ordered = sorted(names, key=lambda name: sizes[name])
    for name in ordered:
        if (total + sizes[name]) * FEWEST_BINS * each > SIGNAL_BYTES:
            break
        total += sizes[name]
        fitting += 1
    most = int(np.clip(SIGNAL_BYTES / (each * max(total, 1)), FEWEST_BINS, SIGNAL_BINS))
    return Bins([run.time for run in runs], most), sorted(ordered[fitting:])


def coded(column: Array) -> dict[str, object]:
    """Return a column as the page's script reads it; one of equal values is one number."""
    known = np.isfinite(column)
    low, high = (
        (float(column[known].min()), float(column[known].max())) if known.any() else (0.0, 0.0)
    )
    if low == high and (known.all() or not known.any()):
        return {"n": len(column), "c": low if known.any() else None}
    step = max(high / CODES - low / CODES, 1e-300)
    codes = np.full(len(column), CODES + 1, "<u2")
    codes[known] = np.rint(np.clip((column[known] - low) / step, 0, CODES))
    return {"l": low, "s": step, "v": encoded(codes)}
