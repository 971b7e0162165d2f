"""MuJoCo's `rollout` beside a fused kernel in one run: RK4 steps of 0.01 s a second, and the ratio.

What differs, plainly. MuJoCo: one free body of the BlueROV2's mass and inertia, an ellipsoid in its
fluid model (added mass, viscous drag and lift from the shape; no current), buoyancy by gravity
compensation, eight actuators at sites, each a first-order filter with linear gain; no contacts, no
constraints; one model for all rollouts; every state of every step is written out. Ours: the hull's
identified 6-DOF matrices (added mass with its Coriolis forces, linear and quadratic damping,
restoring moments, current), eight first-order thrusters with quadratic thrust, every parameter per
environment; only the last state is kept. Both have 21 states, and in float64 the same integrator
and step; ours also in float32. Medians of wall time; the trials alternate.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Callable

import numpy as np
from kernel_speed import processor, vehicle

from uuvsim_cosim.kernels import fuse

try:
    import mujoco
    from mujoco.rollout import Rollout
except ModuleNotFoundError:
    print("MuJoCo is missing: `pip install mujoco` (for this comparison alone).", file=sys.stderr)
    sys.exit(2)

STEP = 0.01
# BlueROV2 heavy's arrangement: four vectored in the plane, four vertical; position, direction.
S = 0.7071
THRUSTERS = [
    ((0.156, 0.111, 0.085), (S, -S, 0)), ((0.156, -0.111, 0.085), (S, S, 0)),
    ((-0.156, 0.111, 0.085), (-S, -S, 0)), ((-0.156, -0.111, 0.085), (-S, S, 0)),
    ((0.120, 0.218, 0.0), (0, 0, -1)), ((0.120, -0.218, 0.0), (0, 0, 1)),
    ((-0.120, 0.218, 0.0), (0, 0, 1)), ((-0.120, -0.218, 0.0), (0, 0, -1)),
]  # fmt: skip


def mjcf() -> str:
    sites = "".join(
        f'<site name="s{i}" pos="{p[0]} {p[1]} {p[2]}"/>' for i, (p, _) in enumerate(THRUSTERS)
    )
    actuators = "".join(
        f'<general site="s{i}" gear="{d[0]} {d[1]} {d[2]} 0 0 0" dyntype="filter" '
        f'dynprm="0.05" gainprm="40" ctrllimited="true" ctrlrange="-1 1"/>'
        for i, (_, d) in enumerate(THRUSTERS)
    )
    return f"""<mujoco>
      <option timestep="{STEP}" integrator="RK4" density="1025" viscosity="0.0011">
        <flag contact="disable" constraint="disable" autoreset="disable"/>
      </option>
      <worldbody>
        <body gravcomp="1">
          <freejoint/>
          <inertial pos="0 0 0.02" mass="13.5" diaginertia="0.26 0.23 0.37"/>
          <geom type="ellipsoid" size="0.23 0.29 0.13" fluidshape="ellipsoid" mass="0"/>
          {sites}
        </body>
      </worldbody>
      <actuator>{actuators}</actuator>
    </mujoco>"""


def alternating(calls: dict[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    times: dict[str, list[float]] = {name: [] for name in calls}
    for call in calls.values():
        call()
    for _ in range(repeats):
        for name, call in calls.items():
            begin = time.perf_counter()
            call()
            times[name].append(time.perf_counter() - begin)
    return {name: statistics.median(t) for name, t in times.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--envs", type=int, default=1024)
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    envs, steps = options.envs, options.steps
    print(f"{processor()}; MuJoCo {mujoco.__version__}; {envs} environments, {steps} steps a call")
    model = mujoco.MjModel.from_xml_string(mjcf())
    u = np.random.default_rng(1).uniform(-0.6, 0.6, (envs, 8))
    first = np.zeros((envs, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    first[:, 4] = 1.0  # time, position, quaternion
    states = np.zeros((envs, steps, first.shape[1]))
    control = np.ascontiguousarray(np.broadcast_to(u[:, None, :], (envs, steps, 8)))
    kernels = {d: fuse(vehicle("model:thruster"), dtype=d) for d in ("float64", "float32")}
    for threads in (1, 2):
        data = [mujoco.MjData(model) for _ in range(threads)]
        calls: dict[str, Callable[[], object]] = {}
        # Threads of MuJoCo's pool come beside the caller's: 0 is to work in the caller.
        with Rollout(nthread=threads if threads > 1 else 0) as rollout:
            calls["MuJoCo rollout"] = lambda r=rollout, d=data: r.rollout(  # type: ignore[misc]
                model, d, first, control, state=states, skip_checks=False
            )
            for dtype, kernel in kernels.items():
                batch = kernel.batch(envs, threads=threads)
                for i in range(8):
                    batch.set(f"thruster_{i + 1}.u", u[:, i])
                calls[f"kernel {dtype}"] = lambda b=batch: b.step(steps)  # type: ignore[misc]
            found = alternating(calls, options.repeats)
        assert np.isfinite(states).all()
        reference = found["MuJoCo rollout"]
        print(f"{threads} thread(s)")
        for name, seconds in found.items():
            rate = envs * steps / seconds
            print(f"  {name:15s} {rate:12,.0f} steps/s, {reference / seconds:6.1f} times MuJoCo")


if __name__ == "__main__":
    main()
