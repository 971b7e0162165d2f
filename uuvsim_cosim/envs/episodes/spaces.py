"""Boxes of actions and observations: channels with limits in any unit, scaled to [-1, 1]."""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.task.signals import Named, Signals, resolved
from uuvsim_cosim.envs.task.task import Array, Channel
from uuvsim_cosim.errors import InputInvalid, Problem
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.values.values import Misfit, conversion

__all__ = ["ActionBox", "ObservationBox"]


@final
class ActionBox:
    """Actions in [-1, 1] of channels, which are unconnected inputs; `width` numbers in order.

    An action a sets the input, in its unit, to `middle` + `half` a, of shape (width, 1) each.
    `problems` lists the mistakes in the channels.
    """

    def __init__(self, plan: Plan, channels: Sequence[Channel]) -> None:
        self.problems: list[Problem] = []
        self.targets: list[tuple[str, int]] = []  # variable and element, by number of the action
        lows: list[float] = []
        highs: list[float] = []
        owner: dict[tuple[str, int], str] = {}
        for channel in channels:
            try:
                named = resolved(plan, channel.name)
                _check_free(plan, named)
                low, high = _limits(plan, channel, named)
                if channel.sin_cos:
                    raise Misfit("an action as sine and cosine", "sin_cos in observations only")
                if low is None or high is None:
                    raise Misfit("an action without limits", "low= and high=")
                for i in named.elements:
                    if (named.key, i) in owner:
                        raise Misfit("an element acted on twice", "each in one channel")
                    owner[named.key, i] = channel.name
            except Misfit as misfit:
                self.problems.append(misfit.at(f"action {channel.name!r}"))
                continue
            self.targets += [(named.key, i) for i in named.elements]
            lows += low.tolist()
            highs += high.tolist()
        if not channels:
            self.problems.append(Problem("actions", "no channel", "at least one"))
        self.width = len(self.targets)
        low, high = np.array(lows), np.array(highs)
        self.middle = (low / 2 + high / 2)[:, None]
        middle, half = self.middle[:, 0], high / 2 - low / 2
        for _ in range(4):  # until rounding cannot lead out of the limits
            out = (middle - half < low) | (middle + half > high)
            half = np.where(out, np.nextafter(half, 0.0), half)
        self.half = half[:, None]

    def checked(self, actions: object, n: int | None, place: str) -> Array:
        """Return actions of shape (n, width), clipped to [-1, 1]; raises InputInvalid.

        With n None those of one environment are given without the first axis.
        """
        try:
            given = np.asarray(actions)
        except ValueError:
            given = np.empty(0, object)
        expected = (self.width,) if n is None else (n, self.width)
        if given.dtype.kind not in "fiu" or given.shape != expected:
            wanted = f"{self.width} numbers" if n is None else f"numbers of shape {expected}"
            raise InputInvalid(
                place,
                f"an action of type {given.dtype} and shape {given.shape}",
                f"{wanted} in [-1, 1]",
            )
        clipped = np.array(given.reshape(-1, self.width).T, np.float64, order="C")  # (width, n)
        clipped.clip(-1.0, 1.0, out=clipped)
        total = np.add.reduce(clipped, axis=None)
        if np.isnan(total):
            row, column = np.argwhere(np.isnan(clipped.T))[0]
            raise InputInvalid(
                f"{place}: the action for {self.name(column)!r}"
                + (f" in environment {row}" if n is not None else "")
                + " is not a number; expected one in [-1, 1]"
            )
        return clipped.T

    def name(self, column: int) -> str:
        """Return the name of the element that a number of the action sets."""
        key, i = self.targets[column]
        return f"{key}[{i + 1}]"

    def scaled(self, actions: Array) -> Array:
        """Return the values of the inputs, in their units, of shape (width, n)."""
        values = self.half * actions.T
        values += self.middle
        return np.asarray(values)


