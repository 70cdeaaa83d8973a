"""Make a folder and a zip from which s7dissect installs without a network: `make bundle` (docs/release.md).

    python -m scripts.bundle [--platform win_amd64] [--python 3.12] [--output build/bundle] [--wheel OWN.whl]

It contains the wheel of s7dissect, the wheels of all that its extra `all` needs, a requirements file with their digests, a bill
of materials (CycloneDX) and a README with the command to type. Without --platform it is for this system and this Python. For
another system or Python our own wheel is the interpreted one. Packages without a wheel there are named and left out, together
with the extras that need them.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import zipfile
from pathlib import Path

from scripts.bundle_readme import readme
from scripts.bundle_sbom import bill
from scripts.bundle_target import Target, Wheel, closure, read_wheel

ROOT = Path(__file__).resolve().parent.parent
OWN = "s7dissect"
#: The sources of a wheel of s7dissect.
SOURCES = (
    "dissect",
    "docs",
    "scripts",
    "setup.py",
    "pyproject.toml",
    "MANIFEST.in",
    "README.md",
    "LICENSE",
    "CHANGELOG.md",
)
#: The time of the files in an archive, unless SOURCE_DATE_EPOCH sets another one (as in setup.py).
EPOCH = int(os.environ.get("SOURCE_DATE_EPOCH", "315532800"))

#: pip chooses wheels for another system, but evaluates markers for this one, so it gets the right values here.
PIP = """
import json, sys
markers = json.loads(sys.argv.pop(1))
import pip._vendor.packaging.markers as asked
asked.default_environment = lambda: dict(markers)
from pip._internal.cli.main import main
sys.exit(main(sys.argv[1:]))
"""


def pip(target: Target, *words: str | Path, environment: dict[str, str] | None = None) -> str:
    """Run pip for a target; return its error output, empty if it did not fail."""
    command = [sys.executable, "-m", "pip"]
    if options := target.pip():
        command = [sys.executable, "-c", PIP, json.dumps(target.markers())]
    verb, *rest = map(str, words)
    command += [verb, *options, "--disable-pip-version-check", "--no-input", "--only-binary=:all:", "-q", *rest]
    ran = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if not ran.returncode:
        return ""
    errors = [line.removeprefix("ERROR: ") for line in ran.stderr.splitlines() if line.startswith("ERROR: ")]
    return errors[-1] if errors else ran.stderr.strip() or "pip failed"


def build_own(folder: Path) -> Path:
    """Build the interpreted wheel, which runs on every system, from a copy of the sources."""
    with tempfile.TemporaryDirectory() as name:
        for source in SOURCES:
            path, copy = ROOT / source, Path(name, source)
            if path.is_dir():
                shutil.copytree(path, copy, ignore=shutil.ignore_patterns("__pycache__", "*.so", "*.pyd"))
            else:
                shutil.copy2(path, copy)
        program = "import sys; from setuptools import build_meta; build_meta.build_wheel(sys.argv[1])"
        environment = {**os.environ, "S7DISSECT_COMPILED": "0"}
        environment.pop("PYTHONPATH", None)
        command = [sys.executable, "-P", "-c", program, str(folder)]
        ran = subprocess.run(command, cwd=name, env=environment, capture_output=True, text=True, check=False)
    if ran.returncode:
        sys.exit(f"bundle: the wheel cannot be built: {ran.stdout}{ran.stderr}")
    return next(folder.glob("*.whl"))


def compressed(wheel: Path, folder: Path) -> Path:
    """Copy a wheel compressed; wheels of a checkout are not compressed, because they are only used locally."""
    copy = folder / wheel.name
    with zipfile.ZipFile(wheel) as read, zipfile.ZipFile(copy, "w", zipfile.ZIP_DEFLATED) as written:
        for entry in read.infolist():
            octets = read.read(entry)
            entry.compress_type = zipfile.ZIP_DEFLATED
            written.writestr(entry, octets)
    return copy


def extras_of(own: Wheel) -> list[str]:
    """Return the extras that `all` includes."""
    said = own.needs({}, frozenset(("all",)))
    return sorted(extra for one in said if one.name == OWN for extra in one.extras)


def fetch(own: Path, extras: list[str], target: Target, folder: Path) -> dict[str, str]:
    """Fetch the wheel's requirements; return the extras that are not available there, and the missing package for each."""

    def attempt(wanted: list[str], into: Path) -> str:
        return pip(target, "download", "-d", into, f"{own}[{','.join(wanted)}]" if wanted else own)

    if not attempt(extras, folder):
        return {}
    missing = {}
    with tempfile.TemporaryDirectory() as name:
        if fault := attempt([], Path(name)):
            sys.exit(f"bundle: s7dissect itself cannot be installed on {target.name}: {fault}")
        for extra in extras:
            if fault := attempt([extra], Path(name)):
                found = re.search(r"No matching distribution found for (\S+)", fault)
                missing[extra] = f"{found[1]} has no wheel there" if found else fault
    shutil.rmtree(folder, ignore_errors=True)
    if fault := attempt([extra for extra in extras if extra not in missing], folder):
        sys.exit(f"bundle: {fault}")
    return missing


