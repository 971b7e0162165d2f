"""Turning circles and a zigzag of the NPS AUV, beside those of npsauv.m in MSS.

    python -m tests.orchestrator.shipped.manoeuvres

prints the table of docs/vehicles/manoeuvres.md. Hull, propeller and fins with the published control
derivatives start at 1.2 m/s and 600 rpm; the rudder is moved after 20 s. The figures of MSS are in
models/reference/manoeuvres.yaml; manoeuvres_npsauv.m, in this folder, computed them.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

import uuvsim_cosim as uuv
from uuvsim_cosim.models.checks.comparison import reference_values

Array = NDArray[np.float64]
RUDDERS = (5.0, 10.0, 20.0)  # deg, to starboard
H, START = 0.02, 20.0  # s
RPM = 600.0
UNITS = {
    "approach": "m/s",
    "steady speed": "m/s",
    "rate": "rad/s",
    "radius": "m",
    "advance": "m",
    "transfer": "m",
    "tactical diameter": "m",
    "depth": "m",
}


def npsauv() -> uuv.System:
    """Return hull, propeller and fins with the published control derivatives."""
    n = RPM * 2.0 * np.pi / 60.0
    return (
        uuv.System("npsauv", str(H), "The NPS AUV II with propeller and fins")
        .add("hull", "model:npsauv?surface=false", {"nu_0": [1.2, 0, 0, 0, 0, 0]})
        .add("propeller", "model:propeller?vehicle=npsauv", {"u": n / 157.079632679})
        .add("fins", "model:fins?vehicle=npsauv&form=derivatives&contact=true")
        .connect("hull.nu_r", "propeller.nu_r")
        .connect("hull.nu_r", "fins.nu_r")
        .connect("propeller.n", "fins.n")
        .connect("propeller.tau", "fins.contact")
        .connect("fins.tau", "hull.tau")
    )


def flown(seconds: float = 300.0) -> tuple[Array, Array, Array, Array]:
    """Return t (k,), eta, nu (k, 4, 6) and the rudder [rad] (k, 4): three circles, one zigzag."""
    kernel = uuv.fuse(npsauv())
    angle = np.radians(20.0)
    rows = []
    with kernel.batch(4) as batch:
        zigzag = -angle
        for i in range(int(seconds / H)):
            eta = batch.get("hull.eta")
            u = np.zeros((4, 4))
            if i * H >= START - 1e-9:
                if abs(eta[3, 5]) >= angle and np.sign(eta[3, 5]) == -np.sign(zigzag):
                    zigzag = -zigzag
                u[:, 0] = [*-np.radians(RUDDERS), zigzag]
            rows.append((eta, batch.get("hull.nu"), u[:, 0]))
            batch.set("fins.u", u)
            batch.step(1)
    eta, nu, rudder = (np.array([r[k] for r in rows]) for k in range(3))
    return H * np.arange(len(rows)), eta, nu, rudder


def circle(t: Array, eta: Array, nu: Array) -> dict[str, float]:
    """Return the figures of a turning circle, by the names in `UNITS`."""
    k = round(START / H)
    psi = np.abs(np.unwrap(eta[:, 5]))
    a, b = int(np.argmax(psi >= np.pi / 2)), int(np.argmax(psi >= np.pi))
    speed = float(np.hypot(nu[-1, 0], nu[-1, 1]))
    return {
        "approach": float(nu[k, 0]),
        "steady speed": speed,
        "rate": float(nu[-1, 5]),
        "radius": speed / abs(float(nu[-1, 5])),
        "advance": float(eta[a, 0] - eta[k, 0]),
        "transfer": float(eta[a, 1] - eta[k, 1]),
        "tactical diameter": float(eta[b, 1] - eta[k, 1]),
        "depth": float(eta[-1, 2] - eta[0, 2]),
    }


def zigzag(t: Array, eta: Array, rudder: Array) -> dict[str, float]:
    """Return period [s] and overshoots [deg] of a 20-20 zigzag, of the first 200 s."""
    s = np.nonzero(np.diff(rudder))[0] + 1
    psi = np.abs(np.degrees(eta[:, 5]))
    over = {f"overshoot {i}": float(psi[s[i] : s[i + 1]].max() - 20.0) for i in range(1, 6)}
    return {"period": float(t[s[4]] - t[s[2]]), **over}


def figures() -> dict[str, dict[str, float]]:
    """Fly the manoeuvres; return the figures of each."""
    t, eta, nu, rudder = flown()
    found = {f"circle {r:g}": circle(t, eta[:, i], nu[:, i]) for i, r in enumerate(RUDDERS)}
    return {**found, "zigzag 20-20": zigzag(t, eta[:, 3], rudder[:, 3])}


def published() -> Mapping[str, Mapping[str, Mapping[str, float]]]:
    """Return the figures of npsauv.m: those of the file unchanged, and corrected."""
    values: Mapping[str, Mapping[str, Mapping[str, float]]] = reference_values("manoeuvres.yaml")
    return values


def main() -> None:
    """Print the table."""
    theirs = published()
    print("| manoeuvre | figure | here | MSS | difference | MSS, corrected | difference |")
    print("|---|---|---|---|---|---|---|")
    for name, ours in figures().items():
        for key, value in ours.items():
            cells = [f"{value:.4g}"]
            for kind in ("unchanged", "corrected"):
                other = theirs[kind][name][key]
                cells += [f"{other:.4g}", f"{100 * (value / other - 1):+.1f} %"]
            unit = UNITS.get(key, "s" if key == "period" else "deg")
            print(f"| {name} | {key} [{unit}] | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
