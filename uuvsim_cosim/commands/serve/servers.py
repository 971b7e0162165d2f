"""Servers of a served system: each is opened, and its addresses are printed."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from uuvsim_cosim.commands.shared.terminal import line, notice, put, tilde

if TYPE_CHECKING:
    from uuvsim_cosim.bridge.access.transports import ServerSettings
    from uuvsim_cosim.bridge.server.conductor import Conductor

__all__ = ["open_foxglove", "open_node", "open_servers"]


def open_servers(
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


def open_node(
    stack: ExitStack, conductor: Conductor, distribution: str, topics: Path | None,
    port: int | None, real_time: float, origin: tuple[float, float] | None, opened: ServerSettings,
) -> None:  # fmt: skip
    """Open a node of ROS 2, and print what it publishes, reads and serves."""
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


def open_foxglove(
    stack: ExitStack, conductor: Conductor, opened: ServerSettings, port: int,
    origin: tuple[float, float] | None,
) -> None:  # fmt: skip
    """Open a server for Foxglove, and print who can do what there."""
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
