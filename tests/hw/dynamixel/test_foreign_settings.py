"""Motors as other programs leave them: refused before they move, or a goal means what it should."""

from __future__ import annotations

import random
from math import copysign, pi, remainder
from pathlib import Path

import pytest
from tests.hw.emulated import STEP_RAD, Emulated

from endolock.hw.api import AXES, HardwareError, StateError
from endolock.hw.dynamixel import bus_log, models
from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.handle import Handle
from endolock.hw.dynamixel.models import MODELS, UNFIT, Model
from endolock.hw.dynamixel.packets import Instruction, Parser
from endolock.hw.dynamixel.registers import Register
from endolock.hw.dynamixel.settings import SETTINGS, Policy, Setting, Wish
from endolock.hw.emulator.control_table import LARGEST_GAIN
from endolock.hw.emulator.servo_model import Refused, Servo

LIMIT_A = 0.5
COUNT = 1.01 * STEP_RAD
"""One count of the encoder, and what rounding adds to it [rad]."""


def limited(limit_a: float | None = LIMIT_A) -> dict[str, Handle]:
    return {
        axis: Handle(id=i, zero_counts=2048, current_limit_a=limit_a)
        for i, axis in enumerate(AXES, 1)
    }


def true_rad(bench: Emulated) -> list[float]:
    return [motor.measure()[0] for motor in bench.motors]


def check_goals(bench: Emulated) -> None:
    """Enable without a movement, then follow a small stroke, each handle its own."""
    before, position = true_rad(bench), bench.guard.exchange(None).position
    for told, true in zip(position, bench.angles(), strict=True):
        # The zero is where it was; a motor that was turned by others may have lost whole turns.
        assert remainder(told - true, 2 * pi) == pytest.approx(0.0, abs=COUNT)
    bench.guard.enable()
    bench.follow(5)
    moved = [now - then for now, then in zip(true_rad(bench), before, strict=True)]
    assert moved == pytest.approx([0.0, 0.0], abs=2 * COUNT)
    # Towards zero, away from the limits; a handle that others left beyond one comes back to it.
    goals = position[0] - copysign(0.1, position[0]), position[1] - copysign(0.05, position[1])
    bench.follow(30, goals)
    rows = zip(goals, position, bench.guard.limits.position_rad, strict=True)
    stroke = [min(max(g, low), high) - p for g, p, (low, high) in rows]
    moved = [now - then for now, then in zip(true_rad(bench), before, strict=True)]
    assert moved == pytest.approx(stroke, abs=2 * COUNT)  # goals and readings are whole counts


def values(bench: Emulated, setting: Setting) -> list[int]:
    register = setting.register
    return [setting.value(register.decode(s.read(*register))) for s in bench.servos]


def writable(servo: Servo) -> bytes:
    return bytes(servo._table[: reg.TICK.address])  # above, it measures


# Models.


@pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.name)
def test_every_model_of_the_table_moves_as_told_and_measures_in_its_own_units(model: Model) -> None:
    other = MODELS[1040]  # on the same line, with another unit of current
    bench = Emulated(models=(model, other), handles=limited())
    for motor in bench.motors:
        motor.load_a = 0.4
    bench.guard.connect()
    check_goals(bench)

    units_a = model.units.current_a, other.units.current_a
    measured = zip(bench.guard.exchange(None).current, bench.servos, units_a, strict=True)
    for current, servo, unit_a in measured:
        assert current == pytest.approx(0.4, abs=unit_a)
        goal = reg.GOAL_CURRENT.decode(servo.read(*reg.GOAL_CURRENT))
        assert goal * unit_a == pytest.approx(LIMIT_A, abs=unit_a)
    told = bench.drive.describe()["motor"]["up_down"]
    assert (told["model"], told["units"]["current_a"]) == (model.name, model.units.current_a)


def test_units_of_current_are_those_of_the_manual() -> None:
    fine = {model.name for model in MODELS.values() if model.units.current_a == 1.34e-3}
    assert fine == {"XH430-V350", "XH430-V210"}
    assert {model.units.current_a for model in MODELS.values()} == {1.34e-3, 2.69e-3}
    assert not MODELS.keys() & UNFIT.keys()


@pytest.mark.parametrize("number", [*UNFIT, 4242])
@pytest.mark.parametrize("index", [0, 1])
def test_a_model_without_an_entry_is_refused_before_any_write(
    number: int, index: int, tmp_path: Path
) -> None:
    bench = Emulated()
    bench.servos[index]._store(reg.MODEL, number)
    tables = [writable(servo) for servo in bench.servos]
    bench.bus.record(tmp_path / "bus.log")
    with pytest.raises(StateError) as caught:
        bench.guard.connect()
    assert f"motor {index + 1} ({AXES[index]})" in str(caught.value)
    assert models.described(number) in str(caught.value)
    sent = [r.data for r in bus_log.read(tmp_path / "bus.log") if not r.came_in]
    kinds = {packet.instruction for data in sent for packet in Parser().feed(data)}
    assert kinds == {Instruction.PING}
    assert [writable(servo) for servo in bench.servos] == tables


