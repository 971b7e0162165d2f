"""Analysis of a declaration or a whole system: trim, linear models, loops, optimal control."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from numpy.typing import ArrayLike

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.analysis.operating_point import OperatingPoint
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.near_names import did_you_mean
from uuvsim_cosim.orchestrator.running.library import available, load
from uuvsim_cosim.orchestrator.system.system import System

if TYPE_CHECKING:
    import control

    from uuvsim_cosim.orchestrator.analysis.dynamics import Dynamics
    from uuvsim_cosim.orchestrator.analysis.opened_loop import OpenedLoop
    from uuvsim_cosim.orchestrator.analysis.optimal_control import Bounds, Named, OptimalPlan

__all__ = ["analyse", "dynamics", "linearize", "optimal_control", "trim"]


def linearize(
    target: str | Path | Model | System,
    at: float | Mapping[str, ArrayLike] | OperatingPoint | None = None,
    *,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    parameters: Mapping[str, ArrayLike] | None = None,
) -> control.StateSpace:
    """Return the linear model of a component or a system, with names, in SI and rad.

    If `target` is a component (a name such as ``remus100``, or a `Model`), the model is in
    continuous time, around `at`: states and inputs by name (``{"nu[1]": 1.5}``), or a result of
    `trim`; all others have their start values. `parameters` are values by name. If it is a system
    (a name, a file or a `System`), the model is in discrete time, around the system's own
    trajectory at `at` [s], without noise, with the delays of communication. `inputs` and `outputs`
    choose signals, whole or by element. Raises InputInvalid, with similar names.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> level = uuv.trim("remus100", {"nu[1]": 1.5}, free=["tau[1]", "tau[5]"])  # 1.5 m/s
    >>> pitch = uuv.linearize("remus100", level, inputs=["tau[5]"], outputs=["eta[5]"])
    >>> pitch.nstates, pitch.input_labels, pitch.output_labels
    (12, ['tau[5]'], ['eta[5]'])
    >>> f"{max(abs(pitch.poles().imag)):.2f} rad/s"  # oscillation in roll
    '4.93 rad/s'
    """
    found = _found(target)
    if isinstance(found, Model):
        if isinstance(at, (int, float)):
            raise InputInvalid(
                "linearize", f"at = {at}: a time applies to systems", "states and inputs by name"
            )
        from uuvsim_cosim.models.analysis.linearize import linear_model

        return linear_model(found, at, inputs=inputs, outputs=outputs, parameters=parameters)
    if parameters is not None or not isinstance(at, (int, float, type(None))):
        raise InputInvalid(
            "linearize: for a system, `at` is a time in s and parameters are set with "
            "system.set('component.parameter', value)"
        )
    from uuvsim_cosim.orchestrator.analysis.linear_system import linear_system

    return linear_system(found, float(at or 0.0), inputs=inputs, outputs=outputs)


def trim(
    target: str | Model,
    fixed: Mapping[str, ArrayLike] | None = None,
    *,
    free: Sequence[str] = (),
    moving: Sequence[str] | None = None,
    guess: Mapping[str, ArrayLike] | None = None,
    parameters: Mapping[str, ArrayLike] | None = None,
) -> OperatingPoint:
    """Find an equilibrium of a component, `target`: a name or a `Model`. SI and rad.

    `fixed` are values of states and inputs by name, `free` are inputs that may change. States that
    are not fixed are free; those in `moving` (by default N, E and psi of a hull) need not have a
    zero derivative. `parameters` are values by name. Of several equilibria, the one nearest to
    `guess` is returned. Raises InputInvalid if there is none near it, and for a component that
    samples.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> level = uuv.trim("remus100", {"nu[1]": 1.5}, free=["tau[1]", "tau[5]"])  # 1.5 m/s
    >>> f"X = {level['tau[1]']:.2f} N, theta = {level['eta[5]']:.3f} rad"
    'X = 4.20 N, theta = -0.079 rad'
    """
    found = _found(target)
    if not isinstance(found, Model):
        raise InputInvalid("trim", "applies to one component", "the name of a model, or a Model")
    from uuvsim_cosim.models.analysis.trim import trim_model

    return trim_model(found, fixed, free=free, moving=moving, guess=guess, parameters=parameters)


def analyse(system: str | Path | System, signal: str, at: float = 20.0) -> list[OpenedLoop]:
    """Open a loop of a system at a signal; return the loop at each element, all others closed.

    `system` is a `System`, a name or a file. `signal` is an output such as ``controller.tau_d``,
    all of whose connections are opened, or an input such as ``hull.tau``, of which only its own
    connection is opened; whole, or one element, ``controller.tau_d[3]``. The equations are
    linearised around the run of the closed system at `at` [s], without noise, with samples and
    communication delays. Elements that have no loop are left out, so read `signal` of each loop.
    Angles are in rad. Raises InputInvalid for a signal that does not exist, is not connected or has
    no loop at any element, and for components whose equations are not known (FMUs, Python classes).

    Example:

    >>> import uuvsim_cosim as uuv
    >>> surge = uuv.analyse("bluerov2_hold", "controller.tau_d[1]")[0]
    >>> surge.stable, surge.margins.gain_up > 2
    (True, True)
    """
    from uuvsim_cosim.orchestrator.analysis.opened_loop import opened_loops

    return opened_loops(system if isinstance(system, System) else load(system), signal, at)[0]


def dynamics(
    target: str | Path | Model | System, *, parameters: Mapping[str, ArrayLike] | None = None
) -> Dynamics:
    """Return the equations of a component or a system, `target`, as CasADi functions of x, u.

    The functions are f and h. If no component has a clock, f is dx/dt, and connections have no
    delay. Otherwise f is the map over one period, with samples and communication delays, without
    noise. `parameters` are values by name, of a component alone. Raises InputInvalid for algebraic
    loops, and for components whose equations are not known (FMUs, Python classes).

    Example:

    >>> import uuvsim_cosim as uuv
    >>> loop = uuv.dynamics("bluerov2_hold")
    >>> loop.period, loop.f.size1_out(0) == len(loop.states)
    (0.02, True)
    >>> [loop.states[i].name for i in loop.index("hull.nu")][:2]
    ['hull.nu[1]', 'hull.nu[2]']
    """
    from uuvsim_cosim.orchestrator.analysis.dynamics import model_dynamics, system_dynamics

    found = _found(target)
    if isinstance(found, Model):
        return model_dynamics(found, parameters)
    if parameters is not None:
        raise InputInvalid(
            "dynamics: parameters of a system are set with system.set('component.parameter', value)"
        )
    return system_dynamics(found)


def optimal_control(
    target: str | Path | Model | System,
    until: float | tuple[float, float],
    *,
    inputs: Bounds,
    end: Mapping[str, ArrayLike] | None = None,
    start: Mapping[str, ArrayLike] | None = None,
    bounds: Bounds | None = None,
    cost: Literal["effort", "time"] | Named = "effort",
    keep: Named | None = None,
    intervals: int = 40,
    guess: Mapping[str, ArrayLike] | None = None,
) -> OptimalPlan:
    """Plan a trajectory of `target`, a continuous component or a system of such, by collocation.

    `until` is the duration [s], or (shortest, longest); it is divided into equal `intervals`.
    `inputs` are the inputs that may change, with their bounds, ``{"tau[1]": (-20, 20)}``; others
    keep their start value. `start` and `end` are values of states (the rest: their start values,
    and free), `bounds` keep states between two values. `cost` is "effort" (the integral of the
    squared inputs, each divided by its largest bound), "time", or a function of a dictionary of all
    states, inputs and outputs by element that returns the integrand. ``keep(values)`` must stay 0
    or more, for example a distance from an obstacle. `guess` are end values of states that are not
    in `end`, and constant inputs.

    Raises InputInvalid for unknown names and bounds, for components that sample, and if IPOPT finds
    no solution, with its status.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> plan = uuv.optimal_control("sphere", (1.0, 60.0), end={"eta[1]": 5.0, "nu": 0.0},
    ...     inputs={"tau[1]": (-20.0, 20.0)}, cost="time", intervals=20)
    >>> [round(float(plan["tau[1]"][i])) for i in (0, -1)]  # full ahead, then full astern
    [20, -20]
    """
    from uuvsim_cosim.orchestrator.analysis.optimal_control import collocate

    return collocate(
        dynamics(target), until, start=start, end=end, inputs=inputs, bounds=bounds, cost=cost,
        keep=keep, intervals=intervals, guess=guess,
    )  # fmt: skip


def _found(target: str | Path | Model | System) -> Model | System:
    if isinstance(target, (Model, System)):
        return target
    from uuvsim_cosim.models.declaration.library import ALIASES, LIBRARY, declare
    from uuvsim_cosim.models.declaration.parameter_files import is_vehicle, split_address

    name = str(target).removeprefix("model:")
    if name in LIBRARY or name in ALIASES or is_vehicle(split_address(name)[0]):
        options = {"surface": False} if is_vehicle(split_address(name)[0]) else {}
        return declare(name, **options)
    if name in available() or Path(name).suffix:
        return load(name)

    from uuvsim_cosim.models.declaration.library import available as models

    hint = did_you_mean(name, [*models(), *ALIASES, *available()])
    raise InputInvalid(f"there is no model or system {name!r}{hint}")
