"""A PID controller on the pose, of scalars ``eta_d[1] … eta_d[6]``, for pythonfmu."""

from math import cos, pi, sin

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

P = (60.0, 60.0, 80.0, 5.0, 5.0, 8.0)
D = (40.0, 40.0, 60.0, 1.5, 1.5, 3.0)


class PidFmi2(Fmi2Slave):
    author = "uuvsim-cosim tests"

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.Kp, self.Ki, self.Kd = 1.0, 0.0, 1.0
        for name in ("Kp", "Ki", "Kd"):
            self.register_variable(
                Real(name, causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable)
            )
        self.values = {}
        for name in ("eta_d", "nu_d", "eta", "nu"):
            self.vector(name, Fmi2Causality.input)
        self.vector("tau_d", Fmi2Causality.output)
        self.integral = [0.0] * 6

    def vector(self, name, causality):
        self.values[name] = [0.0] * 6
        for i in range(6):
            self.register_variable(
                Real(
                    f"{name}[{i + 1}]",
                    causality=causality,
                    getter=lambda n=name, i=i: self.values[n][i],
                    setter=lambda x, n=name, i=i: self.values[n].__setitem__(i, x),
                ),
                nested=False,
            )

    def do_step(self, current_time, step_size):
        v = self.values
        north, east, *rest = (d - m for d, m in zip(v["eta_d"], v["eta"], strict=True))
        psi = v["eta"][5]
        rest[3] = (rest[3] + pi) % (2 * pi) - pi
        error = [
            north * cos(psi) + east * sin(psi),
            east * cos(psi) - north * sin(psi),
            *rest,
        ]
        self.integral = [s + step_size * e for s, e in zip(self.integral, error, strict=True)]
        v["tau_d"] = [
            P[i] * (self.Kp * error[i] + self.Ki * self.integral[i])
            + D[i] * self.Kd * (v["nu_d"][i] - v["nu"][i])
            for i in range(6)
        ]
        return True
