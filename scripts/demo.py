"""`./run demo`: two laws follow the straight path; a table, a figure, a strip of pictures."""

from __future__ import annotations

import sys
from pathlib import Path

from rich.console import Console

from endolock.scripts import cli


def main(args: list[str]) -> int:
    """Run the demo; `args` are further options of `endolock compare`."""
    from endolock.scripts import compare, recorder, rrd, run, strip  # cli.guarded says what fails

    console = Console()
    request = cli.parse(compare.Request, "./run demo", ["--scenarios", "straight", *args])
    place = request.out or recorder.new_path(Path("runs"), "demo")
    records, folders = compare.perform(request, place)
    first = folders[0]
    with console.status("writing errors.png, strip.png and run.rrd"):
        errors = compare.draw(records, folders, place / "errors.png")
        picture = strip.write(first, place / "strip.png")
        rrd.derive(first)
    console.print(run.table(records))
    for what, where in (
        ("error over time", errors),
        ("what the tip camera saw", picture),
        ("look into a run", f"./run endolock view {first}"),
    ):
        console.print(f"{what}: {where}", soft_wrap=True, highlight=False)
    return 130 if records[-1]["interrupted"] else 0


if __name__ == "__main__":
    sys.exit(cli.guarded(main, sys.argv[1:]))