def requirements(wheels: list[Wheel], extras: list[str]) -> str:
    """Return a requirements file with the digest of each wheel: pip then installs these and no others."""
    lines = []
    for wheel in wheels:
        asked = f"{OWN}[{','.join(extras)}]" if wheel.name == OWN and extras else wheel.name
        digest = hashlib.sha256(wheel.path.read_bytes()).hexdigest()
        lines.append(f"{asked}=={wheel.version} --hash=sha256:{digest}")
    return "\n".join([*lines, ""])


def archive(folder: Path) -> Path:
    """Pack the folder: the same files give the same zip."""
    path = folder.with_name(f"{folder.name}.zip")
    when = time.gmtime(EPOCH)[:6]
    with zipfile.ZipFile(path, "w") as packed:
        for file in sorted(folder.rglob("*")):
            if file.is_file():
                entry = zipfile.ZipInfo(f"{folder.name}/{file.relative_to(folder).as_posix()}", when)
                entry.compress_type = zipfile.ZIP_STORED if file.suffix == ".whl" else zipfile.ZIP_DEFLATED
                entry.external_attr = 0o100644 << 16
                packed.writestr(entry, file.read_bytes())
    return path


def own_wheel(told: Path | None, target: Target, folder: Path) -> Path:
    """Return our own wheel for a target: the given one if it is compiled for the target, otherwise the interpreted one."""
    fits = f"-cp{target.python.replace('.', '')}-"
    if told is not None and not target.tag and fits in told.name:
        return compressed(told, folder)
    return build_own(folder)


def make(target: Target, output: Path, told: Path | None) -> Path:
    """Make the bundle; return its folder."""
    with tempfile.TemporaryDirectory() as name:
        own = own_wheel(told, target, Path(name))
        version = read_wheel(own).version
        folder = output / f"{OWN}-{version}-{target.name}"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        every = extras_of(read_wheel(own))
        print(f"bundle: fetching wheels for {target.name}", flush=True)
        missing = fetch(own, every, target, folder / "wheels")
    wheels = [read_wheel(path) for path in sorted((folder / "wheels").iterdir())]
    extras = [extra for extra in every if extra not in missing]
    needs = closure(wheels, OWN, frozenset(extras), target)
    if unneeded := sorted({wheel.name for wheel in wheels} - needs.keys()):
        sys.exit(f"bundle: nothing in it needs {', '.join(unneeded)}")
    (folder / "requirements.txt").write_text(requirements(wheels, extras), encoding="ascii")
    (folder / "sbom.cdx.json").write_text(bill(wheels, needs, OWN, EPOCH), encoding="utf-8")
    ours = next(wheel for wheel in wheels if wheel.name == OWN)
    # For Notepad, with line ends of Windows.
    told_there = readme(target, ours, len(wheels), missing)
    (folder / "README.txt").write_text(told_there, encoding="ascii", newline="\r\n")
    return folder


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument(
        "--platform", default="", help="tag of wheels: win_amd64, manylinux_aarch64, macosx_11_0_arm64 …"
    )
    parser.add_argument("--python", default="{}.{}".format(*sys.version_info), help="version of Python: 3.12")
    parser.add_argument("--output", type=Path, default=Path("build/bundle"))
    parser.add_argument("--wheel", type=Path, help="our own wheel, taken where it is compiled for this system")
    told = parser.parse_args()
    begun = time.monotonic()
    target = Target(told.platform, told.python)
    folder = make(target, told.output, told.wheel)
    packed = archive(folder)
    for line in (folder / "README.txt").read_text("ascii").splitlines():
        if line.startswith("* Left out"):
            print(f"bundle: {line.removeprefix('* ')}")
    digest = hashlib.sha256(packed.read_bytes()).hexdigest()
    count = len(list((folder / "wheels").iterdir()))
    print(f"bundle: {count} wheels, {packed.stat().st_size / 1e6:.0f} MB, {time.monotonic() - begun:.0f} s")
    print(f"{digest}  {packed}")


if __name__ == "__main__":
    main()
