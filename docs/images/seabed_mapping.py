"""The map of a survey as a picture: depth with the track, and the errors by both poses.

`uuvsim run seabed_mapping -o run`, then `python docs/images/seabed_mapping.py run`
writes seabed_mapping.png here.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from uuvsim_cosim import read_signals
from uuvsim_cosim.scene import read_map

run = Path(sys.argv[1] if len(sys.argv) > 1 else "run")
made = read_map(run)
if made is None:
    sys.exit(f"{run}: has no map; expected a run of seabed_mapping")
w, track = made.window, read_signals(run)["hull.eta"][::50]
sides = (w.east, w.east + w.columns * w.cell, w.north, w.north + w.rows * w.cell)

figure = Figure(figsize=(11, 5.4), layout="constrained")
axes = figure.subplots(1, 3, sharey=True)
shown = axes[0].imshow(made.depth["true"], origin="lower", extent=sides, cmap="viridis_r")
figure.colorbar(shown, ax=axes[0], label="depth [m]", location="bottom")
axes[0].plot(track[:, 1], track[:, 0], color="#c2571a", lw=1)
axes[0].set(title="depth, and the track", xlabel="E [m]", ylabel="N [m]")
for place, f in zip(axes[1:], made.figures, strict=True):
    error = 100 * (made.depth[f.pose] - made.truth)
    most = np.nanpercentile(np.abs(error), 98)
    shown = place.imshow(
        error, origin="lower", extent=sides, cmap="RdBu_r", vmin=-most, vmax=most,
        interpolation="nearest",
    )  # fmt: skip
    figure.colorbar(shown, ax=place, label="too deep (+) [cm]", location="bottom")
    place.set(title=f"{f.pose} pose: RMSE {100 * f.rmse:.2f} cm", xlabel="E [m]")
    place.set_facecolor("#808890")
axes[0].set_facecolor("#808890")
figure.savefig("seabed_mapping.png", dpi=80)
