"""The printed board is true to scale, and the moving one follows its scenario."""

import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import cv2
import numpy as np
import pytest

from endolock.hw.api import Frame, Image
from endolock.scripts import board, cli
from endolock.twin import board as boards
from endolock.twin import scenario
from endolock.twin.course import Course
from endolock.vision import camera_model
from endolock.vision.markers import MarkerEyes

SVG = "{http://www.w3.org/2000/svg}"
PX_PER_MM = 12


@pytest.mark.parametrize("kind", boards.prints())
def test_markers_are_found_in_the_sheet_where_the_geometry_says(kind: str) -> None:
    """The sheet is drawn anew from its own numbers and looked at from 300 mm ahead."""
    printed = boards.prints()[kind]
    picture, centre = _raster(board.sheet(printed))
    height, width, _ = picture.shape
    focal_px = PX_PER_MM * 300.0  # at 0.3 m a millimetre is so many pixels
    base = camera_model.from_fovy(width, height, 60.0)
    camera = type(base)(width=width, height=height, focal_px=focal_px, centre_px=centre)
    frame = Frame(image=picture, t_capture=0.0, t_available=0.0, seq=0, dropped=0)
    found, fit = MarkerEyes(camera, printed.geometry).look(frame)
    assert {i for _, i in found} == {i for i, *_ in printed.geometry.markers}
    assert not isinstance(fit, str)
    # corners of sharp squares are found to 0.1-0.2 px, and tens of them are fitted
    assert fit.distance_m == pytest.approx(0.3, rel=1e-3)
    target = np.add(centre, 1e3 * PX_PER_MM * np.array(printed.geometry.target))
    # the filling of polygons here rounds their edges outwards, by half a pixel
    assert fit.pixel == pytest.approx(tuple(target), abs=0.6)


def test_the_sheet_has_its_size_in_millimetres() -> None:
    root = ET.fromstring(board.sheet(boards.prints()["rings"]))
    _, _, width, height = (float(c) for c in root.attrib["viewBox"].split())
    assert root.attrib["width"] == f"{width:g}mm"  # one unit of the drawing is a millimetre
    assert root.attrib["height"] == f"{height:g}mm"
    paper = root.find(f"{SVG}rect")
    assert paper is not None
    assert float(paper.attrib["width"]) == 1e3 * boards.SIZE_M


def test_the_page_follows_the_scenario_and_needs_nothing_else(tmp_path: Path) -> None:
    out = tmp_path / "page.html"
    assert cli.main(["board", "--play", "circle", "--out", str(out)]) == 0
    text = out.read_text()
    found = re.search(r"const run = (.*);\n", text)
    assert found
    run = json.loads(found[1])
    loaded = scenario.load("circle")
    course = Course(loaded, seed=0)
    assert len(run["path"]) == round(loaded.duration_s * run["rate"]) + 1
    for n in range(0, len(run["path"]), 97):
        wanted = 1e3 * np.array(course.board(n / run["rate"]))
        assert run["path"][n] == pytest.approx(wanted, abs=1e-4)  # written to a tenth of a micron
    outside = re.findall(r'(?:src|href)="(?!data:)([^"]*)"', text)
    assert outside == []
    assert 'id="marker-0"' in text


@pytest.mark.parametrize(
    ("args", "why"),
    [
        ([], "nothing to do; give --out FILE.svg to print, or --play SCENARIO"),
        (["--out", "board.pdf"], "board.pdf should end in .svg"),
        (["--out", "none/board.svg"], "cannot write none/board.svg: No such file or directory"),
        (["--out", "b.svg", "--kind", "square"], "board 'square' is unknown; use rings, tissue"),
        (["--play", "walk"], "scenario"),
    ],
)
def test_bad_input_gives_one_line(
    args: list[str],
    why: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(["board", *args]) == 2
    said = capsys.readouterr().err
    assert why in said
    assert said.count("\n") == 1
    assert not list(tmp_path.iterdir())


def _raster(svg: str) -> tuple[Image, tuple[float, float]]:
    """Fill the sheet's rectangles, circles and marker paths; return also the board's centre."""
    root = ET.fromstring(svg)
    left, top, width, height = (float(c) for c in root.attrib["viewBox"].split())
    image = np.full((round(height * PX_PER_MM), round(width * PX_PER_MM), 3), 255, np.uint8)

    def fill(corners: np.ndarray, colour: str) -> None:
        rgb = tuple(int(colour[i : i + 2], 16) for i in (1, 3, 5))
        places = (corners - [left, top]) * PX_PER_MM - 0.5
        cv2.fillPoly(image, [np.rint(places * 16).astype(np.int32)], rgb, cv2.LINE_8, shift=4)

    for element in root:
        a = element.attrib
        if element.tag == f"{SVG}rect":
            x, y, w, h = (float(a[k]) for k in ("x", "y", "width", "height"))
            fill(np.array([[x, y], [x + w, y], [x + w, y + h], [x, y + h]]), a["fill"])
        elif element.tag == f"{SVG}circle":
            cx, cy, r = (float(a[k]) for k in ("cx", "cy", "r"))
            turn = np.linspace(0, 2 * np.pi, 64)
            fill(np.column_stack([cx + r * np.cos(turn), cy + r * np.sin(turn)]), a["fill"])
        elif a.get("id", "").startswith("marker-"):
            x, y, scale = (float(c) for c in re.findall(r"-?[\d.]+(?:e-?\d+)?", a["transform"]))
            squares = re.findall(r"M(\d+) (\d+)([hv])(\d+)", a["d"])
            for n, (u, v, _, side) in enumerate(squares):
                low = np.array([x, y]) + scale * np.array([int(u), int(v)])
                square = low + scale * int(side) * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
                fill(square, "#ffffff" if n else a["fill"])
    return image, (-left * PX_PER_MM - 0.5, -top * PX_PER_MM - 0.5)
