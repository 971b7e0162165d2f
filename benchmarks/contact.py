"""What contact costs a step, in one run: a native component alone, and a fused kernel with it.

`python benchmarks/contact.py`.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np

from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.kernels import fuse
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.worlds.obstacles import Cylinder
from uuvsim_cosim.models.worlds.scene import Scene, save_scene
from uuvsim_cosim.models.worlds.terrain import Terrain, save_terrain
from uuvsim_cosim.orchestrator.system.system import System

STEPS, LANES, BATCH = 20_000, 8, 256


def alone(scene: str, vehicle: str, depth: float) -> float:
    """Return microseconds a call of the component at a depth of the hull's CO."""
    native = Native(declare("contact", vehicle=vehicle, scene=scene), "contact")
    v = native.description.variables
    native.set(v["eta"], np.array([10.0, 5.0, depth, 0.1, 0.05, 0.3]))
    native.set(v["nu"], np.array([0.5, 0.0, 0.2, 0.0, 0.0, 0.1]))
    native.enter_initialization_mode(0.0, None)
    native.exit_initialization_mode()
    update, stale, c = native._c.uuv_update_outputs, native._head, native._instance
    native.get(v["tau"])
    best = np.inf
    for _ in range(5):
        begun = time.process_time()
        for _ in range(STEPS):
            stale.outputs_stale = 1
            update(c)
        full = time.process_time() - begun
        begun = time.process_time()
        for _ in range(STEPS):
            stale.outputs_stale = 0
            update(c)
        best = min(best, full - (time.process_time() - begun))
    return 1e6 * best / STEPS


def fused(scene: str, vehicle: str, depth: float, contact: bool) -> float:
    """Return microseconds a step of one environment in a kernel, with or without contact."""
    s = System("drop", "0.02").add("hull", f"model:{vehicle}", {"eta_0": (10, 5, depth, 0, 0, 0)})
    if contact:
        s = s.add("contact", f"model:contact?vehicle={vehicle}&scene={scene}&step=0.02")
        for signal in ("eta", "q", "nu"):
            s = s.connect(f"hull.{signal}", f"contact.{signal}")
        s = s.connect("contact.tau", "hull.tau")
    with fuse(s, lanes=LANES).batch(BATCH) as batch:
        best = np.inf
        for _ in range(5):
            begun = time.process_time()
            batch.step(200)
            best = min(best, time.process_time() - begun)
    return 1e6 * best / (200 * BATCH)


def main() -> None:
    rng = np.random.default_rng(0)
    z = 20 + np.cumsum(rng.normal(size=(300, 300)), axis=0) * 0.1
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "bed.npz"
        save_terrain(Terrain(z.astype(np.float32), 2.0, (-300.0, -300.0)), file)
        bed = float(z[155, 152])
        for vehicle in ("sphere", "bluerov2_heavy"):
            free, deep = alone(str(file), vehicle, 5.0), alone(str(file), vehicle, bed)
            print(f"{vehicle}, native: {free:.2f} us a call in free water, {deep:.2f} in the bed")
            for name, depth in (("free water", 5.0), ("the bed", bed)):
                without = fused(str(file), vehicle, depth, contact=False)
                with_it = fused(str(file), vehicle, depth, contact=True)
                print(
                    f"{vehicle}, kernel of {LANES} lanes, in {name}: {with_it - without:.2f} us a "
                    f"step of one vehicle beside {without:.2f} for its hull"
                )
        places = rng.uniform(-500, 500, (1130, 2)).tolist()
        piles = tuple(Cylinder((north, east, 10.0), 0.5, 5.0) for north, east in places)
        save_scene(Scene("piles", None, piles, None, "made-up piles", "made up"), Path(folder))
        for scene, name in (("tacoma", "over tacoma"), (folder, "among 1,130 piles")):
            cost = alone(scene, "bluerov2_heavy", 10.0)
            print(f"bluerov2_heavy, native, in free water {name}: {cost:.2f} us a call")
        without = fused(folder, "bluerov2_heavy", 10.0, contact=False)
        with_it = fused(folder, "bluerov2_heavy", 10.0, contact=True)
        print(
            f"bluerov2_heavy, kernel of {LANES} lanes, among 1,130 piles: {with_it - without:.2f} "
            f"us a step of one vehicle beside {without:.2f} for its hull"
        )


if __name__ == "__main__":
    main()
