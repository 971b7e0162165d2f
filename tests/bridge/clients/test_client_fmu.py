"""The client FMU is the running co-simulation: its bits, its refusals, and its end, in words."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import uuvsim_cosim as uuv
from tests.fmus.by_wine import NEEDS_WINE, stepped
from uuvsim_cosim.bridge.access.token import known_token, token_file
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.clients.client_fmu import build_client_fmu
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.bridge.tcp.server import TcpServer
from uuvsim_cosim.cli import status_of
from uuvsim_cosim.errors import ComponentFailed, FmuError, InputInvalid, UuvsimError
from uuvsim_cosim.fmus.check.check_fmu import examine
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.importer.read_description import read_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu

PARTS = Path(__file__).parents[1] / "parts.py"
TICK = 0.01
ME = Client("me", "local")


def system(part: str = "Sum") -> uuv.System:
    """Return a sum with two free inputs and a tunable parameter, and a noisy component."""
    return (
        uuv.System("sums", "0.01")
        .add("sum", f"{PARTS}:{part}")
        .add("current", "model:current_gauss_markov")
    )


@pytest.fixture
def served() -> Iterator[tuple[Conductor, TcpServer]]:
    with Conductor(system()) as service, TcpServer(service, 0) as endpoint:
        yield service, endpoint


@pytest.fixture(scope="module")
def built() -> Callable[[int], Path]:
    return lambda fmi: build_client_fmu(system(), fmi=fmi)  # type: ignore[arg-type]


class Run:
    """An instance, by names."""

    def __init__(self, path: Path, **settings: Any) -> None:
        fmu = read_fmu(path)
        self.variables = fmu.description.variables
        self.x: Component = instantiate_fmu(fmu, "it")
        self.set(**settings)

    def set(self, **values: Any) -> None:
        for name, value in values.items():
            self.x.set(self.variables[name], value)

    def get(self, name: str) -> Any:
        return self.x.get(self.variables[name])

    def start(self, **values: Any) -> Run:
        self.set(**values)
        self.x.enter_initialization_mode(0.0, None)
        self.x.exit_initialization_mode()
        return self

    def step(self, k: int, n: int = 1) -> None:
        self.x.do_step(k * TICK, n * TICK)


@pytest.fixture(params=[2, 3])
def run(
    built: Callable[[int], Path],
    served: tuple[Conductor, TcpServer],
    request: pytest.FixtureRequest,
) -> Iterator[Run]:
    made = Run(built(request.param), port=served[1].port)
    yield made
    made.x.free()


def values(service: Conductor, *names: str) -> Mapping[str, Any]:
    return service.get(ME, names)


def test_its_steps_are_those_of_the_co_simulation(
    run: Run, served: tuple[Conductor, TcpServer]
) -> None:
    service, _ = served
    run.start(sum_a=1.0, seed=3)
    assert run.get("sum_s") == 0.0
    for k in range(10):
        run.set(sum_b=0.5 * k)
        run.step(k)
        there = values(service, "sum.s", "sum.both", "current.v_c")
        assert run.get("sum_s") == there["sum.s"]
        assert run.get("sum_both").tolist() == there["sum.both"].tolist() == [1.0, 0.5 * k]
        assert run.get("current_v_c").tobytes() == there["current.v_c"].tobytes()
    run.set(sum_k=0.0, current_speed=0.9)  # tunable
    before = run.get("sum_s")
    run.step(10, 5)
    assert run.get("sum_s") == before
    assert values(service, "current.speed")["current.speed"] == 0.9
    assert service.moment().tick == 15


def test_a_second_run_begins_anew_with_the_same_bits(run: Run) -> None:
    rows = []
    for _ in range(2):
        run.start(seed=5, sum_a=2.0)
        for k in range(20):
            run.step(k)
        rows.append((run.get("sum_s"), run.get("current_v_c").tobytes()))
        run.x.terminate()
        assert run.get("sum_s") == rows[0][0]
        port = run.get("port")
        run.x.reset()
        assert run.get("port") == 7448
        run.set(port=port)
    assert rows[0] == rows[1]


def test_without_restart_it_goes_on_from_where_the_co_simulation_is(
    run: Run, served: tuple[Conductor, TcpServer]
) -> None:
    service, _ = served
    service.set(ME, {"sum.k": 3.0})
    service.step(ME, 7, {"sum.a": 1.0})
    run.start(restart=False, sum_a=1.0)
    assert run.get("sum_s") == pytest.approx(0.21)
    run.step(0)
    assert run.get("sum_s") == pytest.approx(0.24)
    assert service.moment().tick == 8


def test_without_restart_tunable_parameters_that_were_set_go_to_the_server(
    run: Run, served: tuple[Conductor, TcpServer]
) -> None:
    service, _ = served
    service.step(ME, 7, {"sum.a": 1.0})
    run.start(restart=False, sum_k=5.0)
    assert values(service, "sum.k", "sum.s") == {"sum.k": 5.0, "sum.s": pytest.approx(0.07)}
    assert service.moment().tick == 7


def test_one_that_streams_is_paused_and_held(run: Run, served: tuple[Conductor, TcpServer]) -> None:
    service, _ = served
    service.run(ME)
    while not service.moment().running:
        pass
    run.start()
    assert (service.moment().tick, service.moment().running) == (0, False)
    with pytest.raises(InputInvalid, match="time is held in lockstep by fmu"):
        service.step(ME)
    run.x.terminate()
    while service.describe()["clients"]:
        pass
    service.step(ME)


def test_initial_outputs_are_read_in_initialization_mode(run: Run) -> None:
    run.x.enter_initialization_mode(0.0, None)
    first = run.get("current_v_c").tolist()
    run.set(current_speed=0.7)
    assert run.get("current_v_c").tolist() != first


def test_settings_that_change_in_initialization_mode_lead_elsewhere(run: Run) -> None:
    run.x.enter_initialization_mode(0.0, None)
    assert run.get("sum_s") == 0.0
    with Conductor(system()) as other, TcpServer(other, 0) as endpoint:
        other.step(ME, 3, {"sum.a": 1.0})
        run.set(port=endpoint.port, restart=False)
        assert run.get("sum_s") == pytest.approx(0.03)
        run.set(host="localhost", restart=True)
        run.x.exit_initialization_mode()
        assert run.get("sum_s") == 0.0
        run.step(0)
        assert other.moment().tick == 1


def test_a_step_that_is_no_whole_multiple_is_refused_with_both_numbers(run: Run) -> None:
    run.start()
    with pytest.raises(ComponentFailed, match=r"0\.025 s.*whole multiple.*0\.01 s"):
        run.x.do_step(0.0, 0.025)
    run.step(0)


def test_nobody_there_is_said_in_words_and_a_reset_helps(
    run: Run, served: tuple[Conductor, TcpServer]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        free = taken.getsockname()[1]
    with pytest.raises(FmuError, match=f"nobody serves a co-simulation at 127.0.0.1, port {free}"):
        run.start(port=free)
    run.x.reset()
    run.start(port=served[1].port).step(0)


def test_what_is_no_co_simulation_is_said_to_be_none(run: Run) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:

        def answer() -> None:
            with other.accept()[0] as client:
                client.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")

        thread = threading.Thread(target=answer)
        thread.start()
        with pytest.raises(FmuError, match="no co-simulation's TCP server"):
            run.start(port=other.getsockname()[1])
        thread.join()


def test_a_server_that_hangs_is_left_after_the_timeout(run: Run) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        greeting = json.dumps({"ok": True, "protocol": 1}).encode()

        def answer() -> None:
            with other.accept()[0] as client:
                client.sendall(len(greeting).to_bytes(4, "little") + bytes(4) + greeting)
                while client.recv(1000):
                    pass

        thread = threading.Thread(target=answer)
        thread.start()
        with pytest.raises(FmuError, match=r"did not answer within 0\.05 s"):
            run.start(port=other.getsockname()[1], timeout=0.05)
        thread.join()


def test_a_server_that_dies_fails_the_step_and_the_last_values_stay(
    built: Callable[[int], Path],
) -> None:
    with Conductor(system()) as service, TcpServer(service, 0) as endpoint:
        run = Run(built(2), port=endpoint.port).start(sum_a=1.0)
        run.step(0)
    with pytest.raises(ComponentFailed, match="has gone; expected `uuvsim serve` to go on"):
        run.step(1)
    assert run.get("sum_s") == 0.01
    run.x.free()


@pytest.mark.parametrize(
    ("other", "words"),
    [
        (uuv.System("others", "0.02").add("sum", f"{PARTS}:Sum"), r"0\.02 s; expected 0\.01 s"),
        (uuv.System("others", "0.01").add("sum", f"{PARTS}:Sum"), "current.*does not exist"),
        (
            uuv.System("others", "0.01")
            .add("sum", f"{PARTS}:Sum")
            .add("current", f"{PARTS}:Current"),
            r"current\.\w+ has another type or shape",
        ),
    ],
)
def test_another_system_is_refused(
    built: Callable[[int], Path], other: uuv.System, words: str
) -> None:
    with Conductor(other) as service, TcpServer(service, 0) as endpoint:
        run = Run(built(3), port=endpoint.port)
        with pytest.raises(FmuError, match=words):
            run.start()
        run.x.free()


def test_other_units_are_found_by_the_hash(built: Callable[[int], Path]) -> None:
    with Conductor(system("Feet")) as service, TcpServer(service, 0) as endpoint:
        run = Run(built(2), port=endpoint.port)
        with pytest.raises(FmuError, match="units of signals differ"):
            run.start()
        run.x.free()


def test_a_login_is_asked_for_and_given(built: Callable[[int], Path]) -> None:
    def admit(user: str | None, password: str | None, *_: object) -> frozenset[str]:
        if (user, password) != ("ann", 'say "\\please"'):
            raise InputInvalid(f"user {user!r} may not enter; expected user and password")
        return frozenset({"read", "set", "step"})

    with Conductor(system()) as service, TcpServer(service, 0, admit=admit) as endpoint:
        run = Run(built(3), port=endpoint.port)
        with pytest.raises(FmuError, match="user None may not enter"):
            run.start()
        run.x.reset()
        run.start(port=endpoint.port, user="ann", password='say "\\please"').step(0)
        run.x.free()


def test_the_token_of_the_user_is_found_and_no_other_is_shown(
    built: Callable[[int], Path], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with Conductor(system()) as service, TcpServer(service, 0) as endpoint:
        file = token_file(endpoint.port)
        run = Run(built(2), port=endpoint.port).start()
        for spoil in (
            lambda: file.chmod(0o640),
            lambda: monkeypatch.setenv("UUVSIM_TOKENS", str(tmp_path)),
            lambda: (file.rename(tmp_path / "kept"), file.symlink_to(tmp_path / "kept")),
        ):
            kept = known_token("127.0.0.1", endpoint.port)
            spoil()
            run.x.reset()
            with pytest.raises(FmuError, match=r"this co-simulation requires a token\. Programs"):
                run.start(port=endpoint.port)
            monkeypatch.undo()
            file.unlink()
            file.write_text(f"{kept}\n")
            file.chmod(0o600)
        run.x.reset()
        run.start(port=endpoint.port, host="localhost").step(0)
        monkeypatch.setenv("UUVSIM_TOKENS", str(tmp_path))
        monkeypatch.setenv("UUVSIM_TOKEN", str(kept))
        run.x.reset()
        run.start(port=endpoint.port).step(0)
        run.x.free()


def test_what_fails_there_is_said_here(built: Callable[[int], Path]) -> None:
    with Conductor(system("Fails")) as service, TcpServer(service, 0) as endpoint:
        run = Run(built(2), port=endpoint.port).start()
        run.step(0, 40)
        with pytest.raises(ComponentFailed, match="the well is dry"):
            run.step(40, 20)
        run.x.reset()
        run.start(port=endpoint.port).step(0)
        run.x.free()


def test_time_moved_by_somebody_else_is_noticed(
    run: Run, served: tuple[Conductor, TcpServer]
) -> None:
    run.start()
    run.step(0)
    served[0].reset(ME)
    with pytest.raises(ComponentFailed, match=r"another client has moved.*point 1; expected 2"):
        run.step(1)


def test_two_of_them_step_together(
    served: tuple[Conductor, TcpServer],
) -> None:
    port = served[1].port
    one = Run(build_client_fmu(system(), inputs=["sum.a"], port=port)).start(sum_a=2.0)
    two = Run(build_client_fmu(system(), inputs=["sum.b"], port=port)).start(restart=False, sum_b=1)
    thread = threading.Thread(target=lambda: [one.step(k) for k in range(5)])
    thread.start()
    two.step(0, 5)
    thread.join()
    assert one.get("sum_s") == two.get("sum_s") == pytest.approx(0.15)
    assert served[0].moment().tick == 5
    for each in (one, two):
        each.x.free()


def test_wrong_values_are_refused_here(run: Run) -> None:
    for settings, words in (
        ({"port": 0}, r"\[1, 65535\]"),
        ({"sum_a": np.nan}, "expected a finite number"),
        ({"host": "x" * 300}, "too long"),
    ):
        with pytest.raises(UuvsimError, match=words):
            run.set(**settings)
    with pytest.raises(FmuError, match=r"host \"no\.such\.host\.invalid\" is unknown"):
        run.start(host="no.such.host.invalid")


def test_the_command_builds_it_and_refuses_in_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["fmu", "client", "bluerov2_hold", "--platform", "host", "-o", str(tmp_path)]
    assert status_of([*command, "--signals", "hull.eta", "--inputs", "", "--host", "pool"]) == 0
    there = read_fmu(tmp_path / "bluerov2_hold_client.fmu").description
    assert [v.name for v in there.of("input", "output")] == ["hull_eta"]
    assert there.variables["host"].start == "pool"
    assert status_of([*command, "--inputs", "hull.tau"]) == 2  # it is connected
    assert (
        "inputs 'hull.tau': no free input; expected one such as hull.v_c" in capsys.readouterr().err
    )
    assert status_of([*command, "--port", "0"]) == 2
    assert "port 0; expected 1 to 65535" in capsys.readouterr().err


@pytest.mark.parametrize("fmi", [2, 3])
def test_nothing_is_wrong_with_it(served: tuple[Conductor, TcpServer], fmi: Any) -> None:
    path = build_client_fmu(system(), fmi=fmi, port=served[1].port)
    looks = {look.check: look for look in examine(path)}
    assert {look.result for look in looks.values()} <= {"ok", "not applicable"}, looks
    assert {"rules", "run", "determinism", "reset"} <= {
        name for name, look in looks.items() if look.result == "ok"
    }


@pytest.mark.parametrize("fmi", [2, 3])
def test_fmpy_runs_it(
    built: Callable[[int], Path], served: tuple[Conductor, TcpServer], fmi: int
) -> None:
    from fmpy import simulate_fmu

    found = simulate_fmu(
        str(built(fmi)),
        stop_time=0.1,
        output_interval=0.01,
        start_values={"port": served[1].port, "sum_a": 2.0, "host": "localhost"},
        output=["sum_s"],
    )
    assert found["sum_s"][-1] == served[0].get(ME, ["sum.s"])["sum.s"] == pytest.approx(0.2)


LIBCOSIM = """
import json, sys
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave

