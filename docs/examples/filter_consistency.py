"""Does a navigation filter know how wrong it is?  Many missions at once, against its own sigma.

    python docs/examples/filter_consistency.py --seeds 48 --until 1500

The survey's vehicle flies its lanes, then keeps station; from 400 s on, each second, its errors
are divided by the filter's own standard deviations. A Gaussian error is outside three of them
0.27 % of the time, and its mean square is 1.
"""

from __future__ import annotations

import argparse

import numpy as np

import uuvsim_cosim as uuv
from uuvsim_cosim.kernels import fuse

NAMES = ("N", "E", "D", "phi", "theta", "psi")


def main(arguments: list[str] | None = None) -> None:
    """Fly, and print a row for each of the six."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--begin", type=int, default=400, help="s, what is before does not count")
    parser.add_argument("--until", type=int, default=500, help="s")
    given = parser.parse_args(arguments)
    errors, sigmas = [], []
    with fuse(uuv.load("bluerov2_survey")).batch(given.seeds, seeds=0) as batch:
        batch.step(given.begin * 100)  # of 0.01 s
        for _ in range(given.begin, given.until):
            batch.step(100)
            error = batch.get("hull.eta") - batch.get("navigation.eta")
            error[:, 3:] = (error[:, 3:] + np.pi) % (2.0 * np.pi) - np.pi
            errors.append(error)
            sigmas.append(batch.get("navigation.sigma")[:, :6])
    z = np.array(errors) / np.array(sigmas)  # (seconds, seeds, 6)
    print(f"{'':6}{'outside 3 sigma':>16}{'mean square':>13}{'bias at the end':>17}{'sigma':>9}")
    for i, name in enumerate(NAMES):
        outside, square = np.mean(np.abs(z[..., i]) > 3.0), np.mean(z[..., i] ** 2)
        bias, sigma = errors[-1][:, i].mean(), sigmas[-1][:, i].mean()
        print(f"{name:6}{100 * outside:>14.2f} %{square:>13.2f}{bias:>17.4f}{sigma:>9.4f}")


if __name__ == "__main__":
    main()
