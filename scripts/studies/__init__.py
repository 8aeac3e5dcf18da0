"""The studies behind the tables and figures in docs/."""
