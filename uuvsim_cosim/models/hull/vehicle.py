"""The hull: Fossen's equation of motion in six degrees of freedom, assembled.

    M_RB nu_dot + C_RB(nu) nu + M_A nu_r_dot + C_A(nu_r) nu_r + D(nu_r) nu_r + g(eta) = tau

In a uniform current that does not rotate, M_RB nu_dot + C_RB(nu) nu is equally
M_RB nu_r_dot + C_RB(nu_r) nu_r (the rigid body's equation in a frame that drifts with the
water; Fossen 2021, 2nd ed., chapter 10). With M = M_RB + M_A and C from M, the solved equation is

    M nu_r_dot = tau - C(nu_r) nu_r - D(nu_r) nu_r - g(eta),   nu_dot = nu_r_dot + nu_c_dot

so added mass is implicit, through M, and stable at any mass ratio. D(nu_r) nu_r also contains lift,
cross-flow drag by strips and SNAME's products, if a vehicle lists them (damping.py). Lift and drag
of a glider's wings add to tau (wings.py). In waves the water accelerates: the right-hand side then
also has  M_A (a_c, 0)  and the pressure force that accelerates the water, rho nabla a_c at r_b
(Froude and Krylov). If density and volume change with the depth D of the centre of buoyancy,
buoyancy is  B (1 + (beta_rho - beta_nabla) D). In stratified water, an input states the density:
buoyancy is  density g nabla (1 - beta_nabla D). Everything is about CO, in `b` (FRD); p = (N, E, D)
and the current v_c are in `n` (NED).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.expression import Number
from uuvsim_cosim.models.declaration.inertia import elements, symmetric
from uuvsim_cosim.models.declaration.kinematics import R, T_q, euler_of_q, q_of_euler
from uuvsim_cosim.models.declaration.model import Model, is_on
from uuvsim_cosim.models.declaration.parameter_files import parameter_set
from uuvsim_cosim.models.declaration.vectors import ETA, NU, NU_DOT, TAU
from uuvsim_cosim.models.hull.coriolis import coriolis, inverse
from uuvsim_cosim.models.hull.damping import cross_flow_of, damping, fading, lift, products
from uuvsim_cosim.models.hull.matrices import declare_parameters, mass_of_water, structure
from uuvsim_cosim.models.hull.restoring import floating, g, submerged_fraction
from uuvsim_cosim.models.hull.wings import wings
from uuvsim_cosim.models.shapes.volumes import Volume, vehicle_volumes
from uuvsim_cosim.models.water.current import nu_c, nu_c_dot

__all__ = ["hull", "vehicle"]

# Sea water of 35, 10 degC: rho g / K of EOS-80 (seawater.py), without stratification. A hull's own
# loss of volume is not published for any shipped vehicle: 0 until it is set.
COMPRESSIBLE = {"beta_rho": 4.36e-6, "beta_nabla": 0.0}


def vehicle(
    id: str,
    set: str | None = None,
    surface: bool | str = True,
    values: Mapping[str, float] | None = None,
    compressible: bool | str = False,
    waves: bool | str = False,
    stratified: bool | str = False,
) -> Model:
    """Declare the hull of the vehicle in the folder `id`, by one of its published sets.

    `values` replaces parameters, or adds one that the set leaves out as structurally zero.
    `surface`: with true, buoyancy is lost by a smooth step over the hull's height; with false, it
    is constant; with "volumes", it follows from the volumes that the file lists (volumes.py).
    `compressible` adds beta_rho and beta_nabla, `waves` adds the inputs a_c and, with a surface,
    zeta. `stratified` adds the input density, of the water at the hull (`water_column`).
    """
    published = parameter_set(id, set)
    name = published.vehicle + ("" if published.is_default else f"_{published.name}")
    numbers = {k: q.value for k, q in published.quantities.items()} | dict(values or {})
    sources = {k: q.source for k, q in published.quantities.items()}
    if is_on("compressible", compressible):
        numbers = COMPRESSIBLE | numbers
    by_volumes = surface == "volumes"
    return hull(
        name,
        numbers,
        surface=by_volumes or is_on("surface", surface, "volumes"),
        volumes=vehicle_volumes(id) if by_volumes else None,
        waves=is_on("waves", waves),
        stratified=is_on("stratified", stratified),
        sources=sources,
        description=f"Hull of {published.vehicle}, parameter set {published.name}",
    )


def hull(
    name: str,
    numbers: Mapping[str, float],
    *,
    surface: bool = True,
    volumes: Sequence[Volume] | None = None,
    waves: bool = False,
    stratified: bool = False,
    sources: Mapping[str, str] | None = None,
    description: str = "",
) -> Model:
    """Declare a hull of the parameters named in `hull_parameters`; those left out are zero.

    Without `surface`, the hull is submerged at any depth. With `volumes`, buoyancy is that of the
    volumes under water (restoring.py), instead of a step over the hull's height.
    """
    m = Model(name, description, h_max=0.01)
    p = declare_parameters(m, numbers, surface and not volumes, sources or {})
    M_expression, W, B, r_g, r_b, D_l, D_q = structure(p)
    m.h_max = _longest_step(m, M_expression, D_l)
    M = m.derived("M", M_expression)
    M_inv = m.derived("M_inv", inverse(M_expression))

    tau = m.input("tau", 6, unit=TAU, description="generalised force about CO in b [N, N.m]")
    v_c = m.input("v_c", 3, unit="m/s", description="velocity of the water in n")
    eta_0 = m.parameter(
        "eta_0", (0, 0, 5, 0, 0, 0), unit=ETA, description="initial N E D phi theta psi"
    )
    nu_0 = m.parameter("nu_0", (0,) * 6, unit=NU, description="initial u v w p q r of CO in b")
    position = m.state("p", eta_0[:3], unit="m", description="CO in NED")
    q = m.state("q_nb", q_of_euler(eta_0[3], eta_0[4], eta_0[5]), unit="1")
    nu = m.state("nu_b", nu_0, unit=NU, description="nu of CO in b [m/s, rad/s]")

    Rnb = R(q)
    down = Rnb[2, :].T
    v_c_b = nu_c(Rnb, v_c)
    nu_r = nu - v_c_b
    omega = nu[3:]
    depth = position[2]
    if waves and surface:
        depth = depth + m.input("zeta", unit="m", description="water's rise at the hull's N and E")
    afloat: Number = 1.0
    rho: Number = p.get("rho", 0.0)
    if stratified:
        if "nabla" not in p:
            raise ParameterInvalid(
                f"{name}: stratified water", "a set with W and B", "one with rho, nabla and g"
            )
        if "beta_rho" in p:
            raise ParameterInvalid(
                f"{name}: stratified water and beta_rho", "density of both", "one of them"
            )
        rho = m.input(
            "density",
            unit="kg/m3",
            start=numbers["rho"],
            min=0.0,
            description="of the water at the hull",
        )
        B = rho * p["g"] * p["nabla"]
    if "beta_rho" in p or "beta_nabla" in p:
        beta = p.get("beta_rho", 0.0) - p.get("beta_nabla", 0.0)
        B = B * (1.0 + beta * (depth + ca.dot(ca.densify(ca.SX(r_b)), down)))
    if surface and volumes:
        afloat, turning = floating(m, volumes, r_b, depth, down)
        buoyancy = ca.vertcat(B * afloat * down, B * ca.cross(turning, down))
        restoring = g(W, 0.0, r_g, ca.SX(3, 1), down) + buoyancy
    else:
        if surface:
            afloat = submerged_fraction(depth, r_b, down, p["height"])
        restoring = g(W, B * afloat, r_g, r_b, down)
    load = tau - coriolis(M, nu_r) - damping(D_l, D_q, nu_r) - restoring
    if waves:  # accelerating water acts on M_A and on the displaced volume
        a_c = m.input("a_c", 3, unit="m/s2", description="acceleration of the water in n, of waves")
        a = ca.mtimes(Rnb.T, a_c)
        push = mass_of_water(p) * afloat * a
        krylov = ca.vertcat(push, ca.cross(ca.densify(ca.SX(r_b)), push))
        load += krylov + ca.mtimes(symmetric(p, "M_A"), ca.vertcat(a, ca.SX.zeros(3)))
    load += -lift(elements(p, "D_u", 6), nu_r)
    if "U_f" in p:
        load += -fading(elements(p, "D_f", 6), p["U_f"], nu_r)
    if "x_bow" in p:
        load += -cross_flow_of(p, nu_r)
    load += products(p, nu_r)
    if "S" in p:
        load += wings(p, rho, nu_r)
    nu_dot = ca.mtimes(M_inv, load) + nu_c_dot(omega, v_c_b[:3])
    m.der(position, ca.mtimes(Rnb, nu[:3]))
    m.der(q, ca.mtimes(T_q(q), omega))
    m.der(nu, nu_dot)

    m.output(
        "eta",
        ca.vertcat(position, euler_of_q(q)),
        unit=ETA,
        description="N E D of CO [m], phi theta psi [rad]",
    )
    m.output("q", q / ca.sqrt(ca.sumsqr(q)), unit="1", description="attitude, scalar first")
    m.output("nu", nu, unit=NU, description="u v w p q r of CO in b [m/s, rad/s]")
    m.output("nu_dot", nu_dot, unit=NU_DOT, description="its time derivative in b [m/s2, rad/s2]")
    m.output("nu_r", nu_r, unit=NU, description="nu relative to the water [m/s, rad/s]")
    return m


def _longest_step(m: Model, M: ca.SX, D_l: ca.SX) -> float:
    """Return a sub-step at which RK4 damps what linear damping damps:  h lambda(M^-1 D_l) <= 1.

    A published set may brake a light axis hard (SAGA's roll, with no added mass, in 3 ms).
    """
    h = m.h_max
    if not D_l.nnz():
        return h
    start = [float(v.start[0]) for v in m.of_kind("parameter")]
    p = ca.vertcat(*(v.symbol for v in m.of_kind("parameter")))
    numbers = ca.Function("numbers", [p], [ca.densify(M), ca.densify(D_l)])(start)
    M_0, D_0 = (np.array(x) for x in numbers)
    if np.linalg.matrix_rank(M_0) < 6:
        return h
    rate = float(np.max(np.abs(np.linalg.eigvals(np.linalg.solve(M_0, D_0)))))
    return h / max(1, math.ceil(h * rate))
