"""Variable communication step: what a system states of it, as a value and as text."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from fractions import Fraction
from math import isfinite
from typing import Literal, get_args

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import expected_names

__all__ = ["PowerBond", "VariableStep", "variable_step_of_text"]

Estimate = Literal["connections", "bonds", "both"]
_PLACE = "variable step"


@dataclass(frozen=True)
class PowerBond:
    """Two components that exchange a power: on each side, an input times an output.

    `first` and `second` are an input and an output of the two components, as
    ``("chassis.velocity", "chassis.force")``. The input of each side is connected to the output of
    the other. What the products differ by is power that the coupling makes or loses.
    """

    name: str
    first: tuple[str, str]
    second: tuple[str, str]


@dataclass(frozen=True)
class VariableStep:
    """Communication step whose length follows an estimate of the coupling's error.

    Lengths `smallest`, `largest` and `first` are in s, and whole multiples of the system's tick.
    The `estimate` is 1 where the error equals absolute + relative · |value|:

    - "connections": the difference between the input that was used and the value that follows from
      the output at the step's end, the largest of all delayed connections of continuous numbers.
      `tolerances` gives a connection, by its input, an absolute and a relative one of its own,
      and adds connections of outputs that are declared as discrete.
    - "bonds": the energy residual of the power `bonds` (Sadjina et al. 2017, as libcosim has it).
    - "both": the larger of the two.

    The next step is the present one times
    safety · e^-(integral + proportional) · e'^proportional, at least times `slowest` and at most
    times `fastest`; e' is the estimate of the step before. With `rollback`, a step with e > 1 is
    made again, with a shorter step, from the states at its start. `order` is that of the
    polynomial by which inputs are extrapolated: an input has, over the step, its mean.
    """

    smallest: Fraction
    largest: Fraction
    first: Fraction | None = None
    absolute: float = 1e-6
    relative: float = 1e-4
    order: int = 0
    rollback: bool = True
    estimate: Estimate = "connections"
    safety: float = 0.9
    slowest: float = 0.2
    fastest: float = 2.0
    proportional: float | None = None
    integral: float | None = None
    bonds: tuple[PowerBond, ...] = ()
    tolerances: tuple[tuple[str, float, float], ...] = ()

    def __post_init__(self) -> None:
        """Check the numbers; raises InputInvalid."""
        if not 0 < self.smallest <= self.largest:
            raise InputInvalid(
                _PLACE,
                f"smallest {float(self.smallest):g} s, largest {float(self.largest):g} s",
                "0 < smallest <= largest",
            )
        if not self.smallest <= self.beginning <= self.largest:
            raise InputInvalid(
                _PLACE,
                f"first {float(self.beginning):g} s",
                f"from {float(self.smallest):g} to {float(self.largest):g} s",
            )
        if self.order not in range(4):
            raise InputInvalid(_PLACE, f"order {self.order}", "0, 1, 2 or 3")
        if self.estimate not in get_args(Estimate):
            raise InputInvalid(_PLACE, f"estimate {self.estimate!r}", "connections, bonds or both")
        own = [(f"tolerances of {name}", x) for name, *both in self.tolerances for x in both]
        for name, x in (("absolute", self.absolute), ("relative", self.relative), *own):
            if not (isfinite(x) and x >= 0.0):
                raise InputInvalid(_PLACE, f"{name} {x:g}", "a number, 0 or more")
        for absolute, relative in (
            (self.absolute, self.relative),
            *(t[1:] for t in self.tolerances),
        ):
            if absolute == 0.0:
                raise InputInvalid(
                    _PLACE,
                    f"absolute {absolute:g} (relative {relative:g})",
                    "an absolute tolerance above 0: of a value of 0, a relative one is none",
                )
        if not (0.0 < self.safety <= 1.0):
            raise InputInvalid(_PLACE, f"safety {self.safety:g}", "above 0 and at most 1")
        if not (0.0 < self.slowest < 1.0 <= self.fastest < float("inf")):
            raise InputInvalid(
                _PLACE,
                f"slowest {self.slowest:g}, fastest {self.fastest:g}",
                "0 < slowest < 1 <= fastest",
            )
        for name, gain in (("proportional", self.gains[0]), ("integral", self.gains[1])):
            if not (isfinite(gain) and gain >= 0.0):
                raise InputInvalid(_PLACE, f"{name} {gain:g}", "a number, 0 or more")

    @property
    def beginning(self) -> Fraction:
        """The length of the first step [s]: `first`, else the smallest."""
        return self.smallest if self.first is None else self.first

    @property
    def gains(self) -> tuple[float, float]:
        """Proportional and integral gain; by default 0.4 and 0.3 over order + 1 (Gustafsson)."""
        k = self.order + 1.0
        return (
            0.4 / k if self.proportional is None else self.proportional,
            0.3 / k if self.integral is None else self.integral,
        )

    def text(self) -> str:
        """Write the step as `variable_step_of_text` reads it, without bonds and tolerances."""
        plain = VariableStep(self.smallest, self.largest)
        words = [
            f"{f.name}={_written(getattr(self, f.name))}"
            for f in fields(self)
            if f.name not in ("bonds", "tolerances")
            and (
                f.name in ("smallest", "largest") or getattr(self, f.name) != getattr(plain, f.name)
            )
        ]
        return " ".join(words)


def _written(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return repr(value) if isinstance(value, float) else str(value)


def variable_step_of_text(
    text: str, base: VariableStep | None = None
) -> tuple[VariableStep, Fraction | None]:
    """Read ``smallest=1e-5 largest=1e-2 relative=1e-5 order=1``; raises InputInvalid.

    Names are those of `VariableStep`, lengths are in s. What is not named is that of `base`. Return
    a `tick` [s] as well if the text names one.
    """
    names = [f.name for f in fields(VariableStep) if f.name not in ("bonds", "tolerances")]
    given: dict[str, object] = {}
    tick: Fraction | None = None
    for word in text.replace(",", " ").split():
        name, equals, value = word.partition("=")
        if name == "tick" and equals:
            tick = Fraction(str(_read("smallest", value)))
            continue
        if name not in names or not equals:
            expected = f"{expected_names(name, [*names, 'tick'], 'a setting')}, as largest=0.01"
            raise InputInvalid(_PLACE, f"{word!r}", expected)
        given[name] = _read(name, value)
    if base is not None:
        return replace(base, **given), tick  # type: ignore[arg-type]  # of `_read`'s types
    missing = [n for n in ("smallest", "largest") if n not in given]
    if missing:
        raise InputInvalid(_PLACE, f"no {' and no '.join(missing)} in {text!r}", "both, in s")
    return VariableStep(**given), tick  # type: ignore[arg-type]


def _read(name: str, value: str) -> object:
    try:
        if name in ("smallest", "largest", "first"):
            return Fraction(value)
        if name == "estimate":
            return value
        if name == "rollback":
            return {"yes": True, "no": False, "true": True, "false": False}[value.lower()]
        return int(value) if name == "order" else float(value)
    except (ValueError, KeyError, ZeroDivisionError):
        wanted = {"rollback": "yes or no", "order": "0, 1, 2 or 3"}.get(name, "a number")
        raise InputInvalid(_PLACE, f"{name}={value}", wanted) from None
