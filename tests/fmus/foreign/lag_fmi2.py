"""A first-order lag for pythonfmu that says something in each step, and raises when asked to."""

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real
from pythonfmu.enums import Fmi2Status


class LagFmi2(Fmi2Slave):
    author = "uuvsim-cosim tests"

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.u, self.y, self.T, self.limit = 0.0, 0.0, 0.5, 1e9
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        self.register_variable(Real("y", causality=Fmi2Causality.output))
        for name in ("T", "limit"):
            self.register_variable(
                Real(name, causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable)
            )

    def do_step(self, current_time, step_size):
        self.y += step_size * (self.u - self.y) / self.T
        self.log(f"y is {self.y:.3f}", Fmi2Status.warning)
        if self.y > self.limit:
            raise ValueError("beyond the limit")
        return True
