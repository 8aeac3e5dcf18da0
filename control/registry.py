"""Registry of controllers: makes them and their settings from names."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, fields
from functools import partial
from typing import Any, NamedTuple

from pydantic import TypeAdapter, ValidationError

from endolock.control import user_law
from endolock.control.laws import hysteresis_compensation as compensation
from endolock.control.laws.ik_sync import IKSyncSettings, SynchronousIK
from endolock.control.laws.inverse_kinematics import IKSettings, InverseKinematics
from endolock.control.laws.oracle import Oracle, OracleSettings
from endolock.control.laws.pi import PI, PISettings
from endolock.control.laws.pi_simc import SimcPI, SimcSettings
from endolock.control.laws.repetitive import Repetitive, RepetitiveSettings
from endolock.control.laws.smith import Smith, SmithSettings
from endolock.control.laws.still import Still, StillSettings
from endolock.control.loop import Controller
from endolock.control.predictive.predictive_lock import Predictive
from endolock.control.predictive.predictive_settings import (
    PredictiveSettings,
    SinglePredictiveSettings,
)
from endolock.control.user_controller import UserController, caller_of
from endolock.hw.api import Calibration, ConfigError, Truth
from endolock.hw.errors import did_you_mean
from endolock.hw.files import first_problem


class Law(NamedTuple):
    """A controller in the registry."""

    make: Callable[..., Controller]
    """Makes it from the calibration of the tip camera and its settings."""
    settings: type[Any]
    """Dataclass of its settings."""
    summary: str
    """Description for help texts."""


LAWS: dict[str, Law] = {
    "still": Law(Still, StillSettings, "holds the handles: the error without control"),
    "pi": Law(PI, PISettings, "PI on the pixel error, the first of the thesis"),
    "pi_hc": Law(compensation.pi_hc, compensation.PIHCSettings, "pi with hysteresis compensation"),
    "pi_simc": Law(SimcPI, SimcSettings, "PI tuned by SIMC"),
    "pi_simc_hc": Law(
        compensation.pi_simc_hc, compensation.SimcHCSettings, "pi_simc with hysteresis compensation"
    ),
    "ik": Law(InverseKinematics, IKSettings, "inverse kinematics for an assumed distance"),
    "ik_sync": Law(SynchronousIK, IKSyncSettings, "ik on the bend at the exposure"),
    "smith": Law(Smith, SmithSettings, "PI with a Smith predictor"),
    "repetitive": Law(Repetitive, RepetitiveSettings, "learns a motion of known period"),
    "predictive": Law(Predictive, SinglePredictiveSettings, "internal model, one predictor"),
    "predictive_bank": Law(Predictive, PredictiveSettings, "internal model, a bank of predictors"),
    "oracle": Law(Oracle, OracleSettings, "uses the truth: a lower bound, not a controller"),
}
"""All controllers by name; help texts are made from this list."""


def help_text() -> str:
    """List all controllers with their descriptions, for the help of a command."""
    listed = "; ".join(f"{name} ({law.summary})" for name, law in LAWS.items())
    return f"Controller: {listed}; or a .py file that defines make(calibration)."


def check(name: str) -> None:
    """Check that a name is that of a controller, or of a file that makes one.

    Raises:
        ConfigError: it is neither.
    """
    if name.endswith(user_law.SUFFIX):
        user_law.load(name)
    elif name not in LAWS:
        hint = did_you_mean(name, LAWS)
        known = ", ".join(sorted(LAWS))
        raise ConfigError(f"controller '{name}' is unknown", f"use {known} or a .py file{hint}")


def configure(
    name: str, changes: Mapping[str, Any] | None = None, known: Mapping[str, Any] | None = None
) -> Any:
    """Return the settings of a controller.

    Args:
        name: one of `LAWS`, or a file.
        changes: values that differ from the defaults, by name.
        known: values known from the task, by name; used for settings of the same name that are
            not in `changes`.

    Returns:
        Its settings; for a file the changed parameters of its `make`, by name.

    Raises:
        ConfigError: a name or value is not valid, or a setting without a default is missing.
    """
    check(name)
    if name.endswith(user_law.SUFFIX):
        return user_law.load(name).configure(changes or {})
    settings = LAWS[name].settings
    names = [field.name for field in fields(settings)]
    for key in changes or {}:
        if key not in names:
            hint = did_you_mean(key, names, "law.")
            choice = f"it has {', '.join(sorted(names))}" if names else "it has no settings"
            raise ConfigError(f"{name} has no law.{key}", f"{choice}{hint}")
    values = {k: v for k, v in (known or {}).items() if k in names} | dict(changes or {})
    try:
        return TypeAdapter(settings).validate_python(values)
    except ValidationError as error:
        first = error.errors()[0]
        cause = first.get("ctx", {}).get("error")
        if not first["loc"] and isinstance(cause, ConfigError):  # of all settings together
            raise cause from None
        if first["type"] == "missing":
            lacks = f"law.{first['loc'][0]}"
            raise ConfigError(f"{name} needs {lacks}", f"give it with --vary {lacks}=...") from None
        what, next_step = first_problem(error, lambda _section: ["radii", "weights"])
        raise ConfigError(f"{name}: law.{what}", next_step) from None


def make(
    name: str, calibration: Calibration, settings: Any = None, truth: Truth | None = None
) -> Controller:
    """Make a controller.

    Args:
        name: one of `LAWS`, or a file that makes one.
        calibration: calibration of the tip camera.
        settings: from `configure`; the defaults if None.
        truth: truth of a simulated rig; only the oracle uses it.

    Raises:
        ConfigError: the name is unknown, or the oracle has no truth.
    """
    if name.endswith(user_law.SUFFIX):
        return user_law.load(name).make(calibration, settings or {})
    settings = configure(name) if settings is None else settings
    if LAWS[name].make is Oracle:
        if truth is None:
            raise ConfigError(
                "the oracle needs the truth, which only a simulated rig has",
                "use another controller",
            )
        return Oracle(calibration, settings, truth.now)
    return LAWS[name].make(calibration, settings)


def adopt(controller: Any, calibration: Calibration) -> Controller:
    """Wrap a controller object, or make one with a class or function, for the loop.

    Args:
        controller: an object with `reset` and `update`, or a class or function that returns one
            from the calibration.
        calibration: calibration of the tip camera.

    Raises:
        ConfigError: it lacks a method.
    """
    if isinstance(controller, type) or not hasattr(controller, "update"):
        if not callable(controller):
            raise ConfigError(
                f"controller {controller!r} has no update()",
                "give a name, a file, or an object with reset(state) and "
                "update(t, state, observation)",
            )
        make = partial(controller, calibration)
        controller = caller_of(controller).call("making it from the calibration", make)
    return UserController(controller)


def save(controller: Controller) -> dict[str, Any]:
    """Return the memory of a controller of `LAWS` as plain values for JSON.

    Raises:
        ConfigError: its memory holds more than plain values, as that of the predictive laws.
    """
    try:
        values = asdict(controller.memory)  # type: ignore[attr-defined]
        json.dumps(values)
    except TypeError:
        raise ConfigError(
            f"the memory of {type(controller).__name__} cannot be saved",
            "start it anew; it learns within seconds",
        ) from None
    return values


def restore(controller: Controller, values: Mapping[str, Any]) -> None:
    """Restore a memory from `save` into a controller with the same settings."""
    kind = type(controller.memory)  # type: ignore[attr-defined]
    controller.memory = TypeAdapter(kind).validate_python(values)  # type: ignore[attr-defined]
