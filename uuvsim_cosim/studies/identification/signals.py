"""Recording, resampled on the time grid of a fit: inputs of each step, and measurements.

An input varies between its samples as the assumptions say. On the grid, it is a straight line over
each step with the same impulse and first moment. A measurement is the mean of the samples within
half a step of a grid point, and NaN without a sample. A missing signal is refused by name, with
similar names.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.element_names import split_element_name
from uuvsim_cosim.models.declaration.evaluation import Evaluation
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.near_names import close_names, expected_names
from uuvsim_cosim.models.intrinsics.table import interpolants
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.recording.signals import Signals
from uuvsim_cosim.orchestrator.system.resolve import resolve
from uuvsim_cosim.orchestrator.system.sources import ModelSource
from uuvsim_cosim.studies.identification.assumptions import MEASURED, WATER, Assumptions
from uuvsim_cosim.studies.identification.exclusions import kept_spans
from uuvsim_cosim.studies.identification.fitted_model import Feed, GreyBox, feed_of
from uuvsim_cosim.studies.identification.inputs import Curve, Inputs
from uuvsim_cosim.studies.identification.outliers import pulses, spike_remark, spikes

__all__ = ["ANGLES", "MEASURED", "Grid", "Lookup", "grid_of"]

Array = NDArray[np.float64]
ANGLES = (3, 4, 5)
# Steps between samples of N E D [m], angles, u v w and p q r that are usual in any case.
FLOORS = (0.05,) * 3 + (0.02,) * 9
_FORCES = {"thrust", "tau", "force"}
_FINE, _FINEST = 0.05, 0.02  # s: the longest and the shortest step that is chosen
_ENOUGH_STEPS, _MOST_STEPS = 1500, 100_000
_MIDWAY = 0.499  # of a step: a sample farther from its grid point is midway to the next one
_PITCH = 1.65  # rad: more than pi/2 with noise
_RUN = 3.0  # s: shorter parts are not fitted
_DELAYED = 0.2  # s after the first sample at which the grid begins if the delay is unknown
_FINE_PARTS = 4  # of a sample interval in which computed forces are linear


@dataclass(frozen=True)
class Grid:
    """K + 1 points [s] a step h apart: feeds w, measured y (12, K + 1), NaN for none.

    w (2 n_w, K) holds each feed's mean over a step, then its change along the step; `inputs` gives
    it for another delay.
    """

    t: Array
    h: float
    w: Array
    y: Array
    computed: tuple[str, ...]  # what was computed from recorded signals beforehand
    measured: tuple[str, ...]  # the signals that eta and nu were read from
    runs: tuple[tuple[int, int], ...]  # first and last point of each part that is fitted
    inputs: Inputs | None = None  # None: w is for one delay alone
    begin: float = 0.0  # s in the recording
    outliers: tuple[str, ...] = ()  # remarks on samples that are left out, or suspicious


class Lookup:
    """Signals by the system's names: as mapped, else by the same name, else by its last part.

    A mapping may name an element, counted from 1: ``thruster_3.u=u[3]``.
    """

    def __init__(self, signals: Signals, mapped: Mapping[str, str]) -> None:
        self.signals, self.mapped = signals, dict(mapped)
        for name in self.mapped.values():
            base, indices = split_element_name(name)
            if name in signals:
                continue
            if base not in signals:
                raise InputInvalid(
                    f"--map: there is no signal {name!r} in the recording",
                    expected_names(name, sorted(signals)),
                )
            size = self.values(base).shape[1]
            if len(indices) != 1 or not 1 <= indices[0] <= size:
                raise InputInvalid(f"--map: {name}: expected {base}[1] to {base}[{size}]")

    def find(self, name: str) -> str | None:
        """Return the recording's name of a signal, None if there is none."""
        if name in self.mapped:
            return self.mapped[name]
        for candidate in (name, name.rpartition(".")[2]):
            if candidate in self.signals:
                return candidate
        return None

    def measured(self, hull: str) -> list[str]:
        """Return which of MEASURED are recorded of the hull with this path."""
        found = []
        for k, signal in ((0, "eta"), (6, "nu")):
            name = self.find(f"{hull}.{signal}")
            columns = self.values(name).T[:6] if name is not None else ()
            found += [MEASURED[k + j] for j, c in enumerate(columns) if np.isfinite(c).any()]
        return found

    def values(self, name: str) -> Array:
        """Return the values of a signal, or of an element of one, as (n, size)."""
        base, indices = (name, ()) if name in self.signals else split_element_name(name)
        values = np.asarray(self.signals[base], dtype=float)
        values = values[:, None] if values.ndim == 1 else values
        return values[:, indices[0] - 1 : indices[0]] if indices else values

    def near(self, name: str) -> str:
        """Return recorded names that are similar, or all names if none is similar."""
        every = list(self.signals)
        close = close_names(name, every)
        last = name.rpartition(".")[2]
        same = [n for n in every if n.rpartition(".")[2] == last]
        found = list(dict.fromkeys([*same[:3], *close]))
        if found:
            return ", ".join(found)
        more = f" and {len(every) - 12} more" if len(every) > 12 else ""
        return f"nothing like it, but {', '.join(sorted(every)[:12])}{more}"


