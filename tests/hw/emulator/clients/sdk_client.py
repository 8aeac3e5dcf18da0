"""Moves two servos with the vendor's library, dynamixel-sdk, and knows nothing of us.

Run it on a port, or on an emulated one:

    python sdk_client.py /dev/ttyUSB0
"""

# mypy: disable-error-code="import-untyped,import-not-found"

import sys
import time

from dynamixel_sdk import (
    BROADCAST_ID,
    COMM_SUCCESS,
    DXL_HIBYTE,
    DXL_HIWORD,
    DXL_LOBYTE,
    DXL_LOWORD,
    GroupBulkRead,
    GroupSyncRead,
    GroupSyncWrite,
    PacketHandler,
    PortHandler,
)

TORQUE, GOAL, POSITION, VOLTAGE, TEMPERATURE = 64, 116, 132, 144, 146
GOALS = {1: 2400, 2: 1700}

port, packets = PortHandler(sys.argv[1]), PacketHandler(2.0)
if not (port.openPort() and port.setBaudRate(1_000_000)):
    sys.exit("cannot open the port")


def sure(result: int, error: int = 0) -> None:
    """Give up on whatever goes wrong."""
    if result != COMM_SUCCESS:
        sys.exit(packets.getTxRxResult(result))
    if error:
        sys.exit(packets.getRxPacketError(error))


found, result = packets.broadcastPing(port)
sure(result)
print("on the line:", {device: tuple(answer) for device, answer in found.items()})
for device in GOALS:
    model, result, error = packets.ping(port, device)
    sure(result, error)
    sure(*packets.reboot(port, device))
    print(f"motor {device} is a {model}, and starts anew")
for device in GOALS:
    give_up = time.monotonic() + 5
    while packets.ping(port, device)[1] != COMM_SUCCESS and time.monotonic() < give_up:
        pass
    sure(*packets.write1ByteTxRx(port, device, TORQUE, 1))
refused = packets.write1ByteTxRx(port, 1, 11, 4)[1]
print("another mode, with torque on:", packets.getRxPacketError(refused))

reader, writer = GroupSyncRead(port, packets, POSITION, 4), GroupSyncWrite(port, packets, GOAL, 4)
for device, goal in GOALS.items():
    reader.addParam(device)
    low, high = DXL_LOWORD(goal), DXL_HIWORD(goal)
    data = [DXL_LOBYTE(low), DXL_HIBYTE(low), DXL_LOBYTE(high), DXL_HIBYTE(high)]
    writer.addParam(device, data)
sure(reader.txRxPacket())
print("before:", *(reader.getData(device, POSITION, 4) for device in GOALS))
sure(writer.txPacket())
give_up = time.monotonic() + 5
while time.monotonic() < give_up:
    sure(reader.txRxPacket())
    away = [abs(reader.getData(device, POSITION, 4) - goal) for device, goal in GOALS.items()]
    if max(away) <= 20:  # 2 degrees: a real motor has a load
        break
print("after:", *(reader.getData(device, POSITION, 4) for device in GOALS))
sure(reader.fastSyncRead())
print("fast:", *(reader.getData(device, POSITION, 4) for device in GOALS))

bulk = GroupBulkRead(port, packets)
bulk.addParam(1, VOLTAGE, 2)
bulk.addParam(2, TEMPERATURE, 1)
sure(bulk.txRxPacket())
volts, degrees = bulk.getData(1, VOLTAGE, 2) / 10, bulk.getData(2, TEMPERATURE, 1)
print(f"motor 1 has {volts} V, motor 2 {degrees} °C")

sure(*packets.regWriteTxRx(port, 1, GOAL, 4, [0, 8, 0, 0]))
print("registered:", packets.read4ByteTxRx(port, 1, GOAL)[0])
sure(packets.action(port, BROADCAST_ID))  # of one motor the library leaves the answer lying
print("done:", packets.read4ByteTxRx(port, 1, GOAL)[0])
for device in GOALS:
    sure(*packets.write1ByteTxRx(port, device, TORQUE, 0))
port.closePort()
