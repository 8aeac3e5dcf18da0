"""What CONTRIBUTING says of the tree is what the tree holds."""

import ast
import re
from pathlib import Path

import pytest
from tests.test_layout import ARROWS, ROOT

PAGE = (ROOT / "CONTRIBUTING.md").read_text()
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in PAGE.splitlines()
    if line.startswith("| `")
]
CODE = sorted(set(re.findall(r"`([^`\n]+)`", PAGE)))
PATHS = [word for word in CODE if re.fullmatch(r"[\w.*-]+(/[\w.*-]+)+", word)]
NAMES = [word for word in CODE if re.match(r"[A-Za-z_.]+(\(|$)", word) and "FILE" not in word]


def test_there_is_one_row_for_each_room() -> None:
    assert [room for room, *_ in ROWS] == [f"`{room}`" for room in ARROWS]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0].strip("`"))
def test_a_row_repeats_the_docstring_of_the_room(row: list[str]) -> None:
    room, held, imports = row
    file = ROOT / room.strip("`") / "__init__.py"
    if file.exists():
        assert held == ast.get_docstring(ast.parse(file.read_text()))
    allowed = [f"`{there}`" for there in ARROWS[room.strip("`")]]
    assert imports == (", ".join(allowed) or "nothing of ours")


def test_every_path_on_the_page_exists() -> None:
    assert PATHS
    for path in PATHS:
        if not path.startswith("./"):
            assert list(ROOT.glob(path)), path


def test_every_name_is_in_the_tree() -> None:
    assert "all_boards()" in NAMES
    kinds = ("*.py", "*.toml", "*.txt")
    tracked = [file for kind in kinds for folder in _folders() for file in folder.glob(kind)]
    words = set(re.findall(r"\w+", "\n".join(file.read_text() for file in tracked)))
    words |= {file.name for file in tracked} | {folder.name for folder in _folders()}
    for name in NAMES:
        for part in [name] if name in words else re.findall(r"\w+", name):
            assert part in words, name


def test_every_command_is_one_of_run() -> None:
    script = (ROOT / "run").read_text()
    commands = set(re.findall(r"\./run (\w+)", PAGE))
    assert commands >= {"check", "test", "slow", "docs"}
    for word in commands:
        assert re.search(rf"^#   \./run {word}\b", script, re.MULTILINE), word


def _folders() -> list[Path]:
    tops = [ROOT / layer for layer in ("hw", "vision", "control", "twin", "scripts", "models")]
    below = [folder for top in tops for folder in top.rglob("*") if folder.is_dir()]
    return [ROOT, ROOT / "docs", ROOT / "tests", *tops, *below]