def grid_of(
    box: GreyBox,
    lookup: Lookup,
    *,
    h: float | None,
    first: float,
    last: float | None,
    assumed: Assumptions | None = None,
) -> Grid:
    """Lay the signals that `box` needs on a grid from `first` to `last` [s]."""
    assumed = assumed or Assumptions()
    t, place = _times(lookup.signals, first, last)
    # Delayed inputs of the first steps lie before the recording: the grid begins after them.
    known = 0.0 if box.delay is not None else assumed.delay
    delays = [f.delay + (0.0 if f.variable in WATER else known) for f in box.feeds]
    before = max([0.0, *delays]) + (_DELAYED if box.delay is not None else 0.0)
    begin = float(t[min(np.searchsorted(t, t[0] + before - 1e-9), len(t) - 1)])
    if h is None:
        usual = float(np.median(np.diff(t)))
        # As fine as the samples, unless that takes too long: the error of integration is not noise,
        # so intervals do not contain it.
        least = max(usual, _FINEST, (t[-1] - t[0]) / _ENOUGH_STEPS)
        coarser = max(1.0, float(np.floor(min(least, _FINE) / usual + 1e-9)))
        step = usual if usual >= _FINE else usual * coarser
    elif np.isfinite(h) and h > 0:
        step = h
    else:
        raise InputInvalid(f"--step {h:g}: expected seconds above 0")
    end = float(t[-1]) + min([0.0, *delays])  # later inputs lie behind the recording
    K = int(np.floor((end - begin) / step + 1e-6))
    if not 20 <= K <= _MOST_STEPS:
        raise InputInvalid(
            f"the recording from {begin:g} to {end:g} s has {K} steps of {step:g} s",
            f"20 to {_MOST_STEPS}: choose --from, --to or --step",
        )
    grid: Array = begin + step * np.arange(K + 1, dtype=float)
    hull = box.plan.components[box.hull].path
    eta, nu = lookup.find(f"{hull}.eta"), lookup.find(f"{hull}.nu")
    wrong = []
    if eta is None and nu is None:
        wrong.append(f"{hull}.eta or {hull}.nu (recorded: {lookup.near(f'{hull}.nu')})")
    supply = _Supply(box.plan, lookup, t, place, assumed.inputs)
    columns = []
    for feed in box.feeds:
        column = supply.of(feed)
        if column is None:
            label = box.label(feed)
            wrong.append(f"{label} (recorded: {lookup.near(label)})")
        else:
            columns.append(column)
    if wrong:
        raise InputInvalid(
            f"the recording lacks {', '.join(dict.fromkeys(wrong))}",
            f"the inputs of {', '.join(p.path for p in box.parts.values())}, and a measurement of "
            f"{hull} (--map component.variable=signal assigns a recorded signal)",
        )
    outliers = list(dict.fromkeys(supply.remarks))
    y = np.full((12, K + 1), np.nan)
    for k, name in ((0, eta), (6, nu)):
        if name is not None:
            values = lookup.values(name)[place]
            if values.shape[1] != 6:
                raise InputInvalid(f"signal {name} has {values.shape[1]} elements", "6")
            for j in range(6):
                v, angle = values[:, j], k + j in ANGLES
                z = spikes(v, FLOORS[k + j], angle=angle)
                if z.any():
                    outliers.append(spike_remark(f"{name}[{j + 1}]", t, v, z))
                y[k + j] = _measured(t, np.where(z > 0.0, np.nan, v), grid, step, angle)
    _check_units(y, step, eta or f"{hull}.eta", nu or f"{hull}.nu")
    if not np.isfinite(y).any():
        raise InputInvalid(eta or nu, f"no number from {t[0]:g} to {t[-1]:g} s", "some")
    inputs = Inputs(grid, tuple(columns), tuple(delays), box.delayed)
    return Grid(
        grid - grid[0], step, inputs.at(assumed.delay), y, tuple(supply.computed),
        tuple(n for n in (eta, nu) if n),
        _runs(lookup.signals, grid, step),
        inputs, float(grid[0]), tuple(outliers),
    )  # fmt: skip


