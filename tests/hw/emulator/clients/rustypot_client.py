"""Moves two servos with rustypot, and knows nothing of us.

Run it on a port, or on an emulated one:

    python rustypot_client.py /dev/ttyUSB0
"""

# mypy: disable-error-code="import-untyped,import-not-found"

import sys
import time

from rustypot import Xl330PyController  # in radians; torque, goal and position of all X servos

IDS, GOALS_RAD = [1, 2], [0.5, -0.6]

bus = Xl330PyController(sys.argv[1], 1_000_000, 0.2)
print("on the line:", bus.broadcast_scan())
for device in IDS:
    bus.reboot(device)
give_up = time.monotonic() + 5
while not all(bus.ping(device) for device in IDS) and time.monotonic() < give_up:
    pass
bus.sync_write_torque_enable(IDS, [True, True])
print("torque:", bus.sync_read_torque_enable(IDS))
print("before:", *bus.sync_read_present_position(IDS))
bus.sync_write_goal_position(IDS, GOALS_RAD)
give_up = time.monotonic() + 5
while time.monotonic() < give_up:
    angles = bus.sync_read_present_position(IDS)
    if max(abs(angle - goal) for angle, goal in zip(angles, GOALS_RAD, strict=True)) < 0.03:
        break
print("after:", *bus.sync_read_present_position(IDS))
bus.set_fast_sync_read(True)
print("fast:", *bus.sync_read_present_position(IDS))
bus.set_fast_sync_read(False)
print("errors:", [error for _, error in bus.sync_read_raw_data_with_error(IDS, 132, 4)])
bus.sync_write_torque_enable(IDS, [False, False])
bus.close()
