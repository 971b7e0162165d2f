"""`uuvsim serve`: a system runs, and clients elsewhere read, set and step it."""

from __future__ import annotations

import errno
import signal
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from types import FrameType
from typing import Annotated, Any

import typer

from uuvsim_cosim.commands.options import assignments
from uuvsim_cosim.commands.run import MAP, SET
from uuvsim_cosim.commands.terminal import line, tilde
from uuvsim_cosim.errors import InputInvalid

__all__ = ["serve_command"]

_LOOK = 0.1  # [s] between two looks whether the end has come


def serve_command(
    system: Annotated[str, typer.Argument(help="System, .ssd, .ssp, .fmu; or a recording.")],
    real_time: Annotated[
        float, typer.Option(help="Factor of real time at which it streams.")
    ] = 1.0,
    paused: Annotated[
        bool, typer.Option("--paused", help="Wait for clients to run or step it.")
    ] = False,
    until: Annotated[float | None, typer.Option(help="End at this simulated time in s.")] = None,
    port: Annotated[int | None, typer.Option(help="Zenoh's port (7470); 0 for any.")] = None,
    tcp_port: Annotated[
        int | None, typer.Option(help="Port for MATLAB and Octave; 0 for any, -1 for none.")
    ] = None,
    http_port: Annotated[
        int | None, typer.Option(help="Port for browsers and curl; 0 for any, -1 for none.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder of the recording.")
    ] = None,
    no_record: Annotated[bool, typer.Option("--no-record", help="Record nothing.")] = False,
    seed: Annotated[int, typer.Option(help="Seed of all random numbers.")] = 0,
    replace: Annotated[
        list[str] | None, typer.Option(help="component=source: .fmu, FILE.py:Class, keyboard")
    ] = None,
    map_: Annotated[
        list[str] | None, typer.Option("--map", help=f"{MAP}, or component=FILE.ssm.")
    ] = None,
    rate: Annotated[
        list[str] | None, typer.Option(help="component=seconds: communication step.")
    ] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help=f"{SET}; again for more.")] = None,
    fmu: Annotated[bool, typer.Option("--fmu", help="Run models as FMUs, as `run` does.")] = False,
    fail_safe: Annotated[
        str, typer.Option(help="A client late or gone in lockstep: drop, pause or go-on.")
    ] = "drop",
    access: Annotated[
        Path | None, typer.Option(help="YAML that says who may do what: see docs/security.md.")
    ] = None,
    host: Annotated[
        list[str] | None, typer.Option(help="Address to listen at; again for more. 0.0.0.0: all.")
    ] = None,
    anyone: Annotated[
        bool, typer.Option("--anyone", help="Beyond this machine without --access.")
    ] = False,
) -> None:
    """Serve a running system to clients on this machine, until Ctrl-C.

    Python: uuvsim_cosim.connect(). MATLAB and Octave: uuvsim.connect(). Nobody else can reach it,
    unless --host or --access say so.
    """
    from uuvsim_cosim.bridge.access_doors import opening
    from uuvsim_cosim.bridge.conductor import Conductor
    from uuvsim_cosim.bridge.keyboard import with_keyboards
    from uuvsim_cosim.bridge.replay import is_recording
    from uuvsim_cosim.commands.run import _edited

    if until is not None and not 0.0 < until < float("inf"):
        raise InputInvalid(f"--until {until:g}: expected more than 0 seconds")
    if not 0.0 < real_time < float("inf"):
        raise InputInvalid(f"--real-time {real_time:g}: expected a factor of more than 0")
    doors = opening(access, host or (), anyone=anyone)
    _check_ports(doors.hosts, port, tcp_port, http_port)
    changes = {
        "replace": assignments("--replace", replace or [], "component=source", dotted=False),
        "map": assignments("--map", map_ or [], MAP, dotted=False),
        "rate": assignments("--rate", rate or [], "component=seconds", dotted=False),
        "set": assignments("--set", set_ or [], SET, dotted=True),
    }
    recorded = is_recording(system)
    if recorded:
        _refuse_changes(system, changes, fmu=fmu, seed=seed, out=out)
    else:
        with_keyboards(system, changes["replace"])
    edited: Any = system if recorded else _edited(system, None, changes)
    folder = None
    if not no_record and not recorded:
        folder = out if out is not None else Path("runs") / f"{edited.name}-{seed}"
    conductor = Conductor(
        edited, seed, "fmu" if fmu else "native", record=folder,
        fail_safe=fail_safe,  # type: ignore[arg-type]
    )  # fmt: skip
    before = signal.signal(signal.SIGTERM, _interrupt)
    try:
        with ExitStack() as stack:
            stack.callback(_told, conductor)
            stack.callback(conductor.close)
            _open_doors(stack, conductor, doors, port, tcp_port, http_port)
            _wait(conductor, real_time, paused, until)
    finally:
        signal.signal(signal.SIGTERM, before)


