"""Colours of all figures."""

from __future__ import annotations

BLUE, ORANGE, GREEN = "#3b6fb6", "#d1622b", "#3a8a4d"
VIOLET, OCHRE, DARK_GREY = "#8a4fa3", "#8c6d31", "#4d4d4d"
SERIES = (BLUE, ORANGE, GREEN, VIOLET, OCHRE, DARK_GREY)
"""Curves of a plot, in this order."""
LIGHT_BLUE, LIGHT_ORANGE = "#9ab6dc", "#edb598"
GREY = "#9a9a9a"
BAND = "#f1e3b8"
"""A range of values behind the curves."""

RGB_GREEN, RGB_RED, RGB_BLUE = (80, 200, 120), (230, 80, 80), (70, 130, 235)
RGB_ORANGE, RGB_GREY, RGB_YELLOW = (240, 160, 50), (150, 150, 150), (255, 220, 40)
"""Lines over pictures, and everything in the Rerun viewer, whose background is dark."""
RGB_INK, RGB_PAPER = (30, 30, 34), (245, 245, 245)
"""Text below a picture, and its background."""
