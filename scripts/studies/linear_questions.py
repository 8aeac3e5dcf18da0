"""Predictions of linear theory for the loops, compared with the twin."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from endolock.control import registry
from endolock.control.laws.hysteresis_compensation import CompensationSettings, Direction, follow
from endolock.control.laws.pi import PISettings
from endolock.control.loop import PERIOD_S
from endolock.control.transmission.kinematics import SectionGeometry
from endolock.control.transmission.linear_process import HOLD_S, Process, image_gain, simc
from endolock.control.transmission.plays import play
from endolock.hw.api import Command, Vector
from endolock.scripts.figures.palette import SERIES
from endolock.scripts.runs import batch
from endolock.scripts.runs.markdown_table import markdown_table
from endolock.scripts.studies.answers import Answer, experiment
from endolock.twin.rig import TwinRig
from endolock.twin.world import scenario
from endolock.twin.world.instrument import Instrument
from endolock.vision import camera_model

if TYPE_CHECKING:
    from endolock.control.analysis import LimitCycle, Response

STEP_RAD = 0.1
OWN_WIDTH = 0.168
"""Width of the twin's loop near the centre over 180 deg: `endolock hysteresis`, 10 deg of bend."""
FOCAL_PX = 262.0
APPROACH_RAD = 0.9
"""Handle motion in the same direction before the step, so that the wires already slide [rad]."""


def process() -> Answer:
    """Identify gain, lag and dead time from a step; compute the margins with them."""
    from endolock.control import analysis

    t, error = step_response()
    found, misfit = analysis.identify_step(t, error, STEP_RAD)
    assumed = Process(gain=image_gain(SectionGeometry(), 0.12), dead_s=0.4 + HOLD_S)
    rows = [
        [name, f"{one.gain:.2f}", f"{1e3 * one.lag_s:.0f} ms", f"{one.dead_s:.3f} s"]
        for name, one in (("from the step", found), ("assumed by the controllers", assumed))
    ]
    text = markdown_table(["", "error per handle [rad/rad]", "lag", "dead time"], rows)
    text += (
        f"\nThe model fits the step response within {1e3 * misfit:.1f} mrad rms. That response\n"
    )
    text += f"has no hold of frames and ticks; the controllers assume {HOLD_S:g} s for it.\n\n"
    loop = Process(gain=found.gain, lag_s=found.lag_s, dead_s=found.dead_s + HOLD_S)
    rows = []
    for name in sorted(registry.LAWS):
        if name == "repetitive" or not (
            response := analysis.response(registry.configure(name), loop)
        ):
            continue  # no linear part, or none without a period
        m = analysis.margins(response, loop)
        rows.append([name, f"{m.gain:.1f}", f"{m.phase_deg:.0f} deg", f"{m.dead_s:.2f} s"])
    text += markdown_table(["law", "gain margin", "phase margin", "dead time margin"], rows)

    def draw(panel: Any) -> None:
        panel.plot(t, 1e3 * error, ".", color=SERIES[0], label="as seen by the camera")
        since = np.maximum(t - found.dead_s, 0)
        model = -found.gain * STEP_RAD * -np.expm1(-since / found.lag_s)
        panel.plot(t, 1e3 * model, color=SERIES[1], lw=1, label="gain, lag and dead time")
        panel.set_xlabel("time since the step [s]")
        panel.set_ylabel("error [mrad]")

    return Answer(text, draw)


