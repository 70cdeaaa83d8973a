"""--cluster tls://…: a scheduler and a worker that want certificates, as Dask's own settings name them."""

from __future__ import annotations

import datetime
import ipaddress
from pathlib import Path
from typing import Final

import pytest

from tests.cli.support import run
from tests.files.cluster.support import cluster
from tests.meaning.report.schemas import ROOT
from tests.packets.source.servers import LOOPBACK

pytest.importorskip("distributed", reason="no distributed: pip install 's7dissect[test]'")
x509 = pytest.importorskip("cryptography.x509", reason="no cryptography: pip install 's7dissect[test]'")

Capture = pytest.CaptureFixture[bytes]

SZL: Final = ROOT / "captures" / "szl.pcapng"


def authority(folder: Path, name: str) -> dict[str, str]:
    """Make an authority and a certificate of it; return Dask's settings that name their files, for each role the same."""
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec

    now = datetime.datetime.now(datetime.UTC)
    keys = [ec.generate_private_key(ec.SECP256R1()) for _ in range(2)]
    issuer = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, name)])
    files: list[Path] = []
    for own, authority_ in ((keys[0], True), (keys[1], False)):
        subject = issuer if authority_ else x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, LOOPBACK)])
        made = (
            x509.CertificateBuilder()
            .subject_name(subject)
            .issuer_name(issuer)
            .public_key(own.public_key())
            .serial_number(x509.random_serial_number())
            .not_valid_before(now - datetime.timedelta(days=1))
            .not_valid_after(now + datetime.timedelta(days=1))
            .add_extension(x509.BasicConstraints(authority_, None), critical=True)
            .add_extension(
                x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address(LOOPBACK))]), critical=False
            )
            .sign(keys[0], hashes.SHA256())
        )
        files.append(folder / f"{name}-{len(files)}.pem")
        files[-1].write_bytes(made.public_bytes(serialization.Encoding.PEM))
    files.append(folder / f"{name}-key.pem")
    form, unlocked = serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    files[-1].write_bytes(keys[1].private_bytes(serialization.Encoding.PEM, form, unlocked))
    settings = {"ca-file": str(files[0])}
    for role in ("scheduler", "worker", "client"):
        settings |= {f"{role}.cert": str(files[1]), f"{role}.key": str(files[2])}
    return {f"distributed.comm.tls.{key}": value for key, value in settings.items()}


def variable(setting: str) -> str:
    """Return the environment variable of one of Dask's settings."""
    return f"DASK_{setting.replace('.', '__').replace('-', '_').upper()}"


def test_certificates(capfdbinary: Capture, tmp_path: Path) -> None:
    """Those that scheduler and worker know do as tcp:// does; others, or none, are one line. First without a worker."""
    import dask

    ours, others = authority(tmp_path, "plant"), authority(tmp_path, "stranger")
    with cluster(tmp_path, "tls", **{variable(name): value for name, value in ours.items()}) as made:
        arguments = ("analyze", "--separate", "-T", "json", str(SZL), "--cluster", made.address)
        with dask.config.set(ours):
            ran = run(capfdbinary, *arguments)
            assert (ran.code, ran.out, ran.err) == (2, "", f"Error: {made.address}: the cluster has no workers\n")
            checked = run(capfdbinary, "cluster-check", made.address)
            assert (checked.code, checked.out.splitlines()[-1]) == (1, "the cluster has no workers")
        made.begin("a")
        for settings in (others, {}):
            with dask.config.set(settings):
                ran = run(capfdbinary, *arguments)
            assert (ran.code, ran.out) == (2, "")
            assert ran.err.startswith(f"Error: {made.address}: ")
            assert ran.err.endswith("certificates are those of Dask's own settings (distributed.comm.tls)\n")
            assert ran.err.count("\n") == 1
        made.wait("a")
        with dask.config.set(ours):
            there = run(capfdbinary, *arguments)
    here = run(capfdbinary, *arguments[:-2])
    assert (there.code, there.err, there.out) == (0, "", here.out)
