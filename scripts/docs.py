"""`./run docs`: writes again everything in docs/ and models/ that is generated."""

from __future__ import annotations

import dataclasses
import json
import shutil
import sys
import tempfile
from itertools import product
from pathlib import Path
from typing import Any

from rich.console import Console

from endolock.scripts import cli, run, strip, verification
from endolock.twin import generate, instruments, scenario
from endolock.twin.instrument import Instrument

ROOT = Path(__file__).resolve().parents[1]
END = "<!-- end -->"
PICTURED = ("straight", "circle", "rest")
"""Scenarios run with pictures; the others' tables take the exact projections."""
HEADINGS = ("scenario", "law", "rms px", "p95 px", "max px", "seen rms px", "vision rms px", "lost")
HEAD = """# Results

Written by `./run docs`; seed 0, 0.4 s of latency, 640x480 px at f = 262 px, start included.
*rms*, *p95* and *max* are of the true error at every control tick, *seen* is what vision saw, 0.4 s
old. The laws are our reproductions of two of the thesis', with assumed gains, on the twin; nothing
here was measured on an endoscope.
"""
WITHOUT_PICTURES = """## Every scenario, without pictures

The same with `--vision truth`: what eyes that make no error would let these laws do. `occlusion`
hides nothing from such eyes, and `close` needs smaller markers than this version has.
"""


def main(_args: list[str]) -> int:
    """Regenerate the model with its card, the instrument files, docs/results.md and its picture."""
    console = Console(stderr=True)
    console.print("models")
    generate.main()
    models = generate.folder().parent
    (models / "instruments" / "pretensioned.toml").write_text(pretensioned(), encoding="utf-8")
    (models / "scenarios" / "schema.json").write_text(schema(), encoding="utf-8")
    card = generate.folder() / "README.md"
    text = _between(card.read_text(encoding="utf-8"), "parameters", parameters())
    with console.status("measuring what the model card says"):
        text = _between(text, "verification", verified())
    card.write_text(text, encoding="utf-8")

    records, fast = [], []
    for name, law in product(PICTURED, ("pi", "ik")):
        with tempfile.TemporaryDirectory() as place:
            record, folder = _run(name, law, "markers", Path(place) / "run")
            records.append(record)
            if (name, law) == ("straight", "pi"):
                shutil.copy(strip.write(folder, folder / "strip.png"), ROOT / "docs" / "strip.png")
    for name, law in product(scenario.names(), ("pi", "ik")):
        with tempfile.TemporaryDirectory() as place:
            fast.append(_run(name, law, "truth", Path(place) / "run")[0])
    text = f"{HEAD}\n{_markdown(records)}\n{WITHOUT_PICTURES}\n{_markdown(fast)}"
    (ROOT / "docs" / "results.md").write_text(text, encoding="utf-8")
    return 0


def parameters() -> str:
    """Tabulate the defaults of an instrument with grade, meaning and source, as Markdown."""
    lines = ["| parameter | default | grade | meaning and source |", "|---|--:|---|---|"]
    defaults = dataclasses.asdict(Instrument())
    for name, meaning in instruments.meanings().items():
        grade = "C" if "ssumed" in meaning else "B"
        lines.append(f"| `{name}` | {defaults[name]:.6g} | {grade} | {meaning} |")
    return "\n".join(lines) + "\n"


def pretensioned() -> str:
    """Return the defaults of an instrument as its file."""
    header = "The default: wires under tension. Written by ./run docs from twin/instrument.py."
    return instruments.dump(Instrument(), header)


def verified() -> str:
    """Measure and tabulate what the twin is checked against, as Markdown."""
    lines = ["| what | against | figure | bound | why there |", "|---|---|--:|---|---|"]
    for check in verification.CHECKS:
        figure = f"{check.measure():.3g} {check.unit}".strip()
        row = (check.what, check.against, figure, verification.bounds(check), check.why)
        lines.append("| " + " | ".join(row) + " |")
    return "\n".join(lines) + "\n"


def schema() -> str:
    """Return the JSON Schema of scenario files as text."""
    return json.dumps(scenario.schema(), indent=2) + "\n"


def _between(text: str, name: str, content: str) -> str:
    """Replace what stands between the marks of that name and the next end mark."""
    start = f"<!-- {name} -->\n"
    before, rest = text.split(start, 1)
    return f"{before}{start}{content}{END}{rest.split(END, 1)[1]}"


def _run(name: str, law: str, eyes: str, place: Path) -> tuple[dict[str, Any], Path]:
    record, folder = run.perform(run.Request(scenario=name, controller=law, vision=eyes, out=place))
    if record["interrupted"]:
        raise KeyboardInterrupt
    return record, folder


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
