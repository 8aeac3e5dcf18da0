"""Builds the MuJoCo model: section, wires, scene and textures."""
