"""How fast the serial link is: part of `endolock benchmark`.

Two motors, a sync write of both goals and a sync read of both blocks in each cycle, from this
process to the emulator in another one, over a pty. The bound is the time that the bytes of a cycle
take on a wire.
"""

from __future__ import annotations

import time
import timeit
from statistics import median

from endolock.control import loop, registry
from endolock.hw.bench.wall_clock import WallClock
from endolock.hw.dynamixel.packets import crc
from endolock.hw.dynamixel.port import BAUD, BITS
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
"""Simulated time of the run in lock-step, and wall time of the one by the wall [s]."""


def measure() -> dict[str, float]:
    """Return the figures by name.

    `cycles_per_s` without pacing; `over_wire` the share of the cycles that a wire of 1 Mbaud could
    carry; `host_cpu_1khz` the share of a core that 1000 cycles a second cost this process;
    `crc_us` one checksum of 62 bytes; `lock_step_rtf` and `overrun_fraction_100hz` of whole runs
    without pictures.
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
    """Time that the bytes of a cycle take on the wire [s]: two requests, two answers."""
    return BITS * CYCLE_BYTES / BAUD


def _cycle_s(rig: HilRig, count: int) -> float:
    """Mean time of a cycle of the bus [s]."""
    goals = (2048, 2048)
    start = time.perf_counter()
    for _ in range(count):
        assert None not in rig.line.cycle(goals, _always).blocks
    return (time.perf_counter() - start) / count


def _always(_place: int, _block: bytes, _sent_at: float, _came_at: float) -> bool:
    return True


def _cpu_at_1khz(rig: HilRig) -> float:
    """Share of a core that guard, drive and bus take at 1 kHz."""
    rig.actuators.enable()
    clock = WallClock()
    start, used = time.perf_counter(), time.process_time()
    for n in range(round(1000 * FAST_S)):
        clock.sleep_until(n * 1e-3)
        rig.actuators.exchange(None)
    return (time.process_time() - used) / (time.perf_counter() - start)


def _lock_step() -> float:
    """Simulated seconds a second of `straight` with `pi`, in lock-step."""
    factors = []
    for _ in range(3):
        with HilRig("straight", pictures=False) as rig:
            law, eyes = registry.make("pi", rig.camera.calibration), TruthEyes(rig.truth)
            start = time.perf_counter()
            loop.run(rig, eyes, law, duration_s=RUN_S)
            factors.append(RUN_S / (time.perf_counter() - start))
    return median(factors)


def _overruns() -> float:
    """Share of the ticks at 100 Hz that were missed in wall time."""
    with HilRig("straight", pictures=False, wall=True) as rig:
        law, eyes = registry.make("pi", rig.camera.calibration), TruthEyes(rig.truth)
        run = loop.run(rig, eyes, law, duration_s=CONTROL_S, period_s=0.01)
    skipped = sum(tick.skipped for tick in run.ticks)
    return skipped / (len(run.ticks) + skipped)
