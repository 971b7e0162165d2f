"""The declaration of a component: named, united variables and the equations between them.

A `Model` is written once, in CasADi's SX, and runs as FMU, as native component, as kernel and
as derivative. Its semantics over one communication step from t to t + h, inputs held:

* continuous states follow ``der`` by RK4, in sub-steps of at most ``h_max``;
* a clock ticks at every k·period; each tick inside the step cuts the integration, and the
  clock's updates are evaluated there, all from the values before the tick;
* outputs are evaluated at the end of the step;
* `derived` values depend on parameters alone and are computed when those change.

Options of a declaration are structural choices, as Python or a system's file writes them (`is_on`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from math import prod
from typing import Any, Literal

import casadi as ca
import numpy as np

from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.lazy import by_name
from uuvsim_cosim.models.declaration.units import unit_of

__all__ = ["Clock", "Declared", "Model", "Units", "Value", "is_on"]

Units = str | Sequence[str]
Value = float | int | bool | Sequence[float] | np.ndarray
Kind = Literal["input", "parameter", "derived", "state", "discrete", "output"]
Type = Literal["Float64", "Int32", "Boolean"]


@dataclass(frozen=True)
class Declared:
    """One declared variable; `size` elements, flat; `shape` is () for a scalar."""

    name: str
    kind: Kind
    symbol: ca.SX
    unit: str
    shape: tuple[int, ...]
    start: Any  # ca.SX of a derived value; numbers or ca.SX of a state; None of an output
    type: Type = "Float64"
    min: float | None = None
    max: float | None = None
    variability: str = "continuous"
    description: str = ""
    units: tuple[str, ...] = ()  # one for each element where they differ; `unit` is "" then
    soft_min: bool = False  # of an input, see `Model.input`

    @property
    def size(self) -> int:
        """Return the number of scalar elements."""
        return int(prod(self.shape))


@dataclass
class Clock:
    """A sample clock: ticks at k·period; `draws` are standard normals, fresh at each tick."""

    name: str
    period: Fraction
    index: int
    updates: list[tuple[Declared, ca.SX]] = field(default_factory=list)
    draws: list[ca.SX] = field(default_factory=list)


class Model:
    """A component under declaration: variables with units, and the equations between them.

    `name` names it, `description` is a text, `h_max` the longest step of RK4 [s]. Each method that
    declares a variable `name` returns its CasADi symbol. The `shape` is () for a scalar, n for a
    vector, (rows, columns) for a matrix. The `unit` is one for all elements, or one for each;
    `start`, `min` and `max` are in it. `type` is Float64, Int32 or Boolean. A unit, a shape or a
    name that does not fit raises ParameterInvalid.

    Over a communication step from t to t + h, inputs are held and states follow `der` by RK4.
    Each tick of a clock cuts the integration; its updates see the values before the tick. Outputs
    are evaluated at the end of the step.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> m = uuv.Model("lag", "First-order lag")
    >>> u = m.input("u", unit="V")
    >>> T = m.parameter("T", 2.0, unit="s", min=0.01)
    >>> y = m.state("y", unit="V")
    >>> m.der(y, (u - y) / T)
    >>> voltage = m.output("voltage", y, unit="V")
    >>> [v.name for v in m.of_kind("input", "parameter")], m.starts()["T"]
    (['u', 'T'], array([2.]))
    >>> step = uuv.simulate(m, until=2.0, inputs={"u": 1.0})
    >>> f"{step['voltage'][-1]:.3f} V"  # 1 - exp(-1)
    '0.632 V'

    Example: a sensor that samples ten times a second, with noise.

    >>> m = uuv.Model("gauge", "Pressure gauge")
    >>> p = m.input("p", unit="Pa")
    >>> clock = m.clock("sample", "0.1")
    >>> sample = m.discrete("sample", unit="Pa")
    >>> m.update(clock, sample, p + 50.0 * m.normal(clock))  # standard deviation 50 Pa
    >>> reading = m.output("reading", sample, unit="Pa", discrete=True)
    """

    def __init__(self, name: str, description: str = "", h_max: float = 0.01) -> None:
        if not 0.0 < h_max < float("inf"):
            raise ParameterInvalid(name, f"h_max {h_max:g} s", "more than 0")
        self.name = name
        self.description = description
        self.h_max = h_max
        self.t = ca.SX.sym("time")
        self.variables: dict[str, Declared] = {}
        self.clocks: list[Clock] = []
        self.derivatives: dict[str, ca.SX] = {}
        self.made_for: dict[str, str] = {}  # id@set by what, see `fmus/pairs.py`
        self.only_arrays: set[str] = set()  # too large for FMI 2.0, which lists elements one by one
        self.peers: dict[str, str] = {}  # what an input is for, see `orchestrator/system/system.py`

    # ---- declarations ---------------------------------------------------------------------

    def input(
        self,
        name: str,
        shape: int | tuple[int, ...] = (),
        *,
        unit: Units,
        start: Value = 0.0,
        min: float | None = None,
        max: float | None = None,
        soft_min: bool = False,
        type: Type = "Float64",
        description: str = "",
    ) -> ca.SX:
        """Declare an input, held over each communication step; `start` if nothing feeds it.

        A start value out of [min, max] is refused. With `soft_min`, an importer of the FMU may set
        a value below `min`: the FMU reports the first one, and the equations must be valid there.
        """
        variability = "continuous" if type == "Float64" else "discrete"
        symbol = self._declare(
            name, "input", shape, unit, start, type, min, max, variability, description
        )
        if soft_min:
            self.variables[name] = replace(self.variables[name], soft_min=True)
        return symbol

    def parameter(
        self,
        name: str,
        value: Value,
        shape: int | tuple[int, ...] | None = None,
        *,
        unit: Units,
        min: float | None = None,
        max: float | None = None,
        type: Type = "Float64",
        tunable: bool = True,
        description: str = "",
    ) -> ca.SX:
        """Declare a parameter; its `shape` is that of `value` unless given (matrices row by row).

        A `tunable` parameter may change during a run.
        """
        if shape is None:
            shape = np.shape(value)
        variability = "tunable" if tunable else "fixed"
        return self._declare(
            name, "parameter", shape, unit, value, type, min, max, variability, description
        )

    def derived(self, name: str, expression: ca.SX | Value) -> ca.SX:
        """Declare a value that depends on parameters alone, by an `expression` of them.

        It is computed when they change, not in each step. Zeros of it stay structural.

        Example:

        >>> import casadi as ca
        >>> import uuvsim_cosim as uuv
        >>> m = uuv.Model("body")
        >>> M = m.parameter("M", [[30.0, 1.0], [1.0, 40.0]], unit="kg")
        >>> m.derived("M_inv", ca.inv(M)).shape
        (2, 2)
        """
        expression = ca.SX(expression)
        symbol = ca.SX.sym(name, expression.sparsity())
        shape = (int(expression.nnz()),)
        self._add(Declared(name, "derived", symbol, "1", shape, expression, variability="tunable"))
        return symbol

    def state(
        self,
        name: str,
        start: Value | ca.SX = 0.0,
        shape: int | tuple[int, ...] = (),
        *,
        unit: Units,
        description: str = "",
    ) -> ca.SX:
        """Declare a continuous state; `start` is a number, an array or an SX of parameters."""
        return self._declare(
            name, "state", shape, unit, start, "Float64", None, None, "continuous", description
        )

    def discrete(
        self,
        name: str,
        start: Value | ca.SX = 0.0,
        shape: int | tuple[int, ...] = (),
        *,
        unit: Units,
        description: str = "",
    ) -> ca.SX:
        """Declare a discrete state, which changes only in `update` at ticks of a clock."""
        return self._declare(
            name, "discrete", shape, unit, start, "Float64", None, None, "discrete", description
        )

    def clock(self, name: str, period: Fraction | str | float) -> Clock:
        """Declare a sample clock that ticks at each multiple of `period` [s].

        A float is read as its shortest decimal form.
        """
        exact = Fraction(str(period))
        if exact <= 0:
            raise ParameterInvalid(f"{self.name}.{name}", f"period {period} s", "more than 0")
        clock = Clock(name, exact, len(self.clocks))
        self.clocks.append(clock)
        return clock

    def normal(self, clock: Clock, size: int = 1) -> ca.SX:
        """Return `size` standard normal draws, fresh and independent at each tick of the clock."""
        if "seed" not in self.variables:
            self.parameter(
                "seed",
                (0, 0),
                unit="1",
                type="Int32",
                tunable=False,
                description="key of the random numbers; equal seeds give equal bits",
            )
        draw = ca.SX.sym(f"{clock.name}_w{len(clock.draws)}", size)
        clock.draws.append(draw)
        return draw

    # ---- equations ------------------------------------------------------------------------

    def der(self, state: ca.SX, expression: ca.SX | Value) -> None:
        """Set the time derivative of a continuous `state` to an `expression`, in its unit per s."""
        declared = self._declared(state, "state")
        if declared.name in self.derivatives:
            raise ParameterInvalid(f"{self.name}.{declared.name}: der() is given twice")
        self.derivatives[declared.name] = self._shaped(declared, expression)

    def update(self, clock: Clock, discrete: ca.SX, expression: ca.SX | Value) -> None:
        """Set the value of a `discrete` state after a tick of `clock`.

        The `expression` sees the values before the tick.
        """
        declared = self._declared(discrete, "discrete")
        clock.updates.append((declared, self._shaped(declared, expression)))

    def output(
        self,
        name: str,
        expression: ca.SX | Value,
        *,
        unit: Units,
        type: Type = "Float64",
        description: str = "",
        discrete: bool = False,
    ) -> ca.SX:
        """Declare an output, the `expression` at the end of each communication step.

        It is `discrete` if it changes only at ticks of a clock.
        """
        expression = ca.densify(ca.SX(expression))
        shape: tuple[int, ...] = () if expression.numel() == 1 else (int(expression.numel()),)
        variability = "discrete" if discrete or type != "Float64" else "continuous"
        flat = ca.vec(expression.T)
        common, units = self._units(name, unit, int(flat.numel()))
        self._add(
            Declared(
                name,
                "output",
                flat,
                common,
                shape,
                None,
                type,
                variability=variability,
                description=description,
                units=units,
            )
        )
        return expression

    # ---- inside ---------------------------------------------------------------------------

    def of_kind(self, *kinds: Kind) -> list[Declared]:
        """List the declared variables of the given `kinds`, in the order of declaration."""
        return [v for v in self.variables.values() if v.kind in kinds]

    def _declare(
        self,
        name: str,
        kind: Kind,
        shape: int | tuple[int, ...],
        unit: Units,
        start: Value | ca.SX,
        type: Type,
        low: float | None,
        high: float | None,
        variability: str,
        description: str,
    ) -> ca.SX:
        if shape == ():
            if isinstance(start, ca.SX):
                shape = int(start.numel()) if start.numel() > 1 else ()
            else:
                shape = np.shape(start)
        if isinstance(shape, int):
            shape = (shape,)
        size = int(np.prod(shape, dtype=int))
        common, units = self._units(name, unit, size)
        flat = ca.SX.sym(name, size)
        if not isinstance(start, ca.SX):
            start = np.broadcast_to(np.asarray(start, dtype=float), shape).ravel()
        elif start.numel() != size:
            raise ParameterInvalid(
                f"{self.name}.{name}", f"start has {start.numel()} elements", size
            )
        declared = Declared(
            name, kind, flat, common, shape, start, type, low, high, variability, description, units
        )
        self._add(declared)
        return ca.reshape(flat, shape[1], shape[0]).T if len(shape) == 2 else flat

    def _units(self, name: str, unit: Units, size: int) -> tuple[str, tuple[str, ...]]:
        each = (unit,) * size if isinstance(unit, str) else tuple(unit)
        for text in dict.fromkeys(each):
            unit_of(text, f"{self.name}.{name}")
        if len(each) != size:
            raise ParameterInvalid(f"{self.name}.{name}", f"{len(each)} units", f"one, or {size}")
        return (each[0] if each else "1", ()) if len(set(each)) <= 1 else ("", each)

    def _add(self, declared: Declared) -> None:
        if declared.name in self.variables:
            raise ParameterInvalid(f"{self.name}: variable {declared.name!r} is declared twice")
        self.variables[declared.name] = declared

    def _declared(self, symbol: ca.SX, kind: Kind) -> Declared:
        for v in self.of_kind(kind):
            if v.symbol.shape == symbol.shape and ca.is_equal(v.symbol, symbol):
                return v
        raise ParameterInvalid(f"{self.name}: {symbol} is not a declared {kind}")

    def _shaped(self, declared: Declared, expression: ca.SX | Value) -> ca.SX:
        flat = ca.densify(ca.SX(expression))
        if flat.numel() != declared.size:
            raise ParameterInvalid(
                f"{self.name}.{declared.name}",
                f"equation has {flat.numel()} elements",
                declared.size,
            )
        return ca.vec(flat)

    def _repr_html_(self) -> str:
        """Return the table of variables, of a vehicle also its balance, for notebooks."""
        return str(by_name("view.notebook.displays:model_html")(self))

    def starts(self) -> Mapping[str, Any]:
        """Return each parameter's and input's start values, flat."""
        return {v.name: v.start for v in self.of_kind("input", "parameter")}


def is_on(name: str, value: bool | str, *further: str) -> bool:
    """Read an option that is true or false; raises InputInvalid, which lists `further` too."""
    text = str(value).lower()
    if text not in ("true", "false", "1", "0"):
        raise InputInvalid(f"{name}={value!r}", ", ".join(("true", "false", *further)))
    return text in ("true", "1")
