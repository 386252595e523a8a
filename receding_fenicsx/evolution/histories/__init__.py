"""Histories that depend on the condensed system: corners of harmonic ones, tightened bolts."""
