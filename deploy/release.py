"""``make release KEY=...``: what is handed out of a version, what is in it, and who says so.

::

    dist/hilfit-VERSION-py3-none-any.whl   from the files of the commit, nothing else
    dist/hilfit-VERSION.tar.gz             those files
    dist/hilfit-VERSION.cdx.json           CycloneDX: all that the image installs and what is in the page, with licences
    dist/SHA256SUMS                        of the three
    dist/SHA256SUMS.sig                    signed by the releaser's key (ssh-keygen)

The wheel is installed into a new environment with the versions of locks/image.txt; the bill of materials is of that.
"""

from __future__ import annotations

import argparse
import base64
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

ROOT = Path(__file__).parents[1]
#: What a signature is for: one made for something else does not verify.
NAMESPACE = "hilfit-release"
SUMS = "SHA256SUMS"
PIP = (sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check")


class ReleaseError(Exception):
    """Nothing is released; the text is one line that says what to do."""


def run(*command: str | Path, env: Mapping[str, str] | None = None) -> str:
    """Run a program; return its standard output; ReleaseError with its last line if it fails."""
    try:
        done = subprocess.run(list(map(str, command)), cwd=ROOT, env=env, capture_output=True, text=True)
    except FileNotFoundError:
        raise ReleaseError(f"{command[0]} is not installed; install it and try again") from None
    if done.returncode:
        said = (done.stderr or done.stdout).strip().splitlines()
        raise ReleaseError(f"{command[0]} failed: {said[-1] if said else done.returncode}")
    return done.stdout


def check_key(key: str | None) -> Path:
    """Return the file of the releaser's key; ReleaseError if there is none."""
    if not key:
        raise ReleaseError(
            "no key: say who releases, as in make release KEY=~/.ssh/hilfit_release; a new one is made by "
            "ssh-keygen -t ed25519 -f ~/.ssh/hilfit_release"
        )
    path = Path(key).expanduser()
    if not path.is_file():
        raise ReleaseError(f"KEY={key}: is no file; name the private key, or the public one of a key in ssh-agent")
    return path


def build(dist: Path) -> tuple[Path, Path]:
    """Build source archive and wheel of the commit; ReleaseError if anything is in no commit."""
    changed = run("git", "status", "--porcelain", "--untracked-files=normal").splitlines()
    if changed:
        raise ReleaseError(f"{changed[0][3:]} is in no commit; commit it, or put it away (git stash)")
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    name = f"hilfit-{version}"
    archive = dist / f"{name}.tar.gz"
    run("git", "archive", "--format=tar.gz", f"--prefix={name}/", "-o", archive, "HEAD")
    time = run("git", "log", "-1", "--format=%ct").strip()
    with tempfile.TemporaryDirectory() as directory:
        run("tar", "-xzf", archive, "-C", directory)
        made: list[str | Path] = ["wheel", Path(directory, name), "--no-deps", "--no-build-isolation"]
        run(*PIP, *made, "--wheel-dir", dist, env={**os.environ, "SOURCE_DATE_EPOCH": time})
    (wheel,) = dist.glob("*.whl")
    return archive, wheel


def install(wheel: Path, place: Path) -> Path:
    """Install the wheel and the locked versions in a new environment; return its interpreter."""
    run(sys.executable, "-m", "venv", "--without-pip", place)
    python = place / "bin" / "python"
    run(*PIP, "--python", python, "install", "--no-compile", "--require-hashes", "-r", "locks/image.txt")
    run(*PIP, "--python", python, "install", "--no-compile", "--no-deps", wheel)
    return python


def bill_of_materials(python: Path) -> dict[str, Any]:
    """List an environment's contents, and the libraries built into the page (CycloneDX)."""
    program = Path(sys.executable).parent / "cyclonedx-py"
    options = "--pyproject", "pyproject.toml", "--output-reproducible", "--of", "JSON"
    found: dict[str, Any] = json.loads(run(program, "environment", python, *options))
    for component in found["components"]:  # where this computer had a file is nobody's business
        references = component.get("externalReferences", [])
        component["externalReferences"] = [own for own in references if not own["url"].startswith("file:")]
    page = page_components()
    found["components"] = sorted([*found["components"], *page], key=lambda own: str(own["bom-ref"]))
    root = found["metadata"]["component"]["bom-ref"]
    for entry in found["dependencies"]:
        if entry["ref"] == root:
            entry["dependsOn"] = sorted({*entry.get("dependsOn", []), *(own["bom-ref"] for own in page)})
    found["dependencies"] += [{"ref": own["bom-ref"]} for own in page]
    return found


def page_components() -> list[dict[str, Any]]:
    """List the libraries in the page's files, of which a wheel has no metadata."""
    lock = json.loads((ROOT / "server" / "web" / "package-lock.json").read_text())
    found = []
    for place, entry in lock["packages"].items():
        if place and not entry.get("dev") and not entry.get("optional"):
            name = place.rpartition("node_modules/")[2]
            kind, _, digest = entry["integrity"].partition("-")
            purl = f"pkg:npm/{quote(name, safe='/')}@{entry['version']}"
            found.append(
                {
                    "bom-ref": purl,
                    "type": "library",
                    "name": name,
                    "version": entry["version"],
                    "purl": purl,
                    "licenses": [{"license": {"id": entry["license"]}}],
                    "hashes": [{"alg": f"SHA-{kind.removeprefix('sha')}", "content": base64.b64decode(digest).hex()}],
                }
            )
    return found


def sign(files: Sequence[Path], key: Path) -> Path:
    """Write the checksums of files beside them, and their signature, which is returned."""
    sums = files[0].parent / SUMS
    lines = [f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in sorted(files)]
    sums.write_text("".join(lines))
    signature = sums.with_name(f"{SUMS}.sig")
    signature.unlink(missing_ok=True)
    run("ssh-keygen", "-Y", "sign", "-f", key, "-n", NAMESPACE, sums)
    return signature


def main(arguments: Sequence[str] | None = None) -> int:
    """Make a release; 0 done, 2 nothing was released."""
    parser = argparse.ArgumentParser(description="wheel, sources, bill of materials, signed checksums")
    parser.add_argument("--key", help="private key (ssh) of whoever releases, or the public one of a key in ssh-agent")
    parser.add_argument("--dist", type=Path, default=ROOT / "dist")
    parser.add_argument("--environment", type=Path, help="interpreter of an environment that has all of it already")
    given = parser.parse_args(arguments)
    try:
        key = check_key(given.key)
        given.dist.mkdir(parents=True, exist_ok=True)
        if any(given.dist.iterdir()):
            raise ReleaseError(f"{given.dist} is not empty; move what is in it away")
        archive, wheel = build(given.dist)
        with tempfile.TemporaryDirectory() as directory:
            python = given.environment or install(wheel, Path(directory, "environment"))
            content = bill_of_materials(python.absolute())
        bill = archive.with_name(archive.name.replace(".tar.gz", ".cdx.json"))
        bill.write_text(json.dumps(content, indent=2) + "\n")
        signature = sign([archive, wheel, bill], key)
    except ReleaseError as error:
        print(f"release: {error}", file=sys.stderr)
        return 2
    print(f"{given.dist}: {', '.join(path.name for path in (wheel, archive, bill))}, {SUMS}, {signature.name}")
    print("whoever takes them checks, with your public key in allowed_signers (NAME namespaces=... ssh-ed25519 ...):")
    print(f"  ssh-keygen -Y verify -f allowed_signers -I NAME -n {NAMESPACE} -s {signature.name} < {SUMS}")
    print(f"  sha256sum --check {SUMS}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
