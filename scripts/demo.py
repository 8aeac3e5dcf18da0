"""`./run demo`: holding still and two controllers on a straight path; table, figure, pictures."""

from __future__ import annotations

import sys
from pathlib import Path

from rich.console import Console

from endolock.scripts import cli


def main(args: list[str]) -> int:
    """Run the demo; `args` are further options of `endolock compare`."""
    # Imported here, so that cli.guarded reports import errors.
    from endolock.scripts.commands import compare
    from endolock.scripts.figures import error_figure, rerun_export, strip
    from endolock.scripts.runs import output, record_table, run_folder
    from endolock.scripts.runs.experiment import RUNS
    from endolock.scripts.runs.series import run_all

    request = cli.parse(compare.Request, "./run demo", ["--scenarios", "straight", *args])
    output.check_json(request.json)
    console = Console(stderr=request.json == "-")
    with run_folder.series_folder(request.out, RUNS, "demo") as folder:
        series = run_all(compare.plan(request, folder))
    records = series.records
    moving = (record for record in records if record.controller != "still")
    first = next(moving, records[0]).folder
    results: dict[str, Path | str] = {}
    with console.status("writing errors.png, strip.png and run.rrd"):
        results["error over time"] = error_figure.draw(records, folder / "errors.png")
        if strip.pictures(first):
            results["what the tip camera saw"] = strip.write(first, folder / "strip.png")
        rerun_export.derive(first)
    output.write_json({"rows": [record.as_dict() for record in records]}, request.json)
    if request.json != "-":
        console.print(record_table.table(records))
        console.print(record_table.handles(records))
        for line in record_table.legend(records):
            console.print(line, soft_wrap=True, highlight=False)
        results["look into a run"] = f"./run endolock view {first}"
        for label, result in results.items():
            console.print(f"{label}: {result}", soft_wrap=True, highlight=False, markup=False)
    series.conclude()
    return 0


if __name__ == "__main__":
    sys.exit(cli.guarded(main, sys.argv[1:]))
