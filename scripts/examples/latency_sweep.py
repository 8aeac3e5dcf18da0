"""The effect of latency alone: one controller, three latencies, no pictures."""

from endolock import TruthEyes, TwinRig, load_scenario, run, score
from endolock.control.laws.pi import PI

for latency_s in (0.0, 0.2, 0.4):
    loaded = load_scenario("straight", {"camera.latency_s": latency_s})
    with TwinRig(loaded, pictures=False) as rig:
        camera = rig.camera.calibration
        result = run(rig, TruthEyes(rig.truth), PI(camera), duration_s=4)
        error = score(result, camera, scored_from_s=0).error_px
        assert error is not None  # only None on a bench, which has no truth
    print(f"{latency_s:.1f} s: rms {error.rms:.1f} px, max {error.max:.1f} px")
