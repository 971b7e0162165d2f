"""Draw what a Jacobi step delays: a sine goes through three components that pass it on at once."""

import itertools
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

import uuvsim_cosim as uuv

PERIOD, END, STEPS = 4.0, 4.0, ("0.2", "0.05")  # s
CHAIN = ("source", "first", "second", "third")
COLOURS = ("#13202f", "#1268b3", "#12907f", "#e2622a")


class Source:
    """y = sin(2 pi t / T)."""

    inputs = {}
    outputs = {"y": "1"}

    def initialize(self, t):
        """Return the output at the start."""
        return self.step(t, 0.0, {})

    def step(self, t, dt, u):
        """Return the output at the step's end."""
        return {"y": np.sin(2 * np.pi * (t + dt) / PERIOD)}


class Through:
    """y = u."""

    inputs = {"u": "1"}
    outputs = {"y": "1"}

    def initialize(self, t):
        """Return 0, which shows where nothing has arrived yet."""
        return {"y": 0.0}

    def step(self, t, dt, u):
        """Pass the input on."""
        return {"y": u["u"]}


def signals(step, algorithm):
    """Run the chain; give the time, and y of each component."""
    system = uuv.System("chain", step).add("source", f"{__file__}:Source")
    for before, name in itertools.pairwise(CHAIN):
        system = system.add(name, f"{__file__}:Through").connect(f"{before}.y", f"{name}.u")
    system = system.group(CHAIN, algorithm)
    run = uuv.run(system, until=END, out=f"{algorithm}_{step}").signals()
    return run.time, [run[f"{name}.y"] for name in CHAIN]


def delay(source, late):
    """Count the steps that a signal lags behind the source: from there on they are equal."""
    n = len(source)
    return next(k for k in range(n) if np.array_equal(late[k:], source[: n - k]))


def picture():
    """Draw the chain at two steps; give the figure and the delays, in steps."""
    mpl.rcParams |= {"svg.fonttype": "none", "svg.hashsalt": "jacobi", "font.size": 9}
    mpl.rcParams |= {"axes.spines.top": False, "axes.spines.right": False}
    figure, panels = plt.subplots(1, 2, figsize=(9, 3.4), sharey=True, layout="constrained")
    exact = np.linspace(0, END, 400)
    found = {}
    for panel, step in zip(panels, STEPS, strict=True):
        panel.plot(exact, np.sin(2 * np.pi * exact / PERIOD), color="#aab4c0", lw=4, alpha=0.6,
                   label="sin(2πt/T), continuous")  # fmt: skip
        for algorithm in ("jacobi", "gauss-seidel"):
            time, values = signals(step, algorithm)
            found[algorithm, step] = [delay(values[0], y) for y in values[1:]]
            if algorithm == "gauss-seidel":
                panel.plot(time, values[-1], "o", ms=3.2, mfc="white", mec=COLOURS[3], mew=0.9,
                           label="Gauss-Seidel, after 3 connections: no delay")  # fmt: skip
                continue
            for k, (y, colour) in enumerate(zip(values, COLOURS, strict=True)):
                if k:
                    label = f"Jacobi, after {k} connection{'s'[: k - 1]}: {k} step{'s'[: k - 1]}"
                    panel.step(time, y, where="post", color=colour, lw=1.2, label=label)
        panel.set(title=f"h = {step} s: three connections delay by {3 * float(step):g} s",
                  xlabel="time [s]", xlim=(0, END))  # fmt: skip
        panel.grid(color="#e9edf2")
    panels[0].set_ylabel("y")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    return figure, found


if __name__ == "__main__":
    figure, found = picture()
    lines = [f"{a}, h = {h} s: {', '.join(map(str, n))} steps" for (a, h), n in found.items()]
    print("\n".join(lines))
    about = {"Date": None, "Creator": None, "Description": "; ".join(lines)}
    figure.savefig(Path("jacobi_delay.svg"), metadata=about)
