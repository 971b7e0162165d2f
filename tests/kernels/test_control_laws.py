"""Controllers and guidance that are declarations run in a kernel with the bits of the master."""

from __future__ import annotations

import numpy as np

import uuvsim_cosim as uuv
from uuvsim_cosim.kernels import fuse
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten

LAWS = ("lqr", "feedback_linearisation", "backstepping", "sliding_mode")


def loop() -> uuv.System:
    """The first law flies the hull along a path; the others look on."""
    system = uuv.System("laws", "0.01").add("hull", "bluerov2_heavy").add("guide", "path_following")
    system = system.connect("hull.eta", "guide.eta").connect("hull.nu", "guide.nu")
    for law in LAWS:
        system = system.add(law, law)
        for source, name in (
            ("hull", "eta"),
            ("hull", "nu"),
            ("guide", "eta_d"),
            ("guide", "nu_d"),
        ):
            system = system.connect(f"{source}.{name}", f"{law}.{name}")
    return system.connect(f"{LAWS[0]}.tau_d", "hull.tau")


def test_each_law_has_the_bits_of_the_master() -> None:
    plan = flatten(loop())
    names = [f"{c.path}.{v.name}" for c in plan.components for v in c.description.of("output")]
    batch = fuse(loop()).batch(3)
    with Master(plan, prepare(plan, "native")) as master:
        master.initialize()
        for _ in range(300):
            batch.step()
            master.step()
        for name in names:
            mine = np.ravel(master.get(*name.rsplit(".", 1))).astype(float)
            np.testing.assert_array_equal(np.ravel(batch.get(name)[2]).astype(float), mine, name)
