"""The operators, one a file, in the order of the artist's story."""

from .estimate_light import RESHADE_OT_estimate_light
from .import_fspy import RESHADE_FH_fspy, RESHADE_OT_import_fspy
from .import_photo import RESHADE_FH_photo, RESHADE_OT_import_photo
from .paint_colours import RESHADE_OT_paint_colours
from .paint_gloss import RESHADE_OT_paint_gloss
from .preview import RESHADE_OT_preview
from .project_photo import RESHADE_OT_project_photo
from .remove_highlights import RESHADE_OT_remove_highlights
from .reshade import RESHADE_OT_reshade
from .save_reshaded import RESHADE_OT_save_reshaded
from .solve_materials import RESHADE_OT_solve_materials
from .solve_painting import RESHADE_OT_solve_painting

CLASSES = (
    RESHADE_OT_import_photo,
    RESHADE_FH_photo,
    RESHADE_OT_import_fspy,
    RESHADE_FH_fspy,
    RESHADE_OT_project_photo,
    RESHADE_OT_estimate_light,
    RESHADE_OT_solve_materials,
    RESHADE_OT_preview,
    RESHADE_OT_solve_painting,
    RESHADE_OT_paint_colours,
    RESHADE_OT_paint_gloss,
    RESHADE_OT_reshade,
    RESHADE_OT_save_reshaded,
    RESHADE_OT_remove_highlights,
)
