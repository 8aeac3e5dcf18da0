"""The open questions of the thesis, answered on the twin: tables and figures of docs/control.md.

`./run python -m endolock.scripts.studies.questions NAME` answers one, prints its table and draws
its figure into the current folder.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from endolock.hw.api import ConfigError
from endolock.scripts import cli
from endolock.scripts.studies import linear_questions, loop_questions, near_questions
from endolock.scripts.studies.answers import Answer


def questions() -> dict[str, Callable[[], Answer]]:
    """Return all questions by name."""
    return {
        "process": linear_questions.process,
        "limit_cycle": linear_questions.limit_cycle,
        "relative": near_questions.relative,
        "integral": near_questions.integral,
        "aiming": near_questions.aiming,
        "roughness": loop_questions.roughness,
        "circles": loop_questions.circles,
        "push": loop_questions.after_a_push,
        "latency": loop_questions.latency,
    }


def save(answer: Answer, path: Path) -> None:
    """Draw the figure of an answer to a PNG."""
    from matplotlib.figure import Figure  # half a second to load

    figure = Figure(figsize=(7, 4.0), layout="constrained")
    panel = figure.subplots()
    answer.draw(panel)
    panel.spines[["top", "right"]].set_visible(False)
    panel.grid(alpha=0.25)
    _, names = panel.get_legend_handles_labels()
    columns = 4 if len("".join(names)) < 50 else 2
    figure.legend(loc="outside lower center", ncols=columns, frameon=False, fontsize=9)
    figure.savefig(path, dpi=110)


def main(args: list[str]) -> int:
    """Answer the question named in `args`."""
    known = questions()
    if len(args) != 1 or args[0] not in known:
        raise ConfigError(f"name one question: {', '.join(known)}")
    answer = known[args[0]]()
    path = Path(f"{args[0]}.png")
    save(answer, path)
    print(f"{answer.table}\n{path}")
    return 0


if __name__ == "__main__":
    sys.exit(cli.guarded(main, sys.argv[1:]))
