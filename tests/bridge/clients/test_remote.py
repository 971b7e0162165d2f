"""Remote components: they step in another process, and are components as any other."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.clients.remote import ComponentServer, serve_component, source
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.bridge.zenoh.session import free_port
from uuvsim_cosim.errors import ComponentFailed, FmuError, InputInvalid, SystemInvalid
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.python.class_file import load
from uuvsim_cosim.orchestrator.running.run import run
from uuvsim_cosim.orchestrator.system.system import System

PARTS = Path(__file__).parents[1] / "parts.py"
ME = Client("me", "local")
Sum: Any = load(f"{PARTS}:Sum")


@pytest.fixture(scope="module")
def served() -> Iterator[ComponentServer]:
    with serve_component(f"{PARTS}:Sum", "sum", port=0) as server:
        yield server


def system(source: str) -> System:
    return System("sums", "0.1").add("sum", source).add("twice", f"{PARTS}:Twice").connect(
        "sum.s", "twice.x"
    )  # fmt: skip


def test_a_remote_component_gives_what_a_local_one_gives_bit_for_bit(
    served: ComponentServer,
) -> None:
    given = []
    for text in (served.source, f"{PARTS}:Sum"):
        with Conductor(system(text)) as service:
            service.set(ME, {"sum.a": 0.1, "sum.b": 0.7, "sum.k": 1.3})
            given.append(service.run(ME, until=2.0, record=["sum.s", "sum.both", "twice.y"]))
    assert all((given[0][name] == given[1][name]).all() for name in given[0])


def test_it_runs_in_the_process_that_serves_it(tmp_path: Path) -> None:
    text = (
        "import sys\nfrom uuvsim_cosim.bridge.clients.remote import serve_component\n"
        "server = serve_component(sys.argv[1], 'sum', port=0)\n"
        "print(server.source, flush=True)\nsys.stdin.readline()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", text, f"{PARTS}:Sum"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        assert process.stdout is not None
        service = Conductor(system(process.stdout.readline().strip()))
        assert service.step(ME, 3, {"sum.a": 1.0}, ["sum.s"])[1]["sum.s"] == pytest.approx(0.3)
        process.communicate("\n")
        assert process.returncode == 0
        with pytest.raises(ComponentFailed, match=r"no component 'sum' is served at 127\.0\.0\.1"):
            service.step(ME)
        service.close()


def test_a_recorded_run_takes_one(served: ComponentServer, tmp_path: Path) -> None:
    done = run(system(served.source), until=1.0, out=tmp_path / "run")
    assert len(done.signals().time) == 11


def test_reset_begins_with_a_new_object(served: ComponentServer) -> None:
    with Conductor(system(served.source)) as service:
        service.step(ME, 5, {"sum.a": 1.0})
        service.reset(ME)
        assert service.step(ME, 1, {"sum.a": 1.0}, ["sum.s"])[1]["sum.s"] == pytest.approx(0.1)


def test_two_masters_have_objects_of_their_own(served: ComponentServer) -> None:
    with Conductor(system(served.source)) as one, Conductor(system(served.source)) as other:
        one.step(ME, 5, {"sum.a": 1.0})
        assert other.step(ME, 5, {"sum.a": 3.0}, ["sum.s"])[1]["sum.s"] == pytest.approx(1.5)


def test_a_remote_component_goes_back_to_a_snapshot(served: ComponentServer) -> None:
    names = ["sum.s", "sum.both", "twice.y"]
    with Conductor(system(served.source)) as service:
        service.step(ME, 3, {"sum.a": 0.4, "sum.k": 1.5})
        kept, before = service.snapshot(ME), service.get(ME, names)
        first = service.step(ME, 4, {"sum.b": 2.0}, names)[1]
        service.restore(ME, kept)
        assert service.get(ME, names)["sum.s"] == before["sum.s"]
        again = service.step(ME, 4, {"sum.b": 2.0}, names)[1]
        assert first["sum.both"].tolist() == again["sum.both"].tolist()
        assert (first["sum.s"], first["twice.y"]) == (again["sum.s"], again["twice.y"])
        assert service.describe()["components"][0]["can_snapshot"]


def test_its_state_is_kept_in_a_file_as_any_other(served: ComponentServer, tmp_path: Path) -> None:
    plan = flatten(system(served.source), 0)
    with Master(plan, prepare(plan, "native")) as master:
        master.initialize()
        master.set("sum", "a", 0.4)
        master.step(3)
        master.save_snapshot(tmp_path / "state")
        master.step(2)
        after = master.get("sum", "s")
        master.load_snapshot(tmp_path / "state")
        master.step(2)
        assert master.get("sum", "s") == after


def test_a_remote_component_that_cannot_copy_its_state_is_refused_by_name() -> None:
    class Locked(Sum):
        def __init__(self) -> None:
            super().__init__()
            self.lock = threading.Lock()

    with (
        serve_component(Locked, "locked", port=0) as server,
        Conductor(system(server.source)) as service,
    ):
        with pytest.raises(FmuError, match=r"sum: Locked, which is remote, cannot copy its state"):
            service.snapshot(ME)
        assert not service.describe()["components"][0]["can_snapshot"]
        service.step(ME, 2)
        assert service.reset(ME).tick == 0


def test_a_failure_there_names_the_component_here() -> None:
    with (
        serve_component(f"{PARTS}:Fails", "sum", port=0) as server,
        Conductor(system(server.source)) as service,
        pytest.raises(ComponentFailed, match=r"parts\.py:\d+: ValueError: the well is dry"),
    ):
        service.step(ME, 10)


def test_one_that_does_not_answer_in_time_is_a_failure() -> None:
    over = threading.Event()

    class Stuck:
        inputs = {"a": "m"}  # noqa: RUF012
        outputs = {"s": "m"}  # noqa: RUF012

        def step(self, t: float, dt: float, u: object) -> dict[str, float]:
            over.wait(60.0)
            return {"s": 0.0}

    with serve_component(Stuck, "stuck", port=0) as server:
        text = f"{server.source}?timeout=2"
        service = Conductor(System("one", "0.1").add("one", text))
        try:
            with pytest.raises(ComponentFailed, match=r"did not answer within 2 s"):
                service.step(ME)
        finally:
            over.set()
            service.close()


def test_an_unknown_name_is_refused_with_those_that_are_served(served: ComponentServer) -> None:
    with pytest.raises(SystemInvalid, match=r"no component 'smu' is served .* expected .* sum"):
        system(served.source.replace("sum@", "smu@"))


def test_nobody_there_is_said_in_words() -> None:
    with pytest.raises(SystemInvalid, match=r"no server answers at .* expected serve_component"):
        system(f"remote:sum@127.0.0.1:{free_port('127.0.0.1')}")


def test_a_port_in_use_is_said_to_be(served: ComponentServer) -> None:
    with pytest.raises(InputInvalid, match="in use"):
        serve_component(f"{PARTS}:Sum", port=served.port)


@pytest.mark.parametrize("text", ["remote:", "remote:a b", "remote:a@h:p", "remote:a?timeout=x"])
def test_a_source_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(InputInvalid, match="expected remote:NAME"):
        source(text, Path())


@pytest.mark.parametrize(
    "text", ["remote:a@[::1]:7000?timeout=2.5", "remote:a@127.0.0.1:7480?timeout=10"]
)
def test_the_text_of_a_source_is_the_source(text: str) -> None:
    assert source(text, Path()).text == text


def test_one_whose_server_has_ended_is_told_what_is_to_run() -> None:
    server = serve_component(f"{PARTS}:Sum", "sum", port=0)
    with Conductor(system(server.source)) as service:
        service.step(ME)
        server.close()
        with pytest.raises(ComponentFailed, match=r"expected serve_component\(…, 'sum'\) to run"):
            service.step(ME)
