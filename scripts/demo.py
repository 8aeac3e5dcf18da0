"""`./run demo`: the PI law follows the straight path for 25 s; a table, a run folder, a picture."""

from __future__ import annotations

import sys

from rich.console import Console

from endolock.scripts import cli


def main(args: list[str]) -> int:
    """Run the demo; `args` are further options of `endolock run`."""
    from endolock.scripts import rrd, run, strip  # cli.guarded explains what fails to load

    console = Console()
    request = cli.parse(run.Request, "./run demo", ["straight", "--controller", "pi", *args])
    record, folder = run.perform(request)
    with console.status("writing run.rrd and strip.png"):
        rrd.derive(folder)
        picture = strip.write(folder, folder / "strip.png")
    console.print(run.table([record]))
    console.print(f"what the tip camera saw: {picture}", soft_wrap=True, highlight=False)
    console.print(f"look into the run with: ./run endolock view {folder}", soft_wrap=True)
    return 130 if record["interrupted"] else 0


if __name__ == "__main__":
    sys.exit(cli.guarded(main, sys.argv[1:]))
