"""`linearize` and `trim` of a declaration or of a whole system."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.analysis.operating_point import OperatingPoint
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.near_names import did_you_mean
from uuvsim_cosim.orchestrator.running.library import available, load
from uuvsim_cosim.orchestrator.system.system import System

if TYPE_CHECKING:
    import control

__all__ = ["linearize", "trim"]


def linearize(
    target: str | Path | Model | System,
    at: float | Mapping[str, ArrayLike] | OperatingPoint | None = None,
    *,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    parameters: Mapping[str, ArrayLike] | None = None,
) -> control.StateSpace:
    """Return the linear model of a component or a system, with names, in SI and rad.

    For a component (a name such as ``remus100``, or a `Model`) it is in continuous time, around
    `at`: states and inputs by name (``{"nu[1]": 1.5}``), or a result of `trim`; all others have
    their start values. For a system (a name, a file or a `System`) it is in discrete time, around
    its own trajectory at `at` seconds, without noise, with the delays of communication. `inputs`
    and `outputs` choose signals, whole or by element. Raises InputInvalid, with similar names.
    """
    found = _found(target)
    if isinstance(found, Model):
        if isinstance(at, (int, float)):
            raise InputInvalid(
                "linearize", f"at = {at}: a time is for systems", "states and inputs by name"
            )
        from uuvsim_cosim.models.analysis.linearize import linear_model

        return linear_model(found, at, inputs=inputs, outputs=outputs, parameters=parameters)
    if parameters is not None or not isinstance(at, (int, float, type(None))):
        raise InputInvalid(
            "linearize: of a system, `at` is a time in s and parameters are set with "
            "system.set('component.parameter', value)"
        )
    from uuvsim_cosim.orchestrator.plan.linear_system import linear_system

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
    """Find an equilibrium of a component: ``trim("remus100", {"nu[1]": 1.5}, free=["tau"])``.

    `fixed` are values of states and inputs, `free` are inputs that may change. States that are not
    fixed are free; those in `moving` (N, E and psi of a hull) need not have a zero derivative.
    Raises InputInvalid if there is no equilibrium near `guess`.
    """
    found = _found(target)
    if not isinstance(found, Model):
        raise InputInvalid("trim", "is for one component", "the name of a model, or a Model")
    from uuvsim_cosim.models.analysis.trim import trim_model

    return trim_model(found, fixed, free=free, moving=moving, guess=guess, parameters=parameters)


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
