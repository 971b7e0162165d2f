"""A first-order lag for pythonfmu3 that says something in each step."""

from pythonfmu3 import Float64, Fmi3Causality, Fmi3Slave, Fmi3Variability
from pythonfmu3.enums import Fmi3Status


class LagFmi3(Fmi3Slave):
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
        self.u, self.y, self.T = 0.0, 0.0, 0.5
        self.register_variable(Float64("u", causality=Fmi3Causality.input))
        self.register_variable(Float64("y", causality=Fmi3Causality.output))
        self.register_variable(
            Float64("T", causality=Fmi3Causality.parameter, variability=Fmi3Variability.tunable)
        )

    def do_step(self, current_time, step_size):
        self.y += step_size * (self.u - self.y) / self.T
        self.log(f"y is {self.y:.3f}", Fmi3Status.warning)
        return True
