"""Another source in a failed component's place: the values of all others stay as they were."""

from __future__ import annotations

from pathlib import Path

from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.system.system import System

LAG = """
class Lag:
    inputs = {"u": "1"}
    outputs = {"y": "1"}

    def step(self, t, dt, u):
        return {"y": u["u"]}
"""


def test_texts_of_other_components_stay(first_order_fmi3: Path, tmp_path: Path) -> None:
    (tmp_path / "lag.py").write_text(LAG)
    source = f"{tmp_path / 'lag.py'}:Lag"
    system = System("texts", "0.1").add("a", str(first_order_fmi3)).add("c", source)
    system = system.add("b", str(first_order_fmi3)).connect("a.string_out", "b.string_in")
    system = system.set("a.string_in", ["hull", "thrüster"])
    plan = flatten(system)
    with Master(plan, prepare(plan)) as master:
        master.initialize()
        master.step(3)
        kept = master.snapshot()
        master.restart("c", kept, source=source)
        master.step()  # b gets what a's output was before it
        assert list(master.get("b", "string_out")) == ["hull", "thrüster"]
