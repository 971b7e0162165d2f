"""Panels of a run's report: of a vehicle's mission by signal names, else of all outputs.

A panel has one unit. Each is drawn by uPlot in a report, and as SVG in a picture.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.orchestrator.recording.samples import (
    Array,
    Samples,
    blocks,
    computed,
    picked,
    track_rows,
    unwrapped,
    within,
)
from uuvsim_cosim.view.plots.plots import Band, Line, Panel, Rows, TimePanel
from uuvsim_cosim.view.plots.track import Track
from uuvsim_cosim.view.recorded.metrics import cross_track_error, navigation_error, path_end
from uuvsim_cosim.view.recorded.traces import Elements, Traces

__all__ = ["STYLES", "Section", "lead_panels", "sections", "track_of"]

STYLES = ("truth", "estimate", "third", "fourth", "fifth", "sixth", "seventh", "desired")
MOST_PANELS = 48
TRACK_ROWS = 20_000  # of a track, at most, and those of its extremes


@dataclass(frozen=True)
class Section:
    """A heading and the panels below it, in `columns` columns on a wide screen.

    Panels that were recorded are made when they are asked for, once: a panel holds whole signals.
    """

    title: str
    panels: Iterable[Panel]
    columns: int = 2


def track_of(traces: Traces, path: Array | None) -> Track | None:
    """Return the plan view, or None for a system without a hull's ``eta``."""
    eta = traces.elements("hull.eta", 6)
    if eta is None:
        return None
    hat, current = traces.elements("navigation.eta", 2), _current(traces)
    rows = _track_rows([eta, *([] if hat is None else [hat])])
    return Track(
        time=traces.time[rows],
        eta=eta.stacked(*range(6), rows=rows),
        path=path,
        estimate=None if hat is None else hat.stacked(0, 1, rows=rows),
        fixes=_fixes(traces),
        current=None if current is None else current.stacked(0, 1, rows=rows),
    )


def _track_rows(shown: Iterable[Elements]) -> NDArray[np.intp]:
    """Return the rows of a track: all, or some of them and the extremes."""
    positions = [found[k] for found in shown for k in (0, 1)]
    rows = [track_rows(positions[0], positions[1], TRACK_ROWS)]
    if len(positions[0]) <= TRACK_ROWS:
        return rows[0]
    for position in positions:
        low, high, first = (np.inf, 0), (-np.inf, 0), 0
        for block in blocks(position):
            known = np.isfinite(block)
            if known.any():
                i, j = (
                    int(f(np.where(known, block, block[known][0]))) for f in (np.argmin, np.argmax)
                )
                low = min(low, (float(block[i]), first + i))
                high = max(high, (float(block[j]), first + j))
            first += len(block)
        rows.append(np.array([low[1], high[1]]))
    return np.unique(np.concatenate(rows))


