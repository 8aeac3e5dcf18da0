"""What the checks of the doctor find."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """What one check found."""

    name: str
    """Of the check."""
    ok: bool
    """Whether all is well."""
    text: str
    """What was found."""
    advice: str = ""
    """What to do next; empty if all is well."""
