"""Build the distributions of the last commit in dist/, and try the wheel; nothing is uploaded.

    .venv/bin/python .ci/release.py

The version must be the same everywhere, CITATION.cff valid, and all extras together installable on
each Python. The wheel is then installed in a fresh environment outside of the checkout, and drives.
"""

from __future__ import annotations

import io
import os
import re
import subprocess
import sys
import tarfile
import tempfile
import tomllib
import venv
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
DIST = ROOT / "dist"
BIN = Path(sys.executable).parent
PYTHONS = ("3.11", "3.12", "3.13")
NO_WHEELS = ("empy", "docopt")
"""Packages of ROS 2 and of cffconvert that have source distributions alone, in pure Python."""
TRIAL = """\
foresee --version
foresee check compact
foresee corridor --route fixed --episodes 1 --arms known,predicted --risk 0.02 --out run
foresee plot run --episode 0 --race --format gif
python -c "import foresee; foresee.plot(foresee.drive('office')).savefig('figure.png')"
"""
"""Commands that an installed wheel must be able to run."""


def versions(root: Path) -> dict[str, str]:
    """Return file → version that it states."""
    patterns = {
        "pyproject.toml": r'^version = "(.+)"$',
        "CHANGELOG.md": r"^## (\S+)",
        "CITATION.cff": r"^version: (.+)$",
        "ros2/foresee_navigator/package.xml": r"<version>(.+)</version>",
        "ros2/foresee_navigator/setup.py": r'^    version="(.+)",$',
    }
    found = {}
    for name, pattern in patterns.items():
        match = re.search(pattern, (root / name).read_text("utf-8"), re.MULTILINE)
        found[name] = match[1] if match else "none"
    return found


def for_index(readme: str, project: dict[str, Any]) -> str:
    """Return the README as the package index shows it, where no relative link leads anywhere.

    Links and pictures lead to the repository in [project.urls]. Without one, a link becomes its
    text, and a picture is left out, with its caption in italics.

    Args:
        readme: text of README.md.
        project: table `project` of pyproject.toml.
    """
    repository = project.get("urls", {}).get("Repository")
    if repository is None:
        readme = re.sub(r"!\[[^]]*\]\([^)]+\)\n\n(\*[^*]+\*\n\n)?", "", readme)

    def absolute(match: re.Match[str]) -> str:
        picture, text, target = match.groups()
        if repository is None:
            return text
        kind, path = "raw" if picture else "blob", "README.md" if target[0] == "#" else ""
        return f"{picture}[{text}]({repository}/{kind}/v{project['version']}/{path}{target})"

    return re.sub(r"(!?)\[([^]]*)\]\((?!https?://)([^)\s]+)\)", absolute, readme)


def run(*command: str | Path, cwd: Path = ROOT) -> None:
    """Run a command; if it fails, this one ends as well."""
    print("+", *command, flush=True)
    # A checkout on the path would take the place of the wheel.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    subprocess.run([str(word) for word in command], cwd=cwd, env=environment, check=True)


def build(folder: Path) -> Path:
    """Build the distributions of the last commit in `DIST`, and return the wheel.

    Args:
        folder: empty folder, for a copy of the commit.
    """
    archive = subprocess.run(["git", "archive", "HEAD"], cwd=ROOT, check=True, capture_output=True)
    with tarfile.open(fileobj=io.BytesIO(archive.stdout)) as files:
        files.extractall(folder, filter="data")
    project = tomllib.loads((folder / "pyproject.toml").read_text("utf-8"))["project"]
    readme = folder / "README.md"
    readme.write_text(for_index(readme.read_text("utf-8"), project), "utf-8")
    stem = f"{project['name'].replace('-', '_')}-{project['version']}"
    for old in DIST.glob(f"{stem}*"):
        old.unlink()
    # The wheel is built from the source distribution, which must therefore be complete.
    run(sys.executable, "-m", "build", "--outdir", DIST, folder)
    run(sys.executable, "-m", "twine", "check", "--strict", *DIST.glob(f"{stem}*"))
    return next(DIST.glob(f"{stem}*.whl"))


def main() -> None:
    """Check, build and try."""
    stated = versions(ROOT)
    if len(set(stated.values())) > 1:
        sys.exit(f"the versions differ: {stated}")
    if subprocess.run(["git", "diff", "--quiet", "HEAD"], cwd=ROOT, check=False).returncode:
        sys.exit("there are changes that are not committed: a release is made from a commit")
    run(BIN / "cffconvert", "--validate", "-i", "CITATION.cff")
    resolve = (BIN / "uv", "pip", "compile", "pyproject.toml", "--all-extras", "--quiet")
    wheels = ("--only-binary", ":all:", *(f"--no-binary={name}" for name in NO_WHEELS))
    for python in PYTHONS:
        pins = ("-c", "constraints.txt", "--output-file", "/dev/null")
        run(*resolve, *wheels, *pins, "--python-version", python)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "source").mkdir()
        wheel = build(folder / "source")
        venv.create(folder / "venv", with_pip=True)
        binaries = folder / "venv" / "bin"
        run(binaries / "pip", "install", "--quiet", "-c", ROOT / "constraints.txt", wheel)
        for line in TRIAL.splitlines():
            run("bash", "-c", f'PATH="{binaries}:$PATH" && {line}', cwd=folder)
    print(f"\n{wheel} works. To upload: twine upload {wheel.parent / wheel.name.split('-py3')[0]}*")


if __name__ == "__main__":
    main()
