"""Fly the survey in a stronger current; plot where the vehicle was and how far off it thought."""

import matplotlib.pyplot as plt
import numpy as np

import uuvsim_cosim as uuv

system = uuv.load("bluerov2_survey").set("current.speed", 0.4)  # m/s
run = uuv.run(system, until=40, seed=7, out="survey")
signals = run.signals()

eta = signals["hull.eta"]  # N E D [m], phi theta psi [rad]
error = signals["navigation.eta"][:, :3] - eta[:, :3]
print(f"{run.real_time_factor:.0f} times real time")
print(f"navigation error, RMS: {np.sqrt(np.mean(error**2)):.3f} m")

figure, (track, drift) = plt.subplots(1, 2, figsize=(10, 4))
track.plot(eta[:, 1], eta[:, 0])
track.set(xlabel="east [m]", ylabel="north [m]", aspect="equal")
drift.plot(signals.time, error, label=["north", "east", "down"])
drift.set(xlabel="time [s]", ylabel="navigation error [m]")
drift.legend()
figure.savefig("survey.png")
