"""Endolock chooses how MuJoCo renders, so it must be imported before any test imports mujoco."""

import endolock  # noqa: F401
