"""What is installed is what was built, and it works in this Blender."""

import bpy
import numpy as np
import scipy.optimize


def test_the_installed_package_is_the_one_under_test(addon):
    assert addon.__name__ == "bl_ext.user_default.reshade"
    assert "extensions" in addon.__file__


def test_the_extension_stays_enabled_when_a_new_file_is_opened(addon, fresh_scene):
    assert "bl_ext.user_default.reshade" in bpy.context.preferences.addons
    assert not bpy.data.objects


def test_scipy_works_with_the_numpy_of_this_blender():
    """A wheel built against another numpy imports or not; that it computes is what counts."""
    fit = scipy.optimize.least_squares(lambda x: x**2 - 2.0, np.array([1.0, 3.0]))
    np.testing.assert_allclose(fit.x, np.sqrt([2.0, 2.0]), rtol=1e-8)


def test_register_and_unregister_are_inverses(addon):
    addon.unregister()
    addon.register()
