"""A table as Markdown."""

from __future__ import annotations

from collections.abc import Sequence

RULES = {"l": "---", "r": "--:"}


def markdown_table(head: Sequence[str], rows: Sequence[Sequence[str]], align: str = "") -> str:
    """Lay a table out as Markdown.

    Args:
        head: the headings.
        rows: the cells of each row.
        align: "l" or "r" for each column; else the first column left, the others right.
    """
    sides = align or "l" + "r" * (len(head) - 1)
    lines = [head, [RULES[side] for side in sides], *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)
