"""OpenGL does not survive a fork: a picture in the child of a process that rendered hangs for ever.

So does the end of that child, where MuJoCo closes the EGL display. The child forgets the display.
"""

from __future__ import annotations

import os
import sys
from typing import Any

from endolock.hw.api import ConfigError

_used = False
"""Whether this process or one that it was forked from has begun to render."""
_inherited = False
"""Whether a process that this one was forked from had begun to render."""


def check_first_use() -> None:
    """Check, before OpenGL is used, that no parent had used it when this process was forked.

    Raises:
        ConfigError: a parent had used it.
    """
    global _used
    if _inherited:
        raise ConfigError(
            "pictures cannot be rendered in a process forked from one that has rendered (OpenGL "
            "would hang)",
            "use the start method spawn: multiprocessing.get_context('spawn'), or "
            "AsyncVectorEnv(..., context='spawn')",
        )
    _used = True


def _after_fork() -> None:
    """Note in a new process what its parent did, also by MuJoCo's own renderer."""
    global _inherited
    egl: Any = sys.modules.get("mujoco.egl")
    if _used or (egl is not None and egl.EGL_DISPLAY is not None):
        _inherited = True
    if egl is not None:
        egl.EGL_DISPLAY = None


if sys.platform != "win32":
    os.register_at_fork(after_in_child=_after_fork)