def _open_doors(
    stack: ExitStack,
    conductor: Any,
    doors: Any,
    port: int | None,
    tcp: int | None,
    http: int | None,
) -> None:
    """Open the doors, and say where they are once all are open."""
    from uuvsim_cosim.bridge.http_door import HttpDoor
    from uuvsim_cosim.bridge.tcp_door import TcpDoor
    from uuvsim_cosim.bridge.wire import HTTP_PORT, TCP_PORT
    from uuvsim_cosim.bridge.wrapped_session import PORT
    from uuvsim_cosim.bridge.zenoh_bridge import Bridge

    number = PORT if port is None else port
    bridge = stack.enter_context(
        Bridge(conductor, port=number, host=doors.zenoh_hosts, access=doors.keeper)
    )
    local = doors.words == "on this machine"
    served = "on this machine" if local else f"to {doors.words}"
    lines = [f"{conductor.describe()['system']} is served {served}:"]
    kind = "tls" if bridge.tls else "tcp"
    said = [f"port={bridge.port}"] if bridge.port != PORT else []
    said += ['ca="ca.pem"'] if bridge.tls else []
    where = ", ".join(f"{kind}/{host}:{bridge.port}" for host in bridge.hosts)
    lines.append(f"  Zenoh  {where}  Python: uuvsim_cosim.connect({', '.join(said)})")
    guard = {"admit": doors.admit, "tls": doors.tls}
    if tcp != -1:
        number = TCP_PORT if tcp is None else tcp
        door = stack.enter_context(TcpDoor(conductor, number, doors.hosts, **guard))
        whom = "TLS" if bridge.tls else "MATLAB, Octave: uuvsim.connect()"
        lines.append(f"  TCP    {', '.join(door.addresses)}  {whom}")
    if http != -1:
        page = HttpDoor(conductor, HTTP_PORT if http is None else http, doors.hosts, **guard)
        stack.callback(page.close)
        lines.append(f"  HTTP   {page.addresses[0]}  curl, webread, and a page for browsers")
        if any(c["kind"] == "keyboard" for c in conductor.describe()["components"]):
            lines.append(f"  Pilot  {page.addresses[0]}pilot  keyboard and gamepad")
    for one in lines:
        line(one)


def _check_ports(hosts: Sequence[str], port: int | None, tcp: int | None, http: int | None) -> None:
    """Refuse ports that cannot be had before anything is built or recorded."""
    import socket

    from uuvsim_cosim.bridge.wire import HTTP_PORT, TCP_PORT
    from uuvsim_cosim.bridge.wrapped_session import PORT

    wanted = {
        "--port": (port, PORT),
        "--tcp-port": (tcp, TCP_PORT),
        "--http-port": (http, HTTP_PORT),
    }
    taken: dict[int, str] = {}
    for option, (given, usual) in wanted.items():
        number = usual if given is None else given
        if number == 0 or (number == -1 and option != "--port"):
            continue
        if not 0 < number < 1 << 16:
            raise InputInvalid(f"{option} {number}: expected a port, 1 to 65535, or 0 for any")
        if number in taken:
            raise InputInvalid(f"{option} {number}: is {taken[number]} as well; expected another")
        taken[number] = option
        for host in hosts:
            with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as trial:
                trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                try:
                    trial.bind((host, number))
                except OSError as error:
                    if error.errno == errno.EADDRINUSE:
                        raise InputInvalid(
                            f"port {number} on {host} is in use; expected a free one, such as "
                            f"by {option} {number % 65435 + 100}, or 0 for any"
                        ) from None


def _wait(conductor: Any, factor: float, paused: bool, until: float | None) -> None:
    """Run until the end, or until somebody interrupts."""
    from uuvsim_cosim.bridge.desk import Client

    told = None
    try:
        line("paused: clients run or step it; Ctrl-C ends it" if paused else
             f"streams at {factor:g} times real time; Ctrl-C ends it")  # fmt: skip
        asked = None
        if not paused:
            asked = conductor.ask("run", Client("serve", "local"), until, factor, ())
        sys.stdout.flush()
        while until is None or conductor.moment().time < until - 1e-9:
            if (failed := conductor.failed) is not None and failed is not told:
                if until is not None:
                    raise failed
                sys.stderr.write(f"uuvsim: {failed}; paused, clients may reset it\n")
                told = failed
            elif asked is not None and asked.done():
                asked.result()  # raises what it refused, such as a time after a recording's end
                asked = None
            time.sleep(_LOOK)
    except KeyboardInterrupt:
        line()
        line(f"interrupted at t = {conductor.moment().time:.6g} s")
        if until is not None:
            raise


def _refuse_changes(system: str, changes: dict[str, Any], **others: Any) -> None:
    """A recording is as it was."""
    given = [f"--{name}" for name, value in {**changes, **others}.items() if value]
    if given:
        raise InputInvalid(
            f"{system}: is a recording, which nothing can change; expected it without "
            f"{', '.join(given)}"
        )


def _told(conductor: Any) -> None:
    for folder in conductor.folders:
        line(f"recording  {tilde(folder)}")


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt
