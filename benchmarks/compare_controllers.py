"""Fly every shipped controller on one mission: calm, in a current, and with a thruster lost.

    python benchmarks/compare_controllers.py --pictures docs/images

prints the tables of docs/vehicles/controller_comparison.md and draws its pictures.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

import uuvsim_cosim as uuv

CONTROLLERS = ("pid", "lqr", "feedback_linearisation", "backstepping", "sliding_mode", "mpc")
WAYPOINTS = [(0, 0, 3), (6, 0, 3), (6, 3, 3), (0, 3, 4)]
CURRENT = (0.15, 0.25, 0.0)  # m/s in NED, from 10 s on
START = 5.0  # s, where figures begin
LOST = ([1.0, 1.0, 0.0] + [1.0] * 5, 30.0)  # health: thruster 3 (rear right, horizontal), from [s]


def mission(controller, case, allocation="allocation"):
    """Return bluerov2_hold with a controller; `case` is calm, current, thruster lost."""
    system = uuv.load("bluerov2_hold").replace("controller", controller)
    system = system.replace("allocation", allocation)
    rows = np.array([*WAYPOINTS, *[WAYPOINTS[-1]] * (32 - len(WAYPOINTS))], dtype=float)
    system = system.set("guidance.waypoints", rows.tolist()).set("guidance.count", len(WAYPOINTS))
    if case == "calm":
        return system
    system = system.add("current", "current_ramps").connect("current.v_c", "hull.v_c")
    system = system.set("current.dv", [CURRENT, (0, 0, 0), (0, 0, 0)]).set("current.t", [10, 0, 0])
    if case == "current":
        return system
    health, when = LOST
    system = system.add("faults", "thruster_faults").set("faults.efficiency", health)
    system = system.set("faults.t", [when] * 8)
    for i in range(1, 9):
        system = system.disconnect(f"wrench.thrust[{i}]")
        system = system.connect(f"thruster_{i}.thrust", f"faults.thrust_in[{i}]")
        system = system.connect(f"faults.thrust[{i}]", f"wrench.thrust[{i}]")
    if case == "thruster lost, known":
        system = system.connect("faults.health", "allocation.health")
    return system


def figures(signals, start=START):
    """Return errors [m, deg], effort [N] and the force's change a second [N/s], from `start` on."""
    late = signals.time >= start
    e = (signals["hull.eta"] - signals["guidance.eta_d"])[late]
    e[:, 3:] = np.remainder(e[:, 3:] + np.pi, 2 * np.pi) - np.pi
    tau = signals["controller.tau_d"][late][:, :3]
    off = np.linalg.norm(e[:, :3], axis=1)
    rate = np.abs(np.diff(tau, axis=0)).sum(axis=1) / np.diff(signals.time[late])
    return {
        "error, RMS [cm]": 100 * np.sqrt(np.mean(off**2)),
        "largest [cm]": 100 * off.max(),
        "heading, RMS [deg]": np.degrees(np.sqrt(np.mean(e[:, 5] ** 2))),
        "tilt, largest [deg]": np.degrees(np.abs(e[:, 3:5]).max()),
        "force, RMS [N]": np.sqrt(np.mean(np.sum(tau**2, axis=1))),
        "its change [N/s]": rate.mean(),
    }


def run(system, until):
    """Run in a scratch folder and give the signals."""
    with tempfile.TemporaryDirectory() as folder:
        return uuv.run(system, until=until, out=f"{folder}/run", backend="native").signals()


def table(rows):
    """Print figures by name as a Markdown table."""
    head = list(next(iter(rows.values())))
    print("| |", " | ".join(head), "|")
    print("|---|" + "---|" * len(head))
    for name, values in rows.items():
        print(f"| {name} |", " | ".join(f"{values[h]:.3g}" for h in head), "|")
    print()


def guided(method):
    """Fly one long leg there and back across the current by a guidance that steers with the bow."""
    system = uuv.load("bluerov2_hold").replace("guidance", f"path_following?method={method}")
    rows = np.array([(0, 0, 3), (25, 0, 3), (25, 6, 3), *[(0, 6, 3)] * 29], dtype=float)
    system = system.set("guidance.waypoints", rows.tolist()).set("guidance.count", 4)
    system = system.add("current", "current_ramps").connect("current.v_c", "hull.v_c")
    return system.set("current.dv", [CURRENT, (0, 0, 0), (0, 0, 0)])


