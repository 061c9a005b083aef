"""Runs Reshade's command line in Blender as a Python module. `.venv/bin/reshade` starts this."""

import sys

import reshade
from reshade.reshade_addon.cli import main


def run(arguments: list[str]) -> int:
    """What `blender --command reshade` does once the extension is enabled. Returns the exit code."""
    reshade.register()
    try:
        return main(arguments)
    finally:
        reshade.unregister()  # Blender 4.5 as a module hangs at exit on a class left registered


if __name__ == "__main__":
    sys.exit(run(sys.argv[1:]))
