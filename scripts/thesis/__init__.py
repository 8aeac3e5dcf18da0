"""Chapter 6 of the thesis again: runs, measures, statements and figures."""
