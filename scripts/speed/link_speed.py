"""Speed of the serial link.

A cycle is a sync write of both goals and a sync read of both blocks, for two motors, from this
process to the emulator in another process over a pty. The bound is the transmission time of a
cycle's bytes on a wire.
"""

from __future__ import annotations

import time
import timeit
from statistics import median

from endolock.control import loop, registry
from endolock.hw.bench.wall_clock import WallClock
from endolock.hw.dynamixel.packets import crc
from endolock.hw.dynamixel.port import BITS, DEFAULT_BAUD
from endolock.hw.dynamixel.servo_bus import CYCLE_BYTES
from endolock.twin.hil.hil_rig import HilRig
from endolock.vision.truth_eyes import TruthEyes

CYCLES = 3000
REPEAT = 5
PACED_CYCLES = 1000
FRAME = bytes(range(62))
FAST_S = 5.0
"""Wall time of the loop at 1 kHz [s]."""
RUN_S = 10.0
CONTROL_S = 20.0
"""Simulated time of the run in lock-step, and wall time of the run in wall-clock mode [s]."""


def measure() -> dict[str, float]:
    """Return the figures by name.

    `cycles_per_s`: cycles per second without pacing; `over_wire`: cycles with pacing, as a fraction
    of those that a wire of 1 Mbaud could carry; `host_cpu_1khz`: load of one core in this process
    at 1000 cycles per second; `crc_us`: one checksum of 62 bytes [us]; `lock_step_rtf` and
    `overrun_fraction_100hz`: whole runs without pictures.
    """
    wire_s = _wire_s()
    with HilRig("rest", pictures=False, paced=True) as rig:
        paced_s = median(_cycle_s(rig, PACED_CYCLES) for _ in range(3))
    with HilRig("rest", pictures=False) as rig:
        free_s = median(_cycle_s(rig, CYCLES) for _ in range(REPEAT))
        cpu = _cpu_at_1khz(rig)
    rounds = 10_000
    return {
        "cycles_per_s": 1 / free_s,
        "over_wire": wire_s / paced_s,
        "host_cpu_1khz": cpu,
        "crc_us": 1e6 * min(timeit.repeat(lambda: crc(FRAME), number=rounds, repeat=5)) / rounds,
        "lock_step_rtf": _lock_step(),
        "overrun_fraction_100hz": _overruns(),
    }


def _wire_s() -> float:
    """Transmission time of a cycle on the wire [s]: two requests, two answers."""
    return BITS * CYCLE_BYTES / DEFAULT_BAUD


def _cycle_s(rig: HilRig, count: int) -> float:
    """Mean time of a bus cycle [s]."""
    goals = (2048, 2048)
    start = time.perf_counter()
    for _ in range(count):
        assert None not in rig.line.cycle(goals, _always).blocks
    return (time.perf_counter() - start) / count


def _always(_place: int, _block: bytes, _sent_at: float, _came_at: float) -> bool:
    return True


def _cpu_at_1khz(rig: HilRig) -> float:
    """Load of one core by guard, drive and bus at 1 kHz [1]."""
    rig.actuators.enable()
    clock = WallClock()
    start, used = time.perf_counter(), time.process_time()
    for n in range(round(1000 * FAST_S)):
        clock.sleep_until(n * 1e-3)
        rig.actuators.exchange(None)
    return (time.process_time() - used) / (time.perf_counter() - start)


def _lock_step() -> float:
    """Simulated seconds per second of `straight` with `pi`, in lock-step."""
    factors = []
    for _ in range(3):
        with HilRig("straight", pictures=False) as rig:
            law, eyes = registry.make("pi", rig.camera.calibration), TruthEyes(rig.truth)
            start = time.perf_counter()
            loop.run(rig, eyes, law, duration_s=RUN_S)
            factors.append(RUN_S / (time.perf_counter() - start))
    return median(factors)


def _overruns() -> float:
    """Fraction of the ticks at 100 Hz that were missed in wall-clock mode [1]."""
    with HilRig("straight", pictures=False, wall=True) as rig:
        law, eyes = registry.make("pi", rig.camera.calibration), TruthEyes(rig.truth)
        run = loop.run(rig, eyes, law, duration_s=CONTROL_S, period_s=0.01)
    skipped = sum(tick.skipped for tick in run.ticks)
    return skipped / (len(run.ticks) + skipped)
