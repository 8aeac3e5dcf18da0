"""The sub-commands of `endolock`, one file each."""
