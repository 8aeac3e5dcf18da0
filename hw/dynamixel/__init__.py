"""The servo bus: packets, registers, ports, and the drive of two handles."""
