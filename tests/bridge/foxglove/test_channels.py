"""Signals as channels of Foxglove, seen by a client of its WebSocket protocol."""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from numpy.typing import NDArray

import uuvsim_cosim as uuv
from tests.bridge.foxglove.client import FoxgloveClient, connected, decoder
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.foxglove.channels import Message, Output, json_form, outputs_of
from uuvsim_cosim.bridge.foxglove.georeference import around, georeference_of
from uuvsim_cosim.bridge.foxglove.server import FoxgloveServer
from uuvsim_cosim.bridge.ros2.rows import Block, Layout
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.orchestrator.master.observer import Column
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Plan

PARTS = Path(__file__).parents[1] / "parts.py"
ME = Client("me", "local")


@pytest.fixture(scope="module")
def survey() -> Iterator[tuple[Conductor, FoxgloveServer]]:
    with Conductor("bluerov2_survey") as conductor, FoxgloveServer(conductor, 0) as server:
        yield conductor, server


@pytest.fixture
def sums() -> Iterator[Conductor]:
    with Conductor(
        uuv.System("sums", "0.1").add("a", f"{PARTS}:Sum").add("b", f"{PARTS}:Twice")
    ) as made:
        yield made


class Counted(Output):
    """A channel that counts the rows it has encoded."""

    def __init__(self, topic: str = "/counted") -> None:
        self.topic, self.form = topic, json_form({"type": "object", "title": "counted"})
        self.rows, self.times = 0, list[float]()

    def messages(self, block: Block) -> Iterator[Message]:
        self.rows += len(block.time)
        yield round(block.time[-1] * 1e9), b"{}"

    def whole(self, newest: Block) -> Iterator[Message]:
        self.times.append(float(newest.time[0]))
        yield round(newest.time[0] * 1e9), b'{"whole":true}'


class Broken(Counted):
    """A channel that fails."""

    def messages(self, block: Block) -> Iterator[Message]:
        raise ValueError("the pencil is broken")
        yield

    whole = messages


def moved(client: FoxgloveClient, conductor: Conductor, topic: str) -> dict[str, Any]:
    """Step until a topic has a message of a later time than 0."""
    return client.wait(
        lambda m: m.get("topic") == topic and m["at"] > 0,
        lambda: conductor.step(ME, 10, {}, ()),
    )


def test_a_client_finds_every_component_and_the_frames(
    survey: tuple[Conductor, FoxgloveServer],
) -> None:
    conductor, server = survey
    with connected(server.port) as client:
        client.advertised(len(server.topics))
        assert client.raw.subprotocol == "foxglove.sdk.v1"
        assert client.info["name"] == "bluerov2_survey"
        assert {"time", "parameters", "services"} <= set(client.info["capabilities"])
        components = {f"/{c['path']}" for c in conductor.describe()["components"]}
        assert components <= set(client.channels)
        assert client.channels["/tf"]["schemaName"] == "foxglove.FrameTransforms"
        assert client.channels["/hull/pose"]["schemaName"] == "foxglove.PoseInFrame"


def test_a_schema_has_the_unit_of_each_signal(survey: tuple[Conductor, FoxgloveServer]) -> None:
    with connected(survey[1].port) as client:
        schema = json.loads(client.advertised(len(survey[1].topics))["/hull"]["schema"])
    eta = schema["properties"]["eta"]
    assert (eta["type"], eta["maxItems"], eta["unit"]) == ("array", 6, "m, rad")
    assert eta["description"].endswith("[m, rad]")


def test_messages_have_the_values_and_the_simulated_time(
    survey: tuple[Conductor, FoxgloveServer],
) -> None:
    conductor, server = survey
    with connected(server.port) as client:
        client.subscribe("/hull")
        moved(client, conductor, "/hull")
        now, values = conductor.step(ME, 1, {}, ("hull.eta", "hull.nu"))
        message = client.message("/hull", lambda m: m["at"] == pytest.approx(now.time, abs=1e-9))
    assert message["data"]["eta"] == values["hull.eta"].tolist()
    assert message["data"]["nu"] == values["hull.nu"].tolist()


def test_every_message_of_a_component_follows_its_schema(
    survey: tuple[Conductor, FoxgloveServer],
) -> None:
    conductor, server = survey
    with connected(server.port) as client:
        client.advertised(len(server.topics))
        topics = {t for t, c in client.channels.items() if c["encoding"] == "json"}
        client.subscribe(*topics)
        found: dict[str, Any] = {}

        def all_moved(m: dict[str, Any]) -> bool:
            if m["op"] == "data" and m["at"] > 0:
                found[m["topic"]] = m["data"]
            return len(found) == len(topics)

        client.wait(all_moved, lambda: conductor.step(ME, 1, {}, ()))
        for topic, data in found.items():
            jsonschema.validate(data, json.loads(client.channels[topic]["schema"]))


