"""Assumptions of a fit about inputs, sensors, water and residuals, and what they add as unknowns.

An unknown that is not a parameter of the system (a nuisance parameter) is fitted with the others:
the delay of commands and forces, the biases of sensors, and a constant current.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.studies.identification.inputs import COURSES
from uuvsim_cosim.studies.identification.parameters import Fitted

__all__ = ["MEASURED", "RESIDUALS", "UNKNOWN", "WATER", "Assumptions"]

MEASURED = (
    "N", "E", "D", "phi", "theta", "psi", "u", "v", "w", "p", "q", "r",
)  # fmt: skip
RESIDUALS = ("robust", "ar1", "white")
# Feeds that are no commands and no forces: an unknown delay does not move them.
WATER = frozenset({"voltage", "v_c", "nu_r", "nu", "eta", "q", "current", "rho"})
_CURRENT = ("current_N", "current_E", "current_D")
_BIASED = MEASURED[2:]  # biases of N and E are those of the initial state
UNKNOWN = ("delay", *_CURRENT, *(f"bias_{n}" for n in _BIASED))
# Names for several unknowns; a bias of D is fitted only if it is named.
_GROUPS = {"current": _CURRENT[:2], "bias": tuple(f"bias_{n}" for n in _BIASED[1:])}
_SIZES = {"delay": 0.1, "current": 0.2, "bias": 0.1}  # s, m/s, and m, rad, m/s or rad/s
_EARLIEST, _LATEST = -0.3, 1.0  # s of delay
_WIDEST = {"current": 3.0, "bias": 1.0}


@dataclass(frozen=True)
class Assumptions:
    """What a fit assumes of a recording.

    `inputs`: how commands and forces vary between samples: ``held``, ``linear`` or ``smooth``.
    `delay` [s]: how much later than recorded they act. `unknown`: what is fitted besides the
    parameters: ``delay``, ``current``, ``bias``, or single ones such as ``bias_r``. `residuals`:
    ``white`` (independent), ``ar1`` (autoregressive, fitted for each output), or ``robust``
    (independent in the fit; if they are correlated, the intervals are those of the sandwich
    covariance).

    Example:

    >>> from uuvsim_cosim.studies.identification.assumptions import Assumptions
    >>> Assumptions("smooth", unknown=("delay", "current")).names
    ('delay', 'current_N', 'current_E')
    """

    inputs: str = "held"
    delay: float = 0.0
    unknown: tuple[str, ...] = ()
    residuals: str = "robust"

    def __post_init__(self) -> None:
        """Check the options; raises InputInvalid."""
        for option, value, known in (
            ("--inputs", self.inputs, COURSES), ("--residuals", self.residuals, RESIDUALS),
        ):  # fmt: skip
            if value not in known:
                raise InputInvalid(f"{option} {value}", f"one of {', '.join(known)}")
        for name in self.unknown:
            if name not in UNKNOWN and name not in _GROUPS:
                raise InputInvalid(
                    f"--unknown {name}",
                    f"{', '.join(_GROUPS)} or single ones: {', '.join(UNKNOWN)}",
                )
        if not _EARLIEST <= self.delay <= _LATEST:
            raise InputInvalid(f"--delay {self.delay:g}", f"{_EARLIEST:g} to {_LATEST:g} s")

    @property
    def names(self) -> tuple[str, ...]:
        """Return the single unknowns that are asked for."""
        every = [n for name in self.unknown for n in _GROUPS.get(name, (name,))]
        return tuple(dict.fromkeys(every))

    def unknowns(self, measured: Collection[str]) -> list[Fitted]:
        """Return the unknowns besides the parameters; biases of those that are `measured`."""
        found = []
        for name in self.names:
            kind, _, of = name.partition("_")
            if kind == "bias" and of not in measured:
                if name in self.unknown:
                    raise InputInvalid(
                        f"--unknown {name}: {of} is not measured", f"one of {', '.join(measured)}"
                    )
                continue
            unit = {"delay": "s", "current": "m/s"}.get(kind) or _unit(of)
            start = self.delay if kind == "delay" else 0.0
            low, high = (_EARLIEST, _LATEST) if kind == "delay" else (-_WIDEST[kind], _WIDEST[kind])
            found.append(Fitted(name, (), start, unit, low, high, size=_SIZES[kind]))
        return found

    @property
    def texts(self) -> list[str]:
        """Return what is assumed, as it is reported."""
        courses = {"held": "are held from sample to sample", "linear": "are linear between samples",
                   "smooth": "are smooth between samples"}  # fmt: skip
        names = self.names
        delay = (
            "their delay is fitted" if "delay" in names
            else f"they act {1e3 * self.delay:.4g} ms later" if self.delay else "they act at once"
        )  # fmt: skip
        biases = [n.partition("_")[2] for n in names if n.startswith("bias_")]
        current = "fitted" if "current_N" in names or "current_E" in names else "that of the system"
        residuals = {
            "white": "independent", "ar1": "autoregressive of first order",
            "robust": "independent; if they are not, intervals are widened",
        }  # fmt: skip
        return [
            f"commands and forces {courses[self.inputs]} (--inputs {self.inputs}), and {delay}",
            f"biases of {', '.join(biases)} are fitted" if biases else "sensors have no bias",
            f"the current is {current}",
            f"residuals are {residuals[self.residuals]} (--residuals {self.residuals})",
        ]


def _unit(signal: str) -> str:
    if signal in ("N", "E", "D"):
        return "m"
    if signal in ("phi", "theta", "psi"):
        return "rad"
    return "m/s" if signal in ("u", "v", "w") else "rad/s"
