"""The twin's cameras: stage, optics, renderer, exposure, stills."""
