"""What a run is made of: scenario, motion, playback and instrument."""
