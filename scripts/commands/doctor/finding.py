"""Results of the checks of `endolock doctor`."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """Result of one check."""

    name: str
    """Name of the check."""
    ok: bool
    """Whether the check passed."""
    text: str
    """What was found."""
    advice: str = ""
    """What to do next; empty if the check passed."""