def _check_units(y: Array, h: float, eta: str, nu: str) -> None:
    """Refuse angles or rates in degrees: a pitch beyond pi/2, or angles that do not fit rates."""
    pitch = np.abs(y[4])
    if np.nanmax(pitch, initial=0.0) > _PITCH:
        raise InputInvalid(
            f"{eta}[5] (pitch) reaches {np.nanmax(pitch):.3g}",
            "radians, at most pi/2; in a CSV, a line of units may say deg",
        )
    change = np.diff(y[5]) / h
    rate = 0.5 * (y[11, 1:] + y[11, :-1])
    # Steady turns; a change of the yaw angle by 2 pi (or 360) is none.
    seen = np.isfinite(change) & np.isfinite(rate)
    seen &= np.abs(change) < 10.0 * np.nanmedian(np.abs(change[seen])) if seen.any() else seen
    power = float(np.sum(rate[seen] ** 2))
    if seen.sum() < 20 or power == 0.0:
        return
    slope = float(np.sum(change[seen] * rate[seen]) / power)
    fit = slope * np.sqrt(power / max(float(np.sum(change[seen] ** 2)), 1e-300))  # correlation
    if abs(fit) > 0.7 and not 0.1 < abs(slope) < 10.0:
        wrong = f"{eta}[6]" if abs(slope) > 1.0 else f"{nu}[6]"
        raise InputInvalid(
            f"the yaw angle changes by {slope:.3g} times the yaw rate, as if {wrong} were in "
            "degrees",
            "rad and rad/s; in a CSV, a line of units may say deg or deg/s",
        )


def _runs(signals: Signals, grid: Array, h: float) -> tuple[tuple[int, int], ...]:
    """Return first and last grid point of each span without an excluded part."""
    excluded = list(signals.metadata.get("excluded", ()))
    spans = kept_spans(excluded, float(grid[0]), float(grid[-1]))
    inner = [
        (math.ceil((a - grid[0]) / h - 1e-6), math.floor((b - grid[0]) / h + 1e-6))
        for a, b in spans
    ]
    runs = tuple((a, b) for a, b in inner if (b - a) * h >= min(_RUN, h * (len(grid) - 1)) - 1e-6)
    if not runs:
        raise InputInvalid(
            f"no part from {grid[0]:g} to {grid[-1]:g} s is fitted: "
            + "; ".join(str(e) for e in excluded if e.last > grid[0] and e.first < grid[-1]),
            "--from and --to with armed time under water",
        )
    return runs


def _times(signals: Signals, first: float, last: float | None) -> tuple[Array, NDArray[np.intp]]:
    time = np.asarray(signals.time, dtype=float)
    keep = np.isfinite(time) & (time >= first) & (time <= (np.inf if last is None else last))
    # A communication point may have been recorded twice (a restart): the first counts.
    rising = np.zeros(len(time), bool)
    if keep.any():
        held = np.maximum.accumulate(np.where(keep, time, -np.inf))
        rising = keep & np.concatenate([[True], held[1:] > held[:-1]])
    if rising.sum() < 2:
        finite = time[np.isfinite(time)]
        span = f"{finite.min():g} to {finite.max():g} s" if len(finite) else "no time"
        raise InputInvalid(f"no samples from {first:g} s on; the recording holds {span}")
    place = np.flatnonzero(rising)
    return time[place], place


def _measured(t: Array, values: Array, grid: Array, h: float, angle: bool) -> Array:
    good = np.isfinite(values)
    found = np.full(len(grid), np.nan)
    if not good.any():
        return found
    at, v = t[good], values[good]
    if angle:
        v = np.unwrap(v)
    # An odd number of samples about a grid point: an even number would shift the mean in time. So
    # a sample midway between two points counts only if neither of them has another one.
    place = (at - grid[0]) / h
    cell = np.rint(place).astype(int)
    midway = np.abs(place - cell) >= _MIDWAY
    lower = np.floor(place).astype(int)
    alone = ~np.isin(lower, cell[~midway]) & ~np.isin(lower + 1, cell[~midway])
    cell = np.where(midway, lower, cell)
    near = ~midway | alone
    cell, v, at = cell[near], v[near], at[near]
    inside = (cell >= 0) & (cell < len(grid))
    cell, v, at = cell[inside], v[inside], at[inside]
    count = np.bincount(cell, minlength=len(grid))
    some = count > 0
    total = np.bincount(cell, v, len(grid))
    late = np.bincount(cell, at, len(grid))
    middle = late[some] / count[some] - grid[some]
    mean = total[some] / count[some]
    # If samples are uneven about the grid point, subtract the slope at their middle; and the
    # curvature, since the mean over a curve lies on its inner side.
    if some.sum() > 2:
        place = grid[some]
        slope = np.gradient(mean, place + middle)
        spread = np.bincount(cell, (at - grid[cell]) ** 2, len(grid))[some] / count[some]
        bend = np.zeros(len(mean))
        rise = np.diff(mean) / np.diff(place)
        bend[1:-1] = 2.0 * np.diff(rise) / (place[2:] - place[:-2])
        mean = mean - slope * middle + (middle**2 - 0.5 * spread) * bend
    found[some] = mean
    return found


