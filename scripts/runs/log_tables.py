"""The tables of a run folder: their columns, and how ticks and frames become rows."""

from __future__ import annotations

from math import isfinite, sqrt
from typing import Any

import cv2
import numpy as np
import pyarrow as pa

from endolock.control.loop import Seen, Tick
from endolock.hw.api import ConfigError, Image, Plant, Pose, TruthSample
from endolock.vision.observation import Turn

JPEG_QUALITY = 75


def _vector(n: int) -> pa.DataType:
    """Type of a list of N numbers; a pose is a position and a quaternion."""
    return pa.list_(pa.float64(), n)


TICKS = pa.schema(
    [
        ("t", pa.float64()),
        ("skipped", pa.int32()),
        ("command_rad", _vector(2)),
        ("state_t", pa.float64()),
        ("position_rad", _vector(2)),
        ("velocity_rad_s", _vector(2)),
        ("current_a", _vector(2)),
        ("target_rad", _vector(2)),
        ("clipped", pa.list_(pa.int8(), 2)),
        ("fresh", pa.bool_()),
        ("mode", pa.string()),
        ("device_tick", pa.int64()),
        ("status", pa.string()),
        ("signals", pa.map_(pa.string(), pa.float64())),  # internal values of the controller
        # Of the pose tracker; null without one.
        ("tracked_t", pa.float64()),
        ("tracked_pose", _vector(7)),
        # The truth at the tick; null on hardware.
        ("target_px", _vector(2)),
        ("in_picture", pa.bool_()),
        ("distance_m", pa.float64()),
        ("error_deg", pa.float64()),
        ("bend_rad", _vector(2)),
        ("tension_handle_n", _vector(4)),
        ("tension_section_n", _vector(4)),
    ]
)
FRAMES = pa.schema(
    [
        ("seq", pa.int64()),
        ("t_capture", pa.float64()),
        ("t_available", pa.float64()),
        ("dropped", pa.int32()),
        ("repeated", pa.bool_()),
        ("status", pa.string()),
        ("why", pa.string()),
        ("target_px", _vector(2)),
        ("covariance_px2", _vector(3)),
        ("distance_m", pa.float64()),
        # Target position from the markers where vision tracks without them; else null.
        ("reference_px", _vector(2)),
        ("corners_px", pa.list_(_vector(2))),
        # Rotation of the camera since an earlier frame, with the standard deviations of its parts;
        # null without.
        ("turn_since_s", pa.float64()),
        ("turn_rad", _vector(3)),
        ("turn_std_rad", _vector(3)),
        # The truth at the exposure; null on hardware.
        ("true_t", pa.float64()),
        ("true_target_px", _vector(2)),
        ("true_distance_m", pa.float64()),
        ("tip_pose", _vector(7)),
        ("board_pose", _vector(7)),
        ("backbone_m", pa.list_(_vector(3))),
        ("tip_jpeg", pa.binary()),
        ("overview_jpeg", pa.binary()),
    ]
)

LATER = frozenset({"turn_since_s", "turn_rad", "turn_std_rad"})
"""Columns that earlier versions did not write; read from their tables, they are null."""


def forms(schema: pa.Schema) -> tuple[pa.Schema, ...]:
    """Return the columns of a table in this version and, where they differ, in earlier ones."""
    earlier = pa.schema([field for field in schema if field.name not in LATER])
    return (schema,) if earlier.equals(schema) else (schema, earlier)


def completed(batch: pa.RecordBatch, schema: pa.Schema) -> pa.RecordBatch:
    """Return rows with all columns of a table, those of `LATER` null where they are missing."""
    if batch.schema.equals(schema):
        return batch
    columns = [
        batch.column(field.name)
        if field.name in batch.schema.names
        else pa.nulls(len(batch), field.type)
        for field in schema
    ]
    return pa.RecordBatch.from_arrays(columns, schema=schema)


def tick_row(tick: Tick) -> dict[str, Any]:
    """Return the row of one control period."""
    s = tick.state
    row: dict[str, Any] = {
        "t": tick.t,
        "skipped": tick.skipped,
        "command_rad": tick.command.position if tick.command else None,
        "state_t": s.t,
        "position_rad": s.position,
        "velocity_rad_s": s.velocity,
        "current_a": s.current,
        "target_rad": s.goal,
        "clipped": s.clipped,
        "fresh": s.fresh,
        "mode": s.mode,
        "device_tick": s.device_tick,
        "status": tick.status,
        "signals": list(tick.signals.items()),
    }
    if tick.tracked:
        row |= {"tracked_t": tick.tracked.t, "tracked_pose": _pose(tick.tracked)}
    if tick.truth:
        row |= _truth_of_tick(tick.truth, tick.truth.plant)
    return row


def frame_row(seen: Seen) -> dict[str, Any]:
    """Return the row of one frame, with its pictures as JPEG."""
    frame, observation, truth = seen.frame, seen.observation, seen.truth
    has_reference = isfinite(observation.reference_px[0])
    row: dict[str, Any] = {
        "seq": frame.seq,
        "t_capture": frame.t_capture,
        "t_available": frame.t_available,
        "dropped": frame.dropped,
        "repeated": frame.repeated,
        "status": observation.status,
        "why": observation.why,
        "target_px": observation.target_px,
        "covariance_px2": observation.covariance,
        "distance_m": observation.distance_m,
        "reference_px": observation.reference_px if has_reference else None,
        "corners_px": observation.corners_px,
        **_turn(observation.turn),
        "tip_jpeg": jpeg(frame.image),
        "overview_jpeg": jpeg(seen.overview.image) if seen.overview else None,
    }
    if truth:
        row |= {
            "true_t": truth.t,
            "true_target_px": truth.target_px,
            "true_distance_m": truth.distance_m,
            "tip_pose": _pose(truth.plant.tip),
            "board_pose": _pose(truth.plant.board),
            "backbone_m": list(truth.plant.backbone),
        }
    return row


def _turn(turn: Turn | None) -> dict[str, Any]:
    if turn is None:
        return dict.fromkeys(LATER)
    std = tuple(sqrt(turn.covariance[n][n]) for n in range(3))
    return {"turn_since_s": turn.since_s, "turn_rad": turn.vector, "turn_std_rad": std}


def jpeg(image: Image | None) -> bytes | None:
    """Encode an RGB picture."""
    if image is None:
        return None
    bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    done, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    if not done:
        raise RuntimeError(f"OpenCV could not encode a picture of {image.shape}")
    return bytes(data)


def decode(data: bytes) -> Image:
    """Decode a JPEG to RGB."""
    bgr = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    if bgr is None:
        raise ConfigError("a picture in the run folder is not a JPEG", "the folder is damaged")
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8)


def _truth_of_tick(truth: TruthSample, plant: Plant) -> dict[str, Any]:
    return {
        "target_px": truth.target_px,
        "in_picture": truth.in_picture,
        "distance_m": truth.distance_m,
        "error_deg": truth.error_deg,
        "bend_rad": plant.bend_rad,
        "tension_handle_n": plant.tension_handle_n,
        "tension_section_n": plant.tension_section_n,
    }


def _pose(pose: Pose) -> tuple[float, ...]:
    return (*pose.position, *pose.quaternion)
