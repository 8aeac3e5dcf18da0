"""`endolock doctor`: does everything work here."""
