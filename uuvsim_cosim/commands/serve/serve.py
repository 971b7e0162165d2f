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
from uuvsim_cosim.commands.shared.terminal import line, notice, put, remark, tilde
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from uuvsim_cosim.bridge.access.transports import ServerSettings
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
            _open_servers(stack, conductor, opened, *ports)
            if foxglove_port is not None:
                _open_foxglove(stack, conductor, opened, foxglove_port, place)
            if ros2 is not None:
                _open_node(stack, conductor, ros2, topics, ros2_port, real_time, place, opened)
            _wait(conductor, real_time, paused, until)
    finally:
        signal.signal(signal.SIGTERM, before)


def _open_servers(
    stack: ExitStack,
    conductor: Conductor,
    opened: ServerSettings,
    port: int,
    tcp: int,
    http: int,
) -> None:
    """Open the servers, and print their addresses once all are open."""
    from uuvsim_cosim.bridge.access.token import token_file
    from uuvsim_cosim.bridge.http.server import HttpServer
    from uuvsim_cosim.bridge.tcp.framing import HTTP_PORT
    from uuvsim_cosim.bridge.tcp.server import TcpServer
    from uuvsim_cosim.bridge.zenoh.bridge import Bridge
    from uuvsim_cosim.bridge.zenoh.session import PORT

    bridge = stack.enter_context(
        Bridge(
            conductor, port=port, host=opened.zenoh_hosts, access=opened.authenticator,
            anyone=opened.authenticator is None,
        )
    )  # fmt: skip
    lines = [f"{conductor.describe()['system']} is served {opened.summary}:"]
    if opened.authenticator is None:
        sys.stderr.write(
            "uuvsim: --anyone: everybody who reaches these ports may do everything, which includes "
            "running code as this user\n"
        )
    kind = "tls" if bridge.tls else "tcp"
    arguments = [f"port={bridge.port}"] if bridge.port != PORT else []
    arguments += ['ca="ca.pem"'] if bridge.tls else []
    where = ", ".join(f"{kind}/{host}:{bridge.port}" for host in bridge.hosts)
    endpoints: dict[str, list[str]] = {"zenoh": where.split(", ")}
    lines.append(f"  Zenoh  {where}  Python: uuvsim_cosim.connect({', '.join(arguments)})")
    admit, tls = opened.admit, opened.tls
    if tcp != -1:
        server = stack.enter_context(TcpServer(conductor, tcp, opened.hosts, admit=admit, tls=tls))
        endpoints["tcp"] = list(server.addresses)
        whom = "TLS" if bridge.tls else "MATLAB, Octave: uuvsim.connect()"
        lines.append(f"  TCP    {', '.join(server.addresses)}  {whom}")
    if http != -1:
        page = stack.enter_context(HttpServer(conductor, http, opened.hosts, admit=admit, tls=tls))
        endpoints["http"] = list(page.addresses)
        token = None if opened.authenticator is None else opened.authenticator.access.token
        # Other users may read a log: the token is printed to a terminal only.
        entry = f"?token={token}" if token is not None and sys.stdout.isatty() else ""
        lines.append(f"  HTTP   {page.addresses[0]}{entry}  curl, webread, a page for browsers")
        if any(c["kind"] == "keyboard" for c in conductor.describe()["components"]):
            lines.append(f"  Pilot  {page.addresses[0]}pilot{entry}  keyboard and gamepad")
        if token is not None:
            other = "" if page.port == HTTP_PORT else f" --port {page.port}"
            lines.append(f"  Token  {tilde(token_file(page.port))}  uuvsim access token{other}")
    for one in lines:
        line(one)
    put("system", conductor.describe()["system"])
    put("endpoints", endpoints)


def _open_node(
    stack: ExitStack, conductor: Conductor, distribution: str, topics: Path | None,
    port: int | None, real_time: float, origin: tuple[float, float] | None, opened: ServerSettings,
) -> None:  # fmt: skip
    from uuvsim_cosim.bridge.access.access_file import is_loopback
    from uuvsim_cosim.bridge.ros2.node import ROUTER_PORT, Ros2Node
    from uuvsim_cosim.bridge.ros2.permissions import is_mutual

    access = None if opened.authenticator is None else opened.authenticator.access
    mutual = access if is_mutual(access) else None
    commands = access is None or access.token is not None or mutual is not None
    node = stack.enter_context(
        Ros2Node(
            conductor, distribution, topics=topics, port=ROUTER_PORT if port is None else port,
            commands=commands, factor=real_time, report=lambda text: notice(f"ROS 2: {text}"),
            origin=origin, access=mutual, hosts=opened.zenoh_hosts,
        )
    )  # fmt: skip
    router = "router" if node.is_router else "client of the router"
    every = f"{len(node.topics)} topics, {len(node.inputs)} inputs, {len(node.services)} services"
    may = "read, set and step" if commands else "read"
    who = f"every program on this machine can {may} them, without token"
    if mutual is not None and mutual.tls is not None:
        who = "machines with a certificate of its CA can use them by their role: " + ", ".join(
            [f"{name} ({role})" for name, role in mutual.tls.roles.items()]
            + [f"others: {mutual.anyone or 'nothing'}"]
        )
    line(
        f"  ROS 2  {distribution}: node /{node.node.name}, domain {node.domain}, {every}, "
        f"{router} at {', '.join(node.addresses)}; {who}"
    )
    for one in node.inputs:
        signals = ", ".join(name for names in one.signals.values() for name in names)
        line(f"  input  {one.name}  {one.type}: {signals}, time-out {one.timeout:g} s")
    if not commands:
        notice(
            "ROS 2: inputs and services are closed, because a ROS 2 node proves no identity that "
            "a role of --access could allow; expected tls with `ca` and roles of certificates in "
            "the access file, or clients of Zenoh, TCP or HTTP for commands"
        )
    if mutual is None and not all(map(is_loopback, opened.hosts)):
        notice(
            f"ROS 2: stays at {', '.join(node.addresses)}; expected tls with `ca` in the file of "
            "--access to listen beyond this machine"
        )
    for name in node.without_topic if topics is None else ():
        line(f"  note: {name}: a text has no topic")
    for note in node.omitted:
        line(f"  note: {note}")
    put("ros2", [{"topic": topic.name, "type": topic.type} for topic in node.topics])
    put("ros2_inputs", [{"topic": one.name, "type": one.type} for one in node.inputs])
    put("ros2_services", [{"name": name, "type": type_} for name, type_ in node.services.items()])


def _open_foxglove(
    stack: ExitStack, conductor: Conductor, opened: ServerSettings, port: int,
    origin: tuple[float, float] | None,
) -> None:  # fmt: skip
    from uuvsim_cosim.bridge.access.access_file import is_loopback
    from uuvsim_cosim.bridge.foxglove.permissions import foxglove_permissions
    from uuvsim_cosim.bridge.foxglove.server import FoxgloveServer
    from uuvsim_cosim.view.scene3d.foxglove_live import drawing

    permissions = foxglove_permissions(opened)
    server = stack.enter_context(
        FoxgloveServer(conductor, port, permissions, drawing=drawing, origin=origin)
    )
    here = all(map(is_loopback, permissions.hosts))
    who = "every program on this machine" if here else "everybody who reaches it"
    may = "read, set and step it" if "step" in permissions.allowed else "read it"
    line(f"  Foxglove  {', '.join(server.addresses)}; {who} can {may}, without token")
    if permissions.reason:
        line(f"  note: {permissions.reason}")
    put("foxglove", {"addresses": server.addresses, "topics": server.topics})


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
