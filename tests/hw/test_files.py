"""Files are written whole or not at all, through links and to pipes."""

import os
import sys
from pathlib import Path
from threading import Thread

import pytest

from endolock.hw import files
from endolock.hw.api import ConfigError


def test_an_older_file_stays_where_the_new_one_cannot_be_written(tmp_path: Path) -> None:
    path = tmp_path / "record.json"
    path.write_text("older")
    (tmp_path / "record.json.part").mkdir()  # the new one cannot be begun
    with pytest.raises(ConfigError, match=r"cannot write .*record\.json: .*; give another"):
        files.write_whole(path, "newer", "give another")
    assert path.read_text() == "older"


@pytest.mark.skipif(sys.platform == "win32", reason="links need a permission there")
def test_a_link_stays_a_link(tmp_path: Path) -> None:
    path, link = tmp_path / "record.json", tmp_path / "link"
    path.write_text("older")
    link.symlink_to(path)
    files.write_whole(link, "newer", "")
    assert link.is_symlink()
    assert path.read_text() == "newer"
    assert sorted(tmp_path.iterdir()) == [link, path]


def test_a_pipe_stays_a_pipe(tmp_path: Path) -> None:
    if sys.platform == "win32":
        pytest.skip("Windows has no named pipes in folders")
    pipe, found = tmp_path / "pipe", []
    os.mkfifo(pipe)
    reader = Thread(target=lambda: found.append(pipe.read_text()))
    reader.start()
    files.write_whole(pipe, "record", "")
    reader.join()
    assert found == ["record"]
    assert pipe.is_fifo()
