"""Keys without effect: which rig and which vision reads each key of a scenario and an instrument.

A `--vary` none of whose keys has an effect is refused. Where only some of them have none, a note
names these, and so it does with keys of the scenario's file.

    reason("camera.noise", Setting("twin", "truth", scenario, instrument, scenario))
    -> ("camera.noise has no effect with vision truth", "use vision markers or track")
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from endolock.hw import boards
from endolock.hw.api import ConfigError
from endolock.scripts.runs import overrides
from endolock.scripts.runs.rigs import FIXED, RIGS, SERIAL, VISIONS
from endolock.twin.world.instrument import Instrument
from endolock.twin.world.mid_run import CHANGED
from endolock.twin.world.motion import Event
from endolock.twin.world.scenario import Scenario


class Setting(NamedTuple):
    """What decides whether a key is read; scenario and instrument with all changes."""

    rig: str
    """One of `RIGS`, or serial:PORT."""
    vision: str
    """One of `VISIONS`."""
    scenario: Scenario
    instrument: Instrument
    plain: Scenario
    """The scenario without its changes."""


class Reader(NamedTuple):
    """Who reads a key."""

    rigs: frozenset[str]
    visions: frozenset[str] = frozenset(VISIONS)
    used: Callable[[Setting], bool] = lambda setting: True
    """Whether it has an effect beside the other values."""
    needs: str = ""
    """What `used` asks for, for people."""


BENCH = "a bench"
PHYSICS = frozenset(name for name, kind in RIGS.items() if kind.pictures)
WIRES = frozenset(RIGS) - set(FIXED)
"""Rigs whose transmission is that of the instrument's wires."""
FRICTIONLESS = frozenset({"dead_zone"})
"""Rigs whose transmission has no friction that could change."""
SIMULATED = frozenset(RIGS)
ALL = SIMULATED | {BENCH}
PICTURES, TRUTH = frozenset(VISIONS) - {"truth"}, frozenset({"truth"})


def _target(scenario: Scenario) -> tuple[float, float]:
    return boards.aimed(scenario.board.kind, scenario.board.target).target


def _off_centre(setting: Setting) -> bool:
    return setting.vision != "truth" or any(_target(setting.scenario))


def _other_target(setting: Setting) -> bool:
    return setting.vision != "truth" or _target(setting.scenario) != _target(setting.plain)


def _exposed(setting: Setting) -> bool:
    return setting.scenario.camera.exposure_s > 0


def _changes(setting: Setting) -> bool:
    changes = setting.scenario.change
    video = any(getattr(c, name) is not None for c in changes for name in CHANGED[:-1])
    made = setting.instrument
    wires = setting.rig in WIRES and not (made.conduit_friction or made.section_friction)
    return video or not (wires or setting.rig in FRICTIONLESS)


def _shaft_bends(setting: Setting) -> bool:
    scenario = setting.scenario
    return scenario.shaft_bend_deg != 0 or any(e.kind == "bend" for e in scenario.shaft)


_MOVES = "with vision truth, a target off the board's centre: board.kind=several"
_SHARED = Reader(SIMULATED)
OF_SECTIONS: dict[str, Reader] = {
    "light": Reader(PHYSICS, PICTURES),
    "camera": _SHARED,
    "tracker": Reader(PHYSICS),
    "numerics": Reader(PHYSICS),
    "instrument": Reader(PHYSICS),
}
"""Readers of all keys of a section that are not in `KEYS`."""
KEYS: dict[str, Reader] = {
    "summary": Reader(ALL),
    "duration_s": Reader(ALL),
    "scored_from_s": Reader(ALL),
    "shaft_bend_deg": Reader(WIRES),
    "gravity": Reader(PHYSICS),
    "motion": Reader(ALL),  # on a bench, its period is known to the controllers
    "shaft": Reader(PHYSICS),
    "push": Reader(PHYSICS),
    "occluder": _SHARED,
    "change": Reader(
        SIMULATED, used=_changes, needs="for friction_times alone, friction that can change"
    ),
    "video_gap": _SHARED,
    "board.distance_m": _SHARED,
    "board.depth_travel_m": _SHARED,
    "board.depth_period_s": Reader(
        SIMULATED,
        used=lambda s: s.scenario.board.depth_travel_m > 0,
        needs="board.depth_travel_m above 0",
    ),
    "board.kind": Reader(
        SIMULATED, used=_other_target, needs="with vision truth, a target elsewhere on the board"
    ),
    "board.target": _SHARED,
    "board.tilt_deg": Reader(SIMULATED, used=_off_centre, needs=_MOVES),
    "board.tilt_axis_deg": Reader(
        SIMULATED,
        used=lambda s: s.scenario.board.tilt_deg != 0 and _off_centre(s),
        needs=f"a board.tilt_deg other than 0 and, {_MOVES}",
    ),
    "camera.fovy_deg": Reader(
        SIMULATED,
        used=lambda s: s.scenario.camera.projection == "pinhole",
        needs="camera.projection=pinhole",
    ),
    "camera.diagonal_deg": Reader(
        SIMULATED,
        used=lambda s: s.scenario.camera.projection == "equidistant",
        needs="camera.projection=equidistant",
    ),
    "camera.vignette": Reader(PHYSICS, PICTURES),
    "camera.gain": Reader(PHYSICS, PICTURES),
    "camera.sub_exposures": Reader(
        PHYSICS, PICTURES, used=_exposed, needs="camera.exposure_s above 0"
    ),
    "camera.noise": Reader(PHYSICS, PICTURES),
    "camera.jpeg_quality": Reader(PHYSICS, PICTURES),
    "camera.truth_noise_px": Reader(SIMULATED, TRUTH),
    "camera.background": Reader(SIMULATED, TRUTH),
    **dict.fromkeys(
        (
            *("instrument.bending_length_m", "instrument.rigid_tip_m"),
            *("instrument.misalignment_rad", "instrument.handle_range_rad"),
            *("instrument.handle_speed_rad_s", "instrument.encoder_step_rad"),
        ),
        _SHARED,
    ),
    **dict.fromkeys(
        (
            *("instrument.wire_radius_m", "instrument.pulley_radius_m"),
            *("instrument.bending_stiffness", "instrument.wire_stiffness"),
            *("instrument.sheath_friction_nm", "instrument.slack_m"),
            *("instrument.conduit_friction", "instrument.section_friction"),
        ),
        Reader(WIRES),
    ),
    "instrument.slack_loss_m_per_rad": Reader(WIRES, used=_shaft_bends, needs="a shaft that bends"),
    "instrument.residual_wrap_rad": Reader(
        WIRES,
        used=lambda s: s.instrument.conduit_friction > 0,
        needs="instrument.conduit_friction above 0",
    ),
}


