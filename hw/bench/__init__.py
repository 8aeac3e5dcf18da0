"""The laboratory bench: its file, its clock, and the rig made of both."""
