"""Identification: parameters of a system's declarations, fitted to a recording of the vehicle."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.recording.signals import Signals
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.studies.identification.assumptions import MEASURED, Assumptions
from uuvsim_cosim.studies.identification.experiment import WEAK, ambiguities, scaled_information
from uuvsim_cosim.studies.identification.outliers import residual_outliers
from uuvsim_cosim.studies.identification.residuals import Whiteness, warning_of

if TYPE_CHECKING:
    from uuvsim_cosim.studies.identification.experiment import Proposal
    from uuvsim_cosim.studies.identification.parameters import Fitted

__all__ = [
    "Actuator", "Identified", "Number", "expectation", "identify", "recorded_system", "system_of",
    "unanswered",
]  # fmt: skip

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Number:
    """A fitted parameter: value, 95 % interval, start value, and its places in the system."""

    name: str
    value: float
    low: float
    high: float
    start: float
    unit: str
    places: tuple[str, ...]
    at_bound: bool
    nuisance: bool = False  # no parameter of the system: a delay, a bias, a current

    @property
    def half_width(self) -> float:
        """Return half of the 95 % interval."""
        return 0.5 * (self.high - self.low)

    @property
    def is_known(self) -> bool:
        """Whether the 95 % interval is within half of the value."""
        return bool(self.half_width < 2.0 * WEAK * abs(self.value))


@dataclass(frozen=True)
class Actuator:
    """A thruster with fitted parameters: its path, and its number on the vehicle."""

    path: str
    source: str  # model:…
    number: int  # from 1, its element of the wrench's thrust
    of: int  # number of thrusters of the wrench
    held: Mapping[str, float]  # its parameters in the system that were not fitted


@dataclass(frozen=True)
class Identified:
    """Result of a fit: parameters, residuals, and what the data do not determine.

    `numbers` are the fitted parameters, each with its 95 % interval, and `correlation` is that of
    their errors. `residuals` are the root mean squares of the measured signals, `open` are messages
    on what the data do not determine, and `proposals` are manoeuvres that would determine it.
    `hull`, `source`, `held` and `actuators` are the fitted components with their other parameters.
    `recording`, `samples`, `seconds` and `step` describe the data, and `iterations`, `converged`,
    `status` and `notes` the solution. `assumed` are messages on what the fit assumes, and
    `whiteness` are tests of the residuals; `warning` tells what to do if one fails.

    Example: a vehicle that does not turn tells nothing about the damping of a turn.

    >>> import uuvsim_cosim as uuv
    >>> from uuvsim_cosim.studies import identify
    >>> system = uuv.load("bluerov2_hold").set("hull.eta_0", [0, 0, 5, 0, 0, 0])
    >>> dive = uuv.run(system, until=3, out="dive", backend="native")
    >>> found = identify(dive.folder, system, ["D_q_66"], step=0.05, proposals=False)
    >>> found.open, found["D_q_66"].is_known
    (('the data do not determine hull.D_q_66',), False)
    """

    numbers: tuple[Number, ...]
    correlation: Array  # of the numbers' errors (n, n)
    residuals: Mapping[str, float]  # root mean square of what was measured, by element
    open: tuple[str, ...]  # messages: what the data do not determine
    proposals: tuple[Proposal, ...]  # manoeuvres, the most informative first
    hull: str  # its path
    source: str  # its source, model:…
    held: Mapping[str, float]  # the hull's numbers as the system set them
    actuators: tuple[Actuator, ...]  # the thrusters with fitted parameters
    recording: str
    samples: int
    seconds: float
    step: float
    iterations: int
    converged: bool
    status: str
    notes: tuple[str, ...]
    assumed: tuple[str, ...] = ()  # about inputs, sensors, water and residuals
    whiteness: tuple[Whiteness, ...] = ()  # tests of the residuals, by signal
    warning: str | None = None  # if the residuals are not white

    def __getitem__(self, name: str) -> Number:
        """Return a number by its name; the hull's without its path too."""
        for n in self.numbers:
            if name in (n.name, n.name.rpartition(".")[2]):
                return n
        raise InputInvalid(f"no number {name!r}", ", ".join(n.name for n in self.numbers))


