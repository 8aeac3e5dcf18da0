"""Keys without effect: the table of who reads what, compared with what happens."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, fields, replace
from math import sin
from pathlib import Path
from typing import Any

import pytest

from endolock import Experiment
from endolock.control import loop, metrics
from endolock.hw.api import Command, ConfigError, State
from endolock.scripts import cli
from endolock.scripts.runs import effects, rigs
from endolock.scripts.runs.effects import Setting
from endolock.twin.world import scenario as scenarios
from endolock.twin.world.instrument import Instrument, Numerics
from endolock.twin.world.scenario import LISTS, SECTIONS, Scenario
from endolock.vision.observation import Observation

DURATION_S = 0.8
STILL = {"start_s": 0.0, "over_s": 1.0}
BASE: dict[str, Any] = {
    "duration_s": DURATION_S,
    "board.kind": "several",
    "board.tilt_deg": 10.0,
    "board.depth_travel_m": 0.02,
    "board.depth_period_s": 2.0,
    "motion": [{"kind": "circle", "radius_m": 0.03, "period_s": 3.0}],
    "camera.latency_s": 0.1,
    "camera.exposure_s": 0.01,
    "camera.jitter_s": 0.01,
}
"""A scenario in which every key has an effect on some rig."""
OTHER: dict[str, Any] = {
    "shaft_bend_deg": 90.0,
    "gravity": True,
    "motion": [],
    "shaft": [{"kind": "roll", "by_deg": 30.0, **STILL}],
    "push": [{"force_n": 0.5, **STILL}],
    "occluder": [
        {"size_m": [0.9, 0.9], "distance_m": 0.06, "position_m": [0, 0], "to_m": [0, 0], **STILL}
    ],
    "change": [{"friction_times": 3.0, "start_s": 0.0, "over_s": 0.1}],
    "video_gap": [{"start_s": 0.3, "over_s": 0.3}],
    "board.distance_m": 0.1,
    "board.depth_travel_m": 0.04,
    "board.depth_period_s": 1.0,
    "board.kind": "tissue",
    "board.target": 2,
    "board.tilt_deg": -20.0,
    "board.tilt_axis_deg": 90.0,
    "light.room": 0.5,
    "light.tip": 0.3,
    "light.falls_off": True,
    "light.back": 0.5,
    "camera.width": 720,
    "camera.height": 576,
    "camera.projection": "equidistant",
    "camera.fovy_deg": 70.0,
    "camera.diagonal_deg": 100.0,
    "camera.mask": "circle",
    "camera.vignette": 0.5,
    "camera.gain": 0.5,
    "camera.exposure_s": 0.03,
    "camera.sub_exposures": 3,
    "camera.noise": 5.0,
    "camera.jpeg_quality": 30,
    "camera.frame_rate_hz": 20.0,
    "camera.latency_s": 0.2,
    "camera.nominal_latency_s": 0.05,
    "camera.jitter_s": 0.03,
    "camera.drop_fraction": 0.5,
    "camera.repeat_fraction": 0.5,
    "camera.background": False,
    "camera.truth_noise_px": 2.0,
    "tracker.rate_hz": 60.0,
    "tracker.latency_s": 0.1,
    "tracker.position_noise_m": 0.01,
    "tracker.rotation_noise_deg": 1.0,
    "tracker.drop_fraction": 0.5,
    **{f"instrument.{name}": 1.1 * value for name, value in asdict(Instrument()).items()},
    "instrument.damping_time_s": 0.005,
    "instrument.sheath_friction_nm": 0.005,
    "instrument.misalignment_rad": 0.2,
    "instrument.slack_loss_m_per_rad": 0.0005,
    "instrument.handle_range_rad": 0.4,
    "instrument.handle_speed_rad_s": 1.0,
    "instrument.handle_torque_nm": 0.02,
    "numerics.hinges": 10,
    "numerics.timestep_s": 0.001,
    "numerics.nodes": 2,
}
"""Another value of every key, which makes a difference where the key is read."""
ALWAYS = ("summary", "duration_s", "scored_from_s")
"""Words about a scenario, and how long it takes, on every rig."""
SETTINGS = [
    *[(rig, "truth") for rig in ("twin", "surrogate", "quasi_static", "play")],
    *[("twin", vision) for vision in ("markers", "track")],
    *[("hil", "truth"), ("serial:nowhere", "markers")],
]


REST = scenarios.load("rest")


class Swinging:
    """Turns both handles without looking."""

    def reset(self, state: State) -> None:
        """Need nothing."""

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Turn them fast and far enough for every limit."""
        return Command(position=(0.5 * sin(6 * t), 0.8 * sin(9 * t)))


