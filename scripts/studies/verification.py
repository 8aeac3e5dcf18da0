"""All checks of the twin: what is compared, the figure, its bounds and their reason.

The tests require each figure to be within its bounds; `./run docs` writes them into the model card,
and `./run python -m endolock.scripts.studies.verification` prints them.
"""

from __future__ import annotations

import sys
from math import inf

from rich.console import Console
from rich.table import Table

from endolock.scripts import cli
from endolock.scripts.checks import behaviour_checks, closed_form_checks
from endolock.scripts.checks.check import Check

CHECKS = (*closed_form_checks.CHECKS, *behaviour_checks.CHECKS)
"""All checks, in the order of the model card."""


def main(_args: list[str]) -> int:
    """Print all figures; return 0 if each is within its bounds."""
    console = Console()
    table = Table(title="checks of the twin")
    for heading in ("what", "against", "figure", "bounds"):
        table.add_column(heading, justify="right" if heading == "figure" else "left")
    good = True
    with Console(stderr=True).status("measuring") as status:
        for check in CHECKS:
            status.update(check.what)
            figure = check.measure()
            good &= check.low <= figure <= check.high
            table.add_row(check.what, check.against, f"{figure:.3g} {check.unit}", bounds(check))
    console.print(table)
    return 0 if good else 1


def bounds(check: Check) -> str:
    """Return the bounds of a check as text."""
    if check.low == -inf:
        return f"at most {check.high:g}"
    return f"{check.low:g} to {check.high:g}" if check.high < inf else f"at least {check.low:g}"


if __name__ == "__main__":
    sys.exit(cli.guarded(main, sys.argv[1:]))
