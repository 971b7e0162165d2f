"""A PID controller on the pose, of arrays of six, for pythonfmu3."""

from math import cos, pi, sin

import numpy as np
from pythonfmu3 import Dimension, Float64, Fmi3Causality, Fmi3Slave, Fmi3Variability

P = np.array([60.0, 60.0, 80.0, 5.0, 5.0, 8.0])
D = np.array([40.0, 40.0, 60.0, 1.5, 1.5, 3.0])


class PidFmi3(Fmi3Slave):
    author = "uuvsim-cosim tests"

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.time = 0.0
        self.register_variable(
            Float64(
                "time",
                causality=Fmi3Causality.independent,
                variability=Fmi3Variability.continuous,
            )
        )
        self.Kp, self.Ki, self.Kd = 1.0, 0.0, 1.0
        for name in ("Kp", "Ki", "Kd"):
            self.register_variable(
                Float64(
                    name, causality=Fmi3Causality.parameter, variability=Fmi3Variability.tunable
                )
            )
        self.values = {}
        for name in ("eta_d", "nu_d", "eta", "nu"):
            self.vector(name, Fmi3Causality.input)
        self.vector("tau_d", Fmi3Causality.output)
        self.integral = np.zeros(6)

    def vector(self, name, causality):
        self.values[name] = np.zeros(6)
        self.register_variable(
            Float64(
                name,
                causality=causality,
                variability=Fmi3Variability.continuous,
                dimensions=[Dimension(start="6")],
                getter=lambda: list(self.values[name]),
                setter=lambda x: self.values.__setitem__(name, np.array(x)),
            ),
            nested=False,
        )

    def do_step(self, current_time, step_size):
        v = self.values
        error = v["eta_d"] - v["eta"]
        error[5] = (error[5] + pi) % (2 * pi) - pi
        psi = v["eta"][5]
        error[:2] = np.array([[cos(psi), sin(psi)], [-sin(psi), cos(psi)]]) @ error[:2]
        self.integral = self.integral + step_size * error
        v["tau_d"] = P * (self.Kp * error + self.Ki * self.integral) + D * self.Kd * (
            v["nu_d"] - v["nu"]
        )
        return True