def made(changes: Mapping[str, Any], base: Mapping[str, Any] = BASE) -> dict[str, Any]:
    """Return scenario, instrument and numerics with changes."""
    parts: dict[str, dict[str, Any]] = {"instrument": {}, "numerics": {}}
    values = dict(base)
    for key, value in changes.items():
        section, _, name = key.partition(".")
        if section in parts:
            parts[section][name] = value
        else:
            values[key] = value
    if any(key.startswith("tracker.") for key in changes):
        values.setdefault("tracker.rate_hz", 100.0)
    return {
        "scenario": scenarios.load("rest", values),
        "instrument": Instrument(**parts["instrument"]),
        "numerics": Numerics(**parts["numerics"]),
    }


def outcome(
    rig: str, vision: str, changes: Mapping[str, Any], base: Mapping[str, Any] = BASE
) -> str:
    """Run without the check and return all that came of it."""
    parts = made(changes, base)
    scenario = parts.pop("scenario")
    with rigs.make(rig, scenario, vision=vision, seed=0, **parts)[0] as device:
        eyes = rigs.eyes_of(device, vision, scenario, 0)
        ran = loop.run(device, eyes, Swinging(), duration_s=DURATION_S)
        scores = metrics.score(ran, device.camera.calibration, 0.0, scenario.camera.exposure_s)
    ticks = [(t.state, t.tracked, t.truth) for t in ran.ticks]
    known = [
        (state, tracked, truth and (truth.target_px, truth.hidden, truth.in_picture))
        for state, tracked, truth in ticks
    ]
    frames = [(replace(s.frame, image=None), s.observation) for s in ran.seen]
    return repr((known, frames, scores))


def keys() -> list[str]:
    """List all keys of scenarios, instruments and numerics; lists count as a whole."""
    plain = [name for name in Scenario.model_fields if name not in (*SECTIONS, "name")]
    nested = [f"{part}.{name}" for part, model in SECTIONS.items() for name in model.model_fields]
    others = [("instrument", Instrument), ("numerics", Numerics)]
    return plain + nested + [f"{part}.{f.name}" for part, kind in others for f in fields(kind)]


def idle(rig: str, vision: str) -> list[str]:
    """List the keys that the table says have no effect."""
    parts = made({})
    setting = Setting(rig, vision, parts["scenario"], parts["instrument"], REST)
    return [key for key in OTHER if effects.reason(key, setting)]


def test_the_table_knows_every_key_and_no_other() -> None:
    assert set(OTHER) | set(ALWAYS) == set(keys())
    assert set(effects.KEYS) <= set(keys())
    assert set(effects.OF_SECTIONS) <= {key.partition(".")[0] for key in keys()}
    assert set(LISTS) <= set(effects.KEYS)


def without_effect(rig: str, vision: str) -> tuple[dict[str, Any], str, str]:
    unread = {key: OTHER[key] for key in idle(rig, vision)}
    refused = ("shaft", "push", "tracker")  # by the rigs themselves, also in files
    changed = {key: v for key, v in unread.items() if key.split(".")[0] not in refused}
    base = {key: value for key, value in BASE.items() if key not in changed}
    return unread, outcome(rig, vision, {}), outcome(rig, vision, changed | base)


@pytest.mark.parametrize(("rig", "vision"), SETTINGS[:4])
def test_all_keys_that_are_said_to_have_no_effect_together_have_none(rig: str, vision: str) -> None:
    unread, before, after = without_effect(rig, vision)
    assert "camera.noise" in unread
    assert after == before


@pytest.mark.slow  # pictures
@pytest.mark.parametrize(("rig", "vision"), SETTINGS[4:7])
def test_keys_without_effect_have_none_with_pictures_and_over_a_line(rig: str, vision: str) -> None:
    _, before, after = without_effect(rig, vision)
    assert after == before


FAR = [{"kind": "circle", "radius_m": 0.16, "period_s": 3.0}]
SUITED: dict[str, dict[str, Any]] = {
    "camera.diagonal_deg": {"camera.projection": "equidistant"},
    "camera.mask": {"motion": FAR},  # to a corner, which a mask hides
}
"""What else a key needs to have an effect, besides `BASE`."""


