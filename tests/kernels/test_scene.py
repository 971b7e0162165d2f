"""Sensors over a scene and contact in a kernel: the master's bits, whatever the lanes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from uuvsim_cosim.kernels import fuse
from uuvsim_cosim.models.worlds.obstacles import Box, Cylinder
from uuvsim_cosim.models.worlds.placed_mesh import placed_mesh
from uuvsim_cosim.models.worlds.scene import Scene, save_scene
from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.scene.shared.ray_casting import SOLID, Caster

STEPS, SEEDS = 300, [3, 14, 159]


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> System:
    """A sphere that falls onto a slope, against a wall, and what watches it."""
    folder: Path = tmp_path_factory.mktemp("slope")
    x = np.arange(30) - 15.0
    z = 6 + 0.3 * x[:, None] + 0.4 * np.sin(x[None, :])
    terrain = Terrain(z.astype(np.float32), 1.0, (-15.0, -15.0))
    solids = (Box((2.5, 0, 5), (0.3, 4, 3)), Cylinder((0, 3, 5), 0.5, 3))
    (folder / "keel.obj").write_text(
        "v 0 0 0\nv 4 0 0\nv 0 5 0\nv 0 0 3\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    )
    keel = placed_mesh(
        folder / "keel.obj", (0, 0, 7.5), (0.1, 0.2, 0.3), "m", 1.0, "ENU", contact=False
    )
    save_scene(Scene("slope", terrain, solids, None, "a slope", "made up", (keel,)), folder)
    scene = f"scene={folder}"
    below = Caster(str(folder)).cast((0, 1, 4.5), [(0, 0, 1)])[1][0]
    assert below == SOLID + len(solids)  # the mesh is what the altimeter sees first
    sensors = {
        "altimeter": f"model:altimeter?{scene}",
        "multibeam": f"model:multibeam?{scene}&beams=24",
        "camera": f"model:depth_camera?id=camera_class&{scene}&columns=5&rows=4",
        "color": f"model:color_camera?{scene}&columns=5&rows=4&depth=true&labels=true",
        "sonar": f"model:imaging_sonar?{scene}&beams=5&bins=20&columns=20&rays=6&range_max=9",
        "side": f"model:side_scan_sonar?{scene}&bins=9&columns=4&rays=6&range_max=9",
        "scan": f"model:scanning_sonar?{scene}&bins=9&columns=4&rays=6&range_max=9&period=0.06",
    }
    made = System("slope", "0.02", "A fall onto a slope").add(
        "hull",
        "model:sphere",
        {"eta_0": (0, 1, 4.5, 0, 0, 0.4), "nu_0": (0.8, 0.1, 0.9, 0, 0.3, 0)},
    )
    made = made.add("contact", f"model:contact?vehicle=sphere&{scene}&step=0.02")
    for name, source in sensors.items():
        made = made.add(name, source)
    for name in ("contact", *sensors):
        for signal in ("eta", "q", *(["nu"] if name == "contact" else [])):
            made = made.connect(f"hull.{signal}", f"{name}.{signal}")
    return made.connect("contact.tau", "hull.tau")


def test_a_kernel_of_eight_lanes_has_the_bits_of_the_masters_one(system: System) -> None:
    plan = flatten(system)
    names = [f"{c.path}.{v.name}" for c in plan.components for v in c.description.of("output")]
    rows = []
    instantiate = prepare(plan, "native")
    for seed in SEEDS:
        with Master(plan, instantiate) as master:
            master.initialize()
            master.reset(seed=seed)
            mine = []
            for _ in range(0, STEPS, 20):
                master.step(20)
                values = [master.get(*n.split(".", 1)) for n in names]
                mine.append(np.concatenate([np.ravel(v).astype(float) for v in values]))
            rows.append(mine)
    wanted = np.array(rows)
    depth = [i for i, n in enumerate(names) if n == "contact.depth"]
    assert depth
    assert len({r.tobytes() for r in wanted[:, -1]}) == len(SEEDS)
    touched = 0.0
    with fuse(system, lanes=8).batch(len(SEEDS), seeds=SEEDS) as batch:
        for k in range(STEPS // 20):
            for _ in range(20):
                batch.step()
                touched = max(touched, float(batch.get("contact.depth").max()))
            seen = [batch.get(n).reshape(len(SEEDS), -1).astype(float) for n in names]
            np.testing.assert_array_equal(np.hstack(seen), wanted[:, k])
    assert touched > 0.0


def test_a_float32_kernel_shows_the_image_of_a_float64_one() -> None:
    """The phase 2 k r, of up to 1e5 turns, is float64 in both; places are rounded to float32."""
    options = "beams=16&bins=32&columns=24&rays=12&range_max=30&scene=flat"
    made = System("still", "0.2", "A sonar over a level bed")
    made = made.add("hull", "model:sphere", {"eta_0": (1, 2, 20, 0, 0, 0.3)})
    made = made.add("sonar", f"model:imaging_sonar?{options}")
    for signal in ("eta", "q"):
        made = made.connect(f"hull.{signal}", f"sonar.{signal}")
    images = []
    for dtype in ("float64", "float32"):
        with fuse(made, dtype=dtype).batch(32, seeds=list(range(32))) as batch:
            for _ in range(3):
                batch.step()
            images.append(np.array(batch.get("sonar.magnitude"), float))
    assert np.corrcoef(images[0].ravel(), images[1].ravel())[0, 1] > 0.98
    assert images[1].mean() == pytest.approx(images[0].mean(), rel=0.01)
