"""The pages: viser's by what its server is told, the report's in a browser."""

import base64
import http.client
import json
import re
import socket
import sys
import threading
import urllib.request
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.view.browser import chromium
from tests.view.scene_parts import survey_folder, survey_signals
from uuvsim_cosim.bridge.access.token import known_token, token_file
from uuvsim_cosim.cli import status_of
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.orchestrator.master.observer import Chunk, Column
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.running.library import load
from uuvsim_cosim.view.recorded.traces import Traces
from uuvsim_cosim.view.reports.run_report import report_html
from uuvsim_cosim.view.scene3d.live import History, LiveView
from uuvsim_cosim.view.scene3d.motion import Motion, motion_of
from uuvsim_cosim.view.scene3d.recording_page import Replay
from uuvsim_cosim.view.scene3d.scene import Body, Scene3D
from uuvsim_cosim.view.scene3d.scene_html import scene_data, scene_html
from uuvsim_cosim.view.scene3d.scene_of_plan import ANYTHING
from uuvsim_cosim.view.scene3d.scene_of_run import placed
from uuvsim_cosim.view.scene3d.viser_server import close_server, entry, open_server

Placed = tuple[Scene3D, Motion, Traces]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Placed:
    return placed(survey_folder(tmp_path_factory.mktemp("run"), survey_signals()))


@pytest.fixture
def server() -> Iterator[Any]:
    made = open_server(None)
    yield made
    close_server(made)


# ---- viser --------------------------------------------------------------------------------------


def test_the_page_is_served_and_its_port_is_free_again_afterwards(recorded: Placed) -> None:
    server = open_server(None)
    Replay(server, *recorded)
    opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
    with opener.open(entry(server).replace("localhost", "127.0.0.1")) as page:
        assert b"<html" in page.read()
        assert "token" not in page.url  # the address loses it; the browser keeps a cookie
    port = server.get_port()
    close_server(server)
    again = open_server(port)
    close_server(again)


def asked(server: Any, path: str = "/", **headers: str) -> int:
    """Ask the page for a path as it is written, and return the status."""
    page = http.client.HTTPConnection("127.0.0.1", server.get_port())
    page.request("GET", path, headers={k.replace("_", "-"): v for k, v in headers.items()})
    status = page.getresponse().status
    page.close()
    return status


UPGRADE = {
    "Upgrade": "websocket", "Connection": "Upgrade", "Sec_WebSocket_Version": "13",
    "Sec_WebSocket_Key": "dGhlIHNhbXBsZSBub25jZQ==",
}  # fmt: skip


def test_the_page_and_its_socket_require_the_token(server: Any) -> None:
    port = server.get_port()
    token = known_token("127.0.0.1", port)
    assert token is not None
    assert entry(server).endswith(f"?token={token}")
    allowed = {"Authorization": f"Bearer {token}"}
    assert asked(server) == asked(server, "/?token=wrong") == asked(server, **UPGRADE) == 401
    assert asked(server, Cookie=f"uuvsim-{port}={token}") == 401  # the cookie is another secret
    assert asked(server, f"/?token={token}") == 303
    assert asked(server, **allowed) == 200
    mine, other = f"http://127.0.0.1:{port}", "http://evil.example"
    assert asked(server, **UPGRADE, **allowed, Origin=other) == 403
    assert asked(server, **UPGRADE, **allowed, Origin=mine) == 101


def test_a_browser_may_ask_only_this_server(server: Any) -> None:
    port = server.get_port()
    page = http.client.HTTPConnection("127.0.0.1", port)
    page.request("GET", "/", headers={"Authorization": f"Bearer {known_token('127.0.0.1', port)}"})
    policy = page.getresponse().headers["Content-Security-Policy"]
    page.close()
    hosts = re.findall(r"wss?://(\S+)", policy)
    assert hosts == [f"127.0.0.1:{port}"] * 2
    assert "*" not in policy
    assert not re.search(r"(?<!s)https?:", policy)


def test_the_page_serves_no_other_files(server: Any) -> None:
    token = known_token("127.0.0.1", server.get_port())
    for path in ("/" + "../" * 12 + "etc/passwd", "/assets/../../x", "/..\\..\\x", "/C:/x"):
        assert asked(server, path, Authorization=f"Bearer {token}") == 404


def test_the_token_of_a_page_ends_with_it() -> None:
    server = open_server(None)
    file = token_file(server.get_port())
    assert file.stat().st_mode & 0o777 == 0o600
    close_server(server)
    assert not file.exists()


def test_a_port_in_use_is_said() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(InputInvalid, match=f"--port {port}.*expected a free port"):
            open_server(port)
    with pytest.raises(InputInvalid, match="1 to 65535"):
        open_server(70_000)


def test_without_viser_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(InputInvalid, match=r"uuvsim-cosim\[view\]"):
        open_server(None)


