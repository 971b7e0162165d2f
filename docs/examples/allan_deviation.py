"""The Allan deviation of simulated IMUs beside the figures of their data sheets, as a picture."""

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from uuvsim_cosim import System
from uuvsim_cosim.kernels import fuse
from uuvsim_cosim.models import allan_deviation, allan_of_error, declare

mpl.rcParams["svg.hashsalt"] = "allan"  # the same file again
IMUS = ("stim300", "adis16495", "mpu6050")
COLOURS = ("#1f5fa8", "#c2571a", "#2a7d4f")
SHEET = {"stim300": (0.15, 0.5), "adis16495": (0.09, 0.8), "mpu6050": (0.3, None)}
HOURS = 3600.0
STEPS, ENVS = 10000, 16  # s, of 16 IMUs with three axes each
t = np.unique(np.rint(np.logspace(0, 3, 30)))

system = System("imus", "1", "Three IMUs at rest")
for name in IMUS:
    system = system.add(name, f"model:imu@{name}?period=1")
records = {name: np.zeros((STEPS, ENVS, 3)) for name in IMUS}
with fuse(system).batch(ENVS, seeds=range(ENVS)) as batch:
    for k in range(STEPS):
        batch.step()
        for name in IMUS:
            records[name][k] = batch.get(f"{name}.gyro")

figure = Figure(figsize=(7.2, 4.4), layout="constrained")
axes = figure.subplots()
for name, colour in zip(IMUS, COLOURS, strict=True):
    to_deg_h = HOURS * 180.0 / np.pi
    found = to_deg_h * allan_deviation(records[name].reshape(STEPS, -1), 1.0, t)

    p = {v.name: float(np.ravel(v.start)[0]) for v in declare("imu", id=name).of_kind("parameter")}
    figures = (p["gyro_noise_density"], p["gyro_bias_sigma"], p["gyro_bias_tau"])
    closed = to_deg_h * allan_of_error(t, *figures)
    axes.loglog(t, closed, color=colour, lw=1.2)
    axes.loglog(t, found, "o", color=colour, ms=4, label=f"{name}, simulated")

    walk, instability = SHEET[name]  # deg/sqrt(h), deg/h
    axes.loglog(t, 60.0 * walk / np.sqrt(t), ":", color=colour, lw=1)
    if instability:
        axes.axhline(instability, color=colour, ls="--", lw=1)
    lowest = f"{found.min():.3f} deg/h at {t[found.argmin()]:.0f} s"
    print(f"{name:10} random walk {found[0] / 60:.4f} deg/sqrt(h) (data sheet {walk}), "
          f"lowest {lowest} (data sheet {instability})")  # fmt: skip

axes.set(xlabel="averaging time [s]", ylabel="Allan deviation of the gyro [deg/h]")
axes.set_title("Points: simulated. Line: closed form. Dotted, dashed: data sheet.", fontsize=10)
axes.grid(True, which="both", color="#e4e7eb", lw=0.6)
axes.legend(frameon=False)
figure.savefig("allan_deviation.svg", metadata={"Date": None})
