"""`uuvsim serve`: run a system that clients read, set and step."""

from __future__ import annotations

import errno
import signal
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from uuvsim_cosim.commands.serve.servers import open_foxglove, open_node, open_servers
from uuvsim_cosim.commands.shared.answer import answer
from uuvsim_cosim.commands.shared.completion import of, systems
from uuvsim_cosim.commands.shared.options import folder_option
from uuvsim_cosim.commands.shared.system_options import (
    ArdusubBinary,
    ArmReal,
    Force,
    Loops,
    Maps,
    Px4Build,
    Rates,
    Replacements,
    Unsigned,
    Until,
    Values,
    VehicleOfMission,
    changes_of,
    edited_system,
    flown_path,
    named_system,
    permit_commands,
    with_path,
)
from uuvsim_cosim.commands.shared.terminal import line, notice, remark, tilde
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from uuvsim_cosim.bridge.server.conductor import Conductor
    from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["serve_command"]

_LOOK = 0.1  # [s] between two checks for the end


def serve_command(
    system: Annotated[
        str,
        typer.Argument(
            autocompletion=systems,
            help="Name of a system, path to .ssd, .ssp or .fmu, or a recording.",
        ),
    ],
    vehicle: VehicleOfMission = None,
    real_time: Annotated[
        float, typer.Option(help="Factor of real time at which the system runs.")
    ] = 1.0,
    paused: Annotated[
        bool, typer.Option("--paused", help="Start paused; clients run or step the system.")
    ] = False,
    until: Until = None,
    port: Annotated[int | None, typer.Option(help="Zenoh's port (7470); 0 for any.")] = None,
    tcp_port: Annotated[
        int | None, typer.Option(help="Port for MATLAB and Octave; 0 for any, -1 for none.")
    ] = None,
    http_port: Annotated[
        int | None, typer.Option(help="Port for browsers and curl; 0 for any, -1 for none.")
    ] = None,
    ros2: Annotated[
        str | None,
        typer.Option(
            autocompletion=of("humble", "jazzy", "kilted", "lyrical", "rolling"),
            help="Be a node of ROS 2 for this distribution's rmw_zenoh: topics, inputs, services.",
        ),
    ] = None,
    topics: Annotated[
        Path | None, typer.Option(help="With --ros2: file of topics; default by the signals.")
    ] = None,
    ros2_port: Annotated[
        int | None, typer.Option(help="Port of rmw_zenoh's router (7447).")
    ] = None,
    foxglove: Annotated[
        bool,
        typer.Option("--foxglove", help="Show signals, scene and parameters in Foxglove."),
    ] = False,
    foxglove_port: Annotated[
        int | None, typer.Option(help="Port for Foxglove (8765); 0 for any.")
    ] = None,
    mavlink: Annotated[
        str | None,
        typer.Option(
            metavar="[ADDRESS]",
            help="Speak MAVLink like ArduSub, by default to udpout:127.0.0.1:14550.",
        ),
    ] = None,
    waypoints: Annotated[
        Path | None,
        typer.Option(
            help="Mission: a .plan of QGroundControl, or a CSV of north, east, down in m or of "
            "lat, lon, depth."
        ),
    ] = None,
    origin: Annotated[
        str | None,
        typer.Option(
            metavar="LAT,LON",
            help="Place of the local frame's origin: for --waypoints in degrees, --mavlink, "
            "--foxglove, and GPS fixes of --ros2.",
        ),
    ] = None,
    arm_real: ArmReal = False,
    unsigned: Unsigned = False,
    out: Annotated[
        Path | None,
        folder_option("Folder of the recording."),
    ] = None,
    no_record: Annotated[bool, typer.Option("--no-record", help="Record nothing.")] = False,
    seed: Annotated[int, typer.Option(help="Seed of all random numbers.")] = 0,
    replace: Replacements = None,
    ardusub: ArdusubBinary = None,
    px4: Px4Build = None,
    map_: Maps = None,
    rate: Rates = None,
    set_: Values = None,
    force: Force = False,
    loops: Loops = None,
    fmu: Annotated[bool, typer.Option("--fmu", help="Run models as FMUs, as `run` does.")] = False,
    fail_safe: Annotated[
        str,
        typer.Option(
            autocompletion=of("drop", "pause", "go-on"),
            help="Reaction to a lockstep client that is late or gone: drop, pause or go-on.",
        ),
    ] = "drop",
    access: Annotated[
        Path | None,
        typer.Option(
            help="Access file (YAML) with users and roles; see docs/connections/security.md."
        ),
    ] = None,
    host: Annotated[
        list[str] | None, typer.Option(help="Address to listen at, 0.0.0.0: all; may be repeated.")
    ] = None,
    anyone: Annotated[
        bool,
        typer.Option(
            "--anyone", help="Serve without token and access file: everybody may do everything."
        ),
    ] = False,
    no_code: Annotated[
        bool, typer.Option("--no-code", help="Clients may not replace components.")
    ] = False,
) -> None:
    """Serve a running system to clients on this machine, until Ctrl-C.

    Python: uuvsim_cosim.connect(). MATLAB and Octave: uuvsim.connect(). Clients need the server's
    token, which programs of the same user find. --access admits other users, --anyone everybody.
    """
    from uuvsim_cosim.bridge.access.transports import server_settings
    from uuvsim_cosim.bridge.http.keyboard import with_keyboards
    from uuvsim_cosim.bridge.server.conductor import Conductor
    from uuvsim_cosim.bridge.server.playback import is_recording
    from uuvsim_cosim.bridge.tcp.framing import HTTP_PORT, TCP_PORT
    from uuvsim_cosim.bridge.zenoh.session import PORT
    from uuvsim_cosim.commands.shared.waypoints import origin_of
    from uuvsim_cosim.orchestrator.running.mission import has_path

    if until is not None and not 0.0 < until < float("inf"):
        raise InputInvalid(f"--until {until:g}: expected more than 0 seconds")
    if not 0.0 < real_time < float("inf"):
        raise InputInvalid(f"--real-time {real_time:g}: expected a factor of more than 0")
    if ros2 is None and (topics, ros2_port) != (None, None):
        raise InputInvalid("--topics or --ros2-port", "--ros2 DISTRIBUTION beside it")
    if foxglove_port is not None and not foxglove:
        raise InputInvalid("--foxglove-port", "--foxglove beside it")
    _raise_limit_of_files()
    if mavlink is not None:
        from uuvsim_cosim.bridge.mavlink.link import Address, dialect

        dialect()
        Address.of(mavlink, anyone=anyone)
    opened = server_settings(access, host or (), anyone=anyone)
    ports = (
        PORT if port is None else port,
        TCP_PORT if tcp_port is None else tcp_port,
        HTTP_PORT if http_port is None else http_port,
    )
    wanted = dict(zip(("--port", "--tcp-port", "--http-port"), ports, strict=True))
    if foxglove:
        from uuvsim_cosim.bridge.foxglove.permissions import foxglove_permissions
        from uuvsim_cosim.bridge.foxglove.server import FOXGLOVE_PORT, foxglove_sdk

        foxglove_sdk()
        foxglove_permissions(opened)
        foxglove_port = FOXGLOVE_PORT if foxglove_port is None else foxglove_port
        wanted["--foxglove-port"] = foxglove_port
    _check_ports(opened.hosts, wanted)
    changes = changes_of(set_, replace, map_, rate)
    placed = ros2 is not None or mavlink is not None or foxglove
    if origin is not None and waypoints is None and not placed:
        raise InputInvalid(
            f"--origin {origin}", "--waypoints, --mavlink, --ros2 or --foxglove as well"
        )
    flown = flown_path(waypoints, origin, shared=placed)
    place = None if flown is None else flown.origin
    if origin is not None:
        place = origin_of(origin)
    served: System | str = system
    folder = None
    if is_recording(system):
        others = {"fmu": fmu, "seed": seed, "out": out, "loops": loops, "vehicle": vehicle,
                  "force": force, "waypoints": flown}  # fmt: skip
        if given := [f"--{name}" for name, value in {**changes, **others}.items() if value]:
            raise InputInvalid(
                system, "is a recording, which cannot be changed", f"it without {', '.join(given)}"
            )
    else:
        with_keyboards(lambda: named_system(system, vehicle), changes["replace"])
        permit_commands(changes["replace"], arm_real=arm_real, unsigned=unsigned)
        served = edited_system(system, None, changes, loops, None, vehicle, force,
                               {"ardusub": ardusub, "px4": px4})  # fmt: skip
        if flown is not None:
            if mavlink is None or has_path(served):
                served = with_path(served, flown)
            for note in flown.notes:
                remark("note", note)
        if not no_record:
            folder = out if out is not None else Path("runs") / f"{served.name}-{seed}"
    conductor = Conductor(
        served, seed, "fmu" if fmu else "native", record=folder,
        fail_safe=fail_safe, loads_code=not no_code,  # type: ignore[arg-type]
    )  # fmt: skip

    def print_rest(warned: Sequence[str]) -> None:
        """Print the warnings that came up during the run, and the folders of its recordings."""
        for warning in conductor.warnings:
            if warning not in warned:
                remark("assumed", warning)
        for recorded in conductor.folders:
            line(f"recording  {tilde(recorded)}")

    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with ExitStack() as stack:
            for warning in conductor.warnings:
                remark("assumed", warning)
            stack.callback(print_rest, conductor.warnings)
            stack.callback(conductor.close)
            if mavlink is not None:
                from uuvsim_cosim.bridge.mavlink.server import MavlinkServer

                mission = None if flown is None else flown.points.tolist()
                server = stack.enter_context(
                    MavlinkServer(
                        conductor,
                        mavlink,
                        anyone=anyone,
                        mission=mission,
                        origin=place,
                        report=notice,
                    )
                )
                line(f"MAVLink {', '.join(server.addresses)}  QGroundControl, pymavlink, MAVSDK")
            open_servers(stack, conductor, opened, *ports)
            if foxglove_port is not None:
                open_foxglove(stack, conductor, opened, foxglove_port, place)
            if ros2 is not None:
                open_node(stack, conductor, ros2, topics, ros2_port, real_time, place, opened)
            _wait(conductor, real_time, paused, until)
    finally:
        signal.signal(signal.SIGTERM, before)


