"""Predict the second half of a glider's recorded flight from its first half.

Two coefficients of the Slocum, its drag and its volume, are fitted to the vertical speed of the
first half. The second half is predicted from pitch, pumped volume and density of the water alone.

    python docs/examples/glider_flight.py
"""

from uuvsim_cosim.studies.glider.flight import read_flight
from uuvsim_cosim.studies.glider.judged import judge_glide, shared_error

flight = read_flight()  # models/recordings/slocum_2016; or read_flight("my_flight.csv")
for name, steady in (("equilibrium", True), ("with inertia", False)):
    j = judge_glide(flight, steady=steady)
    density = j.glide.m / j.glide.nabla
    print(f"{name}: C_D_0 {j.glide.C_D_0:.4f}, density of the hull {density:.2f} kg/m3")
    print("  RMS error of the vertical speed, second half (first half), mean over n samples:")
    for n, error in j.depth_rate.items():
        print(f"    n = {n:2d}: {100 * error:.2f} ({100 * j.depth_rate_first[n]:.2f}) cm/s")
    print(f"    at {j.samples} samples between 10 and 35 dbar")
    print(f"  speed through the water against the Doppler log: {100 * j.speed:.2f} cm/s")
    print(
        f"    at {j.speed_samples} of these samples; median of its size {100 * j.speed_median:.2f};"
    )
    print(f"    at all samples of the second half, turns included: {100 * j.speed_all:.2f} cm/s")
ctd, other, both = shared_error(flight, j.motion)
print(
    f"over 4.3 s: {100 * ctd:.2f} cm/s by the CTD, {100 * other:.2f} by the second pressure sensor;"
    f" part that both see: {100 * both:.2f} cm/s"
)
