"""Host-side tests are here; those in `inside` need a Python with Blender in it and are started by `run_inside.py`."""

import sys

collect_ignore = [] if "bpy" in sys.modules else ["inside"]
