"""From logs to parameters: fits, loop widths, latency, uncertainty."""
