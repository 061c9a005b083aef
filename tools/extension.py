"""Builds the extension's zips into dist/, one a platform, with Blender's own builder, and validates each.

The wheels that the manifest names are fetched into wheels/ first; those already there are not fetched again.
"""

import importlib.util
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def fetch_wheels() -> None:
    """Bring the wheels of blender_manifest.toml into wheels/. A wheel's name says all that pip needs to find it."""
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text())
    for path in map(ROOT.joinpath, manifest["wheels"]):
        if path.exists():
            continue
        print(f"fetching {path.name}", flush=True)
        distribution, version, python, _, platforms = path.stem.split("-")
        subprocess.run(
            [
                sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--only-binary", ":all:",
                "--python-version", python.removeprefix("cp"), "--platform", platforms.split(".")[0],
                "--dest", str(path.parent), f"{distribution}=={version}",
            ],
            check=True,
        )  # fmt: skip
        if not path.exists():
            raise SystemExit(f"pip did not bring {path.name}. Compare its name with what is in wheels/.")


def blender_ext() -> str:
    """Path of Blender's extension builder, which needs no running Blender."""
    found = importlib.util.find_spec("bpy")
    if found is None or not found.submodule_search_locations:
        raise SystemExit("This Python has no bpy. Run: make extension")
    return str(next(Path(found.submodule_search_locations[0]).glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py")))


def build() -> None:
    """Fetch, build, validate."""
    fetch_wheels()
    dist = ROOT / "dist"
    shutil.rmtree(dist, ignore_errors=True)
    dist.mkdir()
    tool = [sys.executable, blender_ext()]
    subprocess.run(
        [*tool, "build", "--source-dir", str(ROOT), "--output-dir", str(dist), "--split-platforms"], check=True
    )
    for zip_path in sorted(dist.glob("*.zip")):
        subprocess.run([*tool, "validate", str(zip_path)], check=True)


if __name__ == "__main__":
    build()