def test_the_time_of_the_server_is_the_simulated_time(
    survey: tuple[Conductor, FoxgloveServer],
) -> None:
    conductor, server = survey
    with connected(server.port) as client:
        now = conductor.step(ME, 1, {}, ())[0]
        client.wait(lambda m: m["op"] == "time" and m["at"] == pytest.approx(now.time, abs=1e-9))


def test_poses_and_frames_are_enu_and_flu() -> None:
    boat = uuv.System("boat", "0.1").add("hull", "model:bluerov2_heavy")
    eta = [1.0, 2.0, 3.0, 0.0, 0.0, 0.5 * np.pi]  # heading east: FLU's x is ENU's x
    with Conductor(boat) as conductor, FoxgloveServer(conductor, 0) as server:
        starts = [i.name for i in conductor.schema() if i.name == "hull.eta_0"]
        conductor.reset(ME, start={starts[0]: eta})
        with connected(server.port) as client:
            client.subscribe("/hull/pose", "/tf")
            pose = client.message("/hull/pose")["data"]
            [transform] = client.message("/tf")["data"]["transforms"]
    position = {"x": 2.0, "y": 1.0, "z": -3.0}
    assert pose["frame_id"] == transform["parent_frame_id"] == "map"
    assert transform["child_frame_id"] == "base_link"
    assert pose["pose"]["position"] == pytest.approx(position)
    assert transform["translation"] == pytest.approx(position)
    for q in (pose["pose"]["orientation"], transform["rotation"]):
        assert abs(q["w"]) == pytest.approx(1.0)


def test_frames_of_sensors_come_with_the_subscription(
    survey: tuple[Conductor, FoxgloveServer],
) -> None:
    with connected(survey[1].port) as client:
        client.subscribe("/tf")
        first = client.message("/tf")["data"]["transforms"]
    # The axes of the DVL's beams are below its link.
    assert {"base_link", "dvl_link"} == {t["parent_frame_id"] for t in first}
    assert "imu_link" in {t["child_frame_id"] for t in first}


def test_a_channel_is_encoded_only_while_it_has_a_subscriber(sums: Conductor) -> None:
    watched, alone = Counted("/watched"), Counted("/alone")
    with (
        FoxgloveServer(sums, 0, drawing=lambda plan: [watched, alone]) as server,
        connected(server.port) as client,
    ):
        client.subscribe("/watched", "/a")
        moved(client, sums, "/watched")
        number = [k for k, c in client._by_id.items() if c["topic"] == "/watched"]
        client.send(op="unsubscribe", subscriptionIds=number)
        channel = server._run.channels["/watched"][1]  # type: ignore[union-attr]
        client.wait(lambda m: not channel.has_sinks(), lambda: sums.step(ME, 1, {}, ()))
        before = watched.rows
        now = sums.step(ME, 5, {}, ())[0]
        client.message("/a", lambda m: m["at"] == pytest.approx(now.time))
    assert watched.rows == before
    assert alone.rows == 0
    assert alone.times == []


def test_a_subscriber_of_a_paused_system_gets_its_values(sums: Conductor) -> None:
    sums.step(ME, 3, {"a.a": 2.0}, ())
    with FoxgloveServer(sums, 0) as server, connected(server.port) as client:
        client.subscribe("/a")
        message = client.message("/a")
    assert message["at"] == pytest.approx(0.3)
    assert message["data"]["s"] == pytest.approx(0.6)


def survey_layout() -> tuple[Plan, Layout]:
    """Return the layout of all outputs of a system."""
    plan = flatten(uuv.load("bluerov2_survey"))
    columns = [
        column
        for c in plan.components
        for v in c.description.of("output")
        for column in Column.of(c.path, v)
    ]
    return plan, Layout(columns, plan.tick)


def test_a_value_that_is_not_finite_is_null_and_has_no_pose() -> None:
    plan, layout = survey_layout()
    nan = {name: np.full(at.size, np.nan) for name, at in layout.places.items()}
    row = layout.row(0.1, {**nan, **{n: ["?"] * at.size for n, at in layout.texts.items()}})
    for output in outputs_of(plan, layout, around(0.0, 0.0)):
        messages = [data for _, data in output.whole(row)]
        if output.form.encoding == "json":
            [message] = [json.loads(data) for data in messages]
            words = set(re.split(r"[\[\], ]+", str(list(message.values()))))
            assert words <= {"", "None", "'?'"}
        else:
            assert len(messages) == (1 if output.topic == "/tf" else 0)  # frames of sensors


