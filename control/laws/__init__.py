"""The simple control laws, one file each."""
