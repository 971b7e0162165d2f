"""Panels of a run's report: of a vehicle's mission by signal names, else of all outputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uuvsim_cosim.view.plots.plots import Band, Line, Panel, Rows, Sticks, TimePanel
from uuvsim_cosim.view.plots.track import Track
from uuvsim_cosim.view.recorded.metrics import cross_track_error, navigation_errors, sigma_of
from uuvsim_cosim.view.recorded.traces import Array, Traces

__all__ = ["Section", "lead_panels", "sections", "track_of"]

STYLES = ("truth", "estimate", "third", "fourth", "desired")
MOST_PANELS = 48


@dataclass(frozen=True)
class Section:
    """A heading and the panels below it, in `columns` columns."""

    title: str
    panels: Sequence[Panel]
    columns: int = 2
    height: float = 176


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
        towards = np.degrees(np.arctan2(v_c[:, 1], v_c[:, 0])) % 360
        lines = [
            Line("speed", np.hypot(v_c[:, 0], v_c[:, 1]), "third", 2),
            Line("towards [°]", towards, "third", 0, readout_only=True),
        ]
        panels.append(Sticks("Current", "m/s", lines, north=v_c[:, 0], east=v_c[:, 1]))
    return panels


def sections(traces: Traces) -> list[Section]:
    """Return the sections below the lead whose signals were recorded."""
    if traces.vector("hull.eta", 6) is None:
        return _every_output(traces)
    found = [
        Section("Attitude and velocity", [*_attitude(traces), *_velocity(traces)]),
        Section("Navigation error with its ±3 σ", _navigation(traces), 3, 150),
        Section("Thrust", _thrust(traces), 2, 300),
        Section("Power", _power(traces), 2, 150),
    ]
    return [section for section in found if section.panels]


def _attitude(traces: Traces) -> list[Panel]:
    heading = _states(traces, 5, degrees=True, digits=1)
    eta = traces.vector("hull.eta", 6)
    assert eta is not None
    tilt = [
        Line("roll φ", np.degrees(eta[:, 3]), "truth", 2),
        Line("pitch θ", np.degrees(eta[:, 4]), "estimate", 2),
    ]
    return [
        TimePanel("Heading", "°", heading, least_span=2.0),
        TimePanel("Roll and pitch, true", "°", tilt, include=[0.0], least_span=1.0),
    ]


def _velocity(traces: Traces) -> list[Panel]:
    nu = traces.vector("hull.nu", 6)
    if nu is None:
        return []
    labels = (("surge u", "truth"), ("sway v", "estimate"), ("heave w", "third"))
    linear = [Line(label, nu[:, i], style, 3) for i, (label, style) in enumerate(labels)]
    labels = (("roll p", "truth"), ("pitch q", "estimate"), ("yaw r", "third"))
    turns = [
        Line(label, np.degrees(nu[:, i + 3]), style, 2) for i, (label, style) in enumerate(labels)
    ]
    return [
        TimePanel("Velocity over ground, body axes", "m/s", linear, include=[0.0]),
        TimePanel("Angular velocity", "°/s", turns, include=[0.0], least_span=1.0),
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
            lines.append(Line("3 σ", reach, "band", 3, readout_only=True))
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
        names = (("X", 0, "truth"), ("Y", 1, "estimate"), ("Z", 2, "third"), ("N", 5, "fourth"))
        wanted = [
            Line(f"{name} [{'N m' if axis > 2 else 'N'}]", tau[:, axis], style, 1)
            for name, axis, style in names
        ]
        panels.append(TimePanel("Force that the controller asks for", "N, N m", wanted,
                                include=[0.0]))  # fmt: skip
    return panels


def _power(traces: Traces) -> list[Panel]:
    panels: list[Panel] = []
    voltage, current = traces.scalar("battery.voltage"), traces.scalar("wrench.current_total")
    if voltage is not None:
        panels.append(
            TimePanel("Battery voltage", "V", [Line("voltage", voltage, "truth")], least_span=0.5)
        )
        if current is not None:
            power = [Line("power", voltage * current, "estimate", 0)]
            panels.append(TimePanel("Electrical power", "W", power, include=[0.0]))
    return panels


def _every_output(traces: Traces) -> list[Section]:
    """Return one panel for each signal, grouped by component, for systems without a hull."""
    groups: dict[str, list[Panel]] = {}
    for name in sorted(traces.values)[:MOST_PANELS]:
        value = traces.values[name]
        component, _, variable = name.rpartition(".")
        columns = value.reshape(len(value), -1)
        shown = min(columns.shape[1], len(STYLES))
        lines = [
            Line(variable if value.ndim == 1 else f"[{i + 1}]", columns[:, i], STYLES[i], 3)
            for i in range(shown)
        ]
        title = variable if shown == columns.shape[1] else f"{variable} (first {shown})"
        panel = TimePanel(title, traces.units.get(name, ""), lines)
        groups.setdefault(component, []).append(panel)
    return [Section(component or "Signals", panels) for component, panels in groups.items()]
