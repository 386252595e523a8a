"""Evolution of a condensed contact along a load history into a record."""
