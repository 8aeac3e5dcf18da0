"""From handle to tip: cable, plays, quasi-static axis, kinematics."""