def test_texts_and_bytes_are_strings() -> None:
    said = Variable("said", "String", "output", "discrete")
    words = Variable("words", "Binary", "output", "discrete", shape=(2,))
    columns = [*Column.of("talker", said), *Column.of("talker", words)]
    layout = Layout(columns, Fraction(1, 10))
    plan = flatten(uuv.load("bluerov2_survey"))
    [talker, _] = outputs_of(plan, layout, None)
    one = layout.row(0.0, {"talker.said": "mayday", "talker.words": [b"\x01", b"\xff"]})
    texts = {
        "talker.said": np.array([["mayday"]], object),
        "talker.words": np.array([[b"\x01", b"\xff"]], object),
    }
    rows = layout.rows(np.array([3]), np.zeros((1, 3), np.uint64), texts)
    for block, way in itertools.product((one, rows), (talker.messages, talker.whole)):
        [(_, data)] = way(block)
        assert json.loads(data) == {"said": "mayday", "words": ["01", "ff"]}


def test_the_fix_of_an_estimate_has_its_variances_along_enu() -> None:
    plan, layout = survey_layout()
    values = {name: np.zeros(at.size) for name, at in (layout.places | layout.texts).items()}
    values["navigation.eta"][2] = 7.0
    values["navigation.sigma"][:3] = [1.0, 2.0, 3.0]  # N, E, D
    outputs = {o.topic: o for o in outputs_of(plan, layout, around(47.0, -122.0))}
    fix = outputs["/navigation/fix"]
    [(_, data)] = fix.whole(layout.row(0.0, values))
    message = decoder(fix.form.name, fix.form.schema).FromString(data)
    assert list(message.position_covariance) == [4.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 9.0]
    assert message.altitude == -7.0
    assert (message.latitude, message.longitude) == (47.0, -122.0)


def test_when_time_goes_back_the_scene_is_sent_again(sums: Conductor) -> None:
    still = Counted()
    sums.step(ME, 10, {}, ())
    with (
        FoxgloveServer(sums, 0, drawing=lambda plan: [still]) as server,
        connected(server.port) as client,
    ):
        client.subscribe("/counted", "/a")
        client.message("/counted", lambda m: m["data"] == {"whole": True})
        client.message("/a", lambda m: m["at"] == 1.0)
        sums.reset(ME)
        client.wait(lambda m: m["op"] == "time" and m["at"] == 0.0)
        client.message("/counted", lambda m: m["at"] == 0.0 and m["data"] == {"whole": True})
        sums.step(ME, 1, {}, ())
        client.message("/a", lambda m: m["at"] == pytest.approx(0.1))
    assert still.times == [1.0, 0.0]


def test_after_a_restored_snapshot_messages_continue_from_its_time(sums: Conductor) -> None:
    with FoxgloveServer(sums, 0) as server, connected(server.port) as client:
        client.subscribe("/a")
        sums.step(ME, 3, {}, ())
        kept = sums.snapshot(ME)
        sums.step(ME, 7, {}, ())
        client.message("/a", lambda m: m["at"] == pytest.approx(1.0))
        sums.restore(ME, kept)
        sums.step(ME, 1, {}, ())
        client.message("/a", lambda m: m["at"] == pytest.approx(0.4))


def test_a_run_as_fast_as_possible_ends_with_its_last_row(sums: Conductor) -> None:
    with FoxgloveServer(sums, 0) as server, connected(server.port) as client:
        client.subscribe("/a")
        client.message("/a")
        sums.run(ME, until=5000.0)
        client.message("/a", lambda m: m["at"] == pytest.approx(5000.0))


def test_a_client_that_does_not_read_delays_neither_the_system_nor_others(
    survey: tuple[Conductor, FoxgloveServer],
) -> None:
    conductor, server = survey
    with connected(server.port, max_queue=1, close_timeout=0.1) as slow:
        slow.subscribe(*slow.advertised(len(server.topics)))
        with connected(server.port) as other:
            other.subscribe("/hull")
            for _ in range(200):
                now = conductor.step(ME, 50, {}, ())[0]
            other.message("/hull", lambda m: m["at"] == pytest.approx(now.time))


def test_a_replaced_component_has_a_channel_of_its_new_signals(tmp_path: Path) -> None:
    (tmp_path / "parts.py").write_text(
        "class One:\n    inputs, outputs = {}, {'x': 'm'}\n"
        "    def step(self, t, dt, u):\n        return {'x': t}\n"
        "class Two:\n    inputs, outputs = {}, {'x': 'm', 'y': 'm'}\n"
        "    def step(self, t, dt, u):\n        return {'x': t, 'y': 2.0}\n"
    )
    one, two = (f"{tmp_path}/parts.py:{name}" for name in ("One", "Two"))
    with (
        Conductor(uuv.System("s", "0.1").add("a", one).add("b", f"{PARTS}:Sum")) as conductor,
        FoxgloveServer(conductor, 0) as server,
        connected(server.port) as client,
    ):
        client.subscribe("/a", "/b")
        other = client.channels["/b"]["id"]
        old = client.channels["/a"]["id"]
        conductor.replace(ME, "a", two)
        client.wait(lambda m: m.get("channelIds") == [old])
        client.wait(lambda m: client.channels["/a"]["id"] != old)
        client.subscribe("/a")
        conductor.step(ME, 1, {}, ())
        assert client.message("/a", lambda m: m["at"] > 0)["data"]["y"] == 2.0
        assert client.channels["/b"]["id"] == other
        client.message("/b", lambda m: m["at"] == pytest.approx(0.1))


