"""Checks of the registers that decide what a goal means, by `endolock doctor`."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

from endolock.hw.api import ConfigError
from endolock.hw.bench import bench_file
from endolock.hw.dynamixel.handle import Handle
from endolock.hw.dynamixel.settings import SETTINGS, STATUS_LEVEL, Policy, Wish
from endolock.scripts.commands.doctor.finding import Finding
from endolock.scripts.commands.doctor.found_motor import FoundMotor


def judge(motors: Sequence[FoundMotor], cure: str) -> list[Finding]:
    """Judge the settings: a row for each that a user has to change, one for all others.

    Args:
        motors: all motors on the port.
        cure: how to set them up.
    """
    rows, pending = [], []
    wishes = _wishes(motors)
    for setting in SETTINGS:
        has = [
            (m, m.settings[setting.name], wishes[m.id])
            for m in motors
            if m.known and setting.name in m.settings
        ]
        bad = [entry for entry in has if setting.differs(*entry[1:])]
        if setting.doctor or setting.policy is Policy.REFUSE:
            values = ", ".join(f"{m.id}: {setting.show(v, w.units)}" for m, v, w in has)
            advice = f"{setting.why}: {cure if setting.doctor else setting.cure}" if bad else ""
            if has:
                rows.append(Finding(setting.name, not bad, values, advice))
        elif setting is not STATUS_LEVEL:
            pending += [f"{m.id}: {setting.name} {v} -> {setting.wanted(w)}" for m, v, w in bad]
    text = f"set at connecting: {', '.join(pending)}" if pending else "nothing to set at connecting"
    return [*rows, Finding("settings", True, text)]


def _wishes(motors: Sequence[FoundMotor]) -> dict[int, Wish]:
    """Return what each motor is for: as the bench file here says, or one of the defaults."""
    handles = {}
    with suppress(ConfigError):  # the row bench names it
        handles = {handle.id: handle for handle in bench_file.load().handles.values()}
    return {
        m.id: Wish(handle=handles.get(m.id, Handle(id=m.id)), model=m.known, units=m.known.units)
        for m in motors
        if m.known is not None
    }
