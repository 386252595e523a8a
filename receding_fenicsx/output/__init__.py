"""Everything written and drawn from a record."""