def step_response() -> tuple[Vector, Vector]:
    """Step a handle of the twin that already moves; return times [s] and errors [rad].

    Frames come at 100 Hz: the response ends within a few frames at 25 Hz.
    """
    quick = {"camera.frame_rate_hz": 100.0}
    with TwinRig(scenario.load("rest", quick), pictures=False) as rig:
        rig.actuators.enable()
        calibration = rig.camera.calibration
        t, error, newest, start = [], [], -1, 6.0
        while rig.clock.now() < start + 1.2:
            now = rig.clock.sleep_until(rig.clock.now() + 0.01)
            ramp = APPROACH_RAD * min(now / (start - 1.5), 1.0)
            goal = ramp + (STEP_RAD if now >= start - 1e-9 else 0.0)
            rig.actuators.exchange(Command(position=(0.0, goal)))
            frame = rig.camera.latest()
            if frame is not None and frame.seq > newest:
                newest = frame.seq
                right, _ = camera_model.offset(calibration, rig.truth.at_exposure(newest).target_px)
                t.append(frame.t_available - start)
                error.append(np.arctan(right / calibration.focal_px))
    times, angles = np.array(t), np.array(error)
    before = angles[(times > -0.2) & (times <= 0.0)].mean()
    after = times > 0
    # The step turns the tip by less than 0.15 rad: the error is a small change of a large angle.
    return times[after], angles[after] - before


def limit_cycle() -> Answer:
    """Compare the ringing of over-compensation with its describing function."""
    from endolock.control import analysis

    loop = Process(gain=image_gain(SectionGeometry(), 0.12), dead_s=0.4 + HOLD_S)
    kp, ki = simc(loop)  # larger gains move the target out of the picture: no error is seen there
    response = analysis.response(PISettings(kp=kp, ki=ki), loop)
    assert response is not None
    same = (f"law.kp={kp:.6g}", f"law.ki={ki:.6g}", f"motion=[{NUDGE}]")
    widths = (0.2, 0.25, 0.3, 0.35)
    done = batch.all_of([experiment("rest", "pi_hc", f"law.width={w}", *same) for w in widths])
    rows = []
    for width, one in zip(widths, done, strict=True):
        found = analysis.ringing(response, loop, _compensated(width))
        late = one.t > 20
        error = one.error[late, 0]
        at_tip = "-" if found is None else f"{found.omega_rad_s / 2 / np.pi:.2f} Hz"
        size = "-" if found is None else f"{_pixels(found, response):.0f} px"
        seen = f"{_frequency(one.t[late], error):.2f} Hz"
        rows.append([f"{width:g}", at_tip, seen, size, f"{np.sqrt(2) * error.std():.0f} px"])

    def draw(panel: Any) -> None:
        for n, (width, one) in enumerate(zip(widths, done, strict=True)):
            late = (one.t > 30) & (one.t < 36)
            panel.plot(one.t[late], one.error[late, 0], color=SERIES[n], lw=1, label=f"{width:g}")
        panel.set_xlabel("time [s]; by width")
        panel.set_ylabel("error [px]")

    head = ["width", "predicted", "twin", "amplitude predicted", "twin"]
    return Answer(markdown_table(head, rows), draw)


def _compensated(width: float) -> Callable[[Vector], Vector]:
    """Return the chain from output to bend: compensation, slew of the handles, play."""
    settings = CompensationSettings(form="sign", width=width)
    reach = Instrument().handle_speed_rad_s * PERIOD_S

    def chain(outputs: Vector) -> Vector:
        direction, handle, handles = Direction(), 0.0, []
        for before, now in pairwise([float(outputs[0]), *outputs.tolist()]):
            goal = now + follow(settings, direction, before, now, PERIOD_S)
            handle = min(max(goal, handle - reach), handle + reach)
            handles.append(handle)
        return play(np.array(handles), OWN_WIDTH * np.pi / 2)

    return chain


def _pixels(found: LimitCycle, response: Response) -> float:
    """Amplitude of the error of a limit cycle [px], from that of the controller's output."""
    gain = abs(response(np.array([1j * found.omega_rad_s]))[0])
    return float(found.amplitude_rad / gain * FOCAL_PX)


NUDGE = "{kind='jump', travel_m=0.01, start_s=2.0, over_s=0.5}"
"""A small jump of the target that starts the oscillation."""


def _frequency(t: Vector, error: Vector) -> float:
    """Dominant frequency [Hz]; 0 without oscillation."""
    still = error - error.mean()
    if still.std() < 0.5:
        return 0.0
    power = np.abs(np.fft.rfft(still * np.hanning(len(still)))) ** 2
    return float(np.fft.rfftfreq(len(still), t[1] - t[0])[1:][int(power[1:].argmax())])
