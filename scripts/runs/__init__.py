"""The run library: rigs by name, run folders, overrides, batches, logs."""
