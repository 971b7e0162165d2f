"""TLS of the servers: contexts of both sides, and one clear message for each failure."""

from __future__ import annotations

import contextlib
import re
import select
import socket
import ssl
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from uuvsim_cosim.errors import InputInvalid

__all__ = [
    "Tls",
    "certificate_problem",
    "client_context",
    "common_name",
    "common_names",
    "reason_of",
    "secured",
    "server_context",
    "speaks_tls",
    "why_refused",
]

_CN = b"\x06\x03\x55\x04\x03"  # object identifier 2.5.4.3 (common name), encoded in DER
_TLS_HANDSHAKE = b"\x16"


@dataclass(frozen=True)
class Tls:
    """Certificates; with `ca`, a client needs one as well (mutual TLS)."""

    certificate: Path
    key: Path
    ca: Path | None = None
    roles: Mapping[str, str] = field(default_factory=dict)  # common name: role


def server_context(tls: Tls) -> ssl.SSLContext:
    """Return the context of a server.

    A client certificate is optional here: the `Admission` refuses a client without one, with a
    clearer message than TLS has.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.load_cert_chain(tls.certificate, tls.key, password=_no_password)
    if tls.ca is not None:
        context.load_verify_locations(tls.ca)
        context.verify_mode = ssl.CERT_OPTIONAL
    return context


def client_context(
    ca: str | Path | None, certificate: str | Path | None, key: str | Path | None
) -> ssl.SSLContext:
    """Return the context of a client; raises InputInvalid for files that do not fit."""
    if (certificate is None) != (key is None):
        raise InputInvalid("connect", "certificate and key belong together", "both")
    for what, file in (("ca", ca), ("certificate", certificate), ("key", key)):
        if file is not None and not Path(file).is_file():
            raise InputInvalid("connect", f"{what} {str(file)!r}: no such file", "PEM")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    try:
        if ca is None:
            context.load_default_certs()
        else:
            context.load_verify_locations(ca)
        if certificate is not None:
            context.load_cert_chain(certificate, key, password=_no_password)
    except (ssl.SSLError, ValueError) as error:
        raise InputInvalid(f"connect: {_chain_problem(error)}") from None
    return context


def certificate_problem(tls: Tls) -> str | None:
    """Return what is wrong with the files of a server; None if nothing is."""
    try:
        server_context(tls)
    except (ssl.SSLError, ValueError) as error:
        return _chain_problem(error)
    except OSError as error:
        return f"{error.filename or tls.key}: {error.strerror}; expected a file that can be read"
    return None


def common_name(client: socket.socket) -> str | None:
    """Return the common name of the certificate that a client has shown, if it is verified."""
    if not isinstance(client, ssl.SSLSocket):
        return None
    subject: object = (client.getpeercert() or {}).get("subject", ())
    for part in subject if isinstance(subject, tuple) else ():
        for key, value in part:
            if key == "commonName":
                return str(value)
    return None


def common_names(certificate: str | Path) -> list[str]:
    """Return the common names in a PEM file's first certificate, the subject's before the issuer's.

    Each is found by its object identifier; in X.509 the issuer comes before the subject.
    """
    text = Path(certificate).read_text(encoding="ascii", errors="replace")
    first = re.search(r"-----BEGIN CERTIFICATE-----.*?-----END CERTIFICATE-----", text, re.S)
    if first is None:
        return []
    data = ssl.PEM_cert_to_DER_cert(first.group())
    found = []
    for match in re.finditer(re.escape(_CN), data):
        at = match.end() + 2  # a tag, and a length below 128
        name = data[at : at + data[at - 1]].decode("utf-8", "replace")
        if name not in found:
            found.append(name)
    return found[::-1]


def speaks_tls(client: socket.socket, patience: float) -> bool:
    """Return whether a client begins with a TLS handshake; one that waits for data does not."""
    client.settimeout(patience)
    try:
        return client.recv(1, socket.MSG_PEEK) in (_TLS_HANDSHAKE, b"")
    except TimeoutError:
        return False


def secured(plain: socket.socket, context: ssl.SSLContext, patience: float) -> ssl.SSLSocket:
    """Make the TLS handshake with a client; raises InputInvalid if the client does not speak TLS.

    The error is then sent without TLS.
    """
    if not speaks_tls(plain, min(patience, 1.0)):
        raise InputInvalid(
            "this server uses TLS",
            "a client that uses TLS (see docs/connections/security.md)",
        )
    plain.settimeout(patience)
    return context.wrap_socket(plain, server_side=True)


def why_refused(
    host: str, port: int, context: ssl.SSLContext, *, listen: float = 0.5
) -> str | None:
    """Try a handshake, and return one sentence why it fails; None if it succeeds.

    `listen` is the time [s] to wait for the server to refuse this client's certificate.
    """
    try:
        connection = socket.create_connection((host, port), timeout=1.5)
    except OSError:
        return None  # no server, which the caller reports
    try:
        with connection as plain:
            if select.select([plain], [], [], 0.0)[0]:  # the server sends first, unlike TLS
                return "it does not use TLS"
            with context.wrap_socket(plain, server_hostname=host) as client:
                if listen:
                    client.settimeout(listen)
                    with contextlib.suppress(TimeoutError):
                        client.recv(1)
            return None
    except ssl.SSLError as error:
        return reason_of(error, host)
    except OSError as error:
        if isinstance(error, ConnectionResetError | BrokenPipeError | TimeoutError):
            return "it does not use TLS, or not with this client; expected no ca= if it does not"
        return None


def reason_of(error: ssl.SSLError, host: str) -> str:
    """Return one sentence for a handshake that failed, from the client's point of view."""
    if isinstance(error, ssl.SSLCertVerificationError):
        message = error.verify_message
        if "Hostname mismatch" in message or "IP address mismatch" in message:
            return (
                f"its certificate is not one of {host!r}; expected to connect by a name or address "
                "that the certificate has"
            )
        if "expired" in message:
            return "its certificate has expired; expected a new one there"
        if "not yet valid" in message:
            return "its certificate is not valid yet; expected synchronised clocks"
        return (
            f"its certificate is not signed by the CA that is trusted here ({message}); expected "
            "ca=, the file ca.pem of the server"
        )
    text = str(error).lower()
    if "certificate_required" in text or "certificate required" in text:
        return "it requires a certificate of this client; expected certificate= and key="
    if "unknown_ca" in text or "unknown ca" in text or "decrypt_error" in text:
        return "it does not know the CA of this client's certificate; expected one of its own CA"
    if "certificate_expired" in text or "certificate expired" in text:
        return "this client's certificate has expired; expected a new one"
    if "alert" in text and "certificate" in text:
        return f"it refuses this client's certificate ({error.reason})"
    if "wrong_version" in text or "record layer" in text or "eof" in text:
        return "it does not use TLS; expected no ca= and no certificate="
    return f"TLS fails ({error.reason or error})"


def _no_password() -> str:
    raise ValueError("the key is locked by a password")


def _chain_problem(error: Exception) -> str:
    """Return a message for certificates that cannot be loaded."""
    reason = getattr(error, "reason", None) or str(error)
    if "KEY_VALUES_MISMATCH" in str(reason):
        return "the key is not that of the certificate; expected the two that were made together"
    if "password" in str(reason):
        return "the key is locked by a password; expected a key in PEM without one"
    return f"certificate, key or ca cannot be read ({reason}); expected PEM"
