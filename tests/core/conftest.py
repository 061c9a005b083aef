"""Hypothesis draws the same examples every time, and takes as long as it needs."""

import hypothesis

hypothesis.settings.register_profile("repeatable", derandomize=True, deadline=None)
hypothesis.settings.load_profile("repeatable")
