"""The section's geometry against closed forms, and the committed files against their builders."""

from math import cos, sin

import cv2
import mujoco
import numpy as np
import pytest

from endolock.hw import boards
from endolock.hw.api import ConfigError
from endolock.twin.model import generate, scene, section
from endolock.twin.world.instrument import WIRES, Instrument, Numerics

SIDE = {"up": ("up_down", -1), "right": ("left_right", -1), "down": ("up_down", 1)}
SIDE["left"] = ("left_right", 1)
"""The axis in whose plane a wire lies, and the sign with which its bend lengthens the wire."""


@pytest.mark.parametrize("hinges", [2, 10, 12, 16])
def test_wire_lengths_follow_the_closed_form(hinges: int) -> None:
    instrument = Instrument()
    model = section.build(instrument, Numerics(hinges=hinges)).compile()
    data = mujoco.MjData(model)
    angles = np.random.default_rng(hinges).uniform(-0.4, 0.4, hinges)
    names = [model.joint(j).name for j in range(model.njnt) if "hinge_" in model.joint(j).name]
    for name, q in zip(names, angles, strict=True):
        data.joint(name).qpos = q
    mujoco.mj_forward(model, data)
    h, r = instrument.bending_length_m / hinges, instrument.wire_radius_m
    for wire in WIRES:
        axis, sign = SIDE[wire]
        expected = -section.NODE_X_M + sum(
            h * cos(q / 2) + (sign * 2 * r * sin(q / 2) if axis in name else 0.0)
            for name, q in zip(names, angles, strict=True)
        )
        length = data.tendon(f"wire_{wire}").length[0]
        assert length == pytest.approx(expected, abs=1e-12)  # double rounding of a 0.1 m sum


def test_a_wire_cannot_push() -> None:
    model = section.build().compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for wire in WIRES:
        data.joint(f"slide_{wire}_1").qpos = -0.01  # slack, in spite of the pretension
    data.joint("handle_up_down").qpos = 0.0
    mujoco.mj_forward(model, data)
    distal = [model.tendon(f"wire_{wire}").id for wire in WIRES]
    hinge_dofs = [j for j in range(model.njnt) if "hinge_" in model.joint(j).name]
    assert all(data.ten_length[i] < model.tendon_lengthspring[i, 1] for i in distal)
    assert not data.qfrc_spring[hinge_dofs].any()


def test_the_committed_files_are_those_of_the_builders() -> None:
    place = generate.folder()
    assert (place / "section.xml").read_text() == generate.section_xml()
    assert (place / "scene.xml").read_text() == generate.scene_xml()
    for name, image in scene.pictures(boards.all_boards()["rings"]).items():
        picture = cv2.imread(str(place / scene.TEXTURES[name]))
        assert picture is not None
        assert np.array_equal(picture, cv2.cvtColor(image, cv2.COLOR_RGB2BGR))


def test_the_committed_scene_is_the_twin() -> None:
    committed = mujoco.MjModel.from_xml_path(str(generate.folder() / "scene.xml"))
    built = scene.build().compile()
    for field in ("nq", "nv", "nu", "ntendon", "nbody", "ngeom", "nsite", "ncam", "nlight"):
        assert getattr(committed, field) == getattr(built, field)
    for field in [
        "body_pos",
        "body_quat",
        "body_mass",
        "body_inertia",
        "jnt_axis",
        "jnt_range",
        "jnt_stiffness",
        "dof_damping",
        "dof_armature",
        "dof_frictionloss",
        "dof_solimp",
        "dof_solref",
        "site_pos",
        "cam_pos",
        "cam_quat",
        "cam_fovy",
        "tendon_stiffness",
        "tendon_damping",
        "tendon_lengthspring",
        "actuator_gainprm",
        "actuator_biasprm",
        "actuator_forcerange",
        "actuator_ctrlrange",
        "geom_pos",
        "geom_size",
        "mesh_vert",
        "mesh_texcoord",
        "tex_data",
        "light_pos",
        "light_dir",
        "key_qpos",
    ]:
        assert np.array_equal(getattr(committed, field), getattr(built, field)), field


def test_lines_of_the_files_are_not_too_long() -> None:
    for file in generate.folder().glob("*.xml"):
        assert max(len(line) for line in file.read_text().splitlines()) <= generate.COLUMNS


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"conduit_friction": -0.1}, "instrument: conduit_friction: got -0.1, wanted 0 to 2; give"),
        ({"wire_stiffness": 0.0}, "wire_stiffness: got 0 N/m, wanted 1 to 5000000 N/m; give a"),
        ({"wire_stiffness": 1e12}, "got 1e.12 N/m, wanted 1 to 5000000 N/m"),
        ({"tip_mass_kg": float("nan")}, "tip_mass_kg: should be a finite number, got nan"),
        (
            {"tip_mass_kg": 1e6},
            "tip_mass_kg: got 1000000 kg, wanted 1e-06 to 0.5 kg; give .* in kg",
        ),
        ({"slack_m": float("inf")}, "slack_m: should be a finite number, got inf"),
        ({"slack_m": -1e9}, "slack_m: got -1000000000 m, wanted -0.05 to 0.05 m"),
        ({"bending_length_m": 75}, "bending_length_m: got 75 m, wanted 0.005 to 0.5 m"),
        ({"bending_length_m": True}, "bending_length_m: should be a valid number, got true"),
        ({"handle_kp": 1e9}, "handle_kp: got 1000000000 N m/rad, wanted 0.01 to 10000 N m/rad"),
        ({"handle_kp": "20"}, "handle_kp: should be a valid number, got '20'"),
        ({"misalignment_rad": 10.0}, "misalignment_rad: got 10 rad, wanted -3.14159"),
        ({"damping_time_s": 0.02}, "damping_time_s: got 0.02 s, .*; a longer one would delay the"),
        (
            {"slack_m": -0.05, "wire_stiffness": 1e6},
            "a pretension of 5e.04 N .*, wanted 0 to 2000 N",
        ),
        ({"conduit_friction": 2.0, "residual_wrap_rad": 20.0}, "the wrap angle is 40 with"),
        ({"speed_step_rad_s": 1e-5}, "handle_speed_rad_s 3.49 is more than 30000 steps of 1e-05"),
        ({"wire_radius_m": 0.005}, "wire_radius_m 0.005 does not fit into an outer diameter"),
    ],
)
def test_impossible_instruments_are_refused(change: dict[str, float], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        Instrument(**change)


@pytest.mark.parametrize(
    ("hinges", "timestep_s", "message"),
    [
        (11, 0.002, "11 hinges; use an even number"),
        (12, 0.003, "timestep 0.003 s; use 0.010 s divided by a whole number"),
        (12, 0.0, "timestep_s: got 0 s, wanted 1e-05 to 0.01 s; use 0.010 s divided by a whole"),
        (0, 0.002, "hinges: got 0, wanted 2 to 100"),
        (12.0, 0.002, "hinges: should be a valid integer, got 12.0"),
    ],
)
def test_impossible_numerics_are_refused(hinges: int, timestep_s: float, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        Numerics(hinges=hinges, timestep_s=timestep_s)


@pytest.mark.parametrize("nodes", [0, 9])
def test_an_impossible_number_of_nodes_is_refused(nodes: int) -> None:
    with pytest.raises(ConfigError, match=f"numerics: nodes: got {nodes}, wanted 1 to 8"):
        Numerics(nodes=nodes)
