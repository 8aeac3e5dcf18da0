"""Turn one handle back and forth and print how the tip lags: the loop without a controller."""

from math import degrees, pi, sin

from endolock import Command, TwinRig

with TwinRig("rest", pictures=False) as rig:
    rig.actuators.enable()
    for tick in range(250):
        t = 0.02 * tick
        rig.clock.sleep_until(t)
        state = rig.actuators.exchange(Command(position=(0.8 * sin(2 * pi * t / 4), 0.0)))
        if tick % 25 == 0:
            bend = rig.truth.now().plant.bend_rad[0]
            print(f"handle {degrees(state.position[0]):6.1f} deg   tip {degrees(bend):6.1f} deg")