execution = CosimExecution.from_step_size(10_000_000)  # ns
slave = execution.add_local_slave(CosimLocalSlave(fmu_path=sys.argv[1], instance_name="it"))
observer = CosimObserver.create_last_value()
execution.add_observer(observer)
variables = {v.name.decode(): v.reference for v in execution.slave_variables(slave)}
execution.integer_initial_value(slave, variables["port"], int(sys.argv[2]))
execution.real_initial_value(slave, variables["sum_a"], 2.0)
execution.simulate_until(100_000_000)
sys.stderr.write("found " + json.dumps(observer.last_real_values(slave, [variables["sum_s"]])))
"""


def test_libcosim_runs_it(
    built: Callable[[int], Path], served: tuple[Conductor, TcpServer]
) -> None:
    command = [sys.executable, "-c", LIBCOSIM, str(built(2)), str(served[1].port)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    found = float(json.loads(done.stderr.rpartition("found ")[2])[0])
    assert found == served[0].get(ME, ["sum.s"])["sum.s"] == pytest.approx(0.2)


@pytest.mark.slow
@NEEDS_WINE
def test_the_windows_binary_steps_it(tmp_path: Path, served: tuple[Conductor, TcpServer]) -> None:
    import zipfile

    service, endpoint = served
    path = build_client_fmu(system(), fmi=3, platforms=("win64",), port=endpoint.port)
    zipfile.ZipFile(path).extract("binaries/x86_64-windows/sums_client.dll", tmp_path)
    fmu = read_fmu(path)
    a, s = (fmu.description.variables[n].value_references[0] for n in ("sum_a", "sum_s"))
    dll = tmp_path / "binaries/x86_64-windows/sums_client.dll"
    found = stepped(tmp_path, dll, [fmu.description.token, a, 1, s, 1, 20])
    total, expected = 0.0, []
    for k in range(20):
        for _ in range(3):
            total += 1.0 * (0.01 * k + 0.0) * TICK
        expected.append(f"{np.float64(total).view(np.uint64):016x}")
    assert found == expected
    assert service.moment().tick == 60
