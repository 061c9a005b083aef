"""Which photos last steps are taken for, and with how many rays."""

from dataclasses import replace

import numpy as np
import pytest

from core.effort import EFFORTS
from core.light import polish
from core.light.fit import fit_light, rays_worth
from core.light.sight import asked, look
from core.progress import drain
from core.radiance.lights import moved, reach_of

EFFORT = EFFORTS["standard"]


@pytest.mark.parametrize(("noise", "taken"), [(0.012, True), (0.06, False)])
def test_a_photo_explained_to_a_hundredth_is_worth_last_steps(ball, monkeypatch, noise, taken):
    """Its few rays' noise adds to what the first fit leaves over, so it looks worth fewer rays than it is."""
    true = ball.light()
    clean = ball.photo(true)
    rng = np.random.default_rng(0)
    photo = replace(clean, linear=clean.linear * (1 + noise * rng.normal(size=clean.linear.shape)))
    sight, samples = look(photo, ball.camera, ball.buffers, ball.visible, None, 700)
    here = drain(asked(sight, samples))
    problem = here.problem(sight, len(samples), EFFORT.polish_rays)
    start = replace(moved(true, np.full(8, 0.02), reach_of(true, problem.middle)), radiance=np.ones(3))
    fit = drain(fit_light(problem, start, iterations=8))
    asked_for = []

    def refined(few, fit, **_):
        asked_for.append(few.rays)
        yield 0.0
        return fit

    monkeypatch.setattr(polish, "refined", refined)
    drain(polish.finished(sight, here, fit, EFFORT))
    worth = rays_worth(fit, problem, 10_000)
    assert (64 <= worth < 128) if taken else worth < 64
    assert asked_for == ([1024, 4096] if taken else [])
