"""Plots of recorded signals by matplotlib, for notebooks and papers."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.orchestrator.recording.signals import Signals
from uuvsim_cosim.orchestrator.running.run import Run

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["plot"]

ELEMENTS = re.compile(r"(?P<base>.+)\[(?P<first>\d+)(:(?P<last>\d+))?\]")
LINES = ("-", "--", "-.", ":")


def plot(
    recording: Run | Signals | str | Path, *names: str, ax: Axes | None = None, **style: Any
) -> Axes | np.ndarray:
    """Plot recorded signals over time; return the matplotlib axes.

    `recording` is a run, its folder or file, or signals. Each of `names` is a signal, ``hull.eta``,
    an element of one, from 1, ``hull.eta[3]``, or several, ``hull.eta[1:3]``, the last included.
    Signals with the same unit share one axes, which the unit labels. The result is one Axes, or an
    array of them from top to bottom if there are several units. With `ax`, all is drawn there, and
    all units must be equal. `style` goes to ``Axes.plot``.

    Raises InputInvalid for a signal or an element that was not recorded, with similar names, for a
    text, and for different units with `ax`.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> run = uuv.run("bluerov2_hold", until=2.0)
    >>> axes = uuv.plot(run, "guidance.eta_d[3]", "hull.eta[3]")
    >>> axes.get_ylabel(), len(axes.lines)
    ('[m]', 2)
    >>> axes.figure.savefig("depth.svg")
    """
    from matplotlib import pyplot as plt

    if isinstance(recording, Run):
        signals = recording.signals()
    else:
        signals = recording if isinstance(recording, Signals) else read_signals(recording)
    if not names:
        raise InputInvalid("no signal is named", f"one of {', '.join(sorted(signals)[:8])}, …")
    panels: dict[str, list[tuple[str, np.ndarray]]] = {}
    for name in names:
        for label, unit, values in _elements(signals, name):
            panels.setdefault(unit, []).append((label, values))
    if ax is None:
        _, axes = plt.subplots(
            len(panels), 1, sharex=True, squeeze=False, figsize=(8, 1 + 2.2 * len(panels))
        )
    elif len(panels) > 1:
        raise InputInvalid(f"ax= with units {', '.join(panels)}", "signals of one unit")
    else:
        axes = np.array([[ax]])
    for each, (unit, lines) in zip(axes[:, 0], panels.items(), strict=True):
        for i, (label, values) in enumerate(lines):
            # Colours of matplotlib repeat after ten lines, the pattern changes then.
            each.plot(
                signals.time, values, **{"label": label, "linestyle": LINES[i // 10 % 4], **style}
            )
        each.set_ylabel(f"[{unit}]" if unit else "")
        each.legend(fontsize="small")
        each.grid(alpha=0.3)
    axes[-1, 0].set_xlabel("time [s]")
    return axes[0, 0] if len(panels) == 1 else axes[:, 0]


def _elements(signals: Signals, name: str) -> list[tuple[str, str, np.ndarray]]:
    """Return label, unit and values of each element that a name means."""
    found = None if name in signals else ELEMENTS.fullmatch(name)
    base = found["base"] if found else name
    values = signals[base]
    if values.dtype.kind not in "fiub":
        raise InputInvalid(name, "is a text", "a signal of numbers")
    if values.ndim == 1:
        if found:
            raise InputInvalid(f"{name}: {base} is a scalar", base)
        return [(base, signals.units.get(base, ""), values)]
    numbers = list(signals.elements.get(base) or range(1, values.shape[1] + 1))
    units = signals.element_units.get(base) or (signals.units.get(base, ""),) * len(numbers)
    first, last = numbers[0], numbers[-1]
    if found:
        first = int(found["first"])
        last = int(found["last"] or first)
        if not (first in numbers and last in numbers and first <= last):
            raise InputInvalid(name, f"elements of {base}[{numbers[0]}] to {base}[{numbers[-1]}]")
    return [
        (f"{base}[{number}]", unit, values[:, i])
        for i, (number, unit) in enumerate(zip(numbers, units, strict=True))
        if first <= number <= last
    ]
