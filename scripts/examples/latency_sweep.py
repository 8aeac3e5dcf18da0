"""How much the latency alone costs: one controller, three latencies, no pictures."""

from endolock.control.laws.pi import PI
from endolock.control.loop import run
from endolock.control.metrics import score
from endolock.twin.rig import TwinRig
from endolock.twin.world import scenario
from endolock.vision.truth_eyes import TruthEyes

for latency_s in (0.0, 0.2, 0.4):
    loaded = scenario.load("straight", {"camera.latency_s": latency_s})
    with TwinRig(loaded, pictures=False) as rig:
        camera = rig.camera.calibration
        result = run(rig, TruthEyes(rig.truth), PI(camera), duration_s=4)
        error = score(result, camera, scored_from_s=0).error_px
        assert error is not None  # it is on a bench, which knows no truth
    print(f"{latency_s:.1f} s: rms {error.rms:.1f} px, max {error.max:.1f} px")
