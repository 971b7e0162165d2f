"""An own CA with certificates for a server and its clients, to try TLS or to use it."""

from __future__ import annotations

import datetime
import ipaddress
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from cryptography import x509
    from cryptography.hazmat.primitives.asymmetric.ec import EllipticCurvePrivateKey

__all__ = ["make_certificates"]

Pair = tuple["x509.Certificate", "EllipticCurvePrivateKey"]


def make_certificates(
    folder: str | Path,
    hosts: Sequence[str] = ("localhost", "127.0.0.1", "::1"),
    clients: Sequence[str] = (),
    *,
    days: float = 365.0,
) -> list[Path]:
    """Write ca.pem, server.pem and NAME.pem of each client, each with a key; return the files.

    Keys are P-256 in PKCS 8, readable by the user only. `days` is the validity from now; negative:
    the certificates have expired. If the folder has a CA already, it signs the new certificates;
    a server's certificate there is kept.
    """
    try:
        import cryptography as _  # noqa: F401
    except ImportError:
        raise InputInvalid(
            "certificates need the package cryptography",
            "pip install 'uuvsim-cosim[security]', or certificates made elsewhere",
        ) from None
    for name in (*hosts, *clients):
        if not name or len(name) > 64 or "/" in name or name in (".", ".."):
            raise InputInvalid(f"certificate {name!r}", "a name of 1 to 64 letters")
    if not hosts:
        raise InputInvalid("no host", "names or addresses that clients connect to")
    if reserved := {"ca", "server"} & set(clients):
        raise InputInvalid(f"client {reserved.pop()!r}", "another name than ca and server")
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    has_server = (place / "server.pem").exists()
    for name in clients or (["server"] if has_server else []):
        if (place / f"{name}.pem").exists():
            raise InputInvalid(f"{place / f'{name}.pem'} exists", "another folder or name")
    written = []
    if (place / "ca.pem").exists() or (place / "ca-key.pem").exists():
        ca = _read(place)
    else:
        ca = _signed("uuvsim CA", None, days=max(days, 1.0) * 10, authority=True)
        written += _write(place, "ca", ca)
    if not has_server:
        server = _signed(hosts[0], ca, days=days, hosts=hosts)
        written += _write(place, "server", server)
    for name in clients:
        written += _write(place, name, _signed(name, ca, days=days))
    return written


def _signed(
    name: str,
    by: Pair | None,
    *,
    days: float,
    hosts: Sequence[str] = (),
    authority: bool = False,
) -> Pair:
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

    key = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    signer, signing = (None, key) if by is None else by
    now = datetime.datetime.now(datetime.UTC)
    begin, end = sorted((now - datetime.timedelta(hours=1), now + datetime.timedelta(days=days)))
    usage = x509.KeyUsage(
        digital_signature=True, content_commitment=False, key_encipherment=False,
        data_encipherment=False, key_agreement=False, key_cert_sign=authority, crl_sign=authority,
        encipher_only=False, decipher_only=False,
    )  # fmt: skip
    identifier = x509.SubjectKeyIdentifier.from_public_key(key.public_key())
    issuer = x509.AuthorityKeyIdentifier.from_issuer_public_key(signing.public_key())
    path = 0 if authority else None
    builder = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject if signer is None else signer.subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(begin)
        .not_valid_after(end)
        .add_extension(x509.BasicConstraints(ca=authority, path_length=path), critical=True)
        .add_extension(usage, critical=True)
        .add_extension(identifier, critical=False)
        .add_extension(issuer, critical=False)
    )
    if hosts:
        names: list[x509.GeneralName] = []
        for host in hosts:
            try:
                names.append(x509.IPAddress(ipaddress.ip_address(host)))
            except ValueError:
                names.append(x509.DNSName(host))
        builder = builder.add_extension(x509.SubjectAlternativeName(names), critical=False)
    if not authority:
        purpose = ExtendedKeyUsageOID.SERVER_AUTH if hosts else ExtendedKeyUsageOID.CLIENT_AUTH
        builder = builder.add_extension(x509.ExtendedKeyUsage([purpose]), critical=False)
    return builder.sign(signing, hashes.SHA256()), key


def _read(place: Path) -> Pair:
    from cryptography import x509
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    try:
        certificate = x509.load_pem_x509_certificate((place / "ca.pem").read_bytes())
        key = load_pem_private_key((place / "ca-key.pem").read_bytes(), None)
    except (OSError, ValueError, TypeError) as error:
        raise InputInvalid(f"{place}: ca.pem and ca-key.pem cannot be read ({error})") from None
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise InputInvalid(f"{place / 'ca-key.pem'}: expected a key made by this command")
    return certificate, key


def _write(place: Path, name: str, pair: Pair) -> list[Path]:
    from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat

    certificate, key = pair
    files = [place / f"{name}.pem", place / f"{name}-key.pem"]
    secret = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    files[0].write_bytes(certificate.public_bytes(Encoding.PEM))
    with open(os.open(files[1], os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "wb") as file:
        file.write(secret)
    return files
