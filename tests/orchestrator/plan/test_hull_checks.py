"""A hull of one's own that is not a body in water is reported in each run."""

from pathlib import Path

import pytest

from uuvsim_cosim.models.importing.new_vehicle import write_vehicle
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.shipped.of_vehicle import system_of
from uuvsim_cosim.orchestrator.system.system import System


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("I_g_11: {value: ", "I_g_11: {value: 9", "exceeds the sum of the other two"),
        ("D_q_11: {value: ", "D_q_11: {value: -", "the still water drives the hull"),
        ("I_g_11: {value: ", "I_g_11: {value: ", ""),
    ],
)
def test_impossible_inertia_and_negative_damping_are_reported(
    old: str, new: str, said: str, tmp_path: Path
) -> None:
    file = write_vehicle("my_rov", tmp_path) / "parameters.yaml"
    file.write_text(file.read_text("utf-8").replace(old, new), "utf-8")
    plan = flatten(System("s", "0.01").add("hull", f"model:{file.parent}"))
    found = [w for w in plan.warnings if "uuvsim models check" in w]
    assert len(found) == (said != "")
    assert all(said in w for w in found)


def test_shipped_hulls_with_known_deviations_are_not_reported() -> None:
    assert not [w for w in flatten(system_of("rexrov")).warnings if "models check" in w]
