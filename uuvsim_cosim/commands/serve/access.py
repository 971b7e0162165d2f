"""`uuvsim access`: hashes of passwords, certificates, and a look at an access file."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from uuvsim_cosim.commands.shared.terminal import file_line, line, put, table, tilde
from uuvsim_cosim.errors import InputInvalid

__all__ = ["app"]

app = typer.Typer(
    help="Manage passwords, tokens, certificates and access files of `uuvsim serve`.",
    no_args_is_help=True,
)


@app.command("password")
def password_command() -> None:
    """Ask for a password, or read it from stdin, and print its hash for an access file."""
    from uuvsim_cosim.bridge.access.passwords import hashed

    if sys.stdin.isatty():
        import getpass

        password = getpass.getpass("Password: ")
        if getpass.getpass("Again: ") != password:
            raise InputInvalid("the two passwords differ", "the same twice")
    else:
        password = sys.stdin.readline().rstrip("\r\n")
    put("hash", kept := hashed(password))
    line(kept)


@app.command("token")
def token_command(
    port: Annotated[int, typer.Option(help="A port of the server.")] = 7449,
    header: Annotated[
        bool, typer.Option("--header", help="Print the HTTP header that curl -H @FILE reads.")
    ] = False,
) -> None:
    """Print the token of your server on this machine, if it was started without --access."""
    from uuvsim_cosim.bridge.access.token import known_token, token_file

    token = known_token("127.0.0.1", port)
    if token is None:
        raise InputInvalid(
            f"port {port}",
            f"none of your servers uses a token there (no file {tilde(token_file(port))})",
            "the --port of `uuvsim serve` or of a page (`uuvsim view`)",
        )
    text = f"Authorization: Bearer {token}" if header else token
    put("token", token)
    line(text)


@app.command("certificates")
def certificates_command(
    folder: Annotated[Path, typer.Argument(help="Folder to write the certificates into.")],
    host: Annotated[
        list[str] | None,
        typer.Option(
            help="Name or address of the server; may be repeated; by default those of this machine."
        ),
    ] = None,
    client: Annotated[
        list[str] | None, typer.Option(help="Common name of a client; may be repeated.")
    ] = None,
    days: Annotated[int, typer.Option(min=1, help="Validity in days.")] = 365,
) -> None:
    """Make a CA, and certificates that it signs for a server and its clients."""
    from uuvsim_cosim.bridge.access.certificates import make_certificates

    hosts = host or ["localhost", "127.0.0.1", "::1"]
    for file in make_certificates(folder, hosts, client or [], days=days):
        file_line(file, tilde(file))


@app.command("check")
def check_command(file: Annotated[Path, typer.Argument(help="An access file.")]) -> None:
    """List the permissions in an access file, or every mistake with its line."""
    from uuvsim_cosim.bridge.access.access_file import read_access
    from uuvsim_cosim.bridge.access.roles import permissions

    access = read_access(file)
    roles = {} if access.tls is None else access.tls.roles
    who = [(user.name, user.role) for user in access.users.values()]
    who += [(f"certificate {name}", role) for name, role in roles.items()]
    rows = [(name, role, ", ".join(sorted(permissions(role)))) for name, role in who]
    others = ", ".join(sorted(access.anonymous)) or "nothing"
    table(["who", "role", "may"], [*rows, ("others", access.anyone or "", others)],
          key="access")  # fmt: skip
    tls = "no TLS" if access.tls is None else "mutual TLS" if access.tls.ca is not None else "TLS"
    line(f"{tls}; listens at {', '.join(access.listen)}")
