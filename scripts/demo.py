"""`./run demo`: holding still, the best simple law and the lock; table, figure, pictures."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from endolock.scripts import cli

LAWS = ("still", "pi_hc", "predictive_bank")
"""Holding still, the simple law with the least error on `straight` (docs/benchmark.md), and the
lock."""
DURATION_S, LEARNT_S = 50.0, 25.0
"""Duration of a run, and the time in it that controllers have to learn before they are scored [s].
Assumed: three strokes each."""


def main(args: list[str]) -> int:
    """Run the demo; `args` are further options of `endolock compare`."""
    # Imported here, so that cli.guarded reports import errors.
    from endolock.scripts.commands import compare
    from endolock.scripts.figures import error_figure, rerun_export, strip
    from endolock.scripts.runs import output, record_table, run_folder
    from endolock.scripts.runs.experiment import RUNS
    from endolock.scripts.runs.series import run_all

    request = cli.parse(compare.Request, "./run demo", [*defaults(args), *args])
    output.check_json(request.json)
    console = Console(stderr=request.json == "-")
    with run_folder.series_folder(request.out, RUNS, "demo") as folder:
        series = run_all(compare.plan(request, folder))
    records = series.records
    best = records[-1].folder
    results: dict[str, Path | str] = {}
    with console.status("writing errors.png, strip.png and run.rrd"):
        results["error over time"] = error_figure.draw(records, folder / "errors.png")
        pictured = {r.controller: r.folder for r in records if strip.pictures(r.folder)}
        if pictured:
            drawn = strip.write(pictured, folder / "strip.png", records[0].scored_from_s)
            results["what the tip camera saw"] = drawn
        rerun_export.derive(best)
    output.write_json({"rows": [record.as_dict() for record in records]}, request.json)
    if request.json != "-":
        console.print(record_table.table(records))
        console.print(record_table.handles(records))
        for line in record_table.legend(records):
            console.print(line, soft_wrap=True, highlight=False)
        results["look into a run"] = f"./run endolock view {best}"
        for label, result in results.items():
            console.print(f"{label}: {result}", soft_wrap=True, highlight=False, markup=False)
    series.conclude()
    return 0


def defaults(args: Sequence[str]) -> list[str]:
    """Return the options of the demo that are not among the given ones.

    With another duration a run is scored from its start, unless the options say from when.
    """
    usual = {
        "--scenarios": ("straight",),
        "--controllers": LAWS,
        "--scored-from-s": (f"{LEARNT_S:g}",),
        "--duration-s": (f"{DURATION_S:g}",),
    }
    given = {arg.partition("=")[0].replace("_", "-") for arg in args}
    if "--duration-s" in given:
        given.add("--scored-from-s")
    return [word for name, words in usual.items() if name not in given for word in (name, *words)]


if __name__ == "__main__":
    sys.exit(cli.guarded(main, sys.argv[1:]))
