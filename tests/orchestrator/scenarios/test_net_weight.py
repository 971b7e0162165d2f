"""A scenario that loads a vehicle beyond what its actuators carry is refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.errors import SystemInvalid

HOLD = uuv.load("bluerov2_hold")


def scenario(folder: Path, *events: str) -> Path:
    file = folder / "load.yaml"
    file.write_text("name: load\nevents:\n" + "".join(f"  - {e}\n" for e in events))
    return file


def run(system: uuv.System, file: Path) -> uuv.Run:
    return uuv.run(system, until=0.2, scenario=file, out=file.parent / "run", progress=False)


@pytest.mark.parametrize("value", ["30", "30 kg", "30000 g"])
def test_a_mass_that_sinks_the_vehicle_is_refused(value: str, tmp_path: Path) -> None:
    file = scenario(tmp_path, f"{{at: 0.1, set: hull.m, value: {value}}}")
    with pytest.raises(SystemInvalid, match=r"^scenario 'load', hull\.m = 30 at 0\.1 s: it sinks"):
        run(HOLD, file)
    assert not (tmp_path / "run").exists()


def test_a_mass_that_is_carried_is_set(tmp_path: Path) -> None:
    file = scenario(tmp_path, "{at: 0.1, set: hull.m, value: 20}")
    assert not [w for w in run(HOLD, file).warnings if "sinks" in w]


def test_a_mass_that_sinks_a_forced_system_is_a_warning(tmp_path: Path) -> None:
    file = scenario(tmp_path, "{at: 0.1, set: hull.m, value: 30}")
    warnings = run(HOLD.with_mismatches("warn"), file).warnings
    assert [w for w in warnings if w.startswith("scenario 'load', hull.m = 30 at 0.1 s: it sinks")]


def test_changes_are_judged_together_in_the_order_of_their_times(tmp_path: Path) -> None:
    larger = "{at: 0.05, set: hull.nabla, value: 0.03}"
    heavier = "{at: 0.05, set: hull.m, value: 30}"
    run(
        HOLD,
        scenario(tmp_path, heavier.replace("0.05, ", "0.15, "), larger.replace("0.03}", "0.02}")),
    )
    with pytest.raises(SystemInvalid, match="it rises"):
        run(HOLD, scenario(tmp_path, larger, heavier.replace("0.05, ", "0.15, ")))


@pytest.mark.parametrize(
    ("action", "value", "sinks"),
    [("override", 30.0, True), ("bias", 20.0, True), ("bias", 5.0, False)],
)
def test_an_override_and_a_bias_of_libcosim_are_judged(
    action: str, value: float, sinks: bool, tmp_path: Path
) -> None:
    event = {"time": 0.1, "model": "hull", "variable": "m", "action": action, "value": value}
    file = tmp_path / "load.json"
    file.write_text(json.dumps({"events": [event]}))
    if not sinks:
        run(HOLD, file)
        return
    with pytest.raises(SystemInvalid, match="it sinks"):
        run(HOLD, file)
