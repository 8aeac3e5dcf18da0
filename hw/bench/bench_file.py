"""A bench as a TOML file: handles, line, camera and board.

baud = 1000000
board = "rings"
[handle.up_down]            # see hw/dynamixel/handle.py
id = 1
direction = -1
zero_counts = 2071
[camera]
source = "/dev/video0"
calibration = "camera.toml"
latency_s = 0.38            # from endolock latency
"""

from __future__ import annotations

from math import pi
from pathlib import Path
from typing import Annotated, Any, Self

import tomli_w
from pydantic import BaseModel, ValidationError, field_validator, model_validator

from endolock.hw import boards, files
from endolock.hw.api import AXES, Calibration, ConfigError
from endolock.hw.camera import camera_file
from endolock.hw.camera.video_camera import TIMEOUT_S
from endolock.hw.dynamixel.handle import Handle
from endolock.hw.dynamixel.port import DEFAULT_BAUD
from endolock.hw.dynamixel.registers import BAUDS
from endolock.hw.strict import AnyPath, Strict, bounded, shown

DEFAULT_FILE = Path("bench.toml")
"""The bench file used where none is given, if it exists."""


class BenchCamera(Strict):
    """The camera at the tip and its video chain."""

    source: int | str = 0
    """Number or path of a video device, address of a stream, or a video file."""
    calibration: AnyPath | None = None
    """From `endolock calibrate`; relative to the folder of the bench file. None: a pinhole of
    640x480 px with f = 262 px, assumed."""
    latency_s: Annotated[float, bounded(0, 10, "s", hint="give seconds, not milliseconds")] = 0.4
    """Exposure to delivery [s], from `endolock latency`. Source of the default: the loop latency in
    thesis ch. 7; all of it in the video chain: assumed."""
    frame_rate_hz: Annotated[float, bounded(0.1, 1000, "Hz")] | None = None
    """Requested from the device [Hz]; None: its default."""
    video_timeout_s: Annotated[float, bounded(2, 600, "s")] = TIMEOUT_S
    """A run ends if no picture comes for this time [s]. The handles hold from 2 s on, and go on if
    pictures come again."""

    @field_validator("source", mode="before")
    @classmethod
    def _named(cls, value: Any) -> Any:
        if isinstance(value, str):
            good = bool(value) and value.isprintable()
        else:
            good = isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 100
        if good:
            return value
        raise ConfigError(
            f"got {shown(value)}",
            "give the number (0 to 99) or path of a video device, the address of a stream, or a "
            "video file",
        )

    @field_validator("calibration", mode="before")
    @classmethod
    def _file(cls, value: Any) -> Any:
        if value is None or isinstance(value, Path) or (isinstance(value, str) and value):
            return value
        raise ConfigError(f"got {shown(value)}", 'give a file in quotes, such as "camera.toml"')

    def geometry(self) -> Calibration:
        """Return the camera's geometry.

        Raises:
            ConfigError: the calibration cannot be read.
        """
        if self.calibration is None:
            return Calibration(width=640, height=480, focal_px=262.0, centre_px=(319.5, 239.5))
        return camera_file.read(self.calibration)


class Handles(Strict):
    """Both handles."""

    up_down: Handle = Handle(id=1)
    left_right: Handle = Handle(id=2)


class Bench(Strict):
    """A bench; the defaults fit two motors set up by `endolock doctor`."""

    baud: int = DEFAULT_BAUD
    """Baud rate of the bus [1/s], at least 57600: at 9600 a cycle takes longer than `max_age_s`."""
    board: str = "rings"
    """The printed board in front of the camera."""
    handle: Handles = Handles()
    camera: BenchCamera = BenchCamera()

    @field_validator("baud")
    @classmethod
    def _known_baud(cls, value: int) -> int:
        if value not in BAUDS[1:]:
            raise ConfigError(f"baud is {value}", f"use {', '.join(map(str, BAUDS[1:]))}")
        return value

    @field_validator("board")
    @classmethod
    def _known_board(cls, value: str) -> str:
        if value not in boards.all_boards():
            raise ConfigError(f"board is '{value}'", f"use {', '.join(boards.all_boards())}")
        return value

    @model_validator(mode="after")
    def _usable(self) -> Self:
        first, second = (handle.id for handle in self.handles.values())
        if first == second:
            raise ConfigError(f"both handles have motor {first}", "give each its own id")
        for axis, handle in self.handles.items():
            reach = handle.ratio * max(map(abs, handle.range_rad))
            if reach > pi:
                raise ConfigError(
                    f"handle.{axis} may turn its motor by {reach:.2f} rad, but after a start "
                    "a motor knows its position only within half a turn in either direction",
                    "use a smaller range_rad",
                )
        return self

    @property
    def handles(self) -> dict[str, Handle]:
        """The handle of each axis."""
        return {axis: getattr(self.handle, axis) for axis in AXES}


def load(path: Path | None = None) -> Bench:
    """Read a bench.

    Args:
        path: the file; None: bench.toml in this folder, or the defaults where there is none.

    Raises:
        ConfigError: it cannot be read, or has unusable values.
    """
    if path is None:
        if not DEFAULT_FILE.exists():
            return Bench()
        path = DEFAULT_FILE
    values = files.read_toml(path, "bench", "write one with endolock doctor --port PORT --set-up")
    try:
        bench = Bench.model_validate(values)
    except ValidationError as error:
        what, next_step = files.first_problem(error, _keys)
        raise ConfigError(f"bench {path}: {what}", next_step) from None
    camera = bench.camera
    if camera.calibration is None:
        return bench
    camera = camera.model_copy(update={"calibration": path.parent / camera.calibration})
    return bench.model_copy(update={"camera": camera})


def save(bench: Bench, path: Path) -> None:
    """Write a bench, whole or not at all.

    Raises:
        ConfigError: it cannot be written.
    """
    text = tomli_w.dumps(bench.model_dump(mode="json", exclude_none=True))
    files.write_whole(path, text, "give another folder")


def _keys(section: tuple[str, ...]) -> list[str]:
    """List the keys allowed in a section."""
    model: type[BaseModel] = Bench
    for part in section:
        kind = model.model_fields[part].annotation if part in model.model_fields else None
        model = kind if isinstance(kind, type) and issubclass(kind, BaseModel) else model
    return list(model.model_fields)
