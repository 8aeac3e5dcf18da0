"""Emulated servos: their behaviour, their bus, its serial line and its faults."""
