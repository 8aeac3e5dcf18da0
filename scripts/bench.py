"""placeholder"""
from dataclasses import dataclass
@dataclass(frozen=True)
class Request:
    """x."""
    json: str | None = None
