"""Trim REMUS, linearise it there, and draw its Bode diagram and poles with python-control."""

import control
import matplotlib as mpl
import numpy as np

import uuvsim_cosim as uuv

mpl.use("svg")
mpl.rcParams.update({"svg.hashsalt": "uuvsim", "font.size": 9})
import matplotlib.pyplot as plt  # noqa: E402


def main(folder="."):
    # Level flight at 1.5 m/s: which surge force and pitching moment hold it?
    level = uuv.trim("remus100", {"nu[1]": 1.5}, free=["tau[1]", "tau[5]"])
    print(f"X = {level['tau[1]']:.2f} N, M = {level['tau[5]']:.2f} N.m, "
          f"theta = {np.degrees(level['eta[5]']):.1f} deg")  # fmt: skip

    plant = uuv.linearize("remus100", level, inputs=["tau[5]"], outputs=["eta[5]"])
    print("poles [1/s]:", np.sort_complex(np.round(plant.poles(), 3)))

    figure, axes = plt.subplots(2, 1, figsize=(6, 5), sharex=True)
    control.bode_plot(plant, np.logspace(-2, 2, 200), ax=axes, title="pitch of REMUS by moment")
    figure.savefig(f"{folder}/bode.svg", metadata={"Date": None})

    figure, axis = plt.subplots(figsize=(5, 4))
    for speed in (0.5, 1.0, 1.5, 2.0):
        at = uuv.trim("remus100", {"nu[1]": speed}, free=["tau[1]", "tau[5]"])
        poles = uuv.linearize("remus100", at).poles()
        axis.plot(poles.real, poles.imag, "x", label=f"{speed:g} m/s")
    axis.axvline(0.0, color="k", lw=0.5)
    axis.set(xlabel="real [1/s]", ylabel="imaginary [rad/s]", title="poles of REMUS at its trims")
    axis.legend()
    figure.savefig(f"{folder}/poles.svg", metadata={"Date": None})
    plt.close("all")


if __name__ == "__main__":
    main()
