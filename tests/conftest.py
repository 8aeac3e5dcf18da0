"""Endolock chooses how MuJoCo renders, so it must be imported before any test imports mujoco."""

from hypothesis import settings

import endolock  # noqa: F401

# Machines are shared: how long one example takes says nothing.
settings.register_profile("endolock", deadline=None)
settings.load_profile("endolock")