def identify(
    recording: Signals | str | Path,
    system: System | str | Path | None,
    parameters: Sequence[str],
    *,
    mapped: Mapping[str, str] | None = None,
    hull: str | None = None,
    step: float | None = None,
    first: float = 0.0,
    last: float | None = None,
    proposals: bool = True,
    assumed: Assumptions | None = None,
    report: Callable[[str], None] = lambda text: None,
    progress: Callable[[int, float], None] = lambda iteration, residual: None,
) -> Identified:
    """Fit parameters of a system to a recording, by multiple shooting on its own equations.

    `recording` is a folder, .parquet, .mcap, .csv, ArduSub's .BIN or .tlog, or `Signals`; `system`
    is a name, a file, a `System`, or a hull alone (``model:bluerov2``), which gets the thrusters of
    its folder if the recording has commands and no forces; None takes the vehicle that a log
    names. `parameters` are names such
    as ``D_q_11`` (of the hull), ``hull.m``, ``thruster_*.K_n`` (one number for all). `mapped` maps
    a signal of the system to that of the recording that stands for it. `hull` is the path of the
    hull, if the system has several. `step` [s] is that of the grid, and only the time from `first`
    to `last` [s] is used. With `proposals`, manoeuvres that would tell more are computed as well.
    `assumed` states how inputs vary between samples, and which delays, biases and currents are
    unknown; by default, inputs are held and nothing of that is unknown.
    Before the fit, `report` is called with each text on which parameters the recording determines,
    by Fisher information at their start values. `progress` is called with the number of each
    iteration and the root mean square of the weighted residuals. Ctrl-C ends the fit, and the best
    values so far are the result.

    Raises InputInvalid that names the missing signals, or the parameters that do not exist.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> from uuvsim_cosim.studies import identify
    >>> filed = uuv.load("bluerov2_hold").set("hull.eta_0", [0, 0, 5, 0, 0, 0])
    >>> dive = uuv.run(filed.set("hull.D_q_11", 200), until=5, out="dive", backend="native")
    >>> found = identify(dive.folder, filed, ["D_q_11"], first=1, step=0.05, proposals=False)
    >>> number = found["D_q_11"]
    >>> number.start, round(number.value)
    (141.0, 200)
    """
    from uuvsim_cosim.studies.identification.experiment import improvements, propose
    from uuvsim_cosim.studies.identification.fit import expected_information, fit
    from uuvsim_cosim.studies.identification.fitted_model import GreyBox
    from uuvsim_cosim.studies.identification.logs import read_log
    from uuvsim_cosim.studies.identification.parameters import wanted_parameters
    from uuvsim_cosim.studies.identification.shooting import Shooting
    from uuvsim_cosim.studies.identification.signals import Lookup, grid_of

    assumed = assumed or Assumptions()
    signals = recording if isinstance(recording, Signals) else read_log(recording)
    mixed = system if isinstance(system, System) else recorded_system(signals, system)
    plan = flatten(mixed.with_mismatches("warn"))  # a hull whose numbers are sought is another
    at = _hull(plan, hull)
    _check_thrusters(signals, plan)
    lookup = Lookup(signals, mapped or {})
    fitted = wanted_parameters(plan, at, parameters)
    fitted += assumed.unknowns(lookup.measured(plan.components[at].path))
    box = GreyBox(plan, at, fitted, exact="tick" in signals.metadata)
    grid = grid_of(box, lookup, h=step, first=first, last=last, assumed=assumed)
    problem = Shooting(box, grid)
    for text in expectation(fitted, expected_information(problem)):
        report(text)
    found = fit(box, grid, problem=problem, residuals=assumed.residuals, progress=progress)
    error = np.sqrt(np.maximum(np.diag(found.covariance), 0.0))
    numbers = tuple(
        Number(
            f.name, float(v), float(v - 1.96 * s), float(v + 1.96 * s), f.start, f.unit,
            tuple(f"{plan.components[i].path}.{n}" for i, n in f.places),
            bool(min(abs(v - f.low), abs(v - f.high)) < 1e-4 * max(abs(f.start), f.size, 1e-9)),
            not f.places,
        )
        for f, v, s in zip(fitted, found.theta, error, strict=True)
    )  # fmt: skip
    notes = [
        f"{n.name} is at its bound: its interval is not reliable" for n in numbers if n.at_bound
    ]
    notes += [*signals.metadata.get("remarks", ())]
    logged, stated = signals.metadata.get("vehicle"), _vehicle_of(plan, at)
    if logged and stated and logged != stated:
        notes.append(f"the log is of {logged}, by its frame, and the fitted hull is {stated}")
    notes += [f"left out: {e}" for e in signals.metadata.get("excluded", ())]
    if problem.windows.pieces > box.pieces(grid.h):
        notes.append(
            f"integrated in steps of {grid.h / problem.windows.pieces:.3g} s, because longer ones "
            "moved the numbers"
        )
    if grid.computed:
        notes.append(f"computed from recorded signals: {', '.join(grid.computed)}")
    measured = {n: bool(np.isfinite(y).any()) for n, y in zip(MEASURED, grid.y, strict=True)}
    notes += grid.outliers
    if found.point is not None:
        points = problem.steps[:, :1] + np.arange(problem.m + 1)
        times = grid.begin + grid.t[np.minimum(points, len(grid.t) - 1)].ravel()
        residual = found.point.residual.reshape(-1, len(MEASURED))
        notes += residual_outliers(MEASURED, residual.T, times)
    if problem.cuts:
        notes.append(
            f"the model is unstable: the recording was cut at {problem.cuts} points, where a new "
            "initial state begins"
        )
    if not all(measured.values()):
        notes.append(f"not measured: {', '.join(n for n, seen in measured.items() if not seen)}")
    flown = tuple(propose(box, found)) if proposals else ()
    notes += unanswered(numbers, flown)
    actuators = []  # the fitted components whose thrust is an input of a wrench
    for i in sorted({i for f in fitted for i, _ in f.places} - {at}):
        part = box.parts[i]
        own_names = {n for f in fitted for k, n in f.places if k == i}
        held = {n: part.start_of(n) for n in part.usual if n not in own_names}
        for t in plan.transfers:
            if t.source == i and t.source_variable.name == t.target_variable.name == "thrust":
                size = int(np.prod(t.target_variable.shape, dtype=int))
                number = t.target_elements[0] + 1
                actuators.append(Actuator(part.path, part.source, number, size, held))
    recorded = str(signals.metadata.get("file", recording if isinstance(recording, (str, Path))
                   else signals.metadata.get("system", "signals")))  # fmt: skip
    whole = box.parts[at]
    return Identified(
        numbers,
        found.covariance / np.outer(error, error),
        {n: float(s) for (n, seen), s in zip(measured.items(), found.sigma, strict=True) if seen},
        tuple(
            ambiguities(
                [f.name for f in fitted], scaled_information(found.information, found.theta, fitted)
            )
        ),
        flown,
        whole.path,
        whole.source,
        {v.name: whole.start_of(v.name) for v in whole.model.of_kind("parameter") if v.size == 1},
        tuple(actuators),
        Path(recorded).name,
        found.samples,
        float(grid.t[-1]),
        grid.h,
        found.iterations,
        found.converged,
        found.status,
        tuple(notes),
        tuple(assumed.texts),
        found.whiteness,
        warning_of(
            found.whiteness,
            found.widened,
            assumed.residuals,
            lambda: improvements(box, grid, found, assumed),
        ),
    )


