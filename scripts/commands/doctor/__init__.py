"""`endolock doctor`: checks of the installation and of a bench."""
