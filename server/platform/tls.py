"""The certificate that HTTPS is served with: given as files, or made by the service for its own site.

Nobody vouches for a self-made certificate, so browsers warn of it. What takes the place of an authority is the person
who pairs a device: its fingerprint stands in the QR code, behind ``#`` with the code itself, and the page shows it for
comparison with what the browser says of the connection.
"""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from daq.whole_files import write_whole
from server.platform.errors import StartError
from server.platform.files import DataDirectory
from server.platform.settings import Settings

#: The longest that browsers of tablets take, and when it is made anew.
LIFETIME, BEFORE_END = timedelta(days=825), timedelta(days=30)


@dataclass(frozen=True)
class Certificate:
    """A certificate and its key, both PEM files; ``fingerprint`` is the SHA-256 of the certificate in hexadecimal.

    ``self_made``: by the service; then nobody but the fingerprint vouches for it.
    """

    path: Path
    key: Path
    fingerprint: str
    self_made: bool


def certificate(settings: Settings, files: DataDirectory, now: Callable[[], datetime]) -> Certificate | None:
    """Return the certificate that the settings ask for; None for plain HTTP.

    Raises
    ------
    StartError
        If a file is missing or cannot be read, or only one of certificate and key is given.
    """
    if settings.tls_cert is not None or settings.tls_key is not None:
        if settings.tls_cert is None or settings.tls_key is None:
            raise StartError("server.belong_together", names=["--tls-cert", "--tls-key"])
        return Certificate(settings.tls_cert, settings.tls_key, _checked(settings.tls_cert, settings.tls_key), False)
    if settings.tls == "off":
        return None
    names = ["localhost", "127.0.0.1", settings.host, *map(_without_port, settings.public_names)]
    path, key = files.root / "tls" / "site.crt", files.root / "tls" / "site.key"
    if not _is_good(path, key, names, now()):
        # The computer's name is in it as well, but is no reason to make another: containers change it.
        _make(path, key, [*names, socket.gethostname()], now())
    return Certificate(path, key, _checked(path, key), True)


def _without_port(host: str) -> str:
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.partition(":")[0] if host.count(":") == 1 else host


def _checked(path: Path, key: Path) -> str:
    """Check that a certificate fits its key: its fingerprint."""
    try:
        found = x509.load_pem_x509_certificate(path.read_bytes())
    except (OSError, ValueError) as error:
        raise StartError("server.tls_no_certificate", path=path, error=error) from None
    try:
        private = serialization.load_pem_private_key(key.read_bytes(), password=None)
    except (OSError, ValueError, TypeError) as error:
        raise StartError("server.tls_no_key", key=key, error=error) from None
    form = serialization.Encoding.DER, serialization.PublicFormat.SubjectPublicKeyInfo
    if private.public_key().public_bytes(*form) != found.public_key().public_bytes(*form):
        raise StartError("server.tls_other_key", key=key, path=path)
    return found.fingerprint(hashes.SHA256()).hex()


def _general(name: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(name))
    except ValueError:
        return x509.DNSName(name)


def _is_good(path: Path, key: Path, names: Sequence[str], now: datetime) -> bool:
    """Test whether what was made before is for these names, and for long enough."""
    try:
        found = x509.load_pem_x509_certificate(path.read_bytes())
        has = found.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except (OSError, ValueError, x509.ExtensionNotFound):
        return False
    return (
        key.is_file()
        and {_general(name) for name in names} <= set(has)
        and found.not_valid_after_utc > now + BEFORE_END
    )


def _make(path: Path, key: Path, names: Sequence[str], now: datetime) -> None:
    try:  # whoever knows the key, by another way than its certificate, is not warned
        private = serialization.load_pem_private_key(key.read_bytes(), password=None)
        assert isinstance(private, ec.EllipticCurvePrivateKey)
    except (OSError, ValueError, TypeError, AssertionError):
        private = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "hilfit of this site")])
    alternative = x509.SubjectAlternativeName(list(dict.fromkeys(map(_general, names))))
    made = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(private.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - timedelta(days=1))  # clocks of tablets differ
        .not_valid_after(now + LIFETIME)
        .add_extension(alternative, critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), critical=False)
        .sign(private, hashes.SHA256())
    )
    pem = private.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    path.parent.mkdir(mode=0o700, exist_ok=True)
    write_whole(key, pem)
    key.chmod(0o600)
    write_whole(path, made.public_bytes(serialization.Encoding.PEM))
