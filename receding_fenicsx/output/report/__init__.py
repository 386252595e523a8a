"""Summary, tables and report of a run."""