# One register.


def foreign(setting: Setting, model: Model) -> list[int]:
    """Return values that another program may leave, within what the register accepts."""
    known = {
        reg.RETURN_DELAY: [250, 254],
        reg.DRIVE_MODE: [1, 4, 8, 13],
        reg.OPERATING_MODE: [0, 1, 3, 16],
        reg.SECONDARY_ID: [0, 1, 2, 7, 252],
        reg.HOMING_OFFSET: [-1024, 1, 4096],
        reg.PWM_LIMIT: [0, 442, 884],
        reg.CURRENT_LIMIT: [0, round(LIMIT_A / model.units.current_a) - 1],
        reg.STARTUP: [1, 2, 3],
        reg.SHUTDOWN: [0, 0x30, 0x01],
        reg.STATUS_LEVEL: [0, 1],
        reg.GOAL_PWM: [0, -200, 884],
        reg.GOAL_CURRENT: [0, -10],
        reg.PROFILE: [1, 5 << 32],
    }
    gains = [1, LARGEST_GAIN]
    return known.get(setting.register, [0, *gains] if "P" in setting.name else gains)


ONE_BY_ONE = [
    (setting, value)
    for setting in SETTINGS
    if setting.policy is not Policy.RECORD
    for value in foreign(setting, models.XM430_W350)
]


@pytest.mark.parametrize(
    ("setting", "value"), ONE_BY_ONE, ids=[f"{s.name} {v}" for s, v in ONE_BY_ONE]
)
def test_each_register_left_by_others_is_set_or_refused(setting: Setting, value: int) -> None:
    bench = Emulated(handles=limited())
    servo = bench.servos[0]
    if not setting.kept:  # a change of the mode at connecting would reset it
        servo.write(reg.OPERATING_MODE.address, bytes([reg.CURRENT_POSITION]))
    servo.write(setting.register.address, setting.register.encode(value))
    handle, model = bench.handles["up_down"], models.XM430_W350
    wanted = setting.wanted(Wish(handle=handle, model=model, units=model.units))
    if setting.policy is Policy.REFUSE:
        with pytest.raises(StateError, match=rf"^handle motor 1 \(up_down\) has a {setting.name} "):
            bench.guard.connect()
        assert values(bench, setting)[0] == value
        assert not any(motor.on for motor in bench.motors)
        return
    bench.guard.connect()
    assert wanted is not None
    assert values(bench, setting) == [wanted, wanted]
    told = bench.drive.describe()["motor"]["up_down"]
    assert told["registers"][setting.key] == wanted
    if setting.register is not reg.STATUS_LEVEL:  # set before anything is read
        assert f"{setting.name} {value} -> {wanted}" in told["changed"]
    check_goals(bench)


def test_what_is_only_recorded_is_in_the_description() -> None:
    bench = Emulated()
    bench.servos[1].write(reg.VELOCITY_LIMIT.address, reg.VELOCITY_LIMIT.encode(77))
    bench.guard.connect()
    told = bench.drive.describe()["motor"]["left_right"]
    assert told["registers"]["velocity_limit"] == 77
    assert set(told["registers"]) == {setting.key for setting in SETTINGS}
    assert told["firmware"] == 45


def test_settings_are_in_the_order_of_their_addresses() -> None:
    addresses = [setting.register.address for setting in SETTINGS]
    assert addresses == sorted(addresses)  # one request reads from the first to the last


def test_a_motor_that_refuses_addresses_without_a_register_is_asked_for_each() -> None:
    bench, usual = Emulated(), Emulated()
    read = bench.bus.read

    def reads_registers_only(device: int, register: Register) -> int:
        if register.size > 8:
            raise HardwareError("refused", "no register", t=0.0)
        return read(device, register)

    bench.bus.read = reads_registers_only  # type: ignore[method-assign]
    for each in (bench, usual):
        each.guard.connect()
    assert bench.drive.describe() == usual.drive.describe()


def test_a_motor_of_older_firmware_has_no_startup_configuration() -> None:
    bench = Emulated()
    for servo in bench.servos:
        servo._store(reg.FIRMWARE, reg.STARTUP_FIRMWARE - 1)
        servo._store(reg.STARTUP, 3)  # another meaning, or none
    bench.guard.connect()
    assert [servo.read(*reg.STARTUP) for servo in bench.servos] == 2 * [b"\x03"]


