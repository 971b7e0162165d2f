"""The glider's recorded flight and its prediction as a picture, and the table of refinements.

`python docs/images/glider_flight.py` writes glider_flight.png here. With the word `refinements`, it
prints the errors of each refinement instead; this takes about two minutes of CPU time.
"""

import sys

import numpy as np
from matplotlib.figure import Figure

from uuvsim_cosim.studies.glider.flight import depth_rate, read_flight
from uuvsim_cosim.studies.glider.judged import judge_glide
from uuvsim_cosim.studies.glider.refinements import judge_refinements

flight = read_flight()
if "refinements" in sys.argv:
    for r in judge_refinements(flight):
        print(f"{100 * r.first:.3f}  {100 * r.second:.3f}  {r.refinement.name}", flush=True)
    sys.exit()
judged = judge_glide(flight)
t = flight.t / 60.0
shown = (t > 173) & (t < 198)  # dives in the second half
figure = Figure(figsize=(10, 6.4), layout="constrained")
depth, rate, speed = figure.subplots(3, 1, sharex=True)
depth.plot(t[shown], flight.depth[shown], color="#404a54")
depth.invert_yaxis()
depth.set(ylabel="depth [m]", title="Slocum in the Baltic, predicted from the first half")
for axes, measured, computed, label in (
    (rate, depth_rate(flight, 11), judged.motion.depth_rate, "rate of depth [cm/s]"),
    (speed, flight.speed, judged.motion.speed, "speed through water [cm/s]"),
):
    axes.plot(t[shown], 100 * measured[shown], color="#8aa4b8", lw=2.5, label="measured")
    axes.plot(t[shown], 100 * computed[shown], color="#c2571a", lw=1, label="predicted")
    axes.set(ylabel=label)
    axes.grid(alpha=0.3)
rate.legend(loc="upper right")
speed.set(xlabel="time [min]", ylim=(0, 60))
speed.text(t[shown][0], 4, " the Doppler log measures in descents below 12 m", fontsize=8)
figure.savefig("glider_flight.png", dpi=80)
print(f"largest rate {100 * np.nanmax(np.abs(judged.motion.depth_rate)):.0f} cm/s")
