"""Services and parameters of a node: an independent Zenoh session asks as rmw_zenoh does."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest
import zenoh

from tests.bridge.ros2.ros_side import GID, STORE, Said, call, dds, made, ros, tokens
from tests.bridge.waiting import PATIENCE
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.ros2.interfaces import add_service, with_services
from uuvsim_cosim.bridge.ros2.node import Ros2Node
from uuvsim_cosim.bridge.ros2.topic_writer import DISTRIBUTIONS, typestore
from uuvsim_cosim.bridge.server.conductor import Conductor

ME = Client("me", "local")
TRIGGER = "std_srvs/srv/Trigger"
STEP = "simulation_interfaces/srv/StepSimulation"
RCL = "rcl_interfaces/srv/"
MSG = "rcl_interfaces/msg/"


class Opened(NamedTuple):
    conductor: Conductor
    node: Ros2Node
    peer: zenoh.Session
    said: Said

    def ask(self, name: str, type_: str, **fields: Any) -> Any:
        """Return the response of a service of the node."""
        request = made(f"{type_}_Request", **fields) if fields else None
        return call(self.peer, f"/bluerov2_hold/{name}", type_, request)[0]

    def set(self, name: str, type_: int, **fields: Any) -> Any:
        """Return the result of setting one parameter."""
        value = made(f"{MSG}ParameterValue", type=type_, **fields)
        parameter = made(f"{MSG}Parameter", name=name, value=value)
        return self.ask("set_parameters", f"{RCL}SetParameters", parameters=[parameter]).results[0]


@pytest.fixture(scope="module")
def opened() -> Iterator[Opened]:
    said = Said()
    with (
        Conductor("bluerov2_hold") as conductor,
        Ros2Node(conductor, domain=0, port=0, factor=20.0,
                 report=said) as node,
        ros(node.port) as peer,
    ):  # fmt: skip
        yield Opened(conductor, node, peer, said)


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_the_hash_of_a_service_is_that_of_ros(distribution: str) -> None:
    store = with_services(typestore(distribution))
    add_service(store, "example_interfaces/srv/AddTwoInts", "int64 a\nint64 b\n", "int64 sum\n")
    assert store.hash_rihs01("example_interfaces/srv/AddTwoInts") == (
        "RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a"
    )
    assert store.hash_rihs01(TRIGGER) == (
        "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f"
    )


def test_a_service_has_a_token(opened: Opened) -> None:
    [reset] = [t for t in tokens(opened.peer) if "%reset" in t]
    hash_ = STORE.hash_rihs01(TRIGGER)
    assert reset.split("/")[5:] == ["SS", "%", "%", "bluerov2_hold", "%bluerov2_hold%reset",
                                    "std_srvs::srv::dds_::Trigger_", hash_,
                                    "::,10:,:,:,,"]  # fmt: skip
    assert len([t for t in tokens(opened.peer) if "/SS/" in t]) == len(opened.node.services) == 11


def test_a_reply_carries_the_number_and_client_of_its_request(opened: Opened) -> None:
    _, attached = call(opened.peer, "/bluerov2_hold/pause", TRIGGER, number=77)
    number, time, length = struct.unpack_from("<qqB", attached)
    assert (number, length, attached[17:]) == (77, 16, GID)
    assert time > 1.7e18


def test_steps_pause_resume_and_reset_are_calls_of_the_co_simulation(opened: Opened) -> None:
    assert opened.ask("reset", TRIGGER).message == "is paused at t = 0 s"
    assert opened.ask("step", TRIGGER).success
    assert opened.conductor.moment().time == pytest.approx(0.01)
    result = opened.ask("step_simulation", STEP, steps=9).result
    assert (result.result, result.error_message) == (1, "")
    assert opened.conductor.moment().time == pytest.approx(0.1)
    assert opened.ask("resume", TRIGGER).success
    assert opened.conductor.describe()["real_time_factor"] == 20.0
    refused = opened.ask("step", TRIGGER)
    assert not refused.success
    assert "the co-simulation runs; expected pause first" in refused.message
    assert opened.ask("pause", TRIGGER).message.startswith("is paused at t = ")
    assert not opened.conductor.moment().running
    opened.ask("reset", TRIGGER)
    assert opened.conductor.moment().time == 0.0


def test_no_steps_are_refused_with_a_reason(opened: Opened) -> None:
    result = opened.ask("step_simulation", STEP, steps=0).result
    assert (result.result, result.error_message) == (
        4, "step: n 0 was read; expected a whole number of steps from 1",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("payload", "attachment", "words"),
    [
        (b"\x00\x01\x00\x00\x00", b"", "a request with an attachment of 0 bytes; expected 33"),
        (b"\x00\x01", struct.pack("<qqB", 1, 1, 16) + GID,
         "2 bytes that are no std_srvs/srv/Trigger_Request"),
    ],
)  # fmt: skip
def test_a_request_that_cannot_be_read_is_refused_and_reported_once(
    opened: Opened, payload: bytes, attachment: bytes, words: str
) -> None:
    before = len(opened.said.texts)
    for _ in range(2):
        [reply] = opened.peer.get(
            f"0/bluerov2_hold/reset/{dds(TRIGGER)}/{STORE.hash_rihs01(TRIGGER)}",
            payload=payload, attachment=attachment, timeout=PATIENCE,
        )  # fmt: skip
        assert reply.err is not None
        assert words in reply.err.payload.to_string()
    [text] = opened.said.texts[before:]
    assert text.startswith(f"/bluerov2_hold/reset: {words}")


# ---- parameters -------------------------------------------------------------------------------


def test_parameters_are_listed_below_a_prefix(opened: Opened) -> None:
    every = opened.ask("list_parameters", f"{RCL}ListParameters").result
    expected = {i.name for i in opened.conductor.schema() if i.causality == "parameter"}
    assert set(every.names) == expected
    assert {"guidance", "controller", "hull"} <= set(every.prefixes)
    below = opened.ask("list_parameters", f"{RCL}ListParameters", prefixes=["guidance"]).result
    assert "guidance.speed" in below.names
    assert {n.split(".")[0] for n in below.names} == {"guidance"}
    top = opened.ask("list_parameters", f"{RCL}ListParameters", depth=1).result
    assert list(top.names) == []


def test_parameters_have_types_and_values(opened: Opened) -> None:
    names = ["guidance.speed", "guidance.count", "controller.Kp", "guidance.waypoints", "nothing"]
    types = opened.ask("get_parameter_types", f"{RCL}GetParameterTypes", names=names).types
    assert types.tolist() == [3, 2, 8, 8, 0]
    values = opened.ask("get_parameters", f"{RCL}GetParameters", names=names).values
    held = opened.conductor.get(ME, names[:4])
    assert values[0].double_value == held["guidance.speed"]
    assert values[1].integer_value == held["guidance.count"]
    assert values[2].double_array_value.tolist() == held["controller.Kp"].tolist()
    assert values[3].double_array_value.tolist() == held["guidance.waypoints"].ravel().tolist()
    assert [v.type for v in values] == types.tolist()


def test_a_description_has_unit_and_shape(opened: Opened) -> None:
    names = ["guidance.waypoints", "guidance.speed", "nothing"]
    many, one, none = opened.ask(
        "describe_parameters", f"{RCL}DescribeParameters", names=names
    ).descriptors
    assert many.additional_constraints == "32 x 3 elements, row by row; unit m"
    assert (one.type, one.additional_constraints, one.read_only) == (3, "unit m/s", False)
    assert one.description == "along the legs"
    assert (none.name, none.type) == ("nothing", 0)


def test_a_parameter_is_set_for_the_next_step(opened: Opened) -> None:
    assert opened.set("guidance.speed", 3, double_value=0.25).successful
    assert opened.conductor.get(ME, ["guidance.speed"])["guidance.speed"] == 0.25
    assert opened.set("guidance.speed", 2, integer_value=1).successful  # an integer is a number
    kp = opened.conductor.get(ME, ["controller.Kp"])["controller.Kp"] * 2.0
    assert opened.set("controller.Kp", 8, double_array_value=kp).successful
    assert opened.conductor.get(ME, ["controller.Kp"])["controller.Kp"].tolist() == kp.tolist()


@pytest.mark.parametrize(
    ("name", "type_", "fields", "words"),
    [
        ("guidance.sped", 3, {"double_value": 1.0},
         "no parameter 'guidance.sped'; expected one such as guidance.speed"),
        ("guidance.speed", 4, {"string_value": "1"}, "type string; expected type double"),
        ("controller.Kp", 8, {"double_array_value": np.ones(5)}, "5 elements; expected 6"),
        ("guidance.speed", 3, {"double_value": np.nan}, "guidance.speed: "),
        ("hull.eta", 8, {"double_array_value": np.ones(6)}, "no parameter 'hull.eta'"),
    ],
)  # fmt: skip
def test_a_value_that_does_not_fit_is_refused_with_the_reason(
    opened: Opened, name: str, type_: int, fields: dict[str, Any], words: str
) -> None:
    result = opened.set(name, type_, **fields)
    assert not result.successful
    assert words in result.reason


def test_a_fixed_parameter_is_read_only() -> None:
    with (
        Conductor("bluerov2_survey") as conductor,
        Ros2Node(conductor, domain=0, port=0) as node,
        ros(node.port) as peer,
    ):
        fixed = next(
            i.name for i in conductor.schema() if i.causality == "parameter" and not i.settable
        )
        request = made(f"{RCL}DescribeParameters_Request", names=[fixed])
        name = "/bluerov2_survey/describe_parameters"
        response, _ = call(peer, name, f"{RCL}DescribeParameters", request)
        assert response.descriptors[0].read_only


def test_set_atomically_sets_all_or_none(opened: Opened) -> None:
    opened.set("guidance.speed", 3, double_value=0.5)
    parameters = [
        made(f"{MSG}Parameter", name=name,
             value=made(f"{MSG}ParameterValue", type=3, double_value=0.3))
        for name in ("guidance.speed", "guidance.none")
    ]  # fmt: skip
    ask = ("set_parameters_atomically", f"{RCL}SetParametersAtomically")
    assert not opened.ask(*ask, parameters=parameters).result.successful
    assert opened.conductor.get(ME, ["guidance.speed"])["guidance.speed"] == 0.5
    assert opened.ask(*ask, parameters=parameters[:1]).result.successful
    assert opened.conductor.get(ME, ["guidance.speed"])["guidance.speed"] == 0.3