def test_a_current_limit_above_that_of_the_model_names_both() -> None:
    bench = Emulated(models=(MODELS[1040], MODELS[1040]), handles=limited(2.0))
    with pytest.raises(StateError) as caught:
        bench.guard.connect()
    assert str(caught.value) == (
        "handle motor 1 (up_down) has a current limit of 689 (0.923 A), below the current_limit_a "
        "of its handle, 2 A; use a smaller current_limit_a, or raise the motor's with the maker's "
        "DYNAMIXEL Wizard"
    )


@pytest.mark.parametrize(("which", "secondary"), [(0, 2), (1, 1)])
def test_a_motor_with_the_others_secondary_id_obeys_only_its_own(
    which: int, secondary: int
) -> None:
    bench = Emulated()
    bench.servos[which].write(reg.SECONDARY_ID.address, bytes([secondary]))
    bench.motors[1].angle_rad += 1.0  # obeying the other's goal would be a turn of 1.4 rad
    bench.guard.connect()
    assert [servo.secondary_id for servo in bench.servos] == [None, None]
    before = true_rad(bench)
    bench.guard.enable()
    bench.follow(10)
    assert true_rad(bench) == pytest.approx(before, abs=COUNT)


def test_what_a_motor_restores_at_a_start_does_not_hide_its_restart() -> None:
    bench = Emulated()
    bench.servos[0].write(reg.STARTUP.address, b"\x03")
    bench.guard.connect()
    bench.guard.enable()
    bench.follow(5)
    bench.servos[0].reboot()
    with pytest.raises(HardwareError, match="has restarted"):
        bench.follow(20)
    assert not bench.motors[0].on


# All registers at once.


ALL: dict[Register, list[int]] = {
    reg.RETURN_DELAY: [0, 250],
    reg.DRIVE_MODE: [*range(16)],
    reg.OPERATING_MODE: [0, 1, 3, 4, 5, 16],
    reg.SECONDARY_ID: [0, 1, 2, 3, 252, 253, 255],
    reg.PROTOCOL: [2, 2, 2, 2, 2, 1],
    reg.HOMING_OFFSET: [0, 0, 0, 0, 300, -4096],
    reg.PWM_LIMIT: [reg.FULL_PWM, reg.FULL_PWM, reg.FULL_PWM, 0, 300],
    reg.CURRENT_LIMIT: [0, 50, 500, 1193],
    reg.VELOCITY_LIMIT: [0, 200],
    reg.MAX_POSITION: [0, 4095],
    reg.MIN_POSITION: [0, 4000],
    reg.STARTUP: [0, 1, 2, 3],
    reg.SHUTDOWN: [0, 0x34, 0x3D],
    reg.STATUS_LEVEL: [0, 1, 2],
    reg.POSITION_D: [0, LARGEST_GAIN],
    reg.POSITION_I: [0, LARGEST_GAIN],
    reg.POSITION_P: [0, 1, 800, LARGEST_GAIN],
    reg.FEEDFORWARD_2: [0, LARGEST_GAIN],
    reg.FEEDFORWARD_1: [0, LARGEST_GAIN],
    reg.GOAL_PWM: [0, -885, 885, 10],
    reg.GOAL_CURRENT: [0, -40, 40, 1193],
    reg.PROFILE: [0, 1, 1 << 40],
    reg.GOAL_POSITION: [0, 4095, 100_000, -100_000],
    Register(reg.INDIRECT_ADDRESS.address, 2): [0, 132],
    reg.WATCHDOG: [0, 1, 127],
    reg.TORQUE_ENABLE: [0, 1],
}


def leave(servo: Servo, chance: random.Random) -> None:
    """Write registers as another program might, in any order; some are refused."""
    registers = list(ALL)
    chance.shuffle(registers)
    for register in registers[: chance.randrange(len(registers) + 1)]:
        try:
            servo.write(register.address, register.encode(chance.choice(ALL[register])))
        except Refused:
            continue
    if chance.random() < 0.2:
        servo.reboot()


def fuzz(seed: int) -> bool:
    """Connect to motors left by others; return whether that is possible."""
    chance = random.Random(seed)
    bench = Emulated(handles=limited(chance.choice([None, 0.02, 0.3, 3.0])))
    for servo in bench.servos:
        leave(servo, chance)
    bench.wait(chance.choice([0.0, 1.0]))  # what was on may move somewhere else
    refused = None
    try:
        bench.guard.connect()
    except HardwareError as error:
        refused = error
    if refused is None:
        check_goals(bench)
        return True
    assert "\n" not in str(refused)
    assert refused.next_step
    return False


def test_after_connecting_a_goal_means_what_it_should_whatever_was_left() -> None:
    usable = sum(fuzz(seed) for seed in range(60))
    assert 10 < usable < 55  # both outcomes are tested


@pytest.mark.slow
def test_after_connecting_a_goal_means_what_it_should_over_many_seeds() -> None:
    first = random.SystemRandom().randrange(10**9)
    print(f"seeds from {first}")
    for seed in range(first, first + 2000):
        fuzz(seed)