def _fixes(traces: Traces) -> Array | None:
    """Return the distinct fixes of USBL, at most 600; a fix is new when its value changes."""
    fixes = traces.elements("usbl.position", 2)
    if fixes is None:
        return None
    fresh, first, before = [], 0, np.empty((0, 2))
    for north, east in zip(blocks(fixes[0]), blocks(fixes[1]), strict=True):
        rows = np.concatenate([before, np.column_stack([north, east])])
        changes = np.flatnonzero(np.any(np.diff(rows, axis=0) != 0, axis=1)) + 1
        fresh.append(changes + first - len(before))
        first, before = first + len(north), rows[-1:]
    found = np.concatenate(fresh)
    return fixes.stacked(0, 1, rows=found[:: max(1, -(-len(found) // 600))])


def _current(traces: Traces) -> Elements | None:
    """Return the current, if there is one."""
    v_c = traces.elements("current.v_c", 2)
    if v_c is None:
        return None
    flows = any(np.fmax.reduce(np.abs(b), initial=0.0) > 0 for k in (0, 1) for b in blocks(v_c[k]))
    return v_c if flows else None


def _states(traces: Traces, axis: int, *, degrees: bool = False, digits: int = 2) -> list[Line]:
    """Return one axis of eta as desired, true and estimated."""
    names = (
        ("desired", "guidance.eta_d", "desired"),
        ("true", "hull.eta", "truth"),
        ("estimate", "navigation.eta", "estimate"),
    )
    lines: list[Line] = []
    turn = 0.0
    for label, name, style in names:
        value = traces.elements(name, 6)
        if value is None:
            continue
        x = value[axis]
        if degrees:
            x = computed(np.degrees, unwrapped(x))
            start = float(picked(x, np.array([0]))[0])
            turn = turn if lines else start
            whole = 360.0 * np.round((start - turn) / 360.0)
            x = computed(partial(np.add, -whole), x)
        lines.append(Line(label, x, style, digits, dashed=label == "desired"))
    return lines


def lead_panels(traces: Traces, path: Array | None) -> Iterator[Panel]:
    """Yield the panels beside the track: depth, cross-track error and current."""
    eta = traces.elements("hull.eta", 6)
    if eta is None:
        return
    yield TimePanel("Depth", "m", _states(traces, 2), down=True, least_span=0.5)
    if path is not None and len(path) > 1:
        away = within(cross_track_error(eta[0], eta[1], path), 0, path_end(traces) or None)
        error = [Line("true", away, "truth", 3)]
        yield TimePanel("Cross-track error", "m", error, include=[0.0], least_span=0.1)
    v_c = _current(traces)
    if v_c is not None:
        lines = [Line("north", v_c[0], "truth", 3), Line("east", v_c[1], "estimate", 3)]
        yield TimePanel("Current", "m/s", lines, include=[0.0])


def sections(traces: Traces) -> Iterator[Section]:
    """Yield the sections below the lead whose signals were recorded."""
    if traces.elements("hull.eta", 6) is None:
        yield from _every_output(traces)
        return
    groups: list[tuple[str, Callable[[Traces], Iterator[Panel]], int]] = [
        ("Attitude and velocity", _attitude_and_velocity, 2),
        ("Navigation error with its ±3 σ", _navigation, 3),
        ("Thrust", _thrust, 2),
        ("Power", _power, 2),
    ]
    for title, panels_of, columns in groups:
        panels = panels_of(traces)
        for first in panels:
            yield Section(title, chain((first,), panels), columns)
            break


def _power(traces: Traces) -> Iterator[Panel]:
    voltage, current = traces.scalar("battery.voltage"), traces.scalar("wrench.current_total")
    if voltage is not None:
        lines = [Line("voltage", voltage, "truth")]
        yield TimePanel("Battery voltage", "V", lines, least_span=0.5)
        if current is not None:
            power = computed(np.multiply, voltage, current)
            lines = [Line("power", power, "estimate", 0)]
            yield TimePanel("Electrical power", "W", lines, include=[0.0])


def _attitude_and_velocity(traces: Traces) -> Iterator[Panel]:
    eta, nu = traces.elements("hull.eta", 6), traces.elements("hull.nu", 6)
    assert eta is not None
    heading = _states(traces, 5, degrees=True, digits=1)
    yield TimePanel("Heading", "°", heading, least_span=2.0)
    lines = [
        Line("roll φ", computed(np.degrees, eta[3]), "truth", 2),
        Line("pitch θ", computed(np.degrees, eta[4]), "estimate", 2),
    ]
    yield TimePanel("Roll and pitch, true", "°", lines, include=[0.0], least_span=1.0)
    if nu is not None:
        lines = _lines(("surge u", "sway v", "heave w"), (nu[i] for i in range(3)), 3)
        yield TimePanel("Velocity over ground, body axes", "m/s", lines, include=[0.0])
        lines = _lines(("roll p", "pitch q", "yaw r"), _degrees(nu, 3, 4, 5), 2)
        yield TimePanel("Angular velocity", "°/s", lines, include=[0.0], least_span=1.0)


def _degrees(angles: Elements, *axes: int) -> Iterator[Samples]:
    return (computed(np.degrees, angles[i]) for i in axes)


def _lines(labels: Iterable[str], values: Iterable[Samples], digits: int) -> list[Line]:
    """Return a line for each of the values (T,), in the order of the styles."""
    return [
        Line(label, value, style, digits)
        for label, value, style in zip(labels, values, STYLES, strict=False)
    ]


def _navigation(traces: Traces) -> Iterator[Panel]:
    eta, hat = traces.elements("hull.eta", 6), traces.elements("navigation.eta", 6)
    if eta is None or hat is None:
        return
    sigma = traces.elements("navigation.sigma", 1)
    names = (("North", "m"), ("East", "m"), ("Down", "m"), ("Roll", "°"), ("Pitch", "°"),
             ("Heading", "°"))  # fmt: skip
    for i, (name, unit) in enumerate(names):
        factor = 1.0 if i < 3 else 180.0 / np.pi
        error = computed(partial(np.multiply, factor), navigation_error(hat, eta, i))
        lines = [Line("error", error, "truth", 3)]
        bands = []
        if sigma is not None and i < len(sigma):
            spread = sigma[i]
            if any(np.isfinite(block).any() for block in blocks(spread)):
                below, above = (
                    computed(partial(np.multiply, sign * 3.0 * factor), spread) for sign in (-1, 1)
                )
                bands = [Band("±3 σ", below, above)]
        yield TimePanel(name, unit, lines, bands=bands, include=[0.0])


def _thrust(traces: Traces) -> Iterator[Panel]:
    lines = []
    for number in range(1, 33):
        thrust = traces.scalar(f"thruster_{number}.thrust")
        if thrust is not None:
            lines.append(Line(str(number), thrust, "ahead", 1))
    if lines:
        yield Rows("Thrusters", "N", lines)
    del lines
    tau = traces.elements("controller.tau_d", 6)
    if tau is not None:
        for what, unit, labels, numbers in (
            ("Force", "N", "XYZ", range(3)), ("Moment", "N m", "KMN", range(3, 6))
        ):  # fmt: skip
            shown = _lines(labels, (tau[i] for i in numbers), 1)
            yield TimePanel(f"{what} that the controller commands", unit, shown, include=[0.0])


def _every_output(traces: Traces) -> Iterator[Section]:
    """Yield one panel for each unit of a signal, by component, for systems without a hull."""
    names = sorted(traces.values)[:MOST_PANELS]
    for component in dict.fromkeys(name.rpartition(".")[0] for name in names):
        own = [name for name in names if name.rpartition(".")[0] == component]
        yield Section(component or "Signals", _outputs(traces, own))


def _outputs(traces: Traces, names: Iterable[str]) -> Iterator[Panel]:
    for name in names:
        variable, size = name.rpartition(".")[2], traces.size(name)
        units = traces.by_unit(name, len(STYLES))
        for unit, elements in units[:1] if size > 2 * len(STYLES) else units:
            labels = [f"[{k + 1}]" for k in elements] if size > 1 else [variable]
            lines = _lines(labels, (traces.element(name, k) for k in elements), 3)
            yield TimePanel(variable, unit, lines)
