"""Tests the built extension in the Blender that Debian ships, in a chroot of its own, and photographs its sidebar.

    .venv/bin/python tools/real_blender.py trixie                   4.3.2; required
    .venv/bin/python tools/real_blender.py sid --best-effort        5.2; where it cannot be had, that is reported
    .venv/bin/python tools/real_blender.py trixie --picture P.png   only the picture

The chroot is made once, in .build/chroot-SUITE (2 GB, a minute or two), and holds no mounts. Needs root and apt.
The extension is installed from the zip into a profile that was empty, by Blender's own command; then the tests of
tests/blender/inside run in it, its command line finds the light of a real photo, and the interface shows what it found.
"""

import argparse
import fcntl
import os
import shutil
import subprocess
import sys
from pathlib import Path

import skimage

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = [
    *["blender", "python3-scipy", "python3-requests", "python3-openimageio", "python3-pytest"],
    *["xvfb", "xauth", "libgl1-mesa-dri", "imagemagick"],
]
SUITE_PACKAGES = {"trixie": [], "sid": ["python3-cattr"]}
WORK = "/reshade"  # in the chroot: what is tested, and its profile


class Unavailable(Exception):
    """This suite's Blender cannot be had here today."""


class Chroot:
    """A Debian suite with Blender in it."""

    def __init__(self, suite: str) -> None:
        self.suite = suite
        self.root = ROOT / ".build" / f"chroot-{suite}"
        self.work = self.root / WORK.lstrip("/")

    def run(self, *command: str, seconds: int, capture: bool = False) -> subprocess.CompletedProcess[str]:
        """Run a command inside, in the work folder, killed after `seconds`. Its output goes where ours goes, or to
        `stdout` of what is returned."""
        environment = {
            "HOME": "/root",
            "LANG": "C.UTF-8",
            "PATH": "/usr/sbin:/usr/bin:/sbin:/bin",
            "DEBIAN_FRONTEND": "noninteractive",
            "BLENDER_USER_RESOURCES": f"{WORK}/profile",
        }
        inside = ["timeout", "--kill-after=10", str(seconds), *command]
        return subprocess.run(
            ["chroot", str(self.root), "sh", "-c", 'cd "$0" 2>/dev/null; exec "$@"', WORK, *inside],
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE if capture else None,
            stderr=subprocess.STDOUT if capture else None,
            text=True,
        )

    def make(self) -> None:
        """Debian's base and Blender, unless they are there."""
        ready = self.root / "ready"
        if ready.exists():
            return
        if os.geteuid() != 0:
            raise Unavailable("A chroot needs root")
        self.root.parent.mkdir(exist_ok=True)
        with (self.root.parent / "debootstrap.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # two suites may be made at a time
            if shutil.which("debootstrap") is None:
                install = ["apt-get", "install", "-y", "-qq", "--no-install-recommends", "debootstrap"]
                subprocess.run(["apt-get", "update", "-qq"], check=True)
                subprocess.run(install, check=True)
        print(f"making {self.root.relative_to(ROOT)}", flush=True)
        shutil.rmtree(self.root, ignore_errors=True)
        log = self.root.with_suffix(".log")
        with log.open("w") as out:
            done = subprocess.run(
                ["debootstrap", "--variant=minbase", self.suite, str(self.root)], stdout=out, stderr=subprocess.STDOUT
            )
        if done.returncode != 0:
            raise Unavailable(f"debootstrap failed, see {log.relative_to(ROOT)}")
        # sid's release file may be older than a mirror's snapshot promises
        (self.root / "etc/apt/apt.conf.d/99reshade").write_text('Acquire::Check-Valid-Until "false";\n')
        packages = [*PACKAGES, *SUITE_PACKAGES[self.suite]]
        apt = f"apt-get update -qq && apt-get install -y -qq --no-install-recommends {' '.join(packages)}"
        if self.run("sh", "-c", f"({apt}) >/var/log/reshade-apt.log 2>&1", seconds=900).returncode != 0:
            raise Unavailable(f"apt-get failed, see {self.root.relative_to(ROOT)}/var/log/reshade-apt.log")
        ready.touch()

    def install(self, zip_path: Path) -> None:
        """The tests and what they read, and the extension from its zip, in an empty profile."""
        shutil.rmtree(self.work, ignore_errors=True)
        self.work.mkdir()
        for folder in ("tests", "demo_blend"):
            shutil.copytree(ROOT / folder, self.work / folder, ignore=shutil.ignore_patterns("__pycache__"))
        photo = Path(skimage.__file__).parent / "data" / "coffee.png"
        for path in (ROOT / "pyproject.toml", ROOT / "tools" / "sidebar_picture.py", zip_path, photo):
            shutil.copy(path, self.work)
        self.check(
            "blender", "--command", "extension", "install-file", "-r", "user_default", "-e", zip_path.name, seconds=120
        )

    def check(self, *command: str, seconds: int) -> None:
        """Run inside; what fails ends the script with its exit code."""
        code = self.run(*command, seconds=seconds).returncode
        if code != 0:
            raise SystemExit(f"Failed with {code} in {self.suite}: {' '.join(command)}")

    def test(self) -> None:
        """The tests in `inside`, but for those that ask Cycles about mathematics, not this Blender about the add-on."""
        self.run("blender", "--version", seconds=60)
        self.check(
            *["blender", "--background", "--python-exit-code", "1", "--python", "tests/blender/run_inside.py"],
            *["--", "-rs", "-m", "not oracle", "tests/blender/inside"],
            seconds=1200,
        )

    def estimate(self) -> None:
        """The light of the coffee photo by the command line, into lit.blend."""
        # saved again first: the command refuses a file from a newer Blender, as it should
        save = "import bpy; bpy.ops.wm.save_as_mainfile(filepath='scene.blend')"
        self.check("blender", "--background", "demo_blend/coffee.blend", "--python-expr", save, seconds=60)
        self.check(
            *["blender", "--background", "--command", "reshade", "estimate", "--quality", "draft"],
            *["--scene", "scene.blend", "--photo", "coffee.png", "--output", "lit.blend"],
            seconds=300,
        )

    def take_picture(self, picture: Path) -> None:
        """The interface with lit.blend and the Reshade tab open, as it looks on a screen of 1600 x 1000."""
        inside = ["blender", "lit.blend", "--window-geometry", "0", "0", "1600", "1000", "--python-exit-code", "1"]
        done = self.run(
            *["xvfb-run", "-a", "-s", "-screen 0 1600x1000x24", *inside],
            *["--python", "sidebar_picture.py", "--", "sidebar.png"],
            seconds=180,
            capture=True,
        )
        print(done.stdout, flush=True)
        if done.returncode != 0 or "Traceback" in done.stdout:  # Blender goes on when a panel fails to draw
            raise SystemExit(f"No picture of the sidebar in {self.suite}, or a panel that fails to draw")
        picture.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(self.work / "sidebar.png", picture)
        print(f"the sidebar of {self.suite}'s Blender: {picture}", flush=True)


def main() -> None:
    """Make, install, test, photograph."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("suite", choices=sorted(SUITE_PACKAGES))
    parser.add_argument("--best-effort", action="store_true", help="report an absent Blender instead of failing")
    parser.add_argument("--picture", type=Path, help="take only the picture, to this file")
    options = parser.parse_args()
    chroot = Chroot(options.suite)
    try:
        chroot.make()
    except Unavailable as absence:
        print(f"NOT TESTED in {options.suite}'s Blender: {absence}.", flush=True)
        sys.exit(0 if options.best_effort else 1)
    (zip_path,) = (ROOT / "dist").glob("reshade-*-linux_x64.zip")
    chroot.install(zip_path)
    if options.picture is None:
        chroot.test()
    chroot.estimate()
    chroot.take_picture(options.picture or ROOT / "out" / f"sidebar-{options.suite}.png")


if __name__ == "__main__":
    main()
