"""The scene of a running system, as Foxglove gets it: in ENU and FLU, once and when it moves."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from foxglove import messages as sdk
from google.protobuf import json_format

import uuvsim_cosim as uuv
from tests.bridge.foxglove.client import connected, decoder
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.foxglove.channels import Output
from uuvsim_cosim.bridge.foxglove.server import FoxgloveServer
from uuvsim_cosim.bridge.ros2.rows import Block, Layout
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.orchestrator.master.observer import Column
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.view.scene3d.foxglove_live import drawing

ME = Client("me", "local")


def drawn(system: str) -> tuple[Plan, Layout, dict[str, Output]]:
    plan = flatten(uuv.load(system))
    columns = [
        column
        for c in plan.components
        for v in c.description.of("output")
        for column in Column.of(c.path, v)
    ]
    return plan, Layout(columns, plan.tick), {o.topic: o for o in drawing(plan)}


def row(layout: Layout, time: float, **values: Any) -> Block:
    """Return a row of zeros, except for some signals, whose names have __ for a dot."""
    zeros: dict[str, object] = {name: np.zeros(at.size) for name, at in layout.places.items()}
    texts: dict[str, object] = {name: [""] * at.size for name, at in layout.texts.items()}
    given = {name.replace("__", "."): value for name, value in values.items()}
    return layout.row(time, {**zeros, **texts, **given})


def whole(output: Output, block: Block) -> list[Any]:
    return [json.loads(data) for _, data in output.whole(block)]


def entities(messages: list[Any]) -> dict[str, Any]:
    return {e["id"]: e for m in messages for e in m["entities"]}


@pytest.mark.parametrize(
    "system", ["bluerov2_survey", "seabed_mapping", "pool_tracking", "target_tracking"]
)
def test_messages_are_those_of_foxgloves_own_schemas(system: str) -> None:
    _, layout, outputs = drawn(system)
    block = row(layout, 0.5)
    for output in outputs.values():
        schema = getattr(sdk, output.form.name.removeprefix("foxglove.")).get_schema()
        type_ = decoder(schema.name, schema.data)
        for message in whole(output, block):
            json_format.ParseDict(_canonical(message), type_())  # no field is unknown


def _canonical(value: Any) -> Any:
    """Return a message with times and durations as Protobuf's JSON has them."""
    if isinstance(value, dict):
        return {
            k: f"1970-01-01T00:00:{v['sec']:02d}Z" if k == "timestamp"
            else f"{v['sec']}s" if k == "lifetime"
            else _canonical(v)
            for k, v in value.items()
        }  # fmt: skip
    return [_canonical(v) for v in value] if isinstance(value, list) else value


def test_a_hull_is_drawn_in_the_frame_of_its_transform() -> None:
    with (
        Conductor("bluerov2_survey") as conductor,
        FoxgloveServer(conductor, 0, drawing=drawing) as server,
        connected(server.port) as client,
    ):
        client.subscribe("/scene", "/tf")
        scene = client.message("/scene")["data"]
        frames = client.message(
            "/tf", lambda m: m["data"]["transforms"][0]["parent_frame_id"] == "map"
        )["data"]["transforms"]
    hull = entities([scene])["hull hull"]
    assert hull["frame_id"] == frames[0]["child_frame_id"] == "base_link"
    assert hull["frame_locked"]


def test_waypoints_are_enu() -> None:
    plan, layout, outputs = drawn("bluerov2_survey")
    from uuvsim_cosim.orchestrator.running.mission import path_of

    path = path_of(plan)
    assert path is not None
    [line] = entities(whole(outputs["/scene"], row(layout, 0.0)))["waypoints"]["lines"]
    north, east, down = path[-1]
    assert line["points"][-1] == pytest.approx({"x": east, "y": north, "z": -down}, abs=1e-5)


def test_an_echo_of_a_beam_straight_down_lies_below_the_hull() -> None:
    _, layout, outputs = drawn("bluerov2_survey")
    eta = [3.0, 4.0, 5.0, 0.0, 0.0, 0.0]
    block = row(layout, 1.0, hull__eta=eta, hull__q=[1, 0, 0, 0], dvl__range=[2.0] * 4,
                dvl__beam_valid=[1] * 4, dvl__valid=1)  # fmt: skip
    [cloud] = whole(outputs["/echoes"], block)
    import base64

    points = np.frombuffer(base64.b64decode(cloud["data"]), "<f4").reshape(-1, 3)
    assert cloud["frame_id"] == "map"
    assert len(points) == 4
    mean = points.mean(axis=0)  # four beams around the vertical
    assert mean[:2] == pytest.approx([4.0, 3.0], abs=0.3)
    assert -5.0 - 2.2 < mean[2] < -5.0 - 1.0


def test_a_track_joins_the_places_so_far_and_begins_again_when_time_goes_back() -> None:
    _, layout, outputs = drawn("bluerov2_survey")
    track = outputs["/track"]
    for k in range(4):
        list(track.messages(row(layout, float(k), hull__eta=[k, 0.0, 1.0, 0.0, 0.0, 0.0])))
    last = row(layout, 4.0, hull__eta=[4.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    [line] = entities(whole(track, last))["hull track"]["lines"]
    assert [p["y"] for p in line["points"]] == [0.0, 1.0, 2.0, 3.0, 4.0]
    [line] = entities(whole(track, row(layout, 0.0)))["hull track"]["lines"]
    assert len(line["points"]) == 1


def test_the_greatest_thrust_so_far_has_the_longest_arrow() -> None:
    _, layout, outputs = drawn("bluerov2_survey")

    def length(thrust: float) -> float:
        block = row(layout, 1.0, thruster_1__thrust=thrust)
        [lines] = entities(whole(outputs["/moving"], block))["hull thrust"]["lines"]
        a, b = (np.array([p[k] for k in "xyz"]) for p in lines["points"][:2])
        return float(np.linalg.norm(b - a))

    assert length(40.0) > 0.1
    assert length(20.0) == pytest.approx(0.5 * length(40.0), abs=1e-4)


def test_values_that_are_not_finite_leave_their_part_out() -> None:
    _, layout, outputs = drawn("bluerov2_survey")
    nan = {n.replace(".", "__"): np.full(at.size, np.nan) for n, at in layout.places.items()}
    for output in outputs.values():
        for message in whole(output, row(layout, 1.0, **nan)):
            assert "NaN" not in json.dumps(message)
