"""Checks of the twin against closed forms, and of its behaviour."""
