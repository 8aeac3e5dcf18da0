"""The run library: experiments, measurements, rigs by name, run folders, overrides, logs."""
