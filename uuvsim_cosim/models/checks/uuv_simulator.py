"""RexROV's matrices, thruster allocation and thruster curves against uuv_simulator's."""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca
import numpy as np

from uuvsim_cosim.models.actuators.thruster_geometry import configuration_matrix, thruster_geometry
from uuvsim_cosim.models.checks.comparison import Checked, compared, number, reference_values
from uuvsim_cosim.models.checks.compiled_run import end_of
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.parameter_files import parameter_set
from uuvsim_cosim.models.hull.coriolis import coriolis
from uuvsim_cosim.models.hull.damping import damping
from uuvsim_cosim.models.vehicles.closed_forms import total_mass

__all__ = ["allocation_of_rexrov2", "rexrov", "sphere", "thrusters"]

GROUP = "uuv_simulator"
FLU = np.diag([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])


def rexrov() -> Iterator[Checked]:
    """Yield M, and C(nu) nu and D(nu) nu at twelve velocities; then the allocation of thrusters."""
    address = "rexrov@uuv_simulator"
    values = reference_values("rexrov_pointwise.yaml")
    M = total_mass(declare(address))
    numbers = parameter_set("rexrov", "uuv_simulator").quantities
    D_l, D_q = (ca.diag(ca.SX([numbers[f"{D}_{i}{i}"].value for i in range(1, 7)]))
                for D in ("D_l", "D_q"))  # fmt: skip
    yield compared(GROUP, address, "M", M, values["M_total"], 1e-8)
    points = values["points"]
    ours = [number(coriolis(ca.SX(M), ca.SX(p["nu"]))).ravel() for p in points]
    theirs = [p["C_nu"] for p in points]
    yield compared(GROUP, address, "C(nu) nu at twelve velocities", ours, theirs, 1e-8)
    ours = [number(damping(D_l, D_q, ca.SX(p["nu"]))).ravel() for p in points]
    theirs = [p["D_nu"] for p in points]
    yield compared(GROUP, address, "D(nu) nu at twelve velocities", ours, theirs, 1e-8)
    yield _allocation("rexrov")


def allocation_of_rexrov2() -> Iterator[Checked]:
    """Yield the recorded thruster allocation matrix of RexROV 2."""
    yield _allocation("rexrov2")


def _allocation(id: str) -> Checked:
    """Its TAM.yaml is FLU, and its degrees are cut after eight digits."""
    recorded = reference_values("uuv_simulator_tam.yaml")[id]
    ours = FLU @ configuration_matrix(thruster_geometry(id))
    return compared(GROUP, id, "recorded thruster allocation matrix", ours, recorded, 1e-6)


def sphere() -> Iterator[Checked]:
    """Yield added mass and drag that its own test of a sphere asserts."""
    case = reference_values("published_checks.yaml")["uuv_simulator_tests"]["sphere"]
    address = "sphere@uuv_simulator_test"
    numbers = parameter_set("sphere", "uuv_simulator_test").quantities
    ours, theirs = numbers["M_A_11"].value, case["added_mass"]
    yield compared(GROUP, address, "added mass of its sphere", ours, theirs, 1e-5)
    ours, theirs = numbers["D_q_11"].value, case["D_quadratic"]
    yield compared(GROUP, address, "quadratic drag of its sphere", ours, theirs, 1e-4)


def thrusters() -> Iterator[Checked]:
    """Yield thrust of its curves at the speeds that its tests take."""
    case = reference_values("published_checks.yaml")["uuv_simulator_tests"]
    basic, bessa = case["thruster_basic"], case["thruster_bessa"]
    given = {"n_max": basic["w"], "K_n": basic["k"]}
    run = end_of(declare("thruster"), 2.0, 5e-3, {"u": 1.0, "voltage": 16.0}, given)
    what = "thrust of the quadratic curve"
    yield compared(GROUP, "thruster", what, run["thrust"], basic["thrust"], 1e-9)
    given = {"c_l": bessa["cl"], "c_r": bessa["cr"], "d_l": bessa["dead_l"]}
    given |= {"d_r": bessa["dead_r"], "n_max": 50.0}
    model = declare("thruster", curve="bessa")
    found = [
        end_of(model, 2.0, 5e-3, {"u": w / 50.0, "voltage": 16.0}, given)["thrust"][0]
        for w in (*bessa["w"], 4.5)
    ]
    what = "thrust of Bessa's curve, and in its dead zone"
    yield compared(GROUP, "thruster", what, found, [*bessa["thrust"], 0.0], 1e-9)
