"""The control laws by name, and what can be set of each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, fields
from difflib import get_close_matches
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
from endolock.control.predictive.predictive_lock import (
    Predictive,
    PredictiveSettings,
    SinglePredictiveSettings,
)
from endolock.control.user_law import PlugIn
from endolock.hw.api import Calibration, ConfigError, Truth


class Law(NamedTuple):
    """How a law is made."""

    make: Callable[..., Controller]
    """From the calibration of the tip camera and the settings."""
    settings: type[Any]
    """What can be set: a dataclass."""


LAWS: dict[str, Law] = {
    "ik": Law(InverseKinematics, IKSettings),
    "ik_sync": Law(SynchronousIK, IKSyncSettings),
    "oracle": Law(Oracle, OracleSettings),
    "pi": Law(PI, PISettings),
    "pi_hc": Law(compensation.pi_hc, compensation.PIHCSettings),
    "pi_simc": Law(SimcPI, SimcSettings),
    "pi_simc_hc": Law(compensation.pi_simc_hc, compensation.SimcHCSettings),
    "predictive": Law(Predictive, SinglePredictiveSettings),
    "predictive_bank": Law(Predictive, PredictiveSettings),
    "repetitive": Law(Repetitive, RepetitiveSettings),
    "smith": Law(Smith, SmithSettings),
    "still": Law(Still, StillSettings),
}
"""Adding one here is all it takes."""


def check(name: str) -> None:
    """See that there is a law of that name, or a file that makes one.

    Raises:
        ConfigError: there is none.
    """
    if name.endswith(user_law.SUFFIX):
        user_law.load(name)
    elif name not in LAWS:
        near = get_close_matches(name, LAWS, 1)
        hint = f"; did you mean {near[0]}?" if near else ""
        known = ", ".join(sorted(LAWS))
        raise ConfigError(f"controller '{name}' is unknown", f"use {known} or a .py file{hint}")


def configure(
    name: str, changes: Mapping[str, Any] | None = None, known: Mapping[str, Any] | None = None
) -> Any:
    """Return the settings of a law.

    Args:
        name: one of `LAWS`.
        changes: what differs from the defaults, by name; it must fit the law.
        known: what is known of the task, by name; it is used where the law has such a setting that
            is not changed.

    Raises:
        ConfigError: a name or value cannot be used, or something that has no default is missing.
    """
    check(name)
    if name.endswith(user_law.SUFFIX):
        if changes:
            raise ConfigError(f"{name} is a law of your own", "set its parameters in the file")
        return None
    settings = LAWS[name].settings
    names = [field.name for field in fields(settings)]
    for key in changes or {}:
        if key not in names:
            near = get_close_matches(key, names, 1)
            hint = f"; did you mean law.{near[0]}?" if near else ""
            choice = f"it has {', '.join(sorted(names))}" if names else "nothing of it can be set"
            raise ConfigError(f"{name} has no law.{key}", f"{choice}{hint}")
    values = {k: v for k, v in (known or {}).items() if k in names} | dict(changes or {})
    try:
        return TypeAdapter(settings).validate_python(values)
    except ValidationError as error:
        first = error.errors()[0]
        if isinstance(told := first.get("ctx", {}).get("error"), ConfigError):
            raise told from None
        key = ".".join(str(part) for part in first["loc"]) or "settings"
        if first["type"] == "missing":
            raise ConfigError(
                f"{name} needs law.{key}", f"give it with --vary law.{key}=..."
            ) from None
        raise ConfigError(f"{name}: law.{key}: {first['msg']}, got {first['input']!r}") from None


def make(
    name: str, calibration: Calibration, settings: Any = None, truth: Truth | None = None
) -> Controller:
    """Make a law.

    Args:
        name: one of `LAWS`, or a file that makes one.
        calibration: of the tip camera.
        settings: from `configure`; the defaults if None.
        truth: of the rig; only the oracle is handed it.

    Raises:
        ConfigError: there is no such law, or the oracle is asked for where there is no truth.
    """
    if name.endswith(user_law.SUFFIX):
        return PlugIn(name, calibration)
    settings = configure(name) if settings is None else settings
    if LAWS[name].make is Oracle:
        if truth is None:
            raise ConfigError(
                "the oracle needs the truth, which only a twin has", "use another law"
            )
        return Oracle(calibration, settings, truth.now)
    return LAWS[name].make(calibration, settings)


def save(controller: Controller) -> dict[str, Any]:
    """Return all that a law of ours remembers, as plain values that JSON can hold."""
    return asdict(controller.memory)  # type: ignore[attr-defined]


def restore(controller: Controller, values: Mapping[str, Any]) -> None:
    """Let a law of ours, made with the same settings, go on where `save` was called."""
    kind = type(controller.memory)  # type: ignore[attr-defined]
    controller.memory = TypeAdapter(kind).validate_python(values)  # type: ignore[attr-defined]
