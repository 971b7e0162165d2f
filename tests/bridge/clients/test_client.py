"""The Python client: the names of a local master, for one that runs elsewhere."""

from __future__ import annotations

import asyncio
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.bridge.clients.async_client import AsyncConnection, connect_async
from uuvsim_cosim.bridge.clients.client import Connection
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.bridge.zenoh.bridge import Bridge
from uuvsim_cosim.bridge.zenoh.session import Disconnected, free_port, listening
from uuvsim_cosim.errors import ComponentFailed, InputInvalid
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten

PARTS = Path(__file__).parents[1] / "parts.py"


def system(part: str = "Sum") -> uuv.System:
    return uuv.System("sums", "0.1").add("sum", f"{PARTS}:{part}")


@pytest.fixture(scope="module")
def bridge() -> Iterator[Bridge]:
    with uuv.Bridge(system(), port=0) as bridge:
        yield bridge


@pytest.fixture
def client(bridge: Bridge) -> Iterator[Connection]:
    with uuv.connect(port=bridge.port) as client:
        client.reset(start={"sum.a": 0.0, "sum.b": 0.0})
        yield client


def test_get_set_and_step_are_those_of_a_local_one(client: Connection) -> None:
    client.set("sum.a", 1.0)
    client.set({"sum.b": 2.0, "sum.k": 2.0})
    assert client.step(5, outputs=["sum.s"])["sum.s"] == pytest.approx(3.0)
    assert client.get("sum.both").tolist() == [1.0, 2.0]
    assert client.get(["sum.a", "sum.both[2]"]) == {"sum.a": 1.0, "sum.both[2]": 2.0}
    assert (client.tick, client.time, client.moment.running) == (5, 0.5, False)


def test_a_remote_run_is_a_local_run_bit_for_bit(client: Connection) -> None:
    client.set({"sum.a": 0.1, "sum.b": 0.7})
    given = client.run(until=3.0, record=["sum.s", "sum.both"])
    with Conductor(system()) as service:
        from uuvsim_cosim.bridge.calls.service import Client

        me = Client("me", "local")
        service.set(me, {"sum.a": 0.1, "sum.b": 0.7})
        local = service.run(me, until=3.0, record=["sum.s", "sum.both"])
    assert given.keys() == local.keys()
    assert all((given[name] == local[name]).all() for name in given)


def test_snapshots_are_restored_by_name(client: Connection) -> None:
    client.step(3, {"sum.a": 1.0})
    kept = client.snapshot()
    client.step(7)
    assert client.restore(kept).tick == 3
    assert client.get("sum.s") == pytest.approx(0.3)


def test_signals_and_schema_say_what_there_is(client: Connection) -> None:
    assert client.signals == ("sum.a", "sum.b", "sum.s", "sum.both", "sum.k")
    assert {s.name: s.unit for s in client.schema}["sum.s"] == "m"
    assert [c["name"] for c in client.describe()["components"]] == ["Sum"]


def test_a_replacement_has_other_names(bridge: Bridge) -> None:
    with uuv.Bridge(system(), port=0) as own, uuv.connect(port=own.port) as client:
        assert "sum.s" in client.signals
        client.replace("sum", f"{PARTS}:Twice")
        assert client.signals == ("sum.x", "sum.y")
        assert client.step(2, {"sum.x": 3.0}, ["sum.y"]) == {"sum.y": 6.0}


def test_errors_have_the_class_that_they_would_have_here(client: Connection) -> None:
    with pytest.raises(InputInvalid, match=r"no signal 'sum\.z'; expected one such as sum\.s"):
        client.get("sum.z")
    with uuv.Bridge(system("Fails"), port=0) as own, uuv.connect(port=own.port) as failing:
        with pytest.raises(ComponentFailed, match="the well is dry") as failed:
            failing.step(20)
        assert (failed.value.path, failed.value.time) == ("sum", pytest.approx(0.5))


def test_blocks_come_in_order_with_their_time(client: Connection) -> None:
    client.set("sum.a", 1.0)
    with client.subscribe("sum.s") as blocks:
        client.run(factor=10.0)
        taken = [next(blocks) for _ in range(5)]
        client.pause()
    ticks = [block.tick for block in taken]
    assert ticks == sorted(set(ticks))
    for block in taken:
        assert block.time == pytest.approx(0.1 * block.tick)
        assert block["sum.s"] == pytest.approx(block.time)
        assert list(block.values) == ["sum.s"]


def test_a_subscription_to_what_is_no_output_is_refused(client: Connection) -> None:
    with pytest.raises(InputInvalid, match=r"no output 'sum\.t'; expected"):
        client.subscribe("sum.t")


def test_two_in_lockstep_move_time_together(bridge: Bridge, client: Connection) -> None:
    async def both() -> list[dict[str, Any]]:
        from uuvsim_cosim.bridge.clients.async_client import connect_async

        a = await connect_async(port=bridge.port, lockstep=True, lag=60.0)
        b = await connect_async(port=bridge.port, lockstep=True, lag=60.0)
        async with a, b:
            given = []
            for k in range(10):
                steps = (a.step(1, {"sum.a": float(k)}, ["sum.s"]),
                         b.step(1, {"sum.b": 1.0}, ["sum.s"]))  # fmt: skip
                one, other = await asyncio.gather(*steps)
                assert one == other
                given.append(one)
            return given

    given = asyncio.run(both())
    expected = sum((k + 1.0) * 0.1 for k in range(10))
    assert given[-1]["sum.s"] == pytest.approx(expected)