@pytest.mark.parametrize(
    "arguments",
    [["run", "bluerov2_survey", "--port", "9000"], ["play", "source", "--port", "9000"],
     ["play", "source", "--view", "--window"], ["run", "x.fmu", "--view"]],
)  # fmt: skip
def test_options_that_do_not_go_together_are_refused(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of(arguments) == 2
    assert "expected" in capsys.readouterr().err


def test_a_replay_plays_stops_at_its_end_and_begins_again(server: Any, recorded: Placed) -> None:
    replay = Replay(server, *recorded)
    replay.speed.value = "2 x"
    replay.advance(3.0)
    assert replay.t == pytest.approx(6.0)
    replay.show()
    assert replay.slider.value == pytest.approx(6.0)
    assert replay.drawn._bodies["hull"].position == pytest.approx(recorded[1].positions["hull"][60])
    replay.advance(100.0)
    assert (replay.t, replay.playing.value) == (12.0, False)
    replay.advance(1.0)
    assert replay.t == 12.0
    replay.again.value = replay.playing.value = True
    replay.advance(0.5)
    assert replay.t == pytest.approx(1.0)


def test_nobody_looking_leaves_a_replay_where_it_is(server: Any, recorded: Placed) -> None:
    replay = Replay(server, *recorded)
    naps: list[float] = []
    replay.serve(until=lambda: len(naps) == 3, sleep=naps.append)
    assert replay.t == 0.0
    assert len(naps) == 3


def test_a_body_without_a_place_vanishes_and_comes_back(server: Any) -> None:
    scene3d = Scene3D("x", (Body("hull", ANYTHING, "hull.eta"),))
    eta = np.zeros((3, 6))
    eta[1] = np.nan
    traces = Traces(np.arange(3.0), {"hull.eta": eta})
    replay = Replay(server, scene3d, motion_of(scene3d, traces), traces)
    seen = []
    for t in range(3):
        replay.t = float(t)
        replay.show()
        seen.append(replay.drawn._bodies["hull"].visible)
    assert seen == [True, False, True]


def test_a_history_stays_short_and_keeps_the_first_and_the_newest_row() -> None:
    history = History(most=50)
    for k in range(10_000):
        history.add(0.01 * k, np.array([float(k)]))
    traces = history.traces(["a.x"], {})
    assert len(traces.time) <= 51
    assert traces.values["a.x"][[0, -1]].tolist() == [0.0, 9999.0]
    assert np.diff(traces.time)[:-1].max() < 0.06 * traces.time[-1]
    history.add(0.0, np.array([-1.0]))  # a new beginning
    assert len(history) == 1


def test_a_live_view_reads_numbers_of_every_type_and_changes_none(server: Any) -> None:
    plan = flatten(load("bluerov2_survey"))
    columns = _columns(plan)
    rows = np.zeros((2, len(columns)), np.uint64)
    for i, column in enumerate(columns):
        rows[:, i].view(column.type.dtype)[:] = i if column.type.dtype != "f8" else i + 0.5
    before = rows.copy()
    view = LiveView(server, "survey", clock=iter([0.0, 0.01, 1.0]).__next__)
    chunk = Chunk(columns, Fraction(1, 100), np.array([7, 8]), rows, [])
    view._clock, clock = (lambda: 0.0), view._clock
    view.begin(plan, columns)
    view._clock = clock
    for _ in range(3):
        view.observe(chunk)  # the second comes too early
    view.end()
    assert view.failure is None
    assert np.array_equal(rows, before)
    traces = view.history.traces(view._names, view._units)
    assert traces.time.tolist() == [0.08, 0.08]
    for i, column in enumerate(columns):
        values = traces.values[f"{column.path}.{column.variable.name}"]
        value = values[-1] if column.index is None else values[-1, column.index - 1]
        assert value == (i + 0.5 if column.type.dtype == "f8" else i)


def test_a_live_page_is_drawn_by_a_thread_of_its_own(server: Any) -> None:
    plan = flatten(load("bluerov2_survey"))
    eta = [c for c in _columns(plan) if c.name.startswith("hull.eta")]
    shown = threading.Event()
    told: list[float] = []

    def told_clients() -> dict[int, Any]:
        told.append(0.0)
        if len(told) > 4:
            shown.set()
        return {}

    watched = SimpleNamespace(
        gui=server.gui, scene=server.scene, atomic=server.atomic, get_clients=told_clients,
        on_client_connect=server.on_client_connect,
    )  # fmt: skip
    view = LiveView(watched, "survey")
    view.begin(plan, eta)
    rows = np.full((1, 6), 1.5).view(np.uint64)
    view.observe(Chunk(eta, Fraction(1, 10), np.array([3]), rows, []))
    assert shown.wait(120.0)
    view.end()
    assert view.failure is None
    assert len(view.history) == 1


def _columns(plan: Any) -> list[Column]:
    return [
        column
        for c in plan.components
        for v in c.description.variables.values()
        if v.causality == "output"
        for column in Column.of(c.path, v)
    ]


# ---- the report ---------------------------------------------------------------------------------


def _large() -> tuple[Scene3D, Traces]:
    """A fleet over a large terrain, for an hour."""
    random = np.random.default_rng(0)
    n = 36_000
    bodies = tuple(Body(f"v{i}", ANYTHING, f"v{i}.hull.eta") for i in range(24))
    z = (50 + 10 * random.standard_normal((700, 900))).astype(np.float32)
    scene3d = Scene3D("fleet", bodies, terrain=Terrain(z, 1.0, (0.0, 0.0)))
    values = {b.eta: random.standard_normal((n, 6)).cumsum(axis=0) for b in bodies}
    return scene3d, Traces(np.linspace(0, 3600, n), values)


def test_a_report_of_a_fleet_over_a_large_terrain_stays_below_2_mb() -> None:
    scene3d, traces = _large()
    assert len(scene_html(scene3d, motion_of(scene3d, traces, 150)).encode()) < 1.2e6
    assert len(report_html(traces, {"system": "fleet"}, scene3d).encode()) < 2e6


def test_the_scene_s_data_hold_what_was_recorded(recorded: Placed) -> None:
    scene3d, motion, _ = recorded
    data = scene_data(scene3d, motion)
    (body,) = data["bodies"]
    at = np.frombuffer(base64.b64decode(body["p"]), "<f4").reshape(-1, 3)
    assert at + data["origin"] == pytest.approx(motion.positions["hull"], abs=2e-6)
    q = np.frombuffer(base64.b64decode(body["q"]), "<i2").reshape(-1, 4) / 32767
    assert q == pytest.approx(motion.attitudes["hull"], abs=2e-5)
    arrows = np.frombuffer(base64.b64decode(body["arrows"]["v"]), "<i2").reshape(-1, 8)
    lengths = arrows / 32767 * body["arrows"]["scale"]
    assert lengths == pytest.approx(motion.thrusts["hull"] * motion.scales["hull"], abs=1e-4)


def test_a_flat_bottom_is_drawn_where_there_is_no_terrain() -> None:
    body = Body("hull", ANYTHING, "e")
    terrain = Terrain(np.full((2, 2), 9.0, np.float32), 5.0, (0.0, 0.0))
    motion = motion_of(Scene3D("x", (body,)), Traces(np.arange(2.0), {"e": np.zeros((2, 6))}))
    drawn = [
        len(scene_data(Scene3D("x", (body,), bottom=bottom, terrain=under), motion)["solids"])
        for bottom, under in ((None, None), (20.0, None), (None, terrain), (20.0, terrain))
    ]
    assert drawn == [0, 2, 1, 1]  # the bottom and the surface; a terrain is no solid


def test_depths_of_a_terrain_survive_their_16_bits() -> None:
    z = np.array([[3.0, 177.25], [np.nan, 60.5]], np.float32)
    scene3d = Scene3D("x", (Body("hull", ANYTHING, "e"),), terrain=Terrain(z, 5.0, (1.0, 2.0)))
    motion = motion_of(scene3d, Traces(np.arange(2.0), {"e": np.zeros((2, 6))}))
    terrain = scene_data(scene3d, motion)["terrain"]
    coded = np.frombuffer(base64.b64decode(terrain["z"]), "<i2").reshape(2, 2)
    assert coded[1, 0] == -32768
    found = terrain["low"] + terrain["step"] * coded[[0, 0, 1], [0, 1, 1]]
    assert found == pytest.approx([3.0, 177.25, 60.5], abs=0.01)


def test_a_name_cannot_become_markup_nor_a_gap_a_wrong_number() -> None:
    nasty = "</script><script>alert(1)</script>"
    scene3d = Scene3D(nasty, (Body(nasty, ANYTHING, "e"),), notes=(nasty,))
    eta = np.zeros((5, 6))
    eta[2] = np.nan
    html = scene_html(scene3d, motion_of(scene3d, Traces(np.arange(5.0), {"e": eta})))
    assert nasty not in html
    found = re.search(r'<script id="scene-data"[^>]*>(.*?)</script>', html, re.DOTALL)
    assert found is not None
    assert json.loads(found[1])["bodies"][0]["name"] == nasty


def test_a_browser_draws_the_report_s_scene(recorded: Placed, tmp_path: Path) -> None:
    scene3d, _, traces = recorded
    html = report_html(traces, {"system": "survey"}, scene3d)
    for forbidden in ("http://", "https://", "url(", "@import", "fetch(", "XMLHttpRequest"):
        assert forbidden not in html
    # The scene alone, and what went wrong in its title, so that a picture tells.
    page = tmp_path / "report.html"
    top = "<style>header,.figures,.lead,h2{display:none!important}</style>"
    page.write_text(html.replace("</head>", f"{top}</head>"), encoding="utf-8")
    picture = tmp_path / "report.png"
    chromium(tmp_path, page, "--window-size=900,640", "--virtual-time-budget=2000",
             f"--screenshot={picture}")  # fmt: skip
    pixels = np.asarray(Image.open(picture).convert("RGB"), int)
    red, green, blue = pixels[..., 0], pixels[..., 1], pixels[..., 2]
    water = (abs(red - 219) < 4) & (abs(green - 232) < 4) & (abs(blue - 240) < 4)
    hull_and_track = (red - blue > 80) & (green - blue > 40)
    assert water.sum() > 20_000
    assert hull_and_track.sum() > 300
