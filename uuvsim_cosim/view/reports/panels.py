"""Panels of a run's report: of a vehicle's mission by signal names, else of all outputs.

A panel has one unit. Each is drawn by uPlot in a report, and as SVG in a picture.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np

from uuvsim_cosim.view.plots.plots import Band, Line, Panel, Rows, TimePanel
from uuvsim_cosim.view.plots.track import Track
from uuvsim_cosim.view.recorded.metrics import cross_track_error, navigation_error, path_end
from uuvsim_cosim.view.recorded.traces import Array, Traces

__all__ = ["STYLES", "Section", "lead_panels", "sections", "track_of"]

STYLES = ("truth", "estimate", "third", "fourth", "fifth", "sixth", "seventh", "desired")
MOST_PANELS = 48


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
    found = traces.elements("hull.eta", 6)
    if found is None:
        return None
    eta = found.stacked(*range(6))
    fixes = traces.vector("usbl.position", 2)
    if fixes is not None:  # the distinct ones, at most 600; a fix is new when its value changes
        fresh = np.flatnonzero(np.any(np.diff(fixes, axis=0) != 0, axis=1)) + 1
        fixes = fixes[fresh[:: max(1, -(-len(fresh) // 600))]]
    return Track(
        time=traces.time,
        eta=eta,
        path=path,
        estimate=traces.vector("navigation.eta", 2),
        fixes=fixes,
        current=_current(traces),
    )


def _current(traces: Traces) -> Array | None:
    v_c = traces.vector("current.v_c", 2)
    return v_c if v_c is not None and np.nanmax(np.abs(v_c), initial=0.0) > 0 else None


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
            x = np.degrees(np.unwrap(x))
            turn = turn if lines else float(x[0])
            x = x - 360.0 * np.round((x[0] - turn) / 360.0)
        lines.append(Line(label, x, style, digits, dashed=label == "desired"))
    return lines


def lead_panels(traces: Traces, path: Array | None) -> Iterator[Panel]:
    """Yield the panels beside the track: depth, cross-track error and current."""
    eta = traces.elements("hull.eta", 6)
    if eta is None:
        return
    yield TimePanel("Depth", "m", _states(traces, 2), down=True, least_span=0.5)
    if path is not None and len(path) > 1:
        away = cross_track_error(eta.stacked(0, 1), path)
        away[path_end(traces) or len(away) :] = np.nan
        error = [Line("true", away, "truth", 3)]
        yield TimePanel("Cross-track error", "m", error, include=[0.0], least_span=0.1)
    v_c = _current(traces)
    if v_c is not None:
        lines = [Line("north", v_c[:, 0], "truth", 3), Line("east", v_c[:, 1], "estimate", 3)]
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
            lines = [Line("power", voltage * current, "estimate", 0)]
            yield TimePanel("Electrical power", "W", lines, include=[0.0])


def _attitude_and_velocity(traces: Traces) -> Iterator[Panel]:
    eta, nu = traces.elements("hull.eta", 6), traces.elements("hull.nu", 6)
    assert eta is not None
    heading = _states(traces, 5, degrees=True, digits=1)
    yield TimePanel("Heading", "°", heading, least_span=2.0)
    lines = [
        Line("roll φ", np.degrees(eta[3]), "truth", 2),
        Line("pitch θ", np.degrees(eta[4]), "estimate", 2),
    ]
    yield TimePanel("Roll and pitch, true", "°", lines, include=[0.0], least_span=1.0)
    if nu is not None:
        lines = _lines(("surge u", "sway v", "heave w"), (nu[i] for i in range(3)), 3)
        yield TimePanel("Velocity over ground, body axes", "m/s", lines, include=[0.0])
        lines = _lines(("roll p", "pitch q", "yaw r"), (np.degrees(nu[i]) for i in (3, 4, 5)), 2)
        yield TimePanel("Angular velocity", "°/s", lines, include=[0.0], least_span=1.0)


def _lines(labels: Iterable[str], values: Iterable[Array], digits: int) -> list[Line]:
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
        lines = [Line("error", factor * navigation_error(hat, eta, i), "truth", 3)]
        bands = []
        if sigma is not None and i < len(sigma) and np.isfinite(spread := sigma[i]).any():
            reach = 3.0 * factor * spread
            bands = [Band("±3 σ", -reach, reach)]
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
