"""A user-defined controller: a small step towards the target with every frame."""

from endolock import Command, MarkerEyes, Observation, State, Status, TwinRig, run, score

STEP_RAD_PER_PX = 4e-5


class Steps:
    """Turns the handles in proportion to the error of each new frame."""

    def reset(self, state: State) -> None:
        """Start at the present handle angles."""
        self.handles = state.position

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Step towards the target in a new frame."""
        if observation is not None and observation.status is Status.TRACKING:
            u, v = observation.target_px
            up_down, left_right = self.handles
            up_down -= STEP_RAD_PER_PX * (v - 239.5)
            left_right += STEP_RAD_PER_PX * (u - 319.5)
            self.handles = up_down, left_right
        return Command(position=self.handles)


with TwinRig("circle", seed=0) as rig:
    camera = rig.camera.calibration
    result = run(rig, MarkerEyes(camera, rig.board), Steps(), duration_s=4)
    print(score(result, camera, scored_from_s=0).error_px)