def each_with_effect(rig: str, vision: str, part: slice) -> None:
    unread, usual = idle(rig, vision), outcome(rig, vision, {})
    for key in [key for key in OTHER if key not in unread or key in SUITED][part]:
        suited = {"tracker.rate_hz": 100.0} if key.startswith("tracker.") else SUITED.get(key, {})
        base = {**BASE, **suited}
        before = outcome(rig, vision, {}, base) if suited else usual
        assert outcome(rig, vision, {key: OTHER[key]}, base) != before, key


@pytest.mark.parametrize("rig", ["surrogate", "quasi_static", "play"])
def test_every_key_with_an_effect_has_one_without_physics(rig: str) -> None:
    each_with_effect(rig, "truth", slice(None))


def test_every_key_with_an_effect_has_one_on_the_twin() -> None:
    each_with_effect("twin", "truth", slice(0, None, 6))  # all of them among the slow tests


@pytest.mark.slow
@pytest.mark.parametrize(("rig", "vision"), [("twin", "truth"), ("twin", "markers")])
def test_every_single_key_with_an_effect_has_one(rig: str, vision: str) -> None:
    each_with_effect(rig, vision, slice(None))


@pytest.mark.parametrize(
    ("key", "value", "needs"),
    [
        ("camera.diagonal_deg", 100.0, {"camera.projection": "equidistant"}),
        ("board.depth_period_s", 1.0, {"board.depth_travel_m": 0.02}),
        ("board.tilt_deg", 20.0, {"board.kind": "several"}),
        ("board.tilt_axis_deg", 90.0, {"board.kind": "several", "board.tilt_deg": 10.0}),
        ("instrument.slack_loss_m_per_rad", 5e-4, {"shaft_bend_deg": 90.0}),
        ("instrument.residual_wrap_rad", 2.0, {}),
    ],
)
def test_a_key_that_needs_another_is_refused_without_it(
    key: str, value: Any, needs: dict[str, Any]
) -> None:
    poor: dict[str, Any] = {"shaft_bend_deg": 0.0, "instrument.conduit_friction": 0.0}
    if needs:
        del poor["instrument.conduit_friction"]
    vary = tuple(f"{name}={number}" for name, number in {key: value, **poor}.items())
    rich = {name: setting for name, setting in poor.items() if name == "shaft_bend_deg"} | needs
    assert outcome("quasi_static", "truth", {key: value, **poor}, {}) == outcome(
        "quasi_static", "truth", poor, {}
    )
    plain: dict[str, Any] = {"scenario": "rest", "rig": "quasi_static", "vision": "truth"}
    with pytest.raises(ConfigError, match=rf"{key} has no effect here; it needs "):
        Experiment(**plain, vary=vary).resolve()
    assert outcome("quasi_static", "truth", {key: value, **rich}, {}) != outcome(
        "quasi_static", "truth", rich, {}
    )
    given = tuple(f"{name}={setting}" for name, setting in {key: value, **rich}.items())
    Experiment(**plain, vary=given).resolve()


@pytest.mark.parametrize(("rig", "vision"), SETTINGS)
def test_what_has_no_effect_is_refused_by_name(rig: str, vision: str) -> None:
    """By the check that every run and every comparison makes first."""
    parts = made({})
    setting = Setting(rig, vision, parts["scenario"], parts["instrument"], REST)
    unread = idle(rig, vision)
    for key in unread:
        value = OTHER[key]
        if isinstance(value, float | int | str):
            with pytest.raises(ConfigError, match=f"^{key} has no effect (with|here)"):
                effects.check([f"{key}={str(value).lower()}"], {}, setting)
    for key in OTHER:
        if key not in unread and isinstance(OTHER[key], float | int | str):
            effects.check([f"{key}={str(OTHER[key]).lower()}"], {}, setting)


TRUTH = {"vision": "truth"}
RUBBING = "change=[{start_s=1, over_s=1, friction_times=2.0}]"


