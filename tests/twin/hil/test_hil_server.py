"""The server of an emulated bench: what it opened is closed where it cannot start."""

from __future__ import annotations

from pathlib import Path

import pytest

from endolock.hw.api import ConfigError
from endolock.twin.hil import hil_server
from endolock.twin.hil.hil_server import HilServer
from endolock.twin.hil.messages import HilSetup
from endolock.twin.rig import TwinRig
from endolock.twin.world.instrument import Instrument, Numerics
from endolock.twin.world.scenario import load


def test_a_server_without_a_line_closes_its_twin(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    closed: list[TwinRig] = []

    class Watched(TwinRig):
        def close(self) -> None:
            closed.append(self)
            super().close()

    monkeypatch.setattr(hil_server, "TwinRig", Watched)
    (tmp_path / "servo").touch()
    setup = HilSetup(
        scenario=load("rest"),
        instrument=Instrument(),
        numerics=Numerics(),
        seed=0,
        pictures=False,
        overview=False,
        wall=False,
        paced=False,
        baud=1_000_000,
        faults=(),
        link=tmp_path / "servo",
    )
    with pytest.raises(ConfigError, match="exists and is not a link"):
        HilServer(setup)
    assert len(closed) == 1