def expectation(fitted: Sequence[Fitted], information: Array) -> list[str]:
    """Return messages on which parameters a recording determines, by its Fisher information."""
    start = np.array([f.start for f in fitted])
    scaled = scaled_information(information, start, fitted)
    covariance = np.linalg.inv(scaled + 1e-6 * np.eye(len(fitted)))
    shares = 1.96 * np.sqrt(np.maximum(np.diag(covariance), 0.0))
    known: list[str] = []
    others: list[str] = []
    for f, share in ((f, s) for f, s in zip(fitted, shares, strict=True) if f.places):
        told = f"{f.name} (± {100 * share:.2g} %)" if share < 10.0 else f.name
        (known if share < 2.0 * WEAK else others).append(told)
    texts = []
    if known:
        texts.append(f"before the fit: the recording determines {', '.join(known)}")
    if others:
        texts.append(f"before the fit: the recording does not determine {', '.join(others)}")
    return texts


def unanswered(numbers: Sequence[Number], flown: Sequence[Proposal]) -> list[str]:
    """Return a message on parameters that neither the data nor a manoeuvre determines."""
    limits = [2.0 * WEAK * abs(n.value) for n in numbers]
    undetermined = [
        n.name
        for k, n in enumerate(numbers)
        if not n.nuisance
        and n.half_width > limits[k]
        and all(p.half_widths[k] > limits[k] for p in flown)
    ]
    if not undetermined or not flown:
        return []
    return [
        f"none of the {len(flown)} manoeuvres determines {', '.join(undetermined)}: set some of "
        "them to known values (--set), and fit the others"
    ]