def guidance(folder):
    """Compare LOS, ILOS and ALOS: cross-track error in the last second of the two long legs."""
    print("**guidance by the bow, in the current**\n")
    rows, flown = {}, {}
    for method in ("los", "ilos", "alos"):
        s = flown[method] = run(guided(method), 160.0)
        y, leg = s["guidance.cross_track"], s["guidance.waypoint"]
        ends = [np.flatnonzero((leg == k) & (s["guidance.done"] == 0))[-100:] for k in (2, 4)]
        rows[method] = {
            "end of the leg north [cm]": 100 * y[ends[0]].mean(),
            "end of the leg south [cm]": 100 * y[ends[1]].mean(),
            "RMS on both [cm]": 100 * np.sqrt(np.mean(y[np.isin(leg, (2, 4))] ** 2)),
        }
    table(rows)
    if folder:
        plt = _plots()
        fig, axis = plt.subplots(figsize=(9.5, 3.2))
        for i, (method, s) in enumerate(flown.items()):
            y, leg = 100 * s["guidance.cross_track"], s["guidance.waypoint"]
            legs = np.where(np.isin(leg, (2, 4)) & (s["guidance.done"] == 0), y, np.nan)
            axis.plot(s.time[::10], legs[::10], color=f"C{i}", lw=1.2, label=method.upper())
        axis.set(xlabel="t [s]", ylabel="cross-track error [cm]", ylim=(-60, 60))
        axis.grid(alpha=0.3)
        axis.legend(frameon=False)
        fig.tight_layout()
        fig.savefig(Path(folder) / "guidance.svg", metadata={"Date": None, "Creator": None})
        plt.close(fig)


def _plots():
    """Return pyplot, set so that equal runs give equal files."""
    import matplotlib as mpl

    mpl.use("svg")
    mpl.rcParams.update({"svg.hashsalt": "uuvsim", "svg.fonttype": "path", "font.size": 9})
    import matplotlib.pyplot as plt

    return plt


def draw(folder, flown):
    """Draw the tracks and the errors of one case as SVG."""
    plt = _plots()
    for case, runs in flown.items():
        fig, (track, error) = plt.subplots(1, 2, figsize=(9.5, 3.9), width_ratios=[1, 1.5])
        wanted = next(iter(runs.values()))["guidance.eta_d"]
        track.plot(wanted[:, 1], wanted[:, 0], "k", lw=3, alpha=0.18, label="wanted")
        for i, (name, s) in enumerate(runs.items()):
            eta = s["hull.eta"]
            off = np.linalg.norm((eta - s["guidance.eta_d"])[:, :3], axis=1)
            off[s.time < 0.05] = np.nan  # guidance has said nothing yet
            track.plot(eta[:, 1], eta[:, 0], lw=1, color=f"C{i}", label=name)
            error.semilogy(s.time[::10], 100 * off[::10] + 1e-3, lw=1, color=f"C{i}")
        track.set(xlabel="E [m]", ylabel="N [m]", aspect="equal")
        error.set(xlabel="t [s]", ylabel="distance from the wanted place [cm]", ylim=(0.05, 200))
        error.grid(alpha=0.3, which="both")
        fig.suptitle(case)
        fig.legend(loc="lower center", ncol=7, fontsize=8, frameon=False)
        fig.tight_layout(rect=(0, 0.06, 1, 1))
        name = f"controllers_{case.split(',', maxsplit=1)[0].replace(' ', '_')}.svg"
        fig.savefig(Path(folder) / name, metadata={"Date": None, "Creator": None})
        plt.close(fig)


def main(argv=None):
    """Run the comparison."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--until", type=float, default=80.0, help="seconds")
    parser.add_argument("--controllers", nargs="+", default=CONTROLLERS)
    parser.add_argument("--cases", nargs="+", default=["calm", "current", "thruster lost"])
    parser.add_argument("--pictures", help="folder for SVG")
    args = parser.parse_args(argv)
    if args.until <= START:
        parser.error(f"--until {args.until:g}: expected more than {START:g}, where figures begin")
    flown = {}
    for case in args.cases:
        flown[case] = {c: run(mission(c, case), args.until) for c in args.controllers}
        print(f"**{case}**\n")
        table({c: figures(s) for c, s in flown[case].items()})
    if "thruster lost" in args.cases:
        print("**thruster lost: what the allocation knows of it**\n")
        known = "thruster lost, known"
        kinds = {
            "pseudo-inverse, not reported": ("allocation", "thruster lost"),
            "pseudo-inverse, reported": ("allocation", known),
            "quadratic programme, reported": ("allocation_qp", known),
        }
        first = args.controllers[0]
        table({n: figures(run(mission(first, c, a), args.until)) for n, (a, c) in kinds.items()})
    print("**survey: true error, flown on the navigation's estimate, seed 0**\n")
    survey = {c: uuv.load("bluerov2_survey").replace("controller", c) for c in args.controllers}
    table({c: figures(run(system, 1.25 * args.until)) for c, system in survey.items()})
    guidance(args.pictures)
    if args.pictures:
        draw(args.pictures, flown)


if __name__ == "__main__":
    main()
