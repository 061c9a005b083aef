"""What a quality buys: users trade speed for accuracy, and this is the rate."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Effort:
    """How many samples, rays and trials an estimate and a solve take."""

    # The search, from its first look to its last fit
    refine_samples: int  # that say where a light may be
    search_samples: int  # that rank a grid of such places
    directions: int  # of that grid
    starts: int
    suns: int  # among them
    search_total: int  # samples of fits from starts
    fit_samples: int
    fit_rays: int
    finalists: int
    tolerance: float  # of the loss, to end a fit
    jumps: int  # out of small hollows of the loss (`light.hopping`)
    # The last fit and the materials
    samples: int
    pool: int  # from which those in penumbrae are chosen
    polish_rays: int
    most_rays: int  # for jumps and the last fit, where a photo is explained so well that they are worth it
    last_steps: int  # with so many rays that a photo's noise, not theirs, is what is left (`light.refinement`)
    gloss_rounds: int  # of gloss and albedos in turn
    around_rays: int  # from each sample to what surrounds it, where the lights are known


EFFORTS = {
    "draft": Effort(
        refine_samples=300,
        search_samples=150,
        directions=100,
        starts=3,
        suns=2,
        search_total=600,
        fit_samples=400,
        fit_rays=24,
        finalists=1,
        tolerance=1e-3,
        jumps=6,
        samples=1500,
        pool=4000,
        polish_rays=16,
        most_rays=16,
        last_steps=0,
        gloss_rounds=1,
        around_rays=128,
    ),
    "standard": Effort(
        refine_samples=600,
        search_samples=250,
        directions=240,
        starts=6,
        suns=3,
        search_total=1600,
        fit_samples=800,
        fit_rays=64,
        finalists=2,
        tolerance=3e-4,
        jumps=24,
        samples=4000,
        pool=12000,
        polish_rays=16,
        most_rays=64,
        last_steps=4,
        gloss_rounds=2,
        around_rays=512,
    ),
    "accurate": Effort(
        refine_samples=1200,
        search_samples=400,
        directions=400,
        starts=8,
        suns=4,
        search_total=5000,
        fit_samples=2500,
        fit_rays=144,
        finalists=3,
        tolerance=1e-4,
        jumps=24,
        samples=10000,
        pool=30000,
        polish_rays=64,
        most_rays=64,
        last_steps=4,
        gloss_rounds=2,
        around_rays=512,
    ),
}
QUALITIES = tuple(EFFORTS)