@final
class ObservationBox:
    """Observations of some channels, then `extra`: `low` and `high` are the box.

    Of the channels, number i is `factor` [i] times row `rows` [i] of the signals, plus `offset`
    [i]; those of `sines` are then replaced by the sine, and the number after each by the cosine.
    """

    def __init__(
        self,
        plan: Plan,
        signals: Signals,
        channels: Sequence[Channel],
        extra: tuple[Sequence[float], Sequence[float]] = ((), ()),
    ) -> None:
        self.problems: list[Problem] = []
        rows: list[NDArray[np.intp]] = [np.zeros(0, np.intp)]
        factor: list[float] = []
        offset: list[float] = []
        sines: list[int] = []
        scaled: list[bool] = []
        for channel in channels:
            try:
                named = resolved(plan, channel.name)
                low, high = _limits(plan, channel, named, angle=channel.sin_cos)
            except Misfit as misfit:
                self.problems.append(misfit.at(f"observation {channel.name!r}"))
                continue
            mine = signals.rows(named)
            if channel.sin_cos:
                sines += range(len(factor), len(factor) + 2 * len(mine), 2)
                to_rad = np.repeat([f for f, _ in _to(plan, named, "rad")], 2)
                factor += to_rad.tolist()
                offset += [0.0] * len(to_rad)
                scaled += [True] * len(to_rad)
                rows.append(np.repeat(mine, 2))
                continue
            rows.append(mine)
            if low is None or high is None:
                own = _conversions(plan, channel, named)
                factor += [f for f, _ in own]
                offset += [o for _, o in own]
                scaled += [False] * len(mine)
            else:
                factor += (2.0 / (high - low)).tolist()
                offset += (-(high + low) / (high - low)).tolist()
                scaled += [True] * len(mine)
        self.rows = np.concatenate(rows)
        self.factor, self.offset = np.array(factor)[:, None], np.array(offset)[:, None]
        self.sines = sines
        self._buffers: dict[int, tuple[Array, NDArray[np.float32]]] = {}
        low_extra, high_extra = (np.asarray(e, np.float32).ravel() for e in extra)
        self.n_extra = len(low_extra)
        if len(low_extra) != len(high_extra) or not np.all(low_extra <= high_extra):
            self.problems.append(
                Problem("extra_limits", f"{extra[0]} and {extra[1]}", "a least and a greatest each")
            )
        edge = np.where(scaled, np.float32(1), np.float32(np.inf)).astype(np.float32)
        self.low = np.concatenate([-edge, low_extra]).astype(np.float32)
        self.high = np.concatenate([edge, high_extra]).astype(np.float32)
        self._n_own = len(self.rows)
        self.width = len(self.low)
        self._least = self.low[:, None] if np.any(np.isfinite(self.low)) else None
        self._greatest = self.high[:, None]
        self._middle = np.clip(np.zeros_like(self.low), self.low, self.high)[:, None]
        if not self.width and not self.problems:
            self.problems.append(Problem("observations", "none", "at least one"))

    def of(
        self,
        values: Array,
        extra: object,
        blank: NDArray[np.bool_] | None = None,
        *,
        clipped: bool = True,
    ) -> NDArray[np.float32]:
        """Return observations (n, width) of signals (size, n), clipped to the box.

        Those of `blank` environments are zeros. Raises InputInvalid if one is not finite.
        """
        n = values.shape[1]
        if n not in self._buffers:  # allocated once: a learner asks for the same n in each step
            own = np.empty((self._n_own, n))
            self._buffers = {n: (own, np.empty((self.width, n), np.float32))}
        own, columns = self._buffers[n]
        values.take(self.rows, axis=0, out=own, mode="clip")
        own *= self.factor
        for i in self.sines:
            np.sin(own[i], out=own[i])
            np.cos(own[i + 1], out=own[i + 1])
        own += self.offset
        with np.errstate(over="ignore"):
            columns[: self._n_own] = own
        if self.n_extra:
            given = None if extra is None else np.asarray(extra)
            if given is None or given.shape != (n, self.n_extra) or given.dtype.kind not in "fiub":
                shape = None if given is None else f"{given.dtype}, {given.shape}"
                raise InputInvalid(
                    "extra()",
                    f"observations of type and shape {shape}",
                    f"numbers of shape {(n, self.n_extra)}, that of extra_limits",
                )
            columns[self._n_own :] = given.T
        if blank is not None:
            np.copyto(columns, self._middle, where=blank)
        if not np.isfinite(np.add.reduce(columns, axis=None)):
            most = np.finfo(np.float32).max
            np.clip(own, -most, most, out=columns[: self._n_own], casting="same_kind")
            bad = np.argwhere(~np.isfinite(columns.T))
            if len(bad):
                row, column = bad[0].tolist()
                more = column - self._n_own
                which = f"observation {column}" + (f", extra()[:, {more}]," if more >= 0 else "")
                raise InputInvalid(
                    f"{which} in environment {row} is {columns[column, row]}", "a finite number"
                )
        if clipped and self._least is not None:
            np.maximum(columns, self._least, out=columns)
            np.minimum(columns, self._greatest, out=columns)
        return columns.T.copy(order="C")


