"""`./run docs`: writes again everything in docs/ and models/ that is generated."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import json
import shutil
import sys
import tempfile
from itertools import product
from pathlib import Path
from typing import Any

from rich.console import Console

from endolock.scripts import cli, run, strip
from endolock.twin import generate, scenario
from endolock.twin.instrument import Instrument

ROOT = Path(__file__).resolve().parents[1]
START, END = "<!-- parameters -->", "<!-- end -->"
HEADINGS = ("scenario", "law", "rms px", "p95 px", "max px", "seen rms px", "vision rms px", "lost")
HEAD = """# Results

Written by `./run docs`; seed 0, 0.4 s of latency, 640x480 px at f = 262 px, start included.
*rms*, *p95* and *max* are of the true error at every control tick, *seen* is what vision saw, 0.4 s
old. The laws are our reproductions of two of the thesis', with assumed gains, on the twin; nothing
here was measured on an endoscope.
"""


def main(_args: list[str]) -> int:
    """Regenerate the model with its card, then docs/results.md and docs/strip.png."""
    console = Console(stderr=True)
    console.print("models/endoscope")
    generate.main()
    card = generate.folder() / "README.md"
    before, rest = card.read_text(encoding="utf-8").split(START, 1)
    after = rest.split(END, 1)[1]
    card.write_text(f"{before}{START}\n{parameters()}{END}{after}", encoding="utf-8")
    for_editors = generate.folder().parent / "scenarios" / "schema.json"
    for_editors.write_text(schema(), encoding="utf-8")
    records = []
    for name, law in product(scenario.names(), ("pi", "ik")):
        with tempfile.TemporaryDirectory() as place:
            request = run.Request(scenario=name, controller=law, out=Path(place) / "run")
            record, folder = run.perform(request)
            if record["interrupted"]:
                raise KeyboardInterrupt
            records.append(record)
            if (name, law) == ("straight", "pi"):
                shutil.copy(strip.write(folder, folder / "strip.png"), ROOT / "docs" / "strip.png")
    (ROOT / "docs" / "results.md").write_text(f"{HEAD}\n{_markdown(records)}", encoding="utf-8")
    return 0


def parameters() -> str:
    """Tabulate the defaults of an instrument with grade, meaning and source, as Markdown."""
    (body,) = ast.parse(inspect.getsource(Instrument)).body
    assert isinstance(body, ast.ClassDef)
    meanings = [
        inspect.cleandoc(str(node.value.value)).replace("\n", " ")
        for node in body.body[1:]  # after the docstring of the class
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    ]
    lines = ["| parameter | default | grade | meaning and source |", "|---|--:|---|---|"]
    for field, meaning in zip(dataclasses.fields(Instrument), meanings, strict=True):
        grade = "C" if "ssumed" in meaning else "B"
        lines.append(f"| `{field.name}` | {field.default:.6g} | {grade} | {meaning} |")
    return "\n".join(lines) + "\n"


def schema() -> str:
    """Return the JSON Schema of scenario files as text."""
    return json.dumps(scenario.schema(), indent=2) + "\n"


def _markdown(records: list[dict[str, Any]]) -> str:
    lines = ["| " + " | ".join(HEADINGS) + " |", "|---|---|" + "--:|" * (len(HEADINGS) - 2)]
    for r in records:
        error = r["error_px"]
        cells = [
            r["scenario"],
            r["controller"],
            *(f"{error[key]:.1f}" for key in ("rms", "p95", "max")),
            f"{r['delayed_error_px']['rms']:.1f}",
            f"{r['vision_error_px']['rms']:.2f}",
            f"{100 * r['lost_fraction']:.1f} %",
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(cli.guarded(main, sys.argv[1:]))
