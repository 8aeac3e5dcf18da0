"""Writes models/endoscope: section.xml, scene.xml and the textures of board and wall.

Run it after changing the builders: ./run python -m endolock.twin.model.generate
"""

from __future__ import annotations

import re
from importlib.resources import files
from pathlib import Path

import cv2

from endolock.hw import boards
from endolock.twin.model import scene, section

COLUMNS = 120


def folder() -> Path:
    """Return the folder of the committed model."""
    return Path(str(files("endolock") / "models" / "endoscope"))


def section_xml() -> str:
    """Return the text of section.xml."""
    return _wrapped(section.build().to_xml())


def scene_xml() -> str:
    """Return the text of scene.xml, which includes section.xml; its textures must exist."""
    text = scene.build_alone(folder()).to_xml()
    head, rest = text.split("  <compiler", 1)
    return _wrapped(f'{head}  <include file="section.xml"/>\n\n  <compiler{rest}')


def _wrapped(text: str) -> str:
    """Break lines, at attributes where possible, so that no line is longer than `COLUMNS`."""
    lines = []
    for line in text.splitlines():
        indent = re.match(r" *(<\w+ )?", line)
        pad = " " * (indent.end() if indent else 0)
        while len(line) > COLUMNS:
            at = line.rfind('" ', 0, COLUMNS) + 1
            if at <= len(pad):
                at = line.rfind(" ", 0, COLUMNS)  # within a long row of numbers
            if at <= len(pad):
                break
            lines.append(line[:at])
            line = pad + line[at + 1 :]
        lines.append(line)
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write all files."""
    target = folder()
    for name, image in scene.pictures(boards.all_boards()["rings"]).items():
        file = target / scene.TEXTURES[name]
        file.parent.mkdir(exist_ok=True)
        cv2.imwrite(str(file), cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    (target / "section.xml").write_text(section_xml(), encoding="utf-8")
    (target / "scene.xml").write_text(scene_xml(), encoding="utf-8")


if __name__ == "__main__":
    main()