def _check_ports(hosts: Sequence[str], wanted: Mapping[str, int]) -> None:
    """Raise InputInvalid for ports in use, before anything is built or recorded."""
    import socket

    options: dict[int, str] = {}  # by port
    for option, number in wanted.items():
        if number == 0 or (number == -1 and option in ("--tcp-port", "--http-port")):
            continue
        if not 0 < number < 1 << 16:
            raise InputInvalid(f"{option} {number}: expected a port, 1 to 65535, or 0 for any")
        if number in options:
            raise InputInvalid(
                f"{option} {number}", f"is the port of {options[number]} as well", "another port"
            )
        options[number] = option
        for host in hosts:
            with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as trial:
                trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                try:
                    trial.bind((host, number))
                except OSError as error:
                    if error.errno == errno.EADDRINUSE:
                        raise InputInvalid(
                            f"port {number} on {host} is in use",
                            f"a free one, such as by {option} {number % 65435 + 100}, or 0 for any",
                        ) from None


def _wait(conductor: Conductor, factor: float, paused: bool, until: float | None) -> None:
    """Wait until the end time or Ctrl-C."""
    from uuvsim_cosim.bridge.calls.service import Client

    reported = None
    try:
        line("paused: clients run or step the system; Ctrl-C ends it" if paused else
             f"streams at {factor:g} times real time; Ctrl-C ends it")  # fmt: skip
        asked = None
        if not paused:
            asked = conductor.ask("run", Client("serve", "local"), until, factor, ())
        answer().write_early()
        sys.stdout.flush()
        while until is None or conductor.moment().time < until - 1e-9:
            if (failed := conductor.failed) is not None and failed is not reported:
                if until is not None:
                    raise failed
                notice(f"{failed}; paused, clients may reset it")
                reported = failed
            elif asked is not None and asked.done():
                asked.result()  # raises if the call was refused
                asked = None
            time.sleep(_LOOK)
    except KeyboardInterrupt:
        line()
        line(f"interrupted at t = {conductor.moment().time:.6g} s")
        if until is not None:
            raise


def _raise_limit_of_files() -> None:
    """Raise the limit of open files: idle connections must not use up those of the recording."""
    try:
        import resource
    except ImportError:  # Windows
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = 8192 if hard == resource.RLIM_INFINITY else min(hard, 8192)
    if soft != resource.RLIM_INFINITY and soft < most:
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
