"""Endolock chooses how MuJoCo renders, so it must be imported before any test imports mujoco."""

from hypothesis import settings

import endolock  # noqa: F401

# The machine may be busy: the time that one example takes means nothing.
settings.register_profile("endolock", deadline=None)
settings.load_profile("endolock")
