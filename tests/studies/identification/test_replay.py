"""A recorded flight in the place of a hull: a controller sees it, and cannot change it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import uuvsim_cosim as uuv
from tests.studies.identification.readers.ardusub_logs import HEAVY, PWM, ROV, dataflash
from tests.studies.identification.readers.bag_files import bag, imu, numbers
from uuvsim_cosim.errors import InputInvalid, SystemInvalid
from uuvsim_cosim.orchestrator.recording.signals import Signals
from uuvsim_cosim.orchestrator.system.resolve import remarks_of, resolve
from uuvsim_cosim.studies.identification.replay import LogSource

WIDTHS = (*PWM, 1540, 1460)


@pytest.fixture(scope="module")
def dive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dive") / "dive"
    return uuv.run("bluerov2_hold", until=4.0, out=folder, backend="native").folder


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return dataflash(tmp_path_factory.mktemp("log") / "1.BIN", HEAVY, pwm=WIDTHS)


def replayed(source: str, folder: Path, until: float = 4.0) -> Signals:
    system = uuv.load("bluerov2_hold").replace("hull", source)
    return uuv.run(system, until=until, out=folder, backend="native").signals()


def test_the_same_controller_on_a_recorded_flight_gives_the_recorded_commands(
    dive: Path, tmp_path: Path
) -> None:
    signals = replayed(f"log:{dive}", tmp_path / "shadow")
    assert signals["hull.u"].shape == signals["allocation.u"].shape
    assert np.abs(signals["hull.u"]).max() > 0.01
    assert np.abs(signals["hull.u"] - signals["allocation.u"]).max() < 1e-12


def test_another_controller_has_other_commands_on_the_same_flight(
    dive: Path, tmp_path: Path
) -> None:
    system = uuv.load("bluerov2_hold").replace("hull", f"log:{dive}")
    weaker = system.set("controller.Kp", [1.0] * 6)
    signals = uuv.run(weaker, until=4.0, out=tmp_path / "r", backend="native").signals()
    same = replayed(f"log:{dive}", tmp_path / "s")
    assert np.array_equal(signals["hull.eta"], same["hull.eta"])
    assert np.abs(signals["hull.u"] - signals["allocation.u"]).max() > 1e-3


def test_a_log_of_a_vehicle_is_flown_as_its_autopilot_saw_it(log: Path, tmp_path: Path) -> None:
    signals = replayed(f"log:{log}?from=1", tmp_path / "r", until=2.0)
    assert signals["hull.eta"][-1, 3:].tolist() == pytest.approx([np.pi / 36, 0, np.pi / 2])
    assert signals["hull.nu"][-1].tolist() == pytest.approx([1, 0, 0, 0.01, 0.02, 0.03], abs=1e-6)
    assert signals["hull.u"][-1].tolist() == pytest.approx([1, -1, -0.5, -0.5, 0, -0.25, -0.1, 0.1])
    # Samples are 0.1 s apart and 0.02 s late: at 1 + 2 s the last one is of 2.92 s.
    assert signals["hull.eta"][-1, 1] == pytest.approx(2.9)
    linear = replayed(f"log:{log}?from=1&between=linear", tmp_path / "l", until=2.0)
    assert linear["hull.eta"][-1, 1] == pytest.approx(2.98)


def test_what_the_recording_lacks_is_0_and_reported(tmp_path: Path) -> None:
    path = bag(tmp_path / "b", imu(), numbers("/u", [0.1] * 8))
    remarks = " ".join(remarks_of(f"log:{path}"))
    assert "not recorded, and 0: N, E, D, u, v, w" in remarks
    assert "t = 0 is 0 s of 5.9 s" in remarks
    component = resolve(f"log:{path}").instantiate("hull")
    assert component.description.variables["u"].shape == (8,)


def test_excluded_parts_are_replayed_and_marked(tmp_path: Path) -> None:
    events = [(7.0, 10), (12.0, 11)]
    path = dataflash(tmp_path / "1.BIN", {**HEAVY, "LOG_DISARMED": 1}, pwm=WIDTHS, events=events)
    signals = replayed(f"log:{path}", tmp_path / "r", until=5.5)
    used = signals["hull.used"]
    assert used[signals.time < 4.99].min() == 1.0
    assert used[signals.time > 5.01].max() == 0.0


def test_after_the_end_of_the_recording_nothing_is_used(dive: Path, tmp_path: Path) -> None:
    signals = replayed(f"log:{dive}", tmp_path / "r", until=5.0)
    used = signals["hull.used"]
    assert used[signals.time < 3.99].min() == 1.0
    assert used[signals.time > 4.01].max() == 0.0
    assert "after them, the last sample holds, and used is 0" in " ".join(remarks_of(f"log:{dive}"))


def test_components_that_are_made_for_another_vehicle_are_refused(tmp_path: Path) -> None:
    path = dataflash(tmp_path / "1.BIN", ROV)
    system = uuv.load("bluerov2_hold").replace("hull", f"log:{path}")
    with pytest.raises(SystemInvalid, match="made for bluerov2_heavy, but hull is bluerov2"):
        uuv.run(system, until=1.0, out=tmp_path / "r", backend="native")
    assert not (tmp_path / "r").exists()


def test_parameters_and_channels_are_files_of_the_source(tmp_path: Path) -> None:
    path = dataflash(tmp_path / "1.BIN", {}, pwm=WIDTHS)
    (tmp_path / "p.parm").write_text("".join(f"{k} {v}\n" for k, v in HEAVY.items()))
    (tmp_path / "c.yaml").write_text("depth: XKF1:PD?factor=2\n")
    text = f"log:{path}?parameters=p.parm&channels=c.yaml"
    source = resolve(text, tmp_path)
    assert resolve(source.text).text == source.text
    component = source.instantiate("hull")
    assert component.description.variables["u"].shape == (8,)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("log:none.BIN", "no file 'none.BIN'"),
        ("log:1.BIN?zero=1", "option 'zero'; expected one such as|from, between"),
        ("log:1.BIN?from=x", "from=x; expected seconds"),
        ("log:1.BIN?between=spline", "between=spline; expected held or linear"),
        ("log:1.BIN?channels=none.yaml", "no file 'none.yaml'"),
    ],
)
def test_a_wrong_source_is_refused_by_its_text(text: str, message: str, log: Path) -> None:
    with pytest.raises(InputInvalid, match=message):
        resolve(text, log.parent)


def test_a_time_outside_the_recording_and_two_hulls_are_refused(log: Path, tmp_path: Path) -> None:
    with pytest.raises(InputInvalid, match=r"from=90; expected 0 to 5.94 s, as recorded"):
        resolve(f"log:{log}?from=90").describe()
    columns = ",".join(f"{h}.nu[{k}]" for h in ("rov_1", "rov_2") for k in range(1, 7))
    path = tmp_path / "two.csv"
    path.write_text(f"time,{columns}\n" + "".join(f"{k},{'0,' * 11}0\n" for k in range(3)))
    with pytest.raises(InputInvalid, match=r"has 2 signals nu: rov_1.nu, rov_2.nu; expected one"):
        resolve(f"log:{path}").describe()


def test_a_turn_past_south_does_not_pass_through_north(tmp_path: Path) -> None:
    table = tmp_path / "a.csv"
    names = ",".join(f"eta[{k}]" for k in range(1, 7))
    table.write_text(f"time,{names}\n0,0,0,0,0,0,3.1\n1,0,0,0,0,0,-3.1\n")
    eta = LogSource(table, is_linear=True).flight.at(0.5)["eta"]
    assert isinstance(eta, list)
    assert abs(eta[5]) == pytest.approx(np.pi)