@pytest.mark.parametrize(
    ("vary", "options", "why"),
    [
        (["gravity=true"], {"rig": "surrogate"}, "gravity has no effect with rig surrogate"),
        (["camera.noise=3"], {}, "camera.noise has no effect with vision truth; leave it out"),
        (["camera.truth_noise_px=3"], {"vision": "markers"}, "no effect with vision markers"),
        (["noise"], {"vision": "markers"}, "noise: camera.truth_noise_px has no effect with"),
        (["lag_less"], {"rig": "surrogate"}, "lag_less: instrument.handle_kv has no effect"),
        (["numerics.nodes=3"], {"rig": "play"}, "numerics.nodes has no effect with rig play"),
        (["jump"], {}, "jump: motion.0 starts at 60 s, after the end at 25 s; use a longer"),
        (["jump"], {"duration_s": 60.0}, "motion.0 starts at 60 s, after the end at 60 s"),
        (["shaft_rolls"], {"duration_s": 30.0}, "shaft.0 starts at 60 s, after the end at 30 s"),
        (
            ["change=[{start_s=9, over_s=1, jitter_s=0.1}]"],
            {"duration_s": 9.0},
            "change.0 starts at 9 s, after the end at 9 s",
        ),
        (
            ["video_gap=[{start_s=9, over_s=1}]"],
            {"duration_s": 8.0},
            "video_gap.0 starts at 9 s, after the end at 8 s",
        ),
        ([RUBBING], {"rig": "dead_zone"}, "change has no effect here; it needs .*friction"),
        ([RUBBING, "no_hysteresis"], {}, "change has no effect here; it needs .*friction"),
        (["occlusions"], {"duration_s": 5.0}, "occluder.0 starts at 5 s, after the end at 5 s"),
        (
            ["motion=[{kind='jump', travel_m=0.1, start_s=9, over_s=1}]"],
            {"duration_s": 8.0},
            "motion.0 starts at 9 s, after the end at 8 s",
        ),
        (["camera.gain=2", "camera.gain=3"], {"vision": "markers"}, "camera.gain is given twice"),
        (["camera.latency_s=0.2"], {"latency_s": 0.3}, "camera.latency_s is set by --latency-s"),
        (["duration_s=3"], {"duration_s": 4.0}, "duration_s is set by --duration-s too"),
    ],
)
def test_a_change_that_changes_nothing_is_refused(
    vary: list[str], options: dict[str, Any], why: str
) -> None:
    with pytest.raises(ConfigError, match=why) as caught:
        Experiment(scenario="straight", vary=tuple(vary), **{**TRUTH, **options}).resolve()
    assert "\n" not in str(caught.value)


def test_a_change_without_meaning_is_refused(tmp_path: Path) -> None:
    (tmp_path / "none.toml").write_text('summary = "nothing"\n')
    vary = (str(tmp_path / "none.toml"),)
    with pytest.raises(ConfigError, match=r"none\.toml: it changes nothing; leave it out"):
        Experiment(scenario="straight", vary=vary, vision="truth").resolve()


@pytest.mark.parametrize(
    ("options", "notes"),
    [
        ({"scenario": "straight"}, []),
        ({"scenario": "straight", "vary": ("jump",), "duration_s": 100.0}, []),
        (
            {"scenario": "push", "duration_s": 2.0},
            ["scenario push: push.0 starts at 15 s, after the end at 2 s"],
        ),
        (
            {"scenario": "straight", "vary": ("occlusions",), "duration_s": 30.0},
            [f"occlusions: occluder.{n} starts at {t} s, after" for n, t in ((2, 35), (3, 50))],
        ),
        (
            {"scenario": "straight", "vary": ("all_at_once",), "vision": "markers"},
            ["all_at_once: camera.truth_noise_px has no effect with vision markers"],
        ),
        (
            {"scenario": "endoscope"},
            ["scenario endoscope: without effect with rig twin and vision truth: light.room"],
        ),
    ],
)
def test_what_is_without_effect_beside_others_is_said(
    options: dict[str, Any], notes: list[str]
) -> None:
    found = Experiment(**{**TRUTH, **options}).resolve().notes
    assert bool(found) == bool(notes)
    for note in notes:
        assert any(said.startswith(note) for said in found), note


def test_a_note_is_one_line_on_standard_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    args = ["--rig", "surrogate", "--vision", "truth", "--duration-s", "1", "--json", "-"]
    out = ["--out", str(tmp_path / "run")]
    assert cli.main(["compare", "--scenarios", "jump", "--controllers", "still", *args, *out]) == 0
    said = capsys.readouterr()
    assert said.err.count("endolock: note: ") == 1
    assert "note: scenario jump: motion.0 starts at 10 s, after the end at 1 s\n" in said.err
    assert said.out.startswith("{")
