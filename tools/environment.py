"""Makes the two environments Reshade is run and tested in, from nothing but Python 3.11 or later.

    python3 tools/environment.py main     .venv: Python 3.13 with Blender 5.2, else Python 3.11 with Blender 4.5
    python3 tools/environment.py smoke    .build/venv-4.5: Python 3.11 with Blender 4.5 and pytest, without scipy, so
                                          that the extension has to bring its own

Versions are pinned in requirements-*.txt. An environment that stands ends with a file `ready` in it; the Makefile asks
for that file, so a second run costs nothing. Where no Python 3.11 is to be had, `smoke` says so and leaves nothing.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
UV_VERSION = "0.13.9"

COMMAND = """#!/bin/sh
# Reshade's command line in Blender as a Python module; the same arguments as `blender --command reshade`.
exec "$(dirname "$(readlink -f "$0")")/python" -P -m reshade.tools.command_line "$@"
"""


def find_uv() -> str:
    """uv's path: the one on PATH, else one installed into .build/uv."""
    if found := shutil.which("uv"):
        return found
    private = ROOT / ".build" / "uv"
    if not (private / "bin" / "uv").exists():
        print("uv is not on PATH: installing it into .build/uv", flush=True)
        made = subprocess.run([sys.executable, "-m", "venv", "--clear", str(private)])
        if made.returncode != 0:
            raise SystemExit("This Python cannot make a venv. Install python3-venv, or put uv on PATH.")
        subprocess.run([str(private / "bin" / "pip"), "install", "--quiet", f"uv=={UV_VERSION}"], check=True)
    return str(private / "bin" / "uv")


def find_python(uv: str, version: str) -> str | None:
    """A Python of this version ("3.13"): on PATH, under pyenv, else fetched by uv; None where none is to be had."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    candidates = [shutil.which(f"python{version}"), *sorted(map(str, pyenv.glob(f"{version}.*/bin/python")))]
    for candidate in filter(None, candidates):
        # a pyenv shim is on PATH even where pyenv has that version switched off, so ask it
        asked = subprocess.run(
            [candidate, "-c", "import sys; print('%d.%d' % sys.version_info[:2], sys.executable)"],
            capture_output=True,
            text=True,
        )
        if asked.returncode == 0 and asked.stdout.split()[0] == version:
            return asked.stdout.split(maxsplit=1)[1].strip()
    if subprocess.run([uv, "python", "install", "--quiet", version]).returncode != 0:
        return None
    found = subprocess.run([uv, "python", "find", version], capture_output=True, text=True)
    return found.stdout.strip() if found.returncode == 0 else None


def make(uv: str, python: str, directory: Path, *requirements: str) -> Path:
    """A new environment in `directory` with `requirements` (arguments of pip install); its site-packages."""
    print(f"{directory.relative_to(ROOT)}: {python}, {' '.join(requirements)}", flush=True)
    shutil.rmtree(directory, ignore_errors=True)
    subprocess.run([uv, "venv", "--quiet", "--python", python, str(directory)], check=True)
    subprocess.run(
        [uv, "pip", "install", "--quiet", "--python", str(directory / "bin" / "python"), *requirements],
        check=True,
        cwd=ROOT,
    )
    return next((directory / "lib").glob("python*")) / "site-packages"


def main_environment(uv: str) -> None:
    """.venv, with this clone as the package `reshade` and the command `reshade`."""
    directory = ROOT / ".venv"
    blender = "5.2"
    python = find_python(uv, "3.13")
    if python is None:
        print("No Python 3.13 is to be had: Python 3.11 with Blender 4.5 instead", flush=True)
        blender = "4.5"
        python = find_python(uv, "3.11")
    if python is None:
        raise SystemExit("Neither Python 3.13 nor 3.11 is to be had. Install one of them.")
    packages = make(uv, python, directory, "-r", f"requirements-blender-{blender}.txt", "-r", "requirements-tools.txt")
    # Blender gives the extension's package its name; here the clone gets it by a link, whatever its folder is called
    (packages / "reshade").symlink_to(os.path.relpath(ROOT, packages), target_is_directory=True)
    command = directory / "bin" / "reshade"
    command.write_text(COMMAND)
    command.chmod(0o755)
    (directory / "ready").touch()


def smoke_environment(uv: str) -> None:
    """.build/venv-4.5, or a line that says why not."""
    python = find_python(uv, "3.11")
    if python is None:
        print("No Python 3.11 is to be had: Blender 4.5 is not tested", flush=True)
        return
    directory = ROOT / ".build" / "venv-4.5"
    make(uv, python, directory, "-r", "requirements-blender-4.5.txt", "-c", "requirements-tools.txt", "pytest")
    (directory / "ready").touch()


if __name__ == "__main__":
    {"main": main_environment, "smoke": smoke_environment}[sys.argv[1]](find_uv())