class _Supply:
    """Inputs of the model between the samples: recorded, computed, or a start value."""

    def __init__(
        self, plan: Plan, lookup: Lookup, t: Array, place: NDArray[np.intp], course: str
    ) -> None:
        self.plan, self.lookup, self.t, self.place, self.course = plan, lookup, t, place, course
        self.computed: list[str] = []
        self.remarks: list[str] = []
        self.exact = "tick" in lookup.signals.metadata  # by a master: outputs of a step are held
        self._done: dict[int, Mapping[str, list[Curve]] | None] = {}

    def of(self, feed: Feed) -> Curve | None:
        """Return a feed, None if it can neither be read nor computed."""
        component = self.plan.components[feed.component]
        name = self.lookup.find(f"{component.path}.{feed.variable}")
        if name is not None:
            values = self.lookup.values(name)[self.place]
            e = self._column(feed, name, values.shape[1])
            sampled = np.asarray(feed.factor * values[:, e] + feed.offset, dtype=float)
            self.remarks += pulses(name, self.t, values[:, e])
            smooth = feed.variable in WATER and self.course == "smooth"  # it has no spline
            course = "linear" if smooth else self.course
            if course != "held":  # rows that repeat a value are no samples of it
                sampled = np.where(self._own_rows(name), sampled, np.nan)
            if not np.isfinite(sampled).any():
                element = f"[{e + 1}]" if values.shape[1] > 1 else ""
                raise InputInvalid(
                    f"{name}{element}, which drives the vehicle, holds no number", "some"
                )
            return Curve(self.t, sampled, course)
        if feed.free:  # nothing feeds it: its start value; commands and forces have none
            if feed.variable in ("u", "tau", "thrust", "force"):
                return None
            variable = component.description.variables[feed.variable]
            value = component.start.get(feed.variable, variable.start)
            flat = np.asarray(0.0 if value is None else value, dtype=float).ravel()
            return Curve(self.t[:1], flat[[min(feed.element, len(flat) - 1)]], "held")
        if feed.component not in self._done:
            self._done[feed.component] = None  # so that an algebraic loop ends here
            self._done[feed.component] = self._run(feed.component)
        made = self._done[feed.component]
        if made is None:
            return None
        return made[feed.variable][feed.element].scaled(feed.factor, feed.offset)

    def _own_rows(self, name: str) -> NDArray[np.bool_]:
        """Return the rows at which a signal was sampled: all, unless the log tells its times.

        A log holds a signal at the times of other messages; ``sampled`` of the metadata has its
        own times by name.
        """
        own = self.lookup.signals.metadata.get("sampled", {}).get(split_element_name(name)[0])
        if own is None:
            return np.ones(len(self.t), bool)
        at = np.round(np.asarray(own, dtype=float), 4)
        rows = np.isin(np.round(self.t, 4), at)
        return rows if rows.any() else np.ones(len(self.t), bool)

    def _column(self, feed: Feed, name: str, width: int) -> int:
        """Return the column of a signal that a feed is: of many commands, that of the thruster."""
        component = self.plan.components[feed.component]
        label = f"{component.path}.{feed.variable}"
        shape = component.description.variables[feed.variable].shape
        size = int(np.prod(shape, dtype=int))
        if width == size:
            return feed.element
        if size == 1 and label not in self.lookup.mapped and feed.variable == "u":
            for t in self.plan.transfers:
                to = t.target_variable
                if t.source == feed.component and to.name == "thrust" and to.shape == (width,):
                    return t.target_elements[0]
        raise InputInvalid(
            f"signal {name} has {width} elements, and {label} has {size}",
            f"a signal of size {size}, or --map {label}={name}[1] for one of them",
        )

    def _run(self, i: int) -> Mapping[str, list[Curve]] | None:
        """Compute a declaration's outputs from recorded signals alone; None if one is missing."""
        component = self.plan.components[i]
        source = resolve(component.source)
        if not isinstance(source, ModelSource):
            return None
        with interpolants():
            model = source.declaration()
        outputs = {v.name for v in model.of_kind("output")}
        # Only what makes a force of a command at once: a thruster, a wrench, a fin.
        if model.clocks or not outputs & _FORCES or "tau_d" in outputs:
            return None
        # Only the inputs that the equations of force read; a shaft may declare others.
        forces = [v.symbol for v in model.of_kind("output") if v.name in _FORCES]
        every = ca.vertcat(*(ca.vec(e) for e in (*forces, *model.derivatives.values())))
        used = {s.element_hash() for s in ca.symvar(every)}
        inputs = {}
        for v in model.of_kind("input"):
            if used.isdisjoint(s.element_hash() for s in v.symbol.nonzeros()):
                continue
            columns = [self.of(feed_of(self.plan, i, v.name, e)) for e in range(v.size)]
            if any(c is None for c in columns):
                return None
            inputs[v.name] = [c for c in columns if c is not None]
        known = {v.name for v in model.of_kind("parameter")}
        parameters = {k: np.asarray(v, float) for k, v in component.start.items() if k in known}
        self.computed.append(component.path)
        # Held outputs are those of samples; a shaft or a varying input needs points between them.
        held = all(c.course == "held" for each in inputs.values() for c in each)
        stays = held and (self.exact or not model.of_kind("state"))
        t = self.t if stays else _between(self.t)
        made = _simulated(model, t, inputs, parameters, held)
        course = "held" if stays else "linear"
        return {n: [Curve(t, c, course) for c in np.atleast_2d(y.T)] for n, y in made.items()}


