"""Cameras of a bench: devices, recordings, calibration files, picture streams."""
