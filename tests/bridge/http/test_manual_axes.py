"""A person at the page /pilot is a component: axes move it, silence stops it, one page pilots."""

from __future__ import annotations

import http.client
import json
from pathlib import Path
from typing import Any

import pytest

from tests.bridge.peer import bearer
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.http import manual_axes
from uuvsim_cosim.bridge.http.keyboard import (
    ManualOverlay,
    Piloted,
    piloted,
    source,
    with_keyboards,
)
from uuvsim_cosim.bridge.http.manual_axes import (
    HELD,
    LASTS,
    ManualAxes,
    manual_axes_of,
    steer,
)
from uuvsim_cosim.bridge.http.server import HttpServer
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.python.component import PythonComponent
from uuvsim_cosim.orchestrator.running.library import load
from uuvsim_cosim.orchestrator.system.resolve import register
from uuvsim_cosim.orchestrator.system.system import System

PARTS = Path(__file__).parents[1] / "parts.py"
PAGE = Path(manual_axes.__file__).with_name("pilot.html")
ME = Client("me", "local")
POSE = (6, ("m",) * 3 + ("rad",) * 3)
VELOCITY = (6, ("m/s",) * 3 + ("rad/s",) * 3)
register("keyboard", source)


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


class Hull:
    """Follows nu_d at once: eta(t + dt) = eta(t) + nu_d dt, level, bow north."""

    inputs = {"eta_d": POSE, "nu_d": VELOCITY}  # noqa: RUF012
    outputs = {"eta": POSE, "nu": VELOCITY}  # noqa: RUF012

    def __init__(self) -> None:
        self.eta = [0.0] * 6

    def step(self, t: float, dt: float, u: dict[str, Any]) -> dict[str, Any]:
        self.eta = [e + dt * float(v) for e, v in zip(self.eta, u["nu_d"], strict=True)]
        return {"eta": self.eta, "nu": u["nu_d"]}


def system() -> System:
    return (
        System("piloted", "0.1")
        .add("hull", f"{Path(__file__)}:Hull")
        .add("guidance", "keyboard:")
        .connect("hull.eta", "guidance.eta")
        .connect("hull.nu", "guidance.nu")
        .connect("guidance.eta_d", "hull.eta_d")
        .connect("guidance.nu_d", "hull.nu_d")
    )


# ---- keys -------------------------------------------------------------------------------------


def test_a_pilot_that_falls_silent_flies_with_zeros() -> None:
    clock = Clock()
    manual_axes = ManualAxes("pilot", clock)
    assert manual_axes.update("page-1", {"surge": 0.5, "yaw": -2.0}) is None
    assert manual_axes.now() == (0.5, 0.0, 0.0, -1.0)
    clock.now += 0.99 * LASTS
    assert manual_axes.now()[0] == 0.5
    clock.now += 0.02 * LASTS
    assert manual_axes.now() == (0.0, 0.0, 0.0, 0.0)


def test_one_page_pilots_and_another_may_after_a_silence_or_a_release() -> None:
    clock = Clock()
    manual_axes = ManualAxes("pilot", clock)
    assert manual_axes.update("page-1", {"surge": 1.0}) is None
    assert "another page controls" in str(manual_axes.update("page-2", {"surge": -1.0}))
    assert manual_axes.now()[0] == 1.0
    clock.now += HELD + 0.1
    assert manual_axes.update("page-2", {"surge": -1.0}) is None
    manual_axes.release("page-1")  # not its own any more
    assert manual_axes.is_held
    manual_axes.release("page-2")
    assert manual_axes.now()[0] == 0.0
    assert manual_axes.update("page-1", {}) is None


@pytest.mark.parametrize(
    "axes", [{"surge": float("nan")}, {"surge": "1"}, {"roll": 1}, {"yaw": True}]
)
def test_what_is_no_axis_is_refused(axes: Any) -> None:
    with pytest.raises(InputInvalid, match="expected"):
        ManualAxes("pilot").update("page", axes)


# ---- the component ----------------------------------------------------------------------------