def reader(key: str) -> Reader:
    """Return who reads a key, such as camera.noise, motion or instrument.slack_m."""
    section = key.partition(".")[0]
    return KEYS.get(key) or KEYS.get(section) or OF_SECTIONS.get(section) or Reader(ALL)


def reason(key: str, setting: Setting) -> tuple[str, str] | None:
    """Return why a key has no effect, and what to do; None where it has one."""
    found = reader(key)
    kind = BENCH if setting.rig.startswith(SERIAL) else setting.rig
    if kind not in found.rigs:
        where = f"a bench, --rig {setting.rig}" if kind == BENCH else f"rig {kind}"
        known = " or ".join(name for name in RIGS if name in found.rigs and ":" not in name)
        return f"{key} has no effect with {where}", f"leave it out, or use --rig {known}"
    if setting.vision not in found.visions:
        known = " or ".join(name for name in VISIONS if name in found.visions)
        return (
            f"{key} has no effect with vision {setting.vision}",
            f"leave it out, or use --vision {known}",
        )
    if not found.used(setting):
        return f"{key} has no effect here", f"it needs {found.needs}"
    return None


def check(entries: Sequence[str], given: Mapping[str, str], setting: Setting) -> tuple[str, ...]:
    """Check that each variation has an effect.

    Args:
        entries: the variations, as for `overrides.apply`.
        given: the options, or the file, that replace values of the variations, by dotted key.
        setting: rig and vision, and scenario and instrument with all changes.

    Returns:
        Notes, each in one line: parts of variations and of the scenario that have no effect.

    Raises:
        ConfigError: nothing that a variation changes has an effect.
    """
    notes = []
    for n, entry in enumerate(entries):
        reasons = dict(_reasons(entry, entries[n + 1 :], given, setting))
        without = [found for found in reasons.values() if found]
        if len(without) == len(reasons):
            what, next_step = without[0] if without else ("it changes nothing", "leave it out")
            raise ConfigError(what if "=" in entry else f"{entry}: {what}", next_step)
        notes += [f"{entry}: {what}" for what, _ in without]
    changed = {key for entry in entries for key, _ in overrides.changed_keys(entry)}
    return (*notes, *_of_scenario(setting, changed))


def _reasons(
    entry: str, later: Sequence[str], given: Mapping[str, str], setting: Setting
) -> Iterator[tuple[str, tuple[str, str] | None]]:
    """Yield what a variation changes, each with why it has no effect."""
    replaced = {key for other in later if "=" in other for key, _ in overrides.changed_keys(other)}
    for key, value in overrides.changed_keys(entry):
        if key.startswith("law."):
            yield key, None
        elif key in given:
            yield key, (f"{key} is set by {given[key]} too", "give it once")
        elif key in replaced and "=" in entry:
            yield key, (f"{key} is given twice", "give it once")
        elif found := reason(key, setting):
            yield key, found
        elif isinstance(value, list | tuple) and value:
            named = {f"{key}.{n}": part for n, part in enumerate(value)}
            yield from _too_late(named, setting.scenario.duration_s)
        else:
            yield key, None


def _too_late(
    parts: Mapping[str, Any], duration_s: float
) -> Iterator[tuple[str, tuple[str, str] | None]]:
    """Yield the parts of a list, each with why it has no effect: it starts after the end."""
    for key, part in parts.items():
        start_s = part.get("start_s") if isinstance(part, dict) else getattr(part, "start_s", None)
        if start_s is None or start_s < duration_s:
            yield key, None
        else:
            yield (
                key,
                (
                    f"{key} starts at {start_s:g} s, after the end at {duration_s:g} s",
                    "use a longer --duration-s, or an earlier start_s",
                ),
            )


def _of_scenario(setting: Setting, changed: Iterable[str]) -> Iterator[str]:
    """Yield what a scenario holds that has no effect, besides what variations changed."""
    scenario, rig = setting.scenario, setting.rig
    late: dict[str, Any] = {}
    for name in ("motion", "shaft", "push", "occluder", "change", "video_gap"):
        if name not in changed:
            parts = enumerate(getattr(scenario, name))
            late |= {f"{name}.{n}": part for n, part in parts if isinstance(part, Event)}
    for _, found in _too_late(late, scenario.duration_s):
        if found:
            yield f"scenario {scenario.name}: {found[0]}"
    if rig.startswith(SERIAL):
        return  # a screen or a person moves what a scenario describes
    differing = overrides.flat(scenario.model_dump(exclude={"name"}, exclude_defaults=True))
    unread = [key for key in differing if key not in changed and reason(key, setting)]
    if unread:
        yield (
            f"scenario {scenario.name}: without effect with rig {rig} and vision {setting.vision}: "
            f"{', '.join(unread)}"
        )
