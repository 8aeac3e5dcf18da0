"""Printed and moving boards: true size, detected by vision, on the correct path."""

import base64
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

from endolock.hw import boards
from endolock.hw.api import Calibration, Frame, Image
from endolock.scripts import cli
from endolock.scripts.figures import board_svg
from endolock.twin.model import drawing
from endolock.twin.world import scenario as scenarios
from endolock.twin.world.playback import Course
from endolock.vision.marker_eyes import MarkerEyes
from endolock.vision.observation import Status

SVG = "{http://www.w3.org/2000/svg}"
TEXELS_PER_MM = 24
KINDS = sorted(boards.all_boards())


@pytest.fixture(scope="module", params=KINDS)
def printed(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("boards") / f"{request.param}.svg"
    assert cli.main(["board", "--out", str(path), "--kind", request.param]) == 0
    return path


def test_the_sheet_has_its_size_in_mm_and_a_ruler(printed: Path) -> None:
    root = ElementTree.parse(printed).getroot()
    assert (root.get("width"), root.get("height")) == ("120mm", "130mm")
    assert root.get("viewBox") == "-60 -60 120 130"  # so one unit is one mm
    cut = root.find(f"{SVG}rect[@id='cut']")
    assert cut is not None
    assert [cut.get(k) for k in ("x", "y", "width", "height")] == ["-50", "-50", "100", "100"]
    ruler = root.find(f"{SVG}path[@id='ruler']")
    assert ruler is not None
    assert ruler.attrib["d"].startswith("M-25 60h50 ")  # 10 mm below the board
    assert root.findtext(f"{SVG}text") == "print at 100 %; this line is 50 mm"


def test_every_marker_has_the_bits_of_the_dictionary(printed: Path) -> None:
    image = _raster(printed)
    geometry = boards.all_boards()[printed.stem].geometry
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    for marker, x, y, size in geometry.markers:
        side = round(size * 1e3 * TEXELS_PER_MM)
        u, v = (round((c - size / 2 + 0.05) * 1e3 * TEXELS_PER_MM) for c in (x, y))
        bits = cv2.aruco.generateImageMarker(dictionary, marker, side)[..., None] > 0
        expected = np.where(bits, drawing.PAPER, drawing.INK)
        assert np.array_equal(image[v : v + side, u : u + side], expected), marker


def test_the_sheet_is_the_board_of_the_twin(printed: Path) -> None:
    """Including the random tissue, which must be the same piece."""
    drawn = drawing.picture(boards.all_boards()[printed.stem], boards.SIZE_M, TEXELS_PER_MM)
    apart = np.abs(_raster(printed).astype(int) - drawn).max(axis=2)
    assert (apart > 8).mean() < 0.002  # edges, with and without smoothing; tissue is 4 %


def test_vision_finds_the_printed_board_at_its_position(printed: Path) -> None:
    """The sheet 120 mm in front of a pinhole with f = 240 px, 10 mm right, 4 mm up: 2 px per mm."""
    sheet, factor = _raster(printed), TEXELS_PER_MM // 2
    view = np.full((300 * factor, 320 * factor, 3), 90, np.uint8)
    left, top = (160 + 2 * (10 - 50)) * factor, (150 + 2 * (-4 - 50)) * factor
    view[top : top + len(sheet), left : left + len(sheet)] = sheet
    image = np.asarray(cv2.resize(view, (320, 300), interpolation=cv2.INTER_AREA), np.uint8)
    camera = Calibration(width=320, height=300, focal_px=240.0, centre_px=(159.5, 149.5))
    geometry = boards.all_boards()[printed.stem].geometry
    seen = MarkerEyes(camera, geometry)(_frame(image))
    assert seen.status is Status.TRACKING, seen.why
    x, y = (1e3 * c for c in geometry.target)
    expected = 159.5 + 2 * (10 + x), 149.5 + 2 * (-4 + y)
    assert seen.target_px == pytest.approx(expected, abs=0.15)
    assert seen.distance_m == pytest.approx(0.12, rel=0.005)


@pytest.mark.parametrize("name", ["circle", "random", "jump"])
def test_the_page_follows_the_course(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    _no_screen(monkeypatch)
    monkeypatch.chdir(tmp_path)
    assert cli.main(["board", "--play", name]) == 0
    assert capsys.readouterr().out == f"wrote board-{name}.html; open it in any browser\n"
    assert [file.name for file in tmp_path.iterdir()] == [f"board-{name}.html"]
    record = _record(tmp_path / f"board-{name}.html")
    course = Course(scenarios.load(name), seed=0)
    assert record["rate_hz"] == 100
    assert (len(record["path_mm"]) - 1) / 100 == record["duration_s"]
    for t in (0.0, 0.37, 4.5, 11.99, record["duration_s"]):
        x, y = course.board(t)
        assert record["path_mm"][round(100 * t)] == pytest.approx([1e3 * x, 1e3 * y], abs=1e-4)
    assert np.ptp(record["path_mm"], axis=0).max() > 10


def test_the_page_has_the_scenarios_board_and_no_external_resource(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _no_screen(monkeypatch)
    (tmp_path / "a<b.toml").write_text('duration_s = 0.5\nboard.kind = "several"\n')
    pages = tmp_path / "own.html", tmp_path / "other.html"
    args = ["board", "--play", str(tmp_path / "a<b.toml"), "--out"]
    assert cli.main([*args, str(pages[0])]) == 0
    assert cli.main([*args, str(pages[1]), "--kind", "rings"]) == 0
    for path, kind in zip(pages, ("several", "rings"), strict=True):
        text = path.read_text()
        assert board_svg.elements(boards.all_boards()[kind]) in text
        assert "<title>a&lt;b, board" in text
        assert "://" not in text
        assert not re.search(r'\b(src|href)="(?!data:)|@import|@[A-Z]+@', text)
        assert _record(path)["path_mm"] == [[0, 0]] * 51


@pytest.mark.skipif(sys.platform != "linux", reason="other systems always have a screen")
@pytest.mark.parametrize("screen", [True, False])
def test_the_page_is_opened_if_there_is_a_screen(screen: bool, tmp_path: Path) -> None:
    """With a browser that only logs what it is asked to open."""
    browser, asked = tmp_path / "browser", tmp_path / "asked"
    browser.write_text(f'#!/bin/sh\necho "$1" >"{asked}"\n')
    browser.chmod(0o755)
    command = [sys.executable, "-m", "endolock.scripts.cli", "board", "--play", "rest"]
    screens = {"DISPLAY": ":7" if screen else None, "WAYLAND_DISPLAY": None}
    environment = {**os.environ, **screens, "BROWSER": f"{browser} %s"}
    done = subprocess.run(
        command,
        cwd=tmp_path,
        env={key: value for key, value in environment.items() if value is not None},
        capture_output=True,
        text=True,
        check=True,
    )
    page = tmp_path / "board-rest.html"
    if screen:
        assert done.stdout == "wrote and opened board-rest.html\n"
        assert asked.read_text() == f"{page.as_uri()}\n"
    else:
        assert done.stdout == "wrote board-rest.html; open it in any browser\n"
        assert not asked.exists()


def test_an_existing_file_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "board.svg"
    path.write_text("old")
    assert cli.main(["board", "--out", str(path)]) == 0
    assert path.read_text() == board_svg.sheet(boards.all_boards()["rings"])
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("args", "message"),
    [
        ([], "neither --out nor --play; give --out FILE.svg to print a board, or --play SCENARIO"),
        (["--kind", "tissue"], "neither --out nor --play"),
        (["--out", "x.svg", "--kind", "round"], "kind 'round' is unknown; use rings, several, tis"),
        (["--play", "rest", "--kind", "round"], "kind 'round' is unknown"),
        (["--play", "strait"], "scenario 'strait' is unknown; use"),
        (
            ["--out", "x.png"],
            "cannot write the board to print as x.png; give --out a name that ends in .svg",
        ),
        (
            ["--play", "rest", "--out", "x.svg"],
            "the page as x.svg; give --out a name that ends in .html",
        ),
        (["--out", "nowhere/x.svg"], "cannot write nowhere/x.svg: No such file or directory; use"),
        (["--out", "folder.svg"], "cannot write folder.svg: Is a directory; use another --out"),
        (["--play", "day.toml"], "duration_s 86400 is above the maximum of 3600 for a page"),
    ],
)
def test_bad_input_gives_one_line_and_leaves_nothing(
    args: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    _no_screen(monkeypatch)
    monkeypatch.chdir(tmp_path)
    Path("folder.svg").mkdir()
    Path("day.toml").write_text("duration_s = 86400\n")
    assert cli.main(["board", *args]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert message in said.err
    assert said.err.count("\n") == 1
    assert {file.name for file in tmp_path.iterdir()} == {"folder.svg", "day.toml"}


def _no_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    if sys.platform != "linux":
        pytest.skip("would open a browser")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)


def _record(page: Path) -> dict[str, Any]:
    (text,) = re.findall(r'<script type="application/json".*?>(.*?)</script>', page.read_text())
    record: dict[str, Any] = json.loads(text)
    return record


def _frame(image: Image) -> Frame:
    return Frame(t_capture=0.0, t_available=0.0, seq=0, dropped=0, image=image)


def _raster(path: Path) -> Image:
    """Draw the board of an SVG in the order of its elements; supports only the elements used."""
    image = np.zeros((100 * TEXELS_PER_MM, 100 * TEXELS_PER_MM, 3), np.uint8)
    root = ElementTree.parse(path).getroot()
    clips = {f"url(#{clip.get('id')})": clip[0] for clip in root.iter(f"{SVG}clipPath")}
    clipping = list(clips.values())
    for element in root.iter():
        if element.tag == f"{SVG}rect" and element.get("fill") != "none":
            left, top, width, height = _texels(element, "x", "y", "width", "height")
            image[top : top + height, left : left + width] = _colour(element)
        elif element.tag == f"{SVG}circle" and element not in clipping:
            image[_inside(element)] = _colour(element)
        elif element.tag == f"{SVG}image":
            left, top, width, height = _texels(element, "x", "y", "width", "height")
            code = np.frombuffer(base64.b64decode(element.attrib["href"].split(",")[1]), np.uint8)
            picture = cv2.imdecode(code, cv2.IMREAD_COLOR_RGB)
            assert picture is not None
            layer = np.zeros_like(image)
            layer[top : top + height, left : left + width] = cv2.resize(picture, (width, height))
            inside = _inside(clips[element.attrib["clip-path"]])
            image[inside] = layer[inside]
    return image


def _texels(element: ElementTree.Element, *keys: str) -> list[int]:
    """Attributes as whole texels; positions are relative to the board's corner."""
    values = [float(element.attrib[k]) + (50 if k in ("x", "y") else 0) for k in keys]
    texels = [round(v * TEXELS_PER_MM) for v in values]
    assert values == pytest.approx(np.divide(texels, TEXELS_PER_MM), abs=1e-4)  # whole ones [mm]
    return texels


def _inside(circle: ElementTree.Element) -> np.ndarray:
    x, y, r = (float(circle.attrib[k]) for k in ("cx", "cy", "r"))
    middles = (np.arange(100 * TEXELS_PER_MM) + 0.5) / TEXELS_PER_MM - 50
    inside: np.ndarray = (middles - x) ** 2 + (middles[:, None] - y) ** 2 < r**2
    return inside


def _colour(element: ElementTree.Element) -> tuple[int, ...]:
    return tuple(bytes.fromhex(element.attrib["fill"][1:]))
