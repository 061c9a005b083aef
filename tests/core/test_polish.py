"""Samples of the last fit: half in penumbrae, if there are as many, and any first few of them with the same share."""

import numpy as np

from core.effort import EFFORTS
from core.light.polish import enriched
from core.light.sight import look
from core.radiance.lights import reach_of
from core.radiance.visibility import settled


def test_any_first_few_have_the_share_of_penumbrae_that_all_have(ball):
    effort, light = EFFORTS["draft"], ball.light()
    sight, _ = look(ball.photo(light), ball.camera, ball.buffers, ball.visible, None, 100)
    samples = enriched(sight, light, effort, True)
    edge = np.isnan(settled(light, samples, sight.visible, sight.far, 0.02 * reach_of(light, sight.middle)))
    assert edge[samples.penumbra].mean() > 0.9 and enriched(sight, light, effort, False).penumbra is None
    assert 0.1 < edge.mean() <= 0.55 and len(samples) == effort.samples
    for count in (100, 300, 900):
        np.testing.assert_allclose(edge[:count].mean(), edge.mean(), atol=0.03)
        weighed = [np.average(edge[:n], weights=samples.weight[:n]) for n in (count, len(edge))]
        np.testing.assert_allclose(*weighed, rtol=0.15)
