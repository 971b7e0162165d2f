"""Declare a component, and run it in three ways: by CasADi, as native C, as an exported FMU."""

from pathlib import Path

import casadi as ca

from uuvsim_cosim import Model
from uuvsim_cosim.fmus import Native, build_fmu, simulate_fmu
from uuvsim_cosim.models import simulate


def pendulum() -> Model:
    """Angle of a body whose centre of gravity hangs below its centre of buoyancy."""
    m = Model("pendulum", "A tilted body swings back", h_max=0.01)
    z = m.parameter("z", 0.02, unit="m", min=0, description="CG below CB")
    W = m.parameter("W", 112.8, unit="N", min=0)
    I_x = m.parameter("I_x", 0.35, unit="kg.m2", min=1e-3, description="added inertia included")
    d = m.parameter("d", 0.1, unit="N.m.s/rad", min=0)
    phi = m.state("phi", 0.3, unit="rad")
    p = m.state("p", unit="rad/s")
    m.der(phi, p)
    m.der(p, -(z * W * ca.sin(phi) + d * p) / I_x)
    m.output("roll", phi, unit="rad")
    return m


if __name__ == "__main__":
    declared = simulate(pendulum(), until=2.0, h=0.01)["roll"][-1]

    native = Native(pendulum(), "pendulum")
    native.enter_initialization_mode(0.0, 2.0)
    native.exit_initialization_mode()
    for k in range(200):
        native.do_step(k * 0.01, 0.01)
    in_process = native.get(native.description.variables["roll"])
    native.terminate()
    native.free()

    fmu = build_fmu(pendulum(), fmi=3, target=Path("pendulum.fmu"))
    exported = simulate_fmu(fmu, until=2.0, step="0.01")["roll"][-1]

    print(f"native  {in_process:.17g} rad")
    print(f"FMU     {exported:.17g} rad, the same bits: {in_process == exported}")
    print(f"CasADi  {declared:.17g} rad, {abs(declared - in_process):.1e} off")