def _between(t: Array) -> Array:
    """Return the times with points between them."""
    shares = np.arange(_FINE_PARTS) / _FINE_PARTS
    inner = (t[:-1, None] + np.diff(t)[:, None] * shares).ravel()
    return np.concatenate([inner, t[-1:]])


def _simulated(
    model: Model,
    t: Array,
    inputs: Mapping[str, list[Curve]],
    parameters: Mapping[str, Array],
    held: bool,
) -> dict[str, Array]:
    """Return the outputs of a declaration without clocks at times t, with its inputs by name.

    Inputs are linear between the times, or `held`.
    """
    f = Evaluation(model)
    p = f.values_of("parameter", parameters)
    d = f.derived(p)
    usual = f.values_of("input", {})
    rows: list[Array] = []
    place = 0
    for v in model.of_kind("input"):
        start = np.repeat(usual[place : place + v.size, None], len(t), axis=1)
        rows.append(np.stack([c.at(t) for c in inputs[v.name]]) if v.name in inputs else start)
        place += v.size
    u = np.vstack(rows) if rows else np.zeros((0, len(t)))
    x_0 = np.array(f.initial(p, d))
    states = np.repeat(x_0, len(t), axis=1)
    if len(x_0):
        # Each interval in equal parts that the declaration can bear.
        parts = np.maximum(1, np.ceil(np.diff(t) / model.h_max - 1e-9)).astype(int)
        of = np.repeat(np.arange(len(parts)), parts)
        share = (np.arange(len(of)) - (np.cumsum(parts) - parts)[of]) / parts[of]
        rise = np.zeros_like(u[:, :-1]) if held else np.diff(u, axis=1)
        first = u[:, of] + share * rise[:, of]
        change = rise[:, of] / parts[of]
        h, x, w = ca.MX.sym("h"), ca.MX.sym("x", len(x_0)), ca.MX.sym("w", len(u))
        dw = ca.MX.sym("dw", len(u))
        k_1 = f.rhs(0.0, w, p, d, x, [])
        k_2 = f.rhs(0.0, w + dw / 2, p, d, x + h / 2 * k_1, [])
        k_3 = f.rhs(0.0, w + dw / 2, p, d, x + h / 2 * k_2, [])
        k_4 = f.rhs(0.0, w + dw, p, d, x + h * k_3, [])
        after = x + h / 6 * (k_1 + 2 * k_2 + 2 * k_3 + k_4)
        step = ca.Function("step", [x, w, dw, h], [after])
        h_each = (np.diff(t) / parts)[of]
        made = np.array(step.mapaccum("made", len(of))(x_0, first, change, h_each[None, :]))
        states[:, 1:] = made[:, np.cumsum(parts) - 1]
    x, w = ca.MX.sym("x", len(x_0)), ca.MX.sym("w", len(u))
    output = ca.Function("output", [x, w], [f.outputs(0.0, w, p, d, x, [])])
    y = np.array(output.map(len(t))(states, u))
    found, at = {}, 0
    for v in model.of_kind("output"):
        found[v.name] = y[at] if v.size == 1 else y[at : at + v.size].T
        at += v.size
    return found
