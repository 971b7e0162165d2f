"""Integration of continuous states from one communication point or event to the next.

Each piece starts without a history, so the method is a one-step one: Dormand and Prince 5(4), of
SciPy. If the equations are stiff, CVODE (of FMPy), whose method is implicit, integrates the piece
instead. They count as stiff if the explicit method fails or needs more than `_STEPS` steps, or if
its stability limits its steps, by the estimate of Hairer and Wanner (Solving Ordinary Differential
Equations II, 2nd edition, equation IV.2.20). The choice depends only on the states.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.fmus.model_exchange.calls import Calls

__all__ = ["Solver"]

_STEPS = 200
_FEW_STEPS = 3  # fewer steps are not enough to detect stiffness
_STIFF = 2.5  # mean of step times largest eigenvalue; the method is stable up to 3.3
_CVODE_STEPS = 100_000
_CVODE_TIGHTER = 1e-2  # CVODE starts with Euler's method in each piece, and these errors add up
Array = NDArray[np.float64]


@final
class Solver:
    """Integrator of one instance; `tolerance` is relative, and absolute in units of nominals."""

    def __init__(self, calls: Calls, tolerance: float) -> None:
        self._calls = calls
        self._tolerance = tolerance
        self._x = np.zeros(calls.states)
        self._dx = np.zeros(calls.states)
        self._z = np.zeros(calls.indicators)
        self._nominals = np.ones(calls.states)
        if calls.states:
            calls.get_nominals(self._nominals.ctypes.data, calls.states)
        self.stiff = False  # whether the equations were stiff in the last piece

    def integrate(self, time: float, until: float) -> tuple[float, bool]:
        """Integrate from `time` to `until` [s], or to the first sign change of an event indicator.

        Return the time that was reached, and whether an indicator changed its sign; the instance
        has the states of that time. Raises RuntimeError if the integration fails.
        """
        if not self._calls.states:
            return self._search(time, until, lambda t: self._x, self._signs(time, self._x))
        self._calls.get_states(self._x.ctypes.data, self._x.size)
        x = self._x.copy()
        signs = self._signs(time, x)
        reached = self._one_step_method(time, until, x, signs)
        self.stiff = reached is None
        return reached if reached is not None else self._cvode(time, until, x)

    def _one_step_method(
        self, time: float, until: float, x: Array, signs: NDArray[np.bool_]
    ) -> tuple[float, bool] | None:
        """Integrate explicitly; return None if the equations are stiff."""
        from scipy.integrate import RK45

        rtol = max(self._tolerance, 3e-14)
        atol: Any = self._tolerance * np.abs(self._nominals)  # one for each state, unlike its type

        def rhs(time: float, x: Array) -> Array:
            self._set(time, x)
            self._calls.get_derivatives(self._dx.ctypes.data, self._dx.size)
            return self._dx.copy()

        rk = RK45(rhs, time, x, until, rtol=rtol, atol=atol, first_step=until - time)
        stability = 0.0
        with np.errstate(over="ignore", invalid="ignore"):  # in steps that RK45 then rejects
            for n in range(1, _STEPS + 1):
                before = float(rk.t)
                rk.step()
                if rk.status == "failed":
                    return None
                stability += _stability(rk)
                if n >= _FEW_STEPS and stability > _STIFF * n:
                    return None
                reached, crossed = self._search(before, float(rk.t), rk.dense_output(), signs)
                if crossed:
                    return reached, True
                if rk.status == "finished":
                    self._set(until, rk.y)
                    return until, False
        return None

    def _search(
        self, before: float, after: float, at: Callable[[float], Array], signs: NDArray[np.bool_]
    ) -> tuple[float, bool]:
        """Bisect for the first time at which an indicator has another sign than before."""
        if not self._calls.indicators or np.array_equal(self._signs(after, at(after)), signs):
            return after, False
        low, high = before, after
        while high - low > 1e-14 * max(1.0, abs(high)) + 4 * math.ulp(high):
            middle = 0.5 * (low + high)
            if np.array_equal(self._signs(middle, at(middle)), signs):
                low = middle
            else:
                high = middle
        self._set(high, at(high))
        return high, True

    def _cvode(self, time: float, until: float, x: Array) -> tuple[float, bool]:
        from fmpy.sundials import CVodeSolver

        self._set(time, x)
        calls, kept = self._calls, _Kept()
        held = SimpleNamespace(apply=lambda time: None)  # inputs, which are constant
        cvode = CVodeSolver(
            calls.states, calls.indicators, kept.of(calls.get_states), kept.of(calls.set_states),
            kept.of(calls.get_derivatives), kept.of(calls.get_indicators),
            kept.of(calls.get_nominals), kept.of(calls.set_time), held, time,
            relativeTolerance=self._tolerance * _CVODE_TIGHTER, maxNumSteps=_CVODE_STEPS,
        )  # fmt: skip
        crossed, _, reached = cvode.step(time, until)
        if kept.error is not None:
            raise kept.error
        calls.set_time(float(reached))
        return float(reached), bool(crossed)

    # ---- the instance -------------------------------------------------------------------------

    def _set(self, time: float, x: Array) -> None:
        self._calls.set_time(time)
        if self._x.size:
            self._x[:] = x
            self._calls.set_states(self._x.ctypes.data, self._x.size)

    def _signs(self, time: float, x: Array) -> NDArray[np.bool_]:
        if not self._z.size:
            return np.zeros(0, bool)
        self._set(time, x)
        self._calls.get_indicators(self._z.ctypes.data, self._z.size)
        return np.asarray(self._z > 0.0)


def _stability(rk: Any) -> float:
    """Return the last step times an estimate of the largest eigenvalue, in absolute value.

    The last two stages are at the same time. The estimate is the difference of their derivatives
    divided by the difference of their states.
    """
    h = rk.h_previous
    sixth = rk.y_old + h * (rk.A[5, :5] @ rk.K[:5])
    apart = float(np.linalg.norm(rk.y - sixth))
    return abs(h) * float(np.linalg.norm(rk.K[6] - rk.K[5])) / apart if apart > 0.0 else 0.0


class _Kept:
    """The first error of the FMU, kept until CVODE has returned: it calls from C."""

    def __init__(self) -> None:
        self.error: UuvsimError | None = None

    def of(self, call: Callable[..., None]) -> Callable[..., None]:
        def guarded(*arguments: Any) -> None:
            try:
                call(*arguments)
            except UuvsimError as error:
                self.error = self.error or error
                if len(arguments) == 2 and arguments[1]:  # an array: NaN ends the integration
                    arguments[0][0] = math.nan

        return guarded