def test_a_large_component_is_sent_whole_with_its_newest_values(tmp_path: Path) -> None:
    (tmp_path / "parts.py").write_text(
        "class Camera:\n    inputs, outputs = {}, {'image': (20_000, 'm'), 't': 's'}\n"
        "    def step(self, t, dt, u):\n        return {'image': [t] * 20_000, 't': t}\n"
    )
    system = uuv.System("s", "0.1").add("camera", f"{tmp_path}/parts.py:Camera")
    with (
        Conductor(system) as conductor,
        FoxgloveServer(conductor, 0) as server,
        connected(server.port) as client,
    ):
        client.subscribe("/camera")
        client.message("/camera")
        found = client.wait(
            lambda m: m["op"] == "data" and m["at"] > 0.5,
            lambda: conductor.step(ME, 1, {}, ()),
        )
        schema = json.loads(client.channels["/camera"]["schema"])
    jsonschema.validate(found["data"], schema)
    assert set(found["data"]["image"]) == {found["data"]["t"]}
    assert found["data"]["t"] == pytest.approx(found["at"] - 0.1)


def test_a_channel_that_fails_is_closed_and_the_others_go_on(sums: Conductor) -> None:
    with (
        FoxgloveServer(sums, 0, drawing=lambda plan: [Broken("/broken")]) as server,
        connected(server.port) as client,
    ):
        client.subscribe("/broken", "/a")
        assert client.status() == "/broken: the pencil is broken; the channel is closed"
        moved(client, sums, "/a")


def test_a_place_on_earth_moves_a_minute_of_arc_in_a_nautical_mile() -> None:
    place = around(45.0, 10.0)
    [[latitude, longitude]] = place(np.array([[1852.0, 0.0]]))
    assert latitude - 45.0 == pytest.approx(1 / 60, rel=1e-3)
    assert longitude == 10.0
    with pytest.raises(ValueError, match=r"91\.0"):
        around(91.0, 0.0)


def test_a_system_with_an_origin_has_a_fix(tmp_path: Path) -> None:
    import netCDF4

    file = tmp_path / "current.nc"
    with netCDF4.Dataset(file, "w") as data:
        for name, values in (("lat", [47.0, 47.5]), ("lon", [-123.0, -122.5])):
            data.createDimension(name, 2)
            axis = data.createVariable(name, "f8", (name,))
            axis[:] = values
            axis.units = "degrees"
        for name in ("u", "v"):
            flow = data.createVariable(name, "f4", ("lat", "lon"))
            flow[:] = np.full((2, 2), 0.1)
            flow.units = "m s-1"
    source = f"model:current_grid?file={file}&latitude=47.2&longitude=-122.8"
    boat = uuv.System("boat", "0.1").add("hull", "model:bluerov2_heavy").add("current", source)
    with (
        Conductor(boat) as conductor,
        FoxgloveServer(conductor, 0) as server,
        connected(server.port) as client,
    ):
        client.subscribe("/hull/fix")
        fix = client.message("/hull/fix")["data"]
    assert fix["latitude"] == pytest.approx(47.2)
    assert fix["longitude"] == pytest.approx(-122.8)


def test_a_chart_places_the_system_by_its_projection(tmp_path: Path) -> None:
    from uuvsim_cosim.models.worlds.terrain import Terrain, save_terrain

    z: NDArray[np.float32] = np.full((3, 3), 30.0, np.float32)
    file = tmp_path / "chart.npz"
    save_terrain(
        Terrain(z, 100.0, (-100.0, -100.0), crs="EPSG:32610", northing=5.2e6, easting=5e5), file
    )
    sensor = f"model:multibeam?scene={file}"
    plan = flatten(uuv.System("boat", "0.1").add("sonar", sensor))
    place = georeference_of(plan)
    assert place is not None
    [[latitude, longitude]] = place(np.zeros((1, 2)))
    assert longitude == pytest.approx(-123.0)  # the zone's central meridian is at 500 km
    assert latitude == pytest.approx(46.95, abs=0.01)


def test_a_system_without_origin_has_no_fix(survey: tuple[Conductor, FoxgloveServer]) -> None:
    assert not [t for t in survey[1].topics if t.endswith("/fix")]