def _check_free(plan: Plan, named: Named) -> None:
    v = named.variable
    if v.causality != "input":
        raise Misfit(f"a variable of causality {v.causality}", "an unconnected input")
    if v.type not in ("Float64", "Float32"):
        raise Misfit(f"an input of type {v.type}", "a Float64 input")
    for t in plan.transfers:
        target = f"{plan.components[t.target].path}.{t.target_variable.name}"
        if target == named.key and set(t.target_elements) & set(named.elements):
            source = f"{plan.components[t.source].path}.{t.source_variable.name}"
            raise Misfit(f"an input that is connected to {source}", "an unconnected input")


def _limits(
    plan: Plan, channel: Channel, named: Named, *, angle: bool = False
) -> tuple[Array | None, Array | None]:
    """Return the limits, in the variable's unit for an action; raises Misfit."""
    size = len(named.elements)
    _conversions(plan, channel, named)
    if angle:
        _to(plan, named, "rad")
        return None, None
    v = named.variable
    sides: list[Array | None] = []
    for given, own in ((channel.low, v.min), (channel.high, v.max)):
        if given is None:
            sides.append(None if own is None else np.full(size, own))
            continue
        values = np.asarray(given, dtype=float)
        if values.shape not in ((), (size,)) or not np.all(np.isfinite(values)):
            raise Misfit(f"limit {given!r}", f"a finite number, or {size} of them")
        wide = np.broadcast_to(values, (size,))
        back = _conversions(plan, channel, named)
        sides.append(np.array([(x - o) / f for x, (f, o) in zip(wide, back, strict=True)]))
    low, high = sides
    if channel.low is None and channel.high is None and (low is None or high is None):
        return None, None
    if low is None or high is None:
        raise Misfit(f"limits {channel.low!r} and {channel.high!r}", "both low= and high=")
    if not np.all(low < high):
        raise Misfit(f"limits {channel.low!r} and {channel.high!r}", "low= less than high=")
    if v.causality == "input":
        least, most = -np.inf if v.min is None else v.min, np.inf if v.max is None else v.max
        if np.any(low < least) or np.any(high > most):
            raise Misfit(
                f"limits {low.min():g} and {high.max():g}", f"limits in [{least:g}, {most:g}]"
            )
    return low, high


def _conversions(plan: Plan, channel: Channel, named: Named) -> list[tuple[float, float]]:
    """Return (factor, offset) from the variable's unit to the channel's, for each element."""
    if channel.unit is None:
        return [(1.0, 0.0)] * len(named.elements)
    return _to(plan, named, channel.unit)


def _to(plan: Plan, named: Named, unit: str) -> list[tuple[float, float]]:
    units = next(c.description.units for c in plan.components if c.path == named.path)
    found = []
    for i in named.elements:
        own = named.variable.unit_of_element(i)
        pair = (1.0, 0.0) if own is None else conversion(own, unit, units)
        if pair is None:
            raise Misfit(f"unit {unit!r} for a variable in {own!r}", "a unit of its kind")
        found.append(pair)
    return found