def test_a_client_without_lockstep_cannot_move_time_that_is_held(
    bridge: Bridge, client: Connection
) -> None:
    with (
        uuv.connect(port=bridge.port, name="holder", lockstep=True),
        pytest.raises(InputInvalid, match="held in lockstep by holder"),
    ):
        client.step()
    assert client.step(outputs=["sum.s"]).keys() == {"sum.s"}


_DIES = """
import os, sys
import uuvsim_cosim as uuv
client = uuv.connect(port=int(sys.argv[1]), name="doomed", lockstep=True, lag=600.0)
print("joined", flush=True)
sys.stdin.readline()
os._exit(1)
"""


def test_one_that_dies_inside_a_lockstep_step_does_not_hold_the_others(bridge: Bridge) -> None:
    with (
        subprocess.Popen(
            [sys.executable, "-c", _DIES, str(bridge.port)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        ) as doomed,
        uuv.connect(port=bridge.port, lockstep=True, lag=600.0) as client,
    ):  # fmt: skip
        assert doomed.stdout is not None
        assert doomed.stdout.readline().strip() == "joined"
        from uuvsim_cosim.bridge.calls.service import Client

        me = Client(client.name, "zenoh")
        tick = bridge.conductor.moment().tick
        waiting = bridge.conductor.ask("step", me, 1, None, [])
        assert not waiting.done()
        doomed.communicate("\n")
        assert waiting.result()[0].tick == tick + 1
        names = [c["name"] for c in client.describe()["clients"]]
        assert names == [client.name]


_LEFT_OPEN = """
import sys
import uuvsim_cosim as uuv
client = uuv.connect(port=int(sys.argv[1]))
blocks = client.subscribe("sum.s")
print(client.get("sum.s"))
"""


def test_a_script_ends_though_its_connection_is_open(bridge: Bridge, client: Connection) -> None:
    done = subprocess.run(
        [sys.executable, "-c", _LEFT_OPEN, str(bridge.port)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout.strip(), done.stderr) == (0, "0.0", "")


def test_nobody_there_is_said_in_words() -> None:
    with pytest.raises(Disconnected, match=r"no server answers at .* expected .*uuvsim serve"):
        uuv.connect(port=free_port("127.0.0.1"))


def test_a_port_without_a_co_simulation_is_said_to_be() -> None:
    with listening(0) as other, pytest.raises(InputInvalid, match="0 co-simulations at"):
        uuv.connect(port=other.port)


def test_an_unknown_system_is_refused_with_the_one_there_is(bridge: Bridge) -> None:
    with pytest.raises(InputInvalid, match=r"no co-simulation 'sms' .* sums"):
        uuv.connect("sms", port=bridge.port)


def test_one_whose_co_simulation_ends_is_told_and_its_blocks_end() -> None:
    with uuv.Bridge(system(), port=0) as own:
        client = uuv.connect(port=own.port)
        blocks = client.subscribe("sum.s")
    assert list(blocks) == []
    with pytest.raises(Disconnected, match="'sums' has ended"):
        client.step()
    client.close()


def test_a_closed_connection_says_so(bridge: Bridge) -> None:
    client = uuv.connect(port=bridge.port)
    client.close()
    client.close()
    with pytest.raises(Disconnected, match="closed"):
        client.step()


def test_one_name_is_as_good_as_a_list_of_one(client: Connection) -> None:
    assert list(client.step(1, outputs="sum.s")) == ["sum.s"]
    assert list(client.run(until=0.3, record="sum.s")) == ["time", "sum.s"]


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda c: c.get(5), "5 was read; expected names"),
        (lambda c: c.step(1, ["sum.a"]), "expected values by name"),
        (lambda c: c.step(1, {}, {"sum.s": 1}), "expected names"),
        (lambda c: c.set("sum.a", object()), "cannot be sent"),
        (lambda c: c.set("sum.a", 1j), "cannot be sent"),
        (lambda c: c.restore(object()), "cannot be sent"),
    ],
)
def test_what_cannot_be_meant_is_refused_in_words(
    client: Connection, wrong: Any, words: str
) -> None:
    with pytest.raises(InputInvalid, match=words):
        wrong(client)
    assert client.step(1) == {}


@pytest.mark.parametrize("port", ["7470", 0, 70000, True])
def test_a_port_that_is_none_is_refused(port: Any) -> None:
    with pytest.raises(InputInvalid, match="expected a whole number"):
        uuv.connect(port=port)


def test_the_awaited_client_has_the_names_of_the_other(bridge: Bridge) -> None:
    public = {name for name in dir(Connection) if not name.startswith("_")}
    assert public <= set(dir(AsyncConnection))

    async def used() -> tuple[Any, ...]:
        async with await connect_async(port=bridge.port, name="awaited") as s:
            await s.reset()
            await s.set("sum.a", 2.0)
            await s.step(3)
            return s.tick, s.time, s.system, s.name, "sum.s" in await s.signals()

    assert asyncio.run(used()) == (3, pytest.approx(0.3), "sums", "awaited", True)


def test_a_bridge_serves_a_master_that_has_not_begun() -> None:
    plan = flatten(system(), 0)
    master = Master(plan, prepare(plan, "native"))
    with uuv.Bridge(master, port=0) as own, uuv.connect(port=own.port) as client:
        assert client.step(3, {"sum.a": 2.0}, ["sum.s"])["sum.s"] == pytest.approx(0.6)
        assert client.time == pytest.approx(0.3)


def test_a_master_that_has_begun_is_refused_in_words() -> None:
    plan = flatten(system(), 0)
    master = Master(plan, prepare(plan, "native"))
    try:
        master.initialize()
        with pytest.raises(InputInvalid, match="expected before initialize"):
            uuv.Bridge(master, port=0)
    finally:
        master.free()
