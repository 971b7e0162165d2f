"""Coverage of the intervals of identification: how many 95 % intervals contain the true value.

Dives with known parameters are simulated, with forces that are held, linear or smooth between their
samples at 20 Hz, and with noise. In half of them the forces act 40 ms later than recorded, and the
fit has the delay as an unknown. Each seed has other forces and other noise. Further rows are fits
with a wrong assumption, and coloured noise. The share must be between 88 and 99 % in the rows with
the right assumptions; the exit status is 1 if it is not.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.orchestrator.recording.signals import Signals
from uuvsim_cosim.studies.identification.assumptions import Assumptions
from uuvsim_cosim.studies.identification.identify import identify
from uuvsim_cosim.studies.identification.inputs import COURSES

Array = NDArray[np.float64]
TRUE = {"D_q_11": 21.0, "M_A_11": 7.0, "D_q_33": 30.0, "M_A_66": 0.15}
NOISE = np.array([0.02] * 3 + [0.005] * 3 + [0.01] * 3 + [0.01] * 3)
RATE, DELAY = 20.0, 0.04  # Hz, s
LEAST, MOST = 0.88, 0.99
COLOUR = 0.8  # correlation of coloured noise with that one sample before


def forces(seed: int) -> Callable[[float], Array]:
    """Return forces (6,) over time: four sines in surge, heave and yaw, of 0.05 to 0.8 Hz."""
    rng = np.random.default_rng([seed, 7])
    f = np.geomspace(0.05, 0.8, 4)
    phases = rng.uniform(0.0, 2 * np.pi, (3, 4))
    amounts = np.array([8.0, 6.0, 0.5])[:, None] * rng.uniform(0.5, 1.0, (3, 4))

    def of(t: float) -> Array:
        tau = np.zeros(6)
        tau[[0, 2, 5]] = np.sum(amounts * np.sin(2 * np.pi * f * t + phases), axis=1)
        return tau

    return of


def dive(seed: int, course: str, delay: float, seconds: float, colour: float = 0.0) -> Signals:
    """Simulate a dive and measure it with noise."""
    t: Array = np.round(np.arange(0.0, seconds + 0.5 / RATE, 1.0 / RATE), 9)
    smooth = forces(seed)
    tau = np.stack([smooth(float(s)) for s in t])
    begins = np.round(t + delay, 9)  # of what is held from a sample on

    def acting(s: float) -> Array:
        if course == "smooth":
            return smooth(s - delay)
        k = max(int(np.searchsorted(begins, s, side="right")) - 1, 0)
        share = RATE * (s - begins[k]) if course == "linear" and k + 1 < len(t) else 0.0
        return np.asarray(tau[k] + share * (tau[min(k + 1, len(t) - 1)] - tau[k]))

    made = simulate(
        declare("bluerov2", surface=False), at=[float(s) for s in t], h=0.01, tau=acting,
        parameters={**TRUE, "eta_0": [0.0, 0, 20, 0, 0, 0]},
    )  # fmt: skip
    noise = np.random.default_rng(seed).normal(size=(len(t), 12))
    for k in range(1, len(t)):
        noise[k] = colour * noise[k - 1] + np.sqrt(1.0 - colour**2) * noise[k]
    noise *= NOISE
    values = {"eta": made["eta"] + noise[:, :6], "nu": made["nu"] + noise[:, 6:], "tau": tau}
    return Signals(t, np.arange(len(t)), values, {}, metadata={"file": "dive.csv"})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=24)
    parser.add_argument("--seconds", type=float, default=15.0)
    parser.add_argument("--no-contrast", action="store_true", help="the right assumptions alone")
    options = parser.parse_args()
    rows = [(c, d, 0.0, Assumptions(c, unknown=("delay",) if d else ()), True)
            for d in (0.0, DELAY) for c in COURSES]  # fmt: skip
    if not options.no_contrast:
        rows += [
            ("smooth", 0.0, 0.0, Assumptions("held"), False),
            ("smooth", DELAY, 0.0, Assumptions("smooth"), False),
            ("smooth", 0.0, COLOUR, Assumptions("smooth", residuals="white"), False),
            ("smooth", 0.0, COLOUR, Assumptions("smooth", residuals="robust"), False),
            ("smooth", 0.0, COLOUR, Assumptions("smooth", residuals="ar1"), False),
        ]
    print(f"load {os.getloadavg()[0]:.1f}")
    begin, failed = time.process_time(), False
    for course, delay, colour, assumed, right in rows:
        began, z, white = time.process_time(), [], 0
        for seed in range(options.seeds):
            found = identify(
                dive(seed, course, delay, options.seconds, colour), "model:bluerov2", list(TRUE),
                proposals=False, assumed=assumed,
            )  # fmt: skip
            white += all(w.holds for w in found.whiteness)
            z += [1.96 * (found[n].value - v) / found[n].half_width for n, v in TRUE.items()]
            if delay and "delay" in assumed.names:
                z.append(1.96 * (found["delay"].value - delay) / found["delay"].half_width)
        inside = int(np.sum(np.abs(z) < 1.96))
        share = inside / len(z)
        failed |= right and not LEAST <= share <= MOST
        print(
            f"{course}, {1e3 * delay:g} ms late{', coloured noise' if colour else ''}; fitted with "
            f"--inputs {assumed.inputs} --residuals {assumed.residuals}"
            f"{' --unknown delay' if assumed.unknown else ''}: {inside} of {len(z)} intervals "
            f"({100 * share:.1f} %), errors {np.sqrt(np.mean(np.square(z))):.2f} sigma (rms), "
            f"white in {white} of {options.seeds}; {time.process_time() - began:.1f} s",
            flush=True,
        )
    print(f"{time.process_time() - begin:.1f} s of CPU time")
    sys.exit(int(failed and options.seeds >= 6))


if __name__ == "__main__":
    main()
