"""Put a controller of one's own into the survey: a Python class in this very file."""

import numpy as np

import uuvsim_cosim as uuv

POSE = ("m", "m", "m", "rad", "rad", "rad")
VELOCITY = ("m/s", "m/s", "m/s", "rad/s", "rad/s", "rad/s")


class Hover:
    """A PD law in body axes for small roll and pitch."""

    inputs = {"eta_d": (6, POSE), "nu_d": (6, VELOCITY), "eta": (6, POSE), "nu": (6, VELOCITY)}
    outputs = {"tau_d": (6, ("N", "N", "N", "N.m", "N.m", "N.m"))}
    parameters = {"K_p": ([120.0, 120.0, 160.0, 8.0, 8.0, 16.0], "1")}

    def step(self, t, dt, u):
        """Return the generalised force wanted over the next step."""
        e = u["eta_d"] - u["eta"]
        e[3:] = np.remainder(e[3:] + np.pi, 2 * np.pi) - np.pi
        c, s = np.cos(u["eta"][5]), np.sin(u["eta"][5])
        e[:2] = [c * e[0] + s * e[1], c * e[1] - s * e[0]]
        D = np.array([90, 90, 110, 3, 3, 6])
        return {"tau_d": np.array(self.K_p) * e - D * u["nu"]}


if __name__ == "__main__":
    system = uuv.load("bluerov2_survey").replace("controller", f"{__file__}:Hover")
    for gain in (80.0, 160.0, 320.0):
        changed = system.set("controller.K_p[3]", gain)
        depth = uuv.run(changed, until=20, out=f"gain_{gain:.0f}").signals()["hull.eta"][:, 2]
        print(f"K_p[3] = {gain:5.0f} N/m: depth after 20 s {depth[-1]:.3f} m")
