"""`endolock watch` and `endolock calibrate` on run folders and videos."""

import json
from pathlib import Path

import cv2
import pytest

from endolock.hw.camera import camera_file
from endolock.scripts import cli
from endolock.scripts.runs import log_tables, run_folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("runs") / "run"
    done = cli.main(["run", "circle", "--duration-s", "11", "--out", str(path)])
    assert done == 0
    return path


def test_a_run_folder_gives_the_same_observations_again(folder: Path, tmp_path: Path) -> None:
    written = tmp_path / "seen.json"
    again = tmp_path / "again"
    args = [
        "watch",
        str(folder),
        "--vision",
        "markers",
        "--out",
        str(again),
        "--json",
        str(written),
    ]
    assert cli.main(args) == 0
    seen = json.loads(written.read_text())
    then = run_folder.read(folder, "frames").to_pylist()
    now = run_folder.read(again, "frames").to_pylist()
    assert seen["frames"] == len(then) == len(now)
    assert seen["detected_fraction"] == 1.0
    for old, new in zip(then, now, strict=True):
        assert (old["seq"], old["t_available"]) == (new["seq"], new["t_available"])
        # the recorded pictures are JPEGs of quality 75: a corner moves by 0.1-0.2 px
        assert new["target_px"] == pytest.approx(old["target_px"], abs=0.5)


def test_the_tracker_works_on_a_recording_and_markers_give_its_error(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["watch", str(folder), "--vision", "track", "--json", "-"]) == 0
    seen = json.loads(capsys.readouterr().out)
    assert seen["detected_fraction"] == 1.0
    assert seen["vision_error_px"]["max"] < 0.8  # of tracker and markers together, on JPEGs
    assert seen["refused"] == {}


def test_a_video_file_with_stamps_and_calibration(folder: Path, tmp_path: Path) -> None:
    film, stamps, camera = (tmp_path / name for name in ("film.avi", "times.csv", "camera.toml"))
    rows = run_folder.read(folder, "frames").to_pylist()[:40]
    writer = cv2.VideoWriter(str(film), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (640, 480))
    for row in rows:
        writer.write(cv2.cvtColor(log_tables.decode(row["tip_jpeg"]), cv2.COLOR_RGB2BGR))
    writer.release()
    lines = ["t_capture,t_available", *(f"{r['t_capture']},{r['t_available']}" for r in rows)]
    stamps.write_text("\n".join(lines))
    camera_file.write(camera_file.read(folder / "run.toml"), camera)
    written = tmp_path / "seen.json"
    args = ["watch", str(film), "--times", str(stamps), "--calibration", str(camera)]
    assert cli.main([*args, "--json", str(written)]) == 0
    seen = json.loads(written.read_text())
    assert seen["frames"] == 40
    assert seen["detected_fraction"] == 1.0


@pytest.mark.parametrize(
    ("more", "why"),
    [
        (["--vision", "ears"], "vision 'ears' is unknown here; use markers or track"),
        (["--select", "1,2,30,30"], "select goes with vision track"),
        (["--vision", "track", "--select", "a,b"], "is not X,Y,WIDTH,HEIGHT in whole pixels"),
        (["--board", "square"], "board 'square' is unknown"),
        (["--times", "times.csv"], "a run folder has its own time stamps"),
    ],
)
def test_bad_input_gives_one_line(
    folder: Path, more: list[str], why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["watch", str(folder), *more]) == 2
    said = capsys.readouterr().err
    assert why in said


def test_a_video_without_stamps_or_calibration_is_refused(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    film, stamps = tmp_path / "film.avi", tmp_path / "times.csv"
    stamps.write_text("t_capture\n0.0\n")
    assert cli.main(["watch", str(film)]) == 2
    assert "needs time stamps" in capsys.readouterr().err
    assert cli.main(["watch", str(film), "--times", str(stamps)]) == 2
    assert "the camera is unknown; give its calibration" in capsys.readouterr().err


def test_a_run_calibrates_its_camera(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "camera.toml"
    assert cli.main(["calibrate", str(folder), "--out", str(out)]) == 0
    found, true = camera_file.read(out), camera_file.read(folder / "run.toml")
    # one circle of a small board around the centre, as JPEGs
    assert found.focal_px == pytest.approx(true.focal_px, rel=0.01)
    assert found.rms_px < 0.6


def test_a_run_without_pictures_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "blind"
    args = ["run", "rest", "--vision", "truth", "--duration-s", "1", "--out", str(path)]
    assert cli.main(args) == 0
    capsys.readouterr()
    assert cli.main(["calibrate", str(path)]) == 2
    assert "has no pictures; run it with vision markers" in capsys.readouterr().err
