"""CPU time of a fit: ten parameters from a dive, by windows on the compiled kernel and by ipopt.

The dive is simulated with other numbers than the set's, all six axes are driven, and noise is
added. Both methods solve the same problem (the same grid, windows and weights of the last pass);
"before" is the method of CasADi's virtual machine and ipopt. Differences are in standard errors.
`--before-seconds` gives the slow method a part, on which both are compared.
"""

from __future__ import annotations

import argparse
import os
import resource
import time

import numpy as np
from numpy.typing import NDArray
from parts.ipopt_fit import fit as fit_by_ipopt

from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.guidance.sampled_signal import Signal
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.recording.signals import Signals
from uuvsim_cosim.studies.identification.fit import Fit, fit
from uuvsim_cosim.studies.identification.fitted_model import GreyBox
from uuvsim_cosim.studies.identification.identify import system_of
from uuvsim_cosim.studies.identification.parameters import wanted_parameters
from uuvsim_cosim.studies.identification.signals import Lookup, grid_of

TRUE = {
    "D_q_11": 21.0, "D_q_22": 26.0, "D_q_33": 30.0, "D_q_66": 1.9, "D_l_11": 5.0, "D_l_33": 6.0,
    "M_A_11": 7.0, "M_A_22": 14.0, "M_A_33": 16.0, "M_A_66": 0.15,
}  # fmt: skip
NOISE = np.array([0.02] * 3 + [0.005] * 3 + [0.01] * 3 + [0.01] * 3)


def dive(seconds: float) -> Signals:
    """Simulate a dive at 10 Hz: forces in steps on all axes but roll and pitch."""
    t: NDArray[np.float64] = np.round(np.arange(0.0, seconds + 0.05, 0.1), 9)
    amounts, rates = (14.0, 12.0, 8.0, 1.0), (0.9, 0.7, 0.5, 1.1)
    tau = np.zeros((len(t), 6))
    for column, amount, rate in zip((0, 1, 2, 5), amounts, rates, strict=True):
        tau[:, column] = amount * np.sign(np.sin(rate * t + column))
    held = [Signal(t, c, True) for c in tau.T]
    made = simulate(
        declare("bluerov2", surface=False), at=[float(s) for s in t], h=0.05,
        tau=lambda s: [f(s) for f in held], parameters={**TRUE, "eta_0": [0.0, 0, 40, 0, 0, 0]},
    )  # fmt: skip
    noise = np.random.default_rng(1).normal(size=(len(t), 12)) * NOISE
    values = {"eta": made["eta"] + noise[:, :6], "nu": made["nu"] + noise[:, 6:], "tau": tau}
    return Signals(t, np.arange(len(t)), values, {}, metadata={"file": "dive.csv"})


def used() -> float:
    """Return the CPU time of this process and of its compilers [s]."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=300.0)
    parser.add_argument("--before-seconds", type=float, default=300.0)
    options = parser.parse_args()
    print(f"load {os.getloadavg()[0]:.1f}")
    plan = flatten(system_of("model:bluerov2").with_mismatches("warn"))
    box = GreyBox(plan, 0, wanted_parameters(plan, 0, list(TRUE)), exact=False)
    signals = dive(options.seconds)

    def measured(name: str, method: object, seconds: float) -> Fit:
        grid = grid_of(box, Lookup(signals, {}), h=0.05, first=0.0, last=seconds)
        begin = used()
        found: Fit = method(box, grid)  # type: ignore[operator]
        print(
            f"{name}: {seconds:g} s, {grid.w.shape[1]} steps, {found.iterations} iterations, "
            f"{used() - begin:.1f} s of CPU time, {found.status}"
        )
        return found

    whole = measured("after", fit, options.seconds)
    error = np.sqrt(np.diag(whole.covariance))
    for f, value, e in zip(box.fitted, whole.theta, error, strict=True):
        true = TRUE[f.name.removeprefix("hull.")]
        print(f"  {f.name}: {value:.5g} ± {1.96 * e:.2g}, true {true:g}")
    if options.before_seconds:
        after = measured("after", fit, options.before_seconds)
        before = measured("before", fit_by_ipopt, options.before_seconds)
        away = np.abs(after.theta - before.theta) / np.sqrt(np.diag(before.covariance))
        print(f"largest difference of the optima: {away.max():.4f} standard errors")


if __name__ == "__main__":
    main()
