"""Panels of a run's report: of a vehicle's mission by signal names, else of all outputs.

A panel has one unit. Each is drawn by uPlot in a report, and as SVG in a picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uuvsim_cosim.view.plots.plots import Band, Line, Panel, Rows, TimePanel
from uuvsim_cosim.view.plots.track import Track
from uuvsim_cosim.view.recorded.metrics import cross_track_error, navigation_errors, sigma_of
from uuvsim_cosim.view.recorded.traces import Array, Traces

__all__ = ["STYLES", "Section", "lead_panels", "sections", "track_of"]

STYLES = ("truth", "estimate", "third", "fourth", "fifth", "sixth", "seventh", "desired")
MOST_PANELS = 48


@dataclass(frozen=True)
class Section:
    """A heading and the panels below it, in `columns` columns on a wide screen."""

    title: str
    panels: Sequence[Panel]
    columns: int = 2


def track_of(traces: Traces, path: Array | None) -> Track | None:
    """Return the plan view, or None for a system without a hull's ``eta``."""
    eta = traces.vector("hull.eta", 6)
    if eta is None:
        return None
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
        value = traces.vector(name, 6)
        if value is None:
            continue
        x = value[:, axis]
        if degrees:
            x = np.degrees(np.unwrap(x))
            turn = turn if lines else float(x[0])
            x = x - 360.0 * np.round((x[0] - turn) / 360.0)
        lines.append(Line(label, x, style, digits, dashed=label == "desired"))
    return lines


def lead_panels(traces: Traces, path: Array | None) -> list[Panel]:
    """Return the panels beside the track: depth, cross-track error and current."""
    eta = traces.vector("hull.eta", 6)
    if eta is None:
        return []
    panels: list[Panel] = [TimePanel("Depth", "m", _states(traces, 2), down=True, least_span=0.5)]
    if path is not None and len(path) > 1:
        error = [Line("true", cross_track_error(eta, path), "truth", 3)]
        panels.append(TimePanel("Cross-track error", "m", error, include=[0.0], least_span=0.1))
    v_c = _current(traces)
    if v_c is not None:
        lines = [Line("north", v_c[:, 0], "truth", 3), Line("east", v_c[:, 1], "estimate", 3)]
        panels.append(TimePanel("Current", "m/s", lines, include=[0.0]))
    return panels


def sections(traces: Traces) -> list[Section]:
    """Return the sections below the lead whose signals were recorded."""
    if traces.vector("hull.eta", 6) is None:
        return _every_output(traces)
    power: list[Panel] = []
    voltage, current = traces.scalar("battery.voltage"), traces.scalar("wrench.current_total")
    if voltage is not None:
        lines = [Line("voltage", voltage, "truth")]
        power.append(TimePanel("Battery voltage", "V", lines, least_span=0.5))
        if current is not None:
            lines = [Line("power", voltage * current, "estimate", 0)]
            power.append(TimePanel("Electrical power", "W", lines, include=[0.0]))
    panels = [
        Section("Attitude and velocity", _attitude_and_velocity(traces)),
        Section("Navigation error with its ±3 σ", _navigation(traces), 3),
        Section("Thrust", _thrust(traces), 2),
        Section("Power", power, 2),
    ]
    return [section for section in panels if section.panels]


def _attitude_and_velocity(traces: Traces) -> list[Panel]:
    eta, nu = traces.vector("hull.eta", 6), traces.vector("hull.nu", 6)
    assert eta is not None
    panels: list[Panel] = [
        TimePanel("Heading", "°", _states(traces, 5, degrees=True, digits=1), least_span=2.0),
        TimePanel("Roll and pitch, true", "°", [
            Line("roll φ", np.degrees(eta[:, 3]), "truth", 2),
            Line("pitch θ", np.degrees(eta[:, 4]), "estimate", 2),
        ], include=[0.0], least_span=1.0),
    ]  # fmt: skip
    if nu is not None:
        for title, unit, labels, values, digits, span in (
            ("Velocity over ground, body axes", "m/s", ("surge u", "sway v", "heave w"),
             nu[:, :3], 3, 0.0),
            ("Angular velocity", "°/s", ("roll p", "pitch q", "yaw r"),
             np.degrees(nu[:, 3:]), 2, 1.0),
        ):  # fmt: skip
            panels.append(TimePanel(title, unit, _lines(labels, values, digits), include=[0.0],
                                    least_span=span))  # fmt: skip
    return panels


def _lines(labels: Sequence[str], values: Array, digits: int) -> list[Line]:
    """Return a line for each column of values (T, n), in the order of the styles."""
    return [
        Line(label, value, style, digits)
        for label, value, style in zip(labels, values.T, STYLES, strict=False)
    ]


def _navigation(traces: Traces) -> list[Panel]:
    eta, hat = traces.vector("hull.eta", 6), traces.vector("navigation.eta", 6)
    if eta is None or hat is None:
        return []
    nav = navigation_errors(hat, eta, sigma_of(traces))
    names = (("North", "m"), ("East", "m"), ("Down", "m"), ("Roll", "°"), ("Pitch", "°"),
             ("Heading", "°"))  # fmt: skip
    panels: list[Panel] = []
    for i, (name, unit) in enumerate(names):
        factor = 1.0 if i < 3 else 180.0 / np.pi
        lines = [Line("error", factor * nav.error[:, i], "truth", 3)]
        bands = []
        if nav.sigma is not None and np.isfinite(nav.sigma[:, i]).any():
            reach = 3.0 * factor * nav.sigma[:, i]
            bands = [Band("±3 σ", -reach, reach)]
        panels.append(TimePanel(name, unit, lines, bands=bands, include=[0.0]))
    return panels


def _thrust(traces: Traces) -> list[Panel]:
    lines = []
    for number in range(1, 33):
        thrust = traces.scalar(f"thruster_{number}.thrust")
        if thrust is not None:
            lines.append(Line(str(number), thrust, "ahead", 1))
    panels: list[Panel] = [Rows("Thrusters", "N", lines)] if lines else []
    tau = traces.vector("controller.tau_d", 6)
    if tau is not None:
        for what, unit, labels, values in (
            ("Force", "N", "XYZ", tau[:, :3]), ("Moment", "N m", "KMN", tau[:, 3:])
        ):  # fmt: skip
            panels.append(TimePanel(f"{what} that the controller commands", unit,
                                    _lines(labels, values, 1), include=[0.0]))  # fmt: skip
    return panels


def _every_output(traces: Traces) -> list[Section]:
    """Return one panel for each unit of a signal, by component, for systems without a hull."""
    groups: dict[str, list[Panel]] = {}
    for name in sorted(traces.values)[:MOST_PANELS]:
        component, _, variable = name.rpartition(".")
        value = traces.values[name].reshape(len(traces.time), -1)
        units = traces.by_unit(name, len(STYLES))
        for unit, elements in units[:1] if value.shape[1] > 2 * len(STYLES) else units:
            labels = [f"[{k + 1}]" for k in elements] if value.shape[1] > 1 else [variable]
            panel = TimePanel(variable, unit, _lines(labels, value[:, elements], 3))
            groups.setdefault(component, []).append(panel)
    return [Section(component or "Signals", panels) for component, panels in groups.items()]
