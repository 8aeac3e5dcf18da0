"""Figures and recordings drawn from runs and boards."""
