"""The built zips: what is in them, and whether what they install works in Blender 5.2 and 4.5 as Python modules."""

import os
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
INSIDE = "tests/blender/inside"
SMOKE_PYTHON = ROOT / ".build/venv-4.5/bin/python"
PLATFORMS = ["linux_x64", "windows_x64", "macos_arm64"]


def zip_for(platform: str) -> Path:
    """The zip that `make extension` built."""
    version = tomllib.loads((ROOT / "blender_manifest.toml").read_text())["version"]
    return ROOT / "dist" / f"reshade-{version}-{platform}.zip"


def run_inside(python: Path, profile: Path, *pytest_arguments: str, seconds: int) -> None:
    """Install the Linux zip into an empty profile and run tests there; fails with their output."""
    command = [python, "tests/blender/run_inside.py", "--", "--zip", zip_for("linux_x64"), *pytest_arguments]
    done = subprocess.run(
        list(map(str, command)),
        cwd=ROOT,
        env={**os.environ, "BLENDER_USER_RESOURCES": str(profile)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=seconds,
    )
    print(done.stdout)
    assert done.returncode == 0


@pytest.mark.parametrize("platform", PLATFORMS)
def test_zip_holds_what_runs_and_nothing_else(platform: str) -> None:
    with zipfile.ZipFile(zip_for(platform)) as archive:
        names = archive.namelist()
    top = {name.split("/")[0] for name in names}
    assert top == {"__init__.py", "blender_manifest.toml", "LICENSE", "README.md", "core", "reshade_addon", "wheels"}
    assert [name for name in names if name.endswith(".pyc") or "/." in name] == []
    wheels = sorted(name.split("-")[2] for name in names if name.endswith(".whl"))
    assert wheels == ["cp311", "cp313", "cp314"]


def test_installed_in_the_blender_of_this_environment(tmp_path: Path) -> None:
    """Everything in `inside`, in a Blender whose profile was empty before: 5.2 where Python 3.13 is to be had."""
    run_inside(Path(sys.executable), tmp_path, INSIDE, seconds=1200)


@pytest.mark.skipif(not SMOKE_PYTHON.exists(), reason="no Python 3.11, so no Blender 4.5")
def test_installed_in_blender_4_5(tmp_path: Path) -> None:
    """The same where neither Python, numpy nor Blender is new, and the only scipy is the extension's own."""
    run_inside(SMOKE_PYTHON, tmp_path, f"{INSIDE}/test_installed.py", seconds=300)


def test_command_line_says_what_is_wrong_in_one_line(tmp_path: Path) -> None:
    """`.venv/bin/reshade` reaches the add-on, and its exit code reaches the shell."""
    command = [Path(sys.executable).parent / "reshade", "estimate", "--scene", "none.blend", "--photo", "none.png"]
    done = subprocess.run(list(map(str, command)), cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []
