"""The runs, measures, statements and figures of the thesis' chapter 6, repeated."""
