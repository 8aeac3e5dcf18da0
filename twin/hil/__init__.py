"""Hardware in the loop: the twin behind a serial line."""
