"""Logs of handle angles and tip bends: what a wrong one is refused with."""

from pathlib import Path

import pytest

from endolock.hw.api import ConfigError
from endolock.scripts.runs import handle_logs


def test_what_is_wrong_with_a_log_and_what_to_do_stay_apart(tmp_path: Path) -> None:
    file = tmp_path / "log.csv"
    columns = (handle_logs.TIME, *handle_logs.HANDLES, *handle_logs.BENDS)
    file.write_text(",".join(columns) + "\n0,0,0,0,0\n")
    with pytest.raises(ConfigError) as caught:
        handle_logs.read(file)
    assert caught.value.what == f"{file}: 1 rows"
    assert caught.value.next_step == "record several periods of a slow triangle wave"
