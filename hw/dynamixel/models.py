"""Servos that can drive a handle, each with its own units, and servos that cannot.

All of the first have the addresses of `registers`, and measure their current.

Reference:
    ROBOTIS e-Manual, control table of each model: model number, unit and initial value of
    CURRENT LIMIT, initial value of POSITION P. XH430-V350 and XH430-V210 count their current in
    1.34 mA, all others here in 2.69 mA. The XD series has the control tables of the XH series.
"""

from __future__ import annotations

from dataclasses import dataclass

from endolock.hw.dynamixel.registers import OLDEST_FIRMWARE, Units

COARSE_A, FINE_A = 2.69e-3, 1.34e-3
"""Units of current [A]. Source: e-Manual."""


@dataclass(frozen=True, kw_only=True)
class Model:
    """One model."""

    number: int
    """As it answers to a ping."""
    name: str
    units: Units
    """Units of its registers."""
    current_limit: int
    """Its CURRENT LIMIT as sold, also the largest that it accepts [counts]."""
    position_p: int
    """Its POSITION P as sold; POSITION I, POSITION D and both feedforward gains are 0."""
    oldest_firmware: int = OLDEST_FIRMWARE
    """First usable firmware."""


def _model(
    number: int, name: str, current_limit: int, position_p: int = 800, current_a: float = COARSE_A
) -> Model:
    return Model(
        number=number,
        name=name,
        units=Units(current_a=current_a),
        current_limit=current_limit,
        position_p=position_p,
    )


MODELS: dict[int, Model] = {
    model.number: model
    for model in (
        _model(1000, "XH430-W350", 648, 900),
        _model(1001, "XD430-T350", 648, 900),
        _model(1010, "XH430-W210", 648, 900),
        _model(1011, "XD430-T210", 648, 900),
        _model(1020, "XM430-W350", 1193),
        _model(1030, "XM430-W210", 1193),
        _model(1040, "XH430-V350", 689, current_a=FINE_A),
        _model(1050, "XH430-V210", 689, current_a=FINE_A),
        _model(1100, "XH540-W270", 2047),
        _model(1101, "XD540-T270", 2047),
        _model(1110, "XH540-W150", 2047),
        _model(1111, "XD540-T150", 2047),
        _model(1120, "XM540-W270", 2047),
        _model(1130, "XM540-W150", 2047),
        _model(1140, "XH540-V270", 1188),
        _model(1150, "XH540-V150", 1188),
        _model(1170, "XW540-T260", 2047),
        _model(1180, "XW540-T140", 2047),
        _model(1270, "XW430-T333", 2047, 900),
        _model(1280, "XW430-T200", 2047, 900),
        _model(1310, "XW540-H260", 1188),
    )
}
"""By number."""
XM430_W350 = MODELS[1020]
"""The model of the examples."""

_LOAD = "it measures a load in 0.1 % instead of a current"
_SMALL = "its indirect data are elsewhere, and its current is in 1 mA"
UNFIT: dict[int, tuple[str, str]] = {
    **{1060: ("XL430-W250", _LOAD), 1070: ("XC430-W150", _LOAD), 1080: ("XC430-W240", _LOAD)},
    **{1090: ("2XL430-W250", _LOAD), 1160: ("2XC430-W250", _LOAD)},
    **{1190: ("XL330-M077", _SMALL), 1200: ("XL330-M288", _SMALL)},
    **{1210: ("XC330-T181", _SMALL), 1220: ("XC330-T288", _SMALL)},
    **{1230: ("XC330-M181", _SMALL), 1240: ("XC330-M288", _SMALL)},
}
"""Name, and why it cannot drive a handle, by number."""
FIT = "use X series of the size 430 or 540 that measure their current, such as XM430-W350"
"""What to do about a model without an entry in `MODELS`."""


def described(number: int) -> str:
    """Return the name of a model; of one that cannot be used, also why."""
    if number in MODELS:
        return MODELS[number].name
    name, why = UNFIT.get(number, (f"model {number}", "its registers are not known here"))
    return f"{name}: {why}"