def test_an_axis_becomes_a_wanted_velocity_of_limited_change(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = Clock()
    with Conductor(system()) as service:
        monkeypatch.setattr(manual_axes_of("guidance"), "_clock", clock)
        manual_axes_of("guidance").update("page", {"surge": 1.0})
        largest, change = service.get(ME, ["guidance.surge_max", "guidance.a_max"]).values()
        before = 0.0
        for _ in range(15):
            u_d = float(service.step(ME, 1, None, ["guidance.nu_d"])[1]["guidance.nu_d"][0])
            assert u_d - before <= 0.1 * change + 1e-12
            before = u_d
        assert before == pytest.approx(largest)
        clock.now += LASTS  # the page is lost
        assert service.step(ME, 15, None, ["guidance.nu_d"])[1]["guidance.nu_d"][0] == 0.0
        there = service.get(ME, ["hull.eta", "guidance.eta_d"])
        assert there["hull.eta"][0] == pytest.approx(there["guidance.eta_d"][0], abs=0.1)


def test_the_wanted_pose_never_runs_away_from_the_vehicle() -> None:
    manual_axes = ManualAxes("held")
    component = PythonComponent(type("P", (Piloted,), {"manual_axes": manual_axes}), "held")
    variables = component.description.variables
    for k in range(100):
        manual_axes.update("page", {"surge": 1.0, "yaw": 1.0, "heave": -1.0})
        component.do_step(0.1 * k, 0.1)  # the vehicle does not move
    wanted = component.get(variables["eta_d"])
    assert (wanted[:3] ** 2).sum() ** 0.5 <= 1.0 + 1e-9
    assert abs(wanted[5]) <= 0.6 + 1e-9


def test_keys_move_a_vehicle_and_let_it_brake() -> None:
    class Speed:
        """u_d(t + dt) = u_d(t) + a dt."""

        inputs = {"a": "m/s2", "omega": "rad/s"}  # noqa: RUF012
        outputs = {"nu_d": (6, "1")}  # noqa: RUF012

        def __init__(self) -> None:
            self.u = self.r = 0.0

        def step(self, t: float, dt: float, u: dict[str, Any]) -> dict[str, Any]:
            self.u, self.r = self.u + dt * u["a"], u["omega"]
            return {"nu_d": [self.u, 0, 0, 0, 0, self.r]}

    clock, inner = Clock(), PythonComponent(Speed, "pilot")
    manual_axes = ManualAxes("pilot", clock)
    over = ManualOverlay(inner, manual_axes)
    nu_d = over.description.variables["nu_d"]
    manual_axes.update("page", {"surge": 1.0, "yaw": 0.5})
    for _ in range(30):
        over.do_step(0.0, 0.1)
    assert over.get(nu_d)[0] == pytest.approx(0.3, abs=1e-2)
    assert over.get(nu_d)[5] == 0.75
    kept = over.get_fmu_state()
    clock.now += LASTS
    for _ in range(30):
        over.do_step(0.0, 0.1)
    assert over.get(nu_d)[0] == pytest.approx(0.0, abs=1e-2)
    assert over.get(nu_d)[5] == 0.0
    over.set(over.description.variables["a"], 1.0)  # a policy's, without hands
    over.do_step(0.0, 0.1)
    assert over.get(nu_d)[0] == pytest.approx(0.1, abs=1e-2)
    over.set_fmu_state(kept)
    assert over.get(nu_d)[0] == pytest.approx(0.3, abs=1e-2)


# ---- what `--replace pilot=keyboard` means ------------------------------------------------------


def test_pilot_means_what_gives_the_wanted_pose_where_nothing_has_the_name() -> None:
    swaps = {"pilot": "keyboard", "hull": "other.fmu"}
    with_keyboards(lambda: load("bluerov2_hold"), swaps)
    assert swaps == {"guidance": "keyboard:", "hull": "other.fmu"}


def test_a_pilot_of_a_nested_vehicle_is_steered_at_its_inputs() -> None:
    path, over = piloted(load("target_tracking"), "tracker_2.pilot")
    assert path == "tracker_2.pilot"
    assert over.startswith("keyboard:model:pilot?")


@pytest.mark.parametrize(
    ("of", "name", "words"),
    [
        ("target_tracking", "pilot", r"2 of them \(tracker_1\.pilot, tracker_2\.pilot\)"),
        ("bluerov2_hold", "hull", "hull has outputs .*; expected a component with outputs eta_d"),
        ("bluerov2_hold", "captain", "no such component; expected one such as guidance"),
        ("bluerov2_task", "pilot", "expected a system with a pilot or guidance"),
    ],
)
def test_what_a_person_cannot_stand_for_is_refused(of: str, name: str, words: str) -> None:
    with pytest.raises(InputInvalid, match=words):
        piloted(load(of), name)


# ---- the page ---------------------------------------------------------------------------------


def test_a_page_pilots_and_a_second_one_is_told() -> None:
    with Conductor(system()) as service, HttpServer(service, 0, ("127.0.0.1",)) as endpoint:

        def ask(method: str, path: str, said: Any = None) -> Any:
            link = http.client.HTTPConnection("127.0.0.1", endpoint.port)
            headers = {"Content-Type": "application/json", **bearer(endpoint.port)}
            link.request(method, path, None if said is None else json.dumps(said), headers)
            data = link.getresponse().read()
            link.close()
            return data

        assert ask("GET", "/pilot").decode() == PAGE.read_text(encoding="utf-8")
        assert json.loads(ask("GET", "/pilots"))["pilots"] == [
            {"component": "guidance", "held": False}
        ]
        first = json.loads(ask("POST", "/pilot", {"page": "first", "axes": {"surge": 1}}))
        assert first["pilots"]
        assert len(first["seen"]["eta"]) == 6
        second = json.loads(ask("POST", "/pilot", {"page": "second", "axes": {"surge": -1}}))
        assert not second["pilots"]
        assert "another page controls guidance" in second["words"]
        ask("POST", "/pilot", {"page": "first", "release": True})
        assert json.loads(ask("POST", "/pilot", {"page": "second", "axes": {}}))["pilots"]


def test_what_a_page_says_wrongly_is_refused_in_words() -> None:
    with Conductor(system()) as service:
        for said, words in (
            (
                {"page": "first", "component": "hull"},
                "hull' has no manual control; expected one of guid",
            ),
            ({"page": 1}, "expected a text of 4 to 64 letters"),
            ({"page": "first", "axes": [1]}, "expected an object"),
            ({"page": "first", "keys": {}}, "field 'keys'"),
        ):
            with pytest.raises(InputInvalid, match=words):
                steer(service, ME, said)
        with pytest.raises(InputInvalid, match="this call needs 'set'"):
            steer(service, Client("eyes", "http", frozenset({"read"})), {"page": "first"})
    with (
        Conductor(System("sums", "0.1").add("sum", f"{PARTS}:Sum")) as service,
        pytest.raises(InputInvalid, match="no component has manual control"),
    ):
        steer(service, ME, {"page": "first"})
