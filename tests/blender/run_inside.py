"""Runs pytest inside a Python that has Blender in it, with the extension installed and enabled.

    python tests/blender/run_inside.py -- --zip dist/reshade.zip tests/blender/inside       the bpy wheel
    blender --background --python tests/blender/run_inside.py -- tests/blender/inside       a real Blender

`--zip` installs that extension first; without it, the profile must have it installed. Everything else is pytest's.
Set BLENDER_USER_RESOURCES to an empty folder beforehand, so that the user's own profile is neither used nor changed.
The exit code is pytest's.
"""

import argparse
import sys

import bpy

MODULE = "bl_ext.user_default.reshade"


def main(arguments: list[str]) -> int:
    """Install if asked, enable, test, disable. Returns pytest's exit code."""
    import addon_utils  # on the path once bpy is imported

    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--zip")
    options, pytest_arguments = parser.parse_known_args(arguments)
    if options.zip:
        bpy.ops.extensions.package_install_files(
            filepath=options.zip, repo="user_default", enable_on_install=True, overwrite=True
        )
    if not addon_utils.check(MODULE)[1] and addon_utils.enable(MODULE) is None:
        print(f"{MODULE} is not installed or does not register", file=sys.stderr)
        return 1

    import pytest

    # Blender 4.3 tells every step of a render on stdout
    code = pytest.main(["-p", "no:cacheprovider", "--show-capture=stderr", *pytest_arguments])
    addon_utils.disable(MODULE)  # Blender 4.5 as a module hangs at exit on a class left registered
    return int(code)


if __name__ == "__main__":
    sys.exit(main(sys.argv[sys.argv.index("--") + 1 :]))