def system_of(source: str | Path) -> System:
    """Load a system by its name or file, or make one of a hull alone (``model:bluerov2``)."""
    if str(source).startswith("model:"):
        return System("identified").add("hull", str(source))
    from uuvsim_cosim.orchestrator.running.library import load

    return load(source)


def recorded_system(signals: Signals, source: str | Path | None) -> System:
    """Load a system for a recording; a hull alone gets its thrusters if they were recorded."""
    if source is None:
        vehicle = signals.metadata.get("vehicle")
        if vehicle is None:
            frame = signals.metadata.get("frame")
            why = f" (frame {frame})" if frame else ""
            raise InputInvalid(
                f"the recording does not name a vehicle of this package{why}",
                "--system with a system, or with a hull such as model:bluerov2",
            )
        source = f"model:{vehicle}"
    system = system_of(source)
    names = {name.rpartition(".")[2] for name in signals}
    if str(source).startswith("model:") and "u" in names and "tau" not in names:
        from uuvsim_cosim.orchestrator.shipped.actuators import with_actuators

        system, _ = with_actuators(system, str(source).removeprefix("model:").partition("?")[0])
        for path, component in system.components.items():  # k_T: a factor of the bench's thrust
            if component.source == "model:thruster_t200":
                system = system.replace(path, f"{component.source}?scale=true")
    return system


def _vehicle_of(plan: Plan, at: int) -> str:
    """Return the vehicle that a hull states, without its set; empty if it states none."""
    stated = plan.components[at].description.made_for.get("hull", "")
    return str(stated).partition("@")[0].rpartition("/")[2]


def _check_thrusters(signals: Signals, plan: Plan) -> None:
    """Refuse the log of a vehicle with another number of motors than the system has thrusters."""
    frame = signals.metadata.get("frame")
    motors = signals["u"].shape[1] if frame is not None else 0
    for c in plan.components:
        shape = (
            c.description.variables["thrust"].shape if "thrust" in c.description.variables else ()
        )
        if frame is not None and len(shape) == 1 and shape[0] != motors:
            raise InputInvalid(
                f"the log is of a vehicle with {motors} motors (frame {frame}), and {c.path} has "
                f"{shape[0]} thrusters",
                "a system of the vehicle that was recorded",
            )


def _hull(plan: Plan, wanted: str | None) -> int:
    """Find the hull: the component with the connectors of one, by its path if there are more."""
    found = {
        c.path: i
        for i, c in enumerate(plan.components)
        if {"tau", "eta", "nu", "nu_r"} <= c.description.variables.keys()
        and c.description.variables["eta"].causality == "output"
    }
    if wanted is not None:
        if wanted not in found:
            raise InputInvalid(
                f"--hull {wanted}: expected {' or '.join(found) or 'a system with one'}"
            )
        return found[wanted]
    if len(found) != 1:
        which = f"{len(found)} hulls ({', '.join(found)})" if found else "no hull"
        raise InputInvalid(f"the system has {which}", "one, or --hull with its path")
    return next(iter(found.values()))
